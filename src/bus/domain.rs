//! Domains: they isolate runs on one machine.

use super::BusError;
use crate::words::is_name;
use iceoryx2::prelude::{Config, FileName, Path as IoxPath, SemanticString};
use std::fs::Metadata;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Longest file name that iceoryx2 appends to root path and prefix for a socket: a decimal and
/// `.event`. The decimal is a count of the process's ports times 2^96 plus time and process: 33
/// digits suffice for 12 000 ports, and sockets are created among the first.
const SOCKET_NAME_LEN: usize = 33 + ".event".len();
/// Linux stores a socket's path in 108 bytes, including the final zero.
const SOCKET_PATH_MAX: usize = 107;

/// Environment variable with the directory of the user's sockets and locks.
const RUNTIME_DIR: &str = "XDG_RUNTIME_DIR";

/// Checks the name of a domain or a robot: see [`is_name`].
pub(super) fn check_name(what: &'static str, name: &str) -> Result<(), BusError> {
    match is_name(name) {
        true => Ok(()),
        false => Err(BusError::Name {
            what,
            name: name.into(),
        }),
    }
}

/// A set of shared-memory topics separate from all others on this machine.
///
/// Its files, locks and sockets live in [`root`](Self::root), its shared memory under
/// [`prefix`](Self::prefix) in /dev/shm. Both follow from the name and the user alone, so programs
/// in any language find each other, and users are isolated. No configuration file of iceoryx2 is
/// used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    name: String,
    root: PathBuf,
    prefix: String,
    limits: Limits,
}

/// Capacities of a topic. The program that creates a topic decides; all others use it as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Samples by which a consumer may lag in real time before it loses the oldest.
    pub sample_buffer: usize,
    /// Subscribers of samples.
    pub sample_subscribers: usize,
    /// Subscribers of estimates, and as many of status, journal and description.
    pub estimate_subscribers: usize,
    /// Programs that have a topic open.
    pub programs: usize,
}

impl Default for Limits {
    /// 4 s at 1 kHz, 16 and 32 subscribers, 64 programs.
    fn default() -> Self {
        Self {
            sample_buffer: 4096,
            sample_subscribers: 16,
            estimate_subscribers: 32,
            programs: 64,
        }
    }
}

impl Domain {
    /// The domain called `name`, below `$XDG_RUNTIME_DIR` if that is set and below /tmp
    /// otherwise.
    ///
    /// # Errors
    /// If the name is not `[a-z0-9_-]{1,32}`, the paths of its sockets would exceed 107 bytes, or
    /// `$XDG_RUNTIME_DIR` is relative.
    pub fn new(name: &str) -> Result<Self, BusError> {
        let runtime_dir = std::env::var_os(RUNTIME_DIR).filter(|dir| !dir.is_empty());
        Self::below(name, runtime_dir.as_deref().map(Path::new))
    }

    fn below(name: &str, runtime_dir: Option<&Path>) -> Result<Self, BusError> {
        check_name("domain", name)?;
        // Programs with other working directories would not find each other.
        if let Some(dir) = runtime_dir.filter(|dir| dir.is_relative()) {
            return Err(BusError::RelativeRuntimeDir { dir: dir.to_owned() });
        }
        let root = match runtime_dir {
            Some(dir) => dir.join(format!("thetabus-{name}")),
            None => PathBuf::from(format!("/tmp/thetabus-{}-{name}", nix::unistd::geteuid())),
        };
        let prefix = format!("thetabus_{}_{name}_", nix::unistd::geteuid());
        let len = root.as_os_str().len() + 1 + prefix.len() + SOCKET_NAME_LEN;
        if len > SOCKET_PATH_MAX {
            // Both paths contain the name.
            let shorten = (len - SOCKET_PATH_MAX).div_ceil(2);
            return Err(BusError::SocketPath {
                domain: name.into(),
                root,
                len,
                max: SOCKET_PATH_MAX,
                longest: name.len().saturating_sub(shorten),
            });
        }
        Ok(Self {
            name: name.into(),
            root,
            prefix,
            limits: Limits::default(),
        })
    }

