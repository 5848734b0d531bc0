//! Joining a domain, after removing leftovers.
//!
//! iceoryx2 frees the resources of dead processes of its own version, but fails on files that are
//! truncated, damaged or from another version, which a person would have to remove. Members of a
//! domain therefore share a lock. If a joining program finds the lock free, no living node and yet
//! services, these are leftovers, and it removes them first. The last program to leave also removes
//! leftovers, because iceoryx2 can miss a connection whose process was killed while connecting.
//! Every member removes half-made objects at any time.
//!
//! Nothing here waits without a limit, neither for the lock nor for iceoryx2.

use super::half_made;
use super::lock_file::open_lock;
use super::management;
use super::objects::{SHM, entries, is_management, is_service_memory, mapped_memory, refuse_foreign, unused};
use super::orphans;
use super::time_limit::within;
use super::watch::Watch;
use super::{BusError, Domain, Node};
use iceoryx2::node::{NodeCreationFailure, NodeState};
use iceoryx2::prelude::{CallbackProgression, Config, ipc};
use nix::sys::signal::kill;
use nix::unistd::Pid;
use std::fs::{DirEntry, File, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a join may take at each step that depends on others. Without leftovers it takes
/// milliseconds altogether.
const JOIN_LIMIT: Duration = Duration::from_secs(5);
/// Number of attempts before iceoryx2's refusal is reported, while other processes live in the
/// domain.
const SECOND_LOOKS: usize = 20;
const PAUSE: Duration = Duration::from_millis(50);

/// A node, and the lock that shows others that it is alive. The lock is released last.
pub(super) struct Membership {
    pub node: Node,
    _leaving: Leaving,
    /// Last, because leaving may also meet half-made objects.
    _watch: Watch,
}

/// The members' lock, with the work to do before it is released.
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
        // a process that joins meanwhile waits for the lock
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
    /// Creates the node; first removes leftovers if there is nothing else.
    pub(super) fn new(
        domain: &Domain,
        config: &Config,
        create: impl Fn() -> Result<Node, NodeCreationFailure> + Send + Sync + 'static,
    ) -> Result<Self, BusError> {
        let (lock, alone) = match lock_members(domain)? {
            Lock::Alone(file) => (file, true),
            Lock::Shared(file) => (file, false),
        };
        refuse_foreign(domain)?;
        let half_made = half_made::sweep(domain);
        if !alone {
            // A process alone in the domain removes more, see below.
            orphans::sweep(domain);
        }
        // From here on iceoryx2 is called, which may wait for half-made objects.
        let watch = Watch::start(domain)?;
        management::make(domain);
        let create = Arc::new(create);
        let create = || {
            let create = create.clone();
            within(domain, "joining", JOIN_LIMIT, move || create())
        };
        let mut node = create()?;
        if alone {
            let in_the_way = node.is_err() || half_made > 0 || leaves_services(domain);
            if in_the_way && !others_live(config, node.as_ref().ok()) {
                let is_err = node.is_err();
                drop(node);
                let mut count = sweep(domain);
                if is_err {
                    count += remove_management(domain);
                    management::make(domain);
                }
                tracing::warn!(
                    domain = domain.name(),
                    files = count,
                    "removed what a crash or another version of iceoryx2 had left behind"
                );
                node = create()?;
            }
            lock_shared(&lock).map_err(|source| BusError::Lock {
                path: domain.root().join(MEMBERS),
                source,
            })?;
        } else {
            // Other processes are creating what it needs, or were killed while doing so.
            for _ in 0..SECOND_LOOKS {
                if node.is_ok() {
                    break;
                }
                std::thread::sleep(PAUSE);
                node = create()?;
            }
        }
        management::close_to_others(domain);
        let node = node.map_err(|e| BusError::Join {
            domain: domain.name().into(),
            root: domain.root().into(),
            cause: format!(
                "{e:?}; a program with another iceoryx2 version than {} may be using it, then stop that program or use another \
                 --domain",
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
            _watch: watch,
        })
    }
}

/// The file on which members of a domain share a lock.
pub(super) const MEMBERS: &str = "members.lock";
/// The members' lock.
pub(super) enum Lock {
    /// Held exclusively: there is no other member.
    Alone(File),
    /// Shared with others.
    Shared(File),
}

/// Takes the members' lock; waits, up to a limit, for a process that is removing leftovers.
pub(super) fn lock_members(domain: &Domain) -> Result<Lock, BusError> {
    open_lock(domain, MEMBERS, |file| {
        if file.try_lock().is_ok() {
            return Ok(Lock::Alone(file.try_clone()?));
        }
        lock_shared(file)?;
        Ok(Lock::Shared(file.try_clone()?))
    })
}

/// Shares a lock file; fails with its holder if that takes too long.
fn lock_shared(file: &File) -> io::Result<()> {
    let start = Instant::now();
    loop {
        match file.try_lock_shared() {
            Ok(()) => return Ok(()),
            Err(TryLockError::Error(e)) if e.kind() != io::ErrorKind::Interrupted => return Err(e),
            Err(_) if start.elapsed() < JOIN_LIMIT => std::thread::sleep(Duration::from_millis(2)),
            Err(_) => return Err(io::Error::new(io::ErrorKind::TimedOut, held_too_long(file))),
        }
    }
}

fn held_too_long(file: &File) -> String {
    let seconds = JOIN_LIMIT.as_secs();
    match lock_holder(file) {
        Some(pid) => format!(
            "process {pid} has held it for {seconds} s, it hangs or is stopped; continue it (kill -CONT {pid}) or end it"
        ),
        None => format!("somebody has held it for {seconds} s"),
    }
}

/// The process that holds an exclusive lock on this file. The kernel's list is read in pieces and
/// may lack a line if it changes meanwhile, so it is read more than once.
fn lock_holder(file: &File) -> Option<u32> {
    (0..5).find_map(|again| {
        std::thread::sleep(Duration::from_millis(10 * again));
        listed_holder(file)
    })
}

/// The same by proc_locks(5).
fn listed_holder(file: &File) -> Option<u32> {
    let inode = format!(":{}", file.metadata().ok()?.ino());
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    locks.lines().find_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let is_it = matches!(fields[..], [_, "FLOCK", _, "WRITE", _, at, ..] if at.ends_with(&inode));
        is_it.then(|| fields[4].parse().ok())?
    })
}

