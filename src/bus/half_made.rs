//! Half-made objects: their creator was killed or stopped before they were complete.
//!
//! iceoryx2 creates an object in three steps: it creates it empty and closed to readers, sets its
//! size, and opens it to readers. A program that finds the object in between waits for the creator:
//! up to a limit while the object is closed, forever while it is empty and can be opened (by root
//! always). A killed creator never continues. So if no process has the object open, it will never
//! be completed, and is removed.

use super::Domain;
use super::lock_file::open_lock;
use super::objects::{entries, holders, of_domain};
use nix::fcntl::OFlag;
use std::collections::HashMap;
use std::fs::{Metadata, OpenOptions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long an object must have been half-made while no visible process has it open: a creator in
/// another process namespace, which is not visible, needs only microseconds.
pub(super) const GRACE: Duration = Duration::from_millis(100);
/// How long a living creator may leave an object empty: beyond this it is stopped, and every
/// process that opens the object hangs.
const MAKER_LIMIT: Duration = Duration::from_secs(1);
/// The lock of the program that removes objects.
const QUEUE: &str = "sweep.lock";
/// How long that lock is respected. Removing takes milliseconds, unless the program is stopped, and
/// then its lock must not block others.
const QUEUE_LIMIT: Duration = Duration::from_secs(1);
/// Polling period.
const PAUSE: Duration = Duration::from_millis(20);

/// Watches a domain's half-made objects and removes those that will never be completed.
#[derive(Debug)]
pub(super) struct Tender {
    domain: Domain,
    /// Inode, and when it was first seen half-made.
    first_seen: HashMap<PathBuf, (u64, Instant)>,
    /// Number of removed objects.
    removed: usize,
}

impl Tender {
    pub(super) fn new(domain: &Domain) -> Self {
        Self {
            domain: domain.clone(),
            first_seen: HashMap::new(),
            removed: 0,
        }
    }

    /// Checks once, and removes what is due; returns the number of objects that may become due
    /// within [`GRACE`].
    pub(super) fn sweep_once(&mut self) -> usize {
        let found = half_made(&self.domain);
        self.first_seen
            .retain(|path, _| found.iter().any(|(other, _)| other == path));
        let uid = nix::unistd::geteuid().as_raw();
        let mut waiting = 0;
        for (path, metadata) in found {
            let seen = self
                .first_seen
                .entry(path.clone())
                .or_insert((metadata.ino(), Instant::now()));
            if seen.0 != metadata.ino() {
                *seen = (metadata.ino(), Instant::now());
            }
            let age = seen.1.elapsed();
            if age < GRACE {
                waiting += 1;
            } else if metadata.uid() != uid {
                release(&self.domain, &path, &metadata);
            } else if remove(&self.domain, &path, &metadata, age) {
                self.removed += 1;
                tracing::info!(
                    domain = self.domain.name(),
                    object = %path.display(),
                    "removed an object that a process had created incompletely when it was killed"
                );
            }
        }
        waiting
    }
}

/// Removes objects that will stay half-made; returns their number. Waits for [`GRACE`] only if
/// there are any.
pub(super) fn sweep(domain: &Domain) -> usize {
    let mut tender = Tender::new(domain);
    while tender.sweep_once() > 0 {
        std::thread::sleep(PAUSE);
    }
    tender.removed
}

/// The objects that are half-made at this moment, by a living process or a killed one.
pub(super) fn half_made(domain: &Domain) -> Vec<(PathBuf, Metadata)> {
    let memory = of_domain(domain).map(|entry| (entry, is_memory_half_made as fn(&Metadata) -> bool));
    let services = entries(&domain.root().join("services")).map(|entry| (entry, is_file_half_made as fn(&_) -> bool));
    memory
        .chain(services)
        .filter_map(|(entry, is_half_made)| {
            let metadata = entry.metadata().ok()?;
            (metadata.is_file() && is_half_made(&metadata)).then(|| (entry.path(), metadata))
        })
        .collect()
}

fn is_memory_half_made(metadata: &Metadata) -> bool {
    metadata.len() == 0 || metadata.mode() & 0o400 == 0
}

/// The file that describes a service becomes read-only when it is complete.
fn is_file_half_made(metadata: &Metadata) -> bool {
    metadata.mode() & 0o200 != 0
}

fn is_due(path: &Path, metadata: &Metadata, age: Duration) -> bool {
    match &holders(path)[..] {
        [] => true,
        // Processes that wait for it open it repeatedly, so they may be among the holders.
        makers if metadata.len() == 0 && age > MAKER_LIMIT => {
            tracing::warn!(
                object = %path.display(),
                processes = ?makers,
                "removing an object that has been incomplete for {} s: the process that creates it is stopped, and it blocks the others",
                MAKER_LIMIT.as_secs()
            );
            true
        }
        _ => false,
    }
}

/// Removes the object that was seen, if it is due, and not a new one with its name. Programs take
/// turns, because each must check every process for those that have the object open; a program that
/// is stopped in its turn is skipped.
fn remove(domain: &Domain, path: &Path, seen: &Metadata, age: Duration) -> bool {
    let removed = open_lock(domain, QUEUE, |queue| {
        if queue.try_lock().is_err() && age < GRACE + QUEUE_LIMIT {
            // Another program is removing it; the next check shows the result.
            return Ok(false);
        }
        if !is_due(path, seen, age) {
            return Ok(false);
        }
        let now = std::fs::symlink_metadata(path)?;
        let is_same = (now.ino(), now.len(), now.mode()) == (seen.ino(), seen.len(), seen.mode());
        Ok(is_same && std::fs::remove_file(path).is_ok())
    });
    removed.unwrap_or(false)
}

/// An empty object of another user under the domain's names cannot be removed, but once it has a
/// size, no process waits for it.
fn release(domain: &Domain, path: &Path, metadata: &Metadata) {
    if metadata.len() > 0 {
        return;
    }
    let opened = OpenOptions::new()
        .write(true)
        .custom_flags((OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK).bits())
        .open(path);
    if opened.and_then(|file| file.set_len(1)).is_ok() {
        tracing::error!(
            domain = domain.name(),
            object = %path.display(),
            owner = metadata.uid(),
            "another user has put an object among the names of this domain; it is not used"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::TestDomain;
    use super::*;
    use std::fs::File;

    fn object(domain: &Domain, hash: &str, mode: u32, len: u64) -> (PathBuf, File) {
        let path = PathBuf::from(format!("/dev/shm/{}{}_1.dynamic", domain.prefix(), hash.repeat(20)));
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(mode)
            .open(&path)
            .expect("create");
        file.set_len(len).expect("its size");
        (path, file)
    }

    #[test]
    fn fault_what_nobody_will_finish_is_removed_and_what_is_being_made_is_not() {
        let domain = TestDomain::new();
        let (empty, file) = object(&domain.0, "0a", 0o600, 0);
        drop(file);
        let (closed, file) = object(&domain.0, "0b", 0o200, 16);
        drop(file);
        let (making, _maker) = object(&domain.0, "0c", 0o200, 16);
        let (complete, file) = object(&domain.0, "0d", 0o600, 16);
        drop(file);
        let start = Instant::now();
        assert_eq!(sweep(&domain.0), 2);
        assert!(start.elapsed() >= GRACE, "they could have been in the making");
        let left: Vec<bool> = [&empty, &closed, &making, &complete].map(|path| path.exists()).into();
        assert_eq!(left, [false, false, true, true]);
    }

    #[test]
    fn fault_a_program_that_is_stopped_while_it_removes_something_keeps_no_other_from_it() {
        let domain = TestDomain::new();
        let stopped = open_lock(&domain.0, QUEUE, |file| {
            file.try_lock().map_err(std::io::Error::from)?;
            file.try_clone()
        });
        let _stopped = stopped.expect("the lock is free");
        let (path, file) = object(&domain.0, "0a", 0o600, 0);
        drop(file);
        let mut tender = Tender::new(&domain.0);
        let start = Instant::now();
        while path.exists() {
            tender.sweep_once();
            assert!(start.elapsed() < 20 * QUEUE_LIMIT, "still there");
            std::thread::sleep(PAUSE);
        }
        assert!(start.elapsed() >= QUEUE_LIMIT, "it has its turn");
    }

    #[test]
    fn fault_an_empty_object_of_a_maker_that_stands_still_blocks_the_others_for_a_second() {
        let domain = TestDomain::new();
        let (path, _maker) = object(&domain.0, "0a", 0o200, 0);
        let mut tender = Tender::new(&domain.0);
        let start = Instant::now();
        while path.exists() {
            tender.sweep_once();
            assert!(start.elapsed() < 20 * MAKER_LIMIT, "still there");
            std::thread::sleep(PAUSE);
        }
        assert!(start.elapsed() >= MAKER_LIMIT);
    }
}
