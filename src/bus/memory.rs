//! Memory in /dev/shm: checked before a port is created, reserved before it is used.
//!
//! Shared memory is sparse: creating a segment of any size succeeds, and the kernel kills the
//! process (SIGBUS) at the first page that does not fit. So a port refuses to start if it could
//! exceed the free memory, and then reserves all its pages at once, so that later use of /dev/shm
//! cannot take them. Between checking and reserving, programs of one domain take turns; other
//! writers to /dev/shm in these milliseconds are the remaining risk, for which [`SPARE`] is kept.

use super::lock_file::open_lock;
use super::objects::{SHM, entries, is_service_memory};
use super::{Bus, BusError, Domain, Topic};
use nix::errno::Errno;
use nix::fcntl::{OFlag, posix_fallocate};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

/// Memory that a port needs for its small objects (service, event, connections: a page each, 25 in
/// all programs together), and that others may take meanwhile \[bytes\].
pub(super) const SPARE: u64 = 512 << 10;
/// The lock held between checking and reserving.
const QUEUE: &str = "memory.lock";
/// How long a program waits for others to reserve their memory; one that takes longer is stopped
/// and is not awaited.
const QUEUE_LIMIT: Duration = Duration::from_secs(1);

/// Size and free space of /dev/shm \[bytes\]; `None` if unknown.
pub fn shared_memory() -> Option<(u64, u64)> {
    let found = nix::sys::statvfs::statvfs(SHM).ok()?;
    #[allow(
        clippy::useless_conversion,
        reason = "the width of these types depends on the platform"
    )]
    let bytes = |blocks| u64::from(blocks) * u64::from(found.fragment_size());
    Some((bytes(found.blocks()), bytes(found.blocks_available())))
}

/// The right to create a port's objects, until they are [reserved](Claim::take).
#[derive(Debug)]
pub(super) struct Claim<'a> {
    bus: &'a Bus,
    topic: Topic,
    _queue: Option<File>,
}

/// Waits for other programs that are creating ports, and refuses if a port of `needed` bytes does
/// not fit.
pub(super) fn claim(bus: &Bus, topic: Topic, needed: u64) -> Result<Claim<'_>, BusError> {
    let start = Instant::now();
    let queue = open_lock(bus.domain(), QUEUE, |file| {
        while file.try_lock().is_err() {
            if start.elapsed() > QUEUE_LIMIT {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        file.try_clone().map(Some)
    })?;
    check(bus, topic, needed.saturating_add(SPARE))?;
    Ok(Claim {
        bus,
        topic,
        _queue: queue,
    })
}

impl Claim<'_> {
    /// Reserves the pages of everything that has been created.
    pub(super) fn take(self) -> Result<(), BusError> {
        reserve(self.bus, self.topic)
    }
}

/// Refuses if `needed` bytes exceed the free memory.
pub(super) fn check(bus: &Bus, topic: Topic, needed: u64) -> Result<(), BusError> {
    // If the free memory is unknown, reserving the pages will show it.
    match shared_memory() {
        Some((_, available)) if available < needed => Err(too_small(bus, topic, needed, available)),
        _ => Ok(()),
    }
}

/// Reserves the pages of every segment that this user has in the domain so far.
fn reserve(bus: &Bus, topic: Topic) -> Result<(), BusError> {
    for path in sparse_segments(bus.domain()) {
        // A segment removed meanwhile needs no memory.
        let Ok(file) = OpenOptions::new()
            .write(true)
            .custom_flags(OFlag::O_NOFOLLOW.bits())
            .open(&path)
        else {
            continue;
        };
        let Ok(found) = file.metadata() else { continue };
        if !is_sparse(&found) {
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
                // On a file system without that call, files stay sparse.
                _ => break,
            }
        }
    }
    Ok(())
}

/// Segments of this user that lack pages. Checks each once: with hundreds of robots there are
/// thousands, and nearly all are complete.
fn sparse_segments(domain: &Domain) -> Vec<std::path::PathBuf> {
    let uid = nix::unistd::geteuid().as_raw();
    let is_of_service = |entry: &std::fs::DirEntry| {
        let name = entry.file_name();
        name.to_str()
            .is_some_and(|name| is_service_memory(name, domain.prefix()))
    };
    let lacks_pages = |entry: &std::fs::DirEntry| {
        let found = entry.metadata();
        found.is_ok_and(|found| found.uid() == uid && is_sparse(&found))
    };
    entries(Path::new(SHM))
        .filter(|entry| is_of_service(entry) && lacks_pages(entry))
        .map(|entry| entry.path())
        .collect()
}

fn is_sparse(found: &std::fs::Metadata) -> bool {
    found.blocks() * 512 < found.len()
}

fn too_small(bus: &Bus, topic: Topic, needed: u64, available: u64) -> BusError {
    BusError::SharedMemory {
        topic,
        robot: bus.robot().into(),
        needed,
        available,
    }
}