/// True if any node other than our own is alive, in any language. If unknown, true if we have a
/// node.
pub(super) fn others_live(config: &Config, own: Option<&Node>) -> bool {
    living(config, own).unwrap_or(own.is_some())
}

/// Whether any node other than our own is alive; `None` if they cannot be listed and none was seen.
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

/// True if there are files of services. Only for a domain without another living process, whose
/// files are left over.
fn leaves_services(domain: &Domain) -> bool {
    entries(&domain.root().join("services")).next().is_some()
}

/// Removes all files of iceoryx2 in a domain, but not our locks; returns their number.
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

/// Shared-memory objects of the domain's services that belong to this user and that no process has
/// mapped.
fn unused_memory(domain: &Domain) -> Vec<DirEntry> {
    let mapped = mapped_memory(domain, &[]).unwrap_or_default();
    unused(domain, &mapped, is_service_memory).collect()
}

/// Removes the object that iceoryx2 keeps once per domain; call it only if no process lives there.
fn remove_management(domain: &Domain) -> usize {
    let mapped = mapped_memory(domain, &[]).unwrap_or_default();
    unused(domain, &mapped, is_management)
        .filter(|entry| std::fs::remove_file(entry.path()).is_ok())
        .count()
}

/// Removes a domain without living processes; returns the number of its files. Call it with the
/// members' lock held exclusively.
pub(super) fn remove_domain(domain: &Domain) -> usize {
    let mut count = sweep(domain) + remove_management(domain);
    let mut remove = |path: &Path| count += usize::from(std::fs::remove_file(path).is_ok());
    for entry in entries(domain.root()).filter(|entry| entry.file_name().to_string_lossy().ends_with(".lock")) {
        remove(&entry.path());
    }
    for directory in ["nodes", "services"] {
        let _ = std::fs::remove_dir(domain.root().join(directory));
    }
    let _ = std::fs::remove_dir(domain.root());
    count
}

/// A role's lock file, as seen by other processes.
pub(super) struct RoleFile<'a>(pub &'a Path);

impl RoleFile<'_> {
    /// True if a process holds it. Tests this by holding it for an instant, which
    /// [`RoleLock`](super::RoleLock) tolerates.
    pub fn is_held(&self) -> bool {
        File::open(self.0).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
    }

    /// The process id that its holder wrote into it; `None` if it is not held.
    pub fn holder(&self) -> Option<String> {
        let text = std::fs::read_to_string(self.0).unwrap_or_default();
        self.is_held().then(|| text.trim().to_owned())
    }
}
