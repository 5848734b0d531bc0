//! Joining a domain on clean ground.
//!
//! iceoryx2 frees what dead processes of its own version leave behind, but stumbles over files that were cut off, damaged or made
//! by another version, and would have a person remove them. Members of a domain therefore share a lock. Who finds nobody holding
//! it, no living node and yet services knows them for rubbish, and sweeps before it begins. Who leaves last sweeps, too, where anything is left: of a process
//! that is killed while it connects, iceoryx2 may miss the connection.

use super::memory::SHM;
use super::{BusError, Domain, Node};
use iceoryx2::node::{NodeCreationFailure, NodeState};
use iceoryx2::prelude::{CallbackProgression, Config, ipc};
use nix::sys::signal::kill;
use nix::unistd::Pid;
use std::collections::HashSet;
use std::fs::{DirEntry, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

/// A node, and the lock that tells others of its life. The lock goes last.
pub(super) struct Membership {
    pub node: Node,
    _leaving: Leaving,
}

/// The members' lock, with what is to be done before it is released.
struct Leaving {
    lock: File,
    domain: Domain,
    config: Config,
}

impl Drop for Leaving {
    fn drop(&mut self) {
        let left = entries(Path::new(SHM)).any(|entry| {
            let name = entry.file_name();
            name.to_str()
                .is_some_and(|name| is_service_memory(name, self.domain.prefix()))
        });
        // whoever comes meanwhile waits for the lock
        if left && self.lock.try_lock().is_ok() && living(&self.config, None) == Some(false) {
            let count = sweep(&self.domain);
            tracing::debug!(
                domain = self.domain.name(),
                files = count,
                "removed what a killed process had left behind"
            );
        }
    }
}

impl Membership {
    /// Creates the node; sweeps first where only rubbish is in the way.
    pub(super) fn new(
        domain: &Domain,
        config: &Config,
        create: impl Fn() -> Result<Node, NodeCreationFailure>,
    ) -> Result<Self, BusError> {
        let (lock, alone) = match lock_members(domain)? {
            Lock::Alone(file) => (file, true),
            Lock::Shared(file) => (file, false),
        };
        let mut node = create();
        if alone {
            let in_the_way = node.is_err() || leaves_services(domain);
            if in_the_way && !others_live(config, node.as_ref().ok()) {
                drop(node);
                let count = sweep(domain);
                tracing::warn!(
                    domain = domain.name(),
                    files = count,
                    "removed what a crash or another version of iceoryx2 had left behind"
                );
                node = create();
            }
            lock_shared(&lock).map_err(|source| BusError::Lock {
                path: domain.root().join(MEMBERS),
                source,
            })?;
        }
        close_to_others(domain);
        let node = node.map_err(|e| BusError::Join {
            domain: domain.name().into(),
            root: domain.root().into(),
            cause: format!(
                "{e:?}; a program of another user or with another iceoryx2 version than {} may be using it, then stop that \
                 program or use another --domain",
                super::ICEORYX2_VERSION
            ),
        })?;
        let leaving = Leaving {
            lock,
            domain: domain.clone(),
            config: config.clone(),
        };
        Ok(Self {
            node,
            _leaving: leaving,
        })
    }
}

/// The file that members of a domain share a lock on.
pub(super) const MEMBERS: &str = "members.lock";
/// A lock file that somebody removes just when it is opened is made anew so often.
const ATTEMPTS: usize = 20;

/// The members' lock.
pub(super) enum Lock {
    /// Held alone: nobody else is a member.
    Alone(File),
    /// Shared with others.
    Shared(File),
}

/// Takes the members' lock; waits for somebody who is sweeping.
pub(super) fn lock_members(domain: &Domain) -> Result<Lock, BusError> {
    open_lock(domain, MEMBERS, |file| {
        if file.try_lock().is_ok() {
            return Ok(Lock::Alone(file.try_clone()?));
        }
        lock_shared(file)?;
        Ok(Lock::Shared(file.try_clone()?))
    })
}

/// Opens a lock file of the domain and locks it. A file that a clean-up removed in between is no lock any more, and is made anew.
pub(super) fn open_lock<T>(
    domain: &Domain,
    name: &str,
    mut lock: impl FnMut(&File) -> io::Result<T>,
) -> Result<T, BusError> {
    let path = domain.root().join(name);
    let fail = |source| BusError::Lock {
        path: path.clone(),
        source,
    };
    for _ in 0..ATTEMPTS {
        domain.create_root()?;
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(&path);
        let file = match opened {
            Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
            opened => opened.map_err(fail)?,
        };
        let locked = lock(&file).map_err(fail)?;
        let own = file.metadata().map_err(fail)?;
        if std::fs::metadata(&path).is_ok_and(|found| (found.dev(), found.ino()) == (own.dev(), own.ino())) {
            return Ok(locked);
        }
    }
    Err(fail(io::Error::other("somebody keeps removing it")))
}

/// iceoryx2 lets everybody read and write what it keeps once per domain; all else is the user's alone, and so becomes this.
fn close_to_others(domain: &Domain) {
    let uid = nix::unistd::geteuid().as_raw();
    for entry in entries(Path::new(SHM)) {
        let ours = entry
            .metadata()
            .is_ok_and(|found| found.uid() == uid && found.mode() & 0o077 != 0);
        if ours
            && entry
                .file_name()
                .to_str()
                .is_some_and(|name| is_management(name, domain.prefix()))
        {
            let _ = std::fs::set_permissions(entry.path(), std::fs::Permissions::from_mode(0o600));
        }
    }
}

fn lock_shared(file: &File) -> io::Result<()> {
    loop {
        match file.lock_shared() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}

/// Is any node but our own alive, in whatever language it is written? In doubt, yes, where we have one of our own.
pub(super) fn others_live(config: &Config, own: Option<&Node>) -> bool {
    living(config, own).unwrap_or(own.is_some())
}

/// Is any node but our own alive? `None` where they cannot be listed and none was seen.
fn living(config: &Config, own: Option<&Node>) -> Option<bool> {
    let mut alive = false;
    let listed = Node::list(config, |state| {
        alive |= own.is_none_or(|own| own.id() != state.node_id())
            && match &state {
                NodeState::Dead(_) => false,
                NodeState::Alive(_) => true,
                NodeState::Inaccessible(id) | NodeState::Undefined(id) => {
                    id.pid::<ipc::Service>().map_or(true, |pid| exists(pid.value()))
                }
            };
        CallbackProgression::Continue
    });
    (alive || listed.is_ok()).then_some(alive)
}

pub(super) fn exists(pid: i32) -> bool {
    kill(Pid::from_raw(pid), None) != Err(nix::errno::Errno::ESRCH)
}

/// Are there services, although nobody has made any yet?
fn leaves_services(domain: &Domain) -> bool {
    entries(&domain.root().join("services")).next().is_some()
}

/// Removes all that iceoryx2 keeps for a domain, but not our locks; returns how many files there were.
fn sweep(domain: &Domain) -> usize {
    let mut count = 0;
    let mut remove = |path: &Path| count += usize::from(std::fs::remove_file(path).is_ok());
    for directory in ["nodes", "services"].map(|name| domain.root().join(name)) {
        for entry in entries(&directory) {
            entries(&entry.path()).for_each(|inner| remove(&inner.path()));
            let _ = std::fs::remove_dir(entry.path());
            remove(&entry.path());
        }
    }
    let sockets =
        entries(domain.root()).filter(|entry| entry.file_name().to_string_lossy().starts_with(domain.prefix()));
    sockets
        .chain(unused_memory(domain))
        .for_each(|entry| remove(&entry.path()));
    count
}

pub(super) fn entries(directory: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    std::fs::read_dir(directory).into_iter().flatten().flatten()
}

/// Shared-memory objects of the domain's services that are ours and that no process has mapped.
///
/// The names depend on the domain alone. The same user may have another domain of this name below another root directory, in a
/// session with $XDG_RUNTIME_DIR and in one without; what lives there is mapped.
fn unused_memory(domain: &Domain) -> Vec<DirEntry> {
    let mapped = mapped_memory(domain, &[]).unwrap_or_default();
    let uid = nix::unistd::geteuid().as_raw();
    entries(Path::new(SHM))
        .filter(|entry| {
            let name = entry.file_name();
            let is_ours = entry.metadata().is_ok_and(|found| found.uid() == uid);
            is_ours
                && name.to_str().is_some_and(|name| {
                    is_service_memory(name, domain.prefix()) && !mapped.contains(&format!("{SHM}/{name}"))
                })
        })
        .collect()
}

/// The domain's shared-memory objects that processes have mapped, by path; `None` where one of `living` does not show what it has.
pub(super) fn mapped_memory(domain: &Domain, living: &[i32]) -> Option<HashSet<String>> {
    let path = format!("{SHM}/{}", domain.prefix());
    let mut mapped = HashSet::new();
    let mut seen = HashSet::new();
    for process in entries(Path::new("/proc")) {
        let Ok(maps) = std::fs::read_to_string(process.path().join("maps")) else {
            continue;
        };
        if let Some(pid) = process.file_name().to_str().and_then(|name| name.parse::<i32>().ok()) {
            seen.insert(pid);
        }
        let names = maps
            .lines()
            .filter_map(|line| line.find(&path).map(|at| line[at..].to_owned()));
        mapped.extend(names);
    }
    living.iter().all(|pid| seen.contains(pid)).then_some(mapped)
}

/// Removes a domain in which nobody lives; returns how many files there were. To be called with the members' lock held alone.
pub(super) fn remove_domain(domain: &Domain) -> usize {
    let mut count = sweep(domain);
    let mut remove = |path: &Path| count += usize::from(std::fs::remove_file(path).is_ok());
    let mapped = mapped_memory(domain, &[]).unwrap_or_default();
    let uid = nix::unistd::geteuid().as_raw();
    for entry in entries(Path::new(SHM)).filter(|entry| entry.metadata().is_ok_and(|found| found.uid() == uid)) {
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        if is_management(name, domain.prefix()) && !mapped.contains(&format!("{SHM}/{name}")) {
            remove(&entry.path());
        }
    }
    for entry in entries(domain.root()).filter(|entry| entry.file_name().to_string_lossy().ends_with(".lock")) {
        remove(&entry.path());
    }
    for directory in ["nodes", "services"] {
        let _ = std::fs::remove_dir(domain.root().join(directory));
    }
    let _ = std::fs::remove_dir(domain.root());
    count
}

/// A role's lock file, as others see it.
pub(super) struct RoleFile<'a>(pub &'a Path);

impl RoleFile<'_> {
    /// Does anybody hold it? Asked by holding it for an instant, which [`RoleLock`](super::RoleLock) forgives.
    pub fn is_held(&self) -> bool {
        File::open(self.0).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
    }

    /// The process id that its holder wrote into it; `None` where nobody holds it.
    pub fn holder(&self) -> Option<String> {
        let text = std::fs::read_to_string(self.0).unwrap_or_default();
        self.is_held().then(|| text.trim().to_owned())
    }
}

