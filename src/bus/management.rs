//! The object that iceoryx2 keeps once per domain, created by this library.
//!
//! iceoryx2 creates it in steps and then opens it to every user. Here it appears complete and
//! private from the start: it is written without a name, and linked to its name when complete.

use super::objects::{SHM, is_management, of_domain};
use super::{Domain, ICEORYX2_VERSION};
use nix::fcntl::{AT_FDCWD, AtFlags, OFlag};
use nix::unistd::linkat;
use std::fs::{OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// SHA-1 of the name of the type in the object, which iceoryx2 puts into the object's name.
const TYPE_HASH: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";

fn path(domain: &Domain) -> PathBuf {
    let version = ICEORYX2_VERSION.replace('.', "_");
    Path::new(SHM).join(format!("{}{TYPE_HASH}_node.{version}.global_mgmt", domain.prefix()))
}

/// The version (16 bits each, in a word), then the number of nodes so far.
fn contents() -> [u8; 16] {
    let version = ICEORYX2_VERSION
        .split('.')
        .fold(0, |sum, part| sum << 16 | part.parse::<u64>().unwrap_or(0));
    let mut bytes = [0; 16];
    bytes[..8].copy_from_slice(&version.to_ne_bytes());
    bytes
}

/// Creates the object if it is missing. If that fails, iceoryx2 creates it, and [`close_to_others`]
/// makes it private.
pub(super) fn make(domain: &Domain) {
    let path = path(domain);
    if path.exists() {
        return;
    }
    if let Err(error) = link_new(&path) {
        tracing::debug!(object = %path.display(), %error, "cannot be made in one step");
    }
}

fn link_new(path: &Path) -> io::Result<()> {
    let mut file = OpenOptions::new()
        .write(true)
        .mode(0o600)
        .custom_flags(OFlag::O_TMPFILE.bits())
        .open(SHM)?;
    file.write_all(&contents())?;
    let nameless = format!("/proc/self/fd/{}", file.as_raw_fd());
    match linkat(AT_FDCWD, nameless.as_str(), AT_FDCWD, path, AtFlags::AT_SYMLINK_FOLLOW) {
        // Another process was first.
        Ok(()) | Err(nix::errno::Errno::EEXIST) => Ok(()),
        Err(e) => Err(e.into()),
    }
}

/// iceoryx2 lets every user read and write the object; like all other objects, it is made private.
pub(super) fn close_to_others(domain: &Domain) {
    let uid = nix::unistd::geteuid().as_raw();
    for entry in of_domain(domain) {
        let is_open = |found: &std::fs::Metadata| found.uid() == uid && found.is_file() && found.mode() & 0o077 != 0;
        let name = entry.file_name();
        let is_management = name.to_str().is_some_and(|name| is_management(name, domain.prefix()));
        if is_management && entry.metadata().is_ok_and(|found| is_open(&found)) {
            let _ = std::fs::set_permissions(entry.path(), Permissions::from_mode(0o600));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Bus;
    use super::super::tests::TestDomain;
    use super::*;

    fn objects(domain: &Domain) -> Vec<(PathBuf, u32)> {
        of_domain(domain)
            .filter(|entry| is_management(&entry.file_name().to_string_lossy(), domain.prefix()))
            .map(|entry| (entry.path(), entry.metadata().expect("there").mode() & 0o777))
            .collect()
    }

    #[test]
    fn val_iceoryx2_takes_the_object_that_we_make() {
        let domain = TestDomain::new();
        make(&domain.0);
        let expected = [(path(&domain.0), 0o600)];
        assert_eq!(objects(&domain.0), expected);
        let _bus = Bus::join(&domain.0, "arm", "test").expect("join");
        // Neither replaced nor joined by one of another name.
        assert_eq!(objects(&domain.0), expected);
        let bytes = std::fs::read(path(&domain.0)).expect("read");
        assert_eq!(bytes[..8], contents()[..8]);
        assert_ne!(bytes[8..12], [0; 4], "the node was counted in it");
    }
}
