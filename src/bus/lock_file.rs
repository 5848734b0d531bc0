//! Lock files of a domain.

use super::{BusError, Domain};
use nix::fcntl::OFlag;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};

/// Number of attempts if a lock file is removed just when it is opened.
const ATTEMPTS: usize = 20;

/// Opens a lock file of the domain and locks it. A file that a clean-up removed in between is no
/// longer a lock, and is created again.
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
            .custom_flags(OFlag::O_NOFOLLOW.bits())
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
