//! Room in /dev/shm: asked for before a topic is made, taken before it is used.
//!
//! Shared memory is sparse: making a segment of any size succeeds, and the kernel kills (SIGBUS) at the first page that does not fit.
//! So a port refuses to start where it could outgrow what is left, and then takes all its pages at once, so that nothing which
//! fills /dev/shm later can take them away.

use super::membership::{entries, is_service_memory};
use super::{Bus, BusError, Domain, Topic};
use nix::errno::Errno;
use nix::fcntl::posix_fallocate;
use std::fs::OpenOptions;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Where shared memory lives.
pub(super) const SHM: &str = "/dev/shm";

/// Size and free room of /dev/shm \[bytes\]; `None` where it cannot be asked.
pub fn shared_memory() -> Option<(u64, u64)> {
    let found = nix::sys::statvfs::statvfs(SHM).ok()?;
    #[allow(
        clippy::useless_conversion,
        reason = "the width of these types depends on the platform"
    )]
    let bytes = |blocks| u64::from(blocks) * u64::from(found.fragment_size());
    Some((bytes(found.blocks()), bytes(found.blocks_available())))
}

/// Refuses where `needed` bytes are more than there are.
pub(super) fn check(bus: &Bus, topic: Topic, needed: u64) -> Result<(), BusError> {
    // Where it cannot be asked, taking the pages will tell.
    match shared_memory() {
        Some((_, available)) if available < needed => Err(too_small(bus, topic, needed, available)),
        _ => Ok(()),
    }
}

/// Takes the pages of every segment that this user has in the domain so far.
pub(super) fn reserve(bus: &Bus, topic: Topic) -> Result<(), BusError> {
    for path in segments(bus.domain()) {
        // What has gone meanwhile needs no memory.
        let Ok(file) = OpenOptions::new().write(true).open(&path) else {
            continue;
        };
        let Ok(found) = file.metadata() else { continue };
        if found.blocks() * 512 >= found.len() {
            continue;
        }
        loop {
            match posix_fallocate(&file, 0, found.len().cast_signed()) {
                Err(Errno::EINTR) => {}
                Err(Errno::ENOSPC) => {
                    let needed = found.len() - found.blocks() * 512;
                    let available = shared_memory().map_or(0, |(_, available)| available);
                    return Err(too_small(bus, topic, needed, available));
                }
                // A file system without that call keeps its sparse files.
                _ => break,
            }
        }
    }
    Ok(())
}

fn segments(domain: &Domain) -> Vec<std::path::PathBuf> {
    let uid = nix::unistd::geteuid().as_raw();
    entries(Path::new(SHM))
        .filter(|entry| {
            entry
                .file_name()
                .to_str()
                .is_some_and(|name| is_service_memory(name, domain.prefix()))
                && entry.metadata().is_ok_and(|found| found.uid() == uid)
        })
        .map(|entry| entry.path())
        .collect()
}

fn too_small(bus: &Bus, topic: Topic, needed: u64, available: u64) -> BusError {
    BusError::SharedMemory {
        topic,
        robot: bus.robot().into(),
        needed,
        available,
    }
}