/// The prefix, 40 hexadecimal digits, an underscore. The digits keep domain `a` from domain `a_b`, whose prefix begins with its own.
pub(super) fn is_service_memory(name: &str, prefix: &str) -> bool {
    is_of_domain(name, prefix) && !name.ends_with(".global_mgmt")
}

/// What iceoryx2 keeps once per domain, and never removes.
fn is_management(name: &str, prefix: &str) -> bool {
    is_of_domain(name, prefix) && name.ends_with(".global_mgmt")
}

fn is_of_domain(name: &str, prefix: &str) -> bool {
    name.strip_prefix(prefix)
        .and_then(|rest| rest.split_once('_'))
        .is_some_and(|(hash, _)| hash.len() == 40 && hash.bytes().all(|b| b.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_shared_memory_of_a_domain_whose_name_begins_alike_is_left_alone() {
        let hash = "0354a209029e7d094a819e2d4030ea331e6caaf0";
        assert!(is_service_memory(&format!("thetabus_a_{hash}_123.data"), "thetabus_a_"));
        assert!(!is_service_memory(
            &format!("thetabus_a_b_{hash}_123.data"),
            "thetabus_a_"
        ));
        assert!(!is_service_memory("thetabus_a_b", "thetabus_a_"));
        assert!(!is_service_memory(
            &format!("thetabus_a_{hash}_node.0_10_0.global_mgmt"),
            "thetabus_a_"
        ));
    }
}