    /// The domains of this user that have a directory, below $XDG_RUNTIME_DIR or /tmp.
    pub(super) fn roots() -> Vec<Self> {
        let runtime_dir = std::env::var_os(RUNTIME_DIR).filter(|dir| !dir.is_empty());
        let own = format!("thetabus-{}-", nix::unistd::geteuid());
        let places = [
            runtime_dir
                .as_deref()
                .map(|dir| (Path::new(dir), "thetabus-", Some(Path::new(dir)))),
            Some((Path::new("/tmp"), own.as_str(), None)),
        ];
        let mut domains = Vec::new();
        for (place, beginning, runtime_dir) in places.into_iter().flatten() {
            for entry in std::fs::read_dir(place).into_iter().flatten().flatten() {
                let name = entry.file_name();
                let name = name.to_str().and_then(|name| name.strip_prefix(beginning));
                if let Some(domain) = name.and_then(|name| Self::below(name, runtime_dir).ok())
                    && domain.is_own_directory()
                {
                    domains.push(domain);
                }
            }
        }
        domains
    }

    fn is_own_directory(&self) -> bool {
        let uid = nix::unistd::geteuid().as_raw();
        std::fs::symlink_metadata(&self.root).is_ok_and(|found| found.is_dir() && found.uid() == uid)
    }

    /// A warning if `$XDG_RUNTIME_DIR` is set to nothing, which means /tmp, while programs for
    /// which it is right look elsewhere, or if it is relative, so that no program starts.
    pub fn warning() -> Option<String> {
        let dir = PathBuf::from(std::env::var_os(RUNTIME_DIR)?);
        if dir.as_os_str().is_empty() {
            return Some(format!(
                "${RUNTIME_DIR} is empty, so domains are below /tmp; programs for which it names a directory, such as /run/user/{}, do \
                 not find this one",
                nix::unistd::geteuid()
            ));
        }
        dir.is_relative()
            .then(|| BusError::RelativeRuntimeDir { dir }.to_string())
    }

    /// The same with other limits for the topics that this program creates.
    #[must_use]
    pub fn with_limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// The limits of topics that this program creates.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Directory of its files, locks and sockets.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Prefix of the names of its shared-memory objects: `thetabus_<user number>_<name>_`.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Configuration with which iceoryx2's own programs, such as `iox2`, see this domain: TOML for
    /// `config/iceoryx2.toml` below the directory in which they are started.
    pub fn iceoryx2_toml(&self) -> String {
        // TOML strings escape the same characters as Rust strings; names of domains have none of
        // them.
        format!(
            "[global]\nroot-path = {:?}\nprefix = {:?}\n",
            self.root.display().to_string(),
            self.prefix
        )
    }

