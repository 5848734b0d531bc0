//! Room in /dev/shm: asked for before a port is made, taken before it is used.
//!
//! Shared memory is sparse: making a segment of any size succeeds, and the kernel kills (SIGBUS) at
//! the first page that does not fit. So a port refuses to start if it could outgrow what is
//! left, and then takes all its pages at once, so that nothing which fills /dev/shm later can take
//! them away. Between asking and taking, programs of one domain let each other pass one by one;
//! others who write to /dev/shm in these milliseconds are the risk that remains, and [`SPARE`] is
//! what they may take.

use super::lock_file::open_lock;
use super::objects::{SHM, entries, is_service_memory};
use super::{Bus, BusError, Domain, Topic};
use nix::errno::Errno;
use nix::fcntl::{OFlag, posix_fallocate};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

/// Room that a port needs for its small objects (service, event, connections: a page each, 25 of
/// them in all programs together), and that others may take meanwhile \[bytes\].
pub(super) const SPARE: u64 = 512 << 10;
/// The lock that is held between asking and taking.
const QUEUE: &str = "memory.lock";
/// How long a program waits for others to take their memory; who takes longer is stopped, and not
/// waited for.
const QUEUE_LIMIT: Duration = Duration::from_secs(1);

/// Size and free room of /dev/shm \[bytes\]; `None` if it cannot be asked.
pub fn shared_memory() -> Option<(u64, u64)> {
    let found = nix::sys::statvfs::statvfs(SHM).ok()?;
    #[allow(
        clippy::useless_conversion,
        reason = "the width of these types depends on the platform"
    )]
    let bytes = |blocks| u64::from(blocks) * u64::from(found.fragment_size());
    Some((bytes(found.blocks()), bytes(found.blocks_available())))
}

/// The right to make a port's objects, until they are [taken](Claim::take).
#[derive(Debug)]
pub(super) struct Claim<'a> {
    bus: &'a Bus,
    topic: Topic,
    _queue: Option<File>,
}

/// Waits for others who are making ports, and refuses if a port that takes `needed` bytes does
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
    /// Takes the pages of everything that has been made.
    pub(super) fn take(self) -> Result<(), BusError> {
        reserve(self.bus, self.topic)
    }
}

/// Refuses if `needed` bytes are more than there are.
pub(super) fn check(bus: &Bus, topic: Topic, needed: u64) -> Result<(), BusError> {
    // Where it cannot be asked, taking the pages will tell.
    match shared_memory() {
        Some((_, available)) if available < needed => Err(too_small(bus, topic, needed, available)),
        _ => Ok(()),
    }
}

/// Takes the pages of every segment that this user has in the domain so far.
fn reserve(bus: &Bus, topic: Topic) -> Result<(), BusError> {
    for path in sparse_segments(bus.domain()) {
        // What has gone meanwhile needs no memory.
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
                // A file system without that call keeps its sparse files.
                _ => break,
            }
        }
    }
    Ok(())
}

/// Segments of this user that lack pages. One look at each: beside hundreds of robots there are
/// thousands, and nearly all have theirs.
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