    /// Creates the root directory, for this user only; refuses one that others own or may enter.
    pub(super) fn create_root(&self) -> Result<(), BusError> {
        let created = std::fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&self.root);
        // In /tmp anybody may have created a directory or a link here first; reporting that says
        // more than the failure to create it.
        match (std::fs::symlink_metadata(&self.root), created) {
            (Ok(found), _) => self.check_root(&found),
            (Err(source), Ok(())) | (Err(_), Err(source)) => Err(BusError::Root {
                domain: self.name.clone(),
                root: self.root.clone(),
                source,
            }),
        }
    }

    /// Refuses a root directory like [`create_root`](Self::create_root), but accepts a missing one.
    pub(super) fn check_existing_root(&self) -> Result<(), BusError> {
        match std::fs::symlink_metadata(&self.root) {
            Ok(found) => self.check_root(&found),
            Err(_) => Ok(()),
        }
    }

    fn check_root(&self, found: &Metadata) -> Result<(), BusError> {
        let (domain, root) = (self.name.clone(), self.root.clone());
        let uid = nix::unistd::geteuid().as_raw();
        if !found.is_dir() || found.uid() != uid {
            return Err(BusError::RootOwner {
                domain,
                root,
                uid,
                found: found.uid(),
                kind: match found.file_type() {
                    kind if kind.is_dir() => "a directory",
                    kind if kind.is_symlink() => "a symbolic link",
                    _ => "a file",
                },
            });
        }
        match found.mode() & 0o777 {
            mode if mode & 0o077 == 0 => Ok(()),
            mode => Err(BusError::RootMode { domain, root, mode }),
        }
    }

    /// iceoryx2's configuration: its defaults, with this domain's root path and prefix.
    pub(super) fn config(&self) -> Result<Config, BusError> {
        let unfit = || BusError::Root {
            domain: self.name.clone(),
            root: self.root.clone(),
            source: std::io::Error::new(std::io::ErrorKind::InvalidInput, "iceoryx2 does not accept such a path"),
        };
        let mut config = Config::default();
        let root = IoxPath::new(self.root.as_os_str().as_encoded_bytes()).map_err(|_| unfit())?;
        config.global.set_root_path(&root);
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(|_| unfit())?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_names_other_than_lower_case_letters_digits_dash_and_underscore_are_refused() {
        for name in ["", "Default", "a b", "a/b", "ü", &"x".repeat(33), "..", "a\n"] {
            let error = Domain::below(name, None).expect_err("must be refused");
            assert!(error.to_string().contains("[a-z0-9_-]"), "{error}");
        }
        assert!(Domain::below("default", None).is_ok());
    }

    #[test]
    fn fault_a_root_path_too_long_for_a_socket_is_refused_with_its_length() {
        let deep = PathBuf::from(format!("/run/{}", "d".repeat(60)));
        let error = Domain::below("default", Some(&deep))
            .expect_err("must be refused")
            .to_string();
        assert!(error.contains("107") && error.contains("default"), "{error}");
    }

    #[test]
    fn fault_a_relative_runtime_directory_is_refused_by_its_variable() {
        let error = Domain::below("default", Some(Path::new("run"))).expect_err("must be refused");
        let error = error.to_string();
        assert!(
            error.contains("$XDG_RUNTIME_DIR: expected a path from the root"),
            "{error}"
        );
    }

    #[test]
    fn val_iceoryx2_reads_the_domain_out_of_its_own_file() {
        let domain = Domain::below("left-arm", Some(Path::new("/run/user/1000"))).expect("valid");
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        std::io::Write::write_all(&mut file, domain.iceoryx2_toml().as_bytes()).expect("written");
        let path = file.path().to_str().expect("UTF-8");
        let path = iceoryx2::prelude::FilePath::new(path.as_bytes()).expect("a path");
        let read = Config::from_file(&path).expect("a configuration");
        assert_eq!(read, domain.config().expect("a configuration"));
    }

    #[test]
    fn prop_root_and_prefix_follow_from_the_name_and_the_user() {
        let domain = Domain::below("left-arm", Some(Path::new("/run/user/1000"))).expect("valid");
        assert_eq!(domain.root(), Path::new("/run/user/1000/thetabus-left-arm"));
        let uid = nix::unistd::geteuid();
        assert_eq!(domain.prefix(), format!("thetabus_{uid}_left-arm_"));
    }

    #[test]
    fn fault_a_root_that_is_a_link_or_a_file_or_open_to_others_is_refused_and_left_as_it_is() {
        use std::fs::Permissions;
        use std::os::unix::fs::{PermissionsExt, symlink};
        let place = tempfile::tempdir().expect("a directory");
        let target = place.path().join("target");
        std::fs::create_dir(&target).expect("create");
        std::fs::set_permissions(&target, Permissions::from_mode(0o700)).expect("its mode");
        let domain = |name: &str| Domain::below(name, Some(place.path())).expect("valid");
        let refused = |domain: &Domain| domain.create_root().expect_err("must be refused").to_string();
        for (name, leads_to) in [("link", "target"), ("broken", "nowhere")] {
            let domain = domain(name);
            symlink(place.path().join(leads_to), domain.root()).expect("link");
            let error = refused(&domain);
            assert!(
                error.contains("a symbolic link") && error.contains("--domain"),
                "{error}"
            );
        }
        assert!(!place.path().join("nowhere").exists());
        let file = domain("file");
        std::fs::write(file.root(), "").expect("write");
        assert!(refused(&file).contains("a file"));
        for mode in [0o777, 0o750, 0o701, 0o720] {
            let open = domain(&format!("open-{mode:o}"));
            std::fs::create_dir(open.root()).expect("create");
            std::fs::set_permissions(open.root(), Permissions::from_mode(mode)).expect("its mode");
            let error = refused(&open);
            assert!(
                error.contains(&format!("{mode:04o}")) && error.contains("0700"),
                "{error}"
            );
        }
        let good = domain("good");
        good.create_root().expect("created");
        good.create_root().expect("there already");
        let mode = std::fs::metadata(good.root()).expect("there").mode() & 0o777;
        assert_eq!(mode, 0o700);
    }
}
