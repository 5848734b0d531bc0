//! Joining a domain on clean ground.
//!
//! iceoryx2 frees what dead processes of its own version leave behind, but stumbles over files that were cut off, damaged or made
//! by another version, and would have a person remove them. Members of a domain therefore share a lock. Who finds nobody holding
//! it, no living node and yet services knows them for rubbish, and sweeps before it begins.

use super::{BusError, Domain, Node};
use iceoryx2::node::{NodeCreationFailure, NodeState};
use iceoryx2::prelude::{CallbackProgression, Config, ipc};
use nix::sys::signal::kill;
use nix::unistd::Pid;
use std::collections::HashSet;
use std::fs::{DirEntry, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

/// A node, and the lock that tells others of its life. The lock goes last.
pub(super) struct Membership {
    pub node: Node,
    _lock: File,
}

impl Membership {
    /// Creates the node; sweeps first where only rubbish is in the way.
    pub(super) fn new(
        domain: &Domain,
        config: &Config,
        create: impl Fn() -> Result<Node, NodeCreationFailure>,
    ) -> Result<Self, BusError> {
        let path = domain.root().join("members.lock");
        let fail = |source| BusError::Lock {
            path: path.clone(),
            source,
        };
        let lock = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(&path)
            .map_err(fail)?;
        let alone = lock.try_lock().is_ok();
        if !alone {
            // Waits for somebody who is sweeping; other members share.
            lock_shared(&lock).map_err(fail)?;
        }
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
            lock_shared(&lock).map_err(fail)?;
        }
        let node = node.map_err(|e| BusError::Join {
            domain: domain.name().into(),
            root: domain.root().into(),
            cause: format!(
                "{e:?}; a program of another user or with another iceoryx2 version than {} may be using it, then stop that \
                 program or use another --domain",
                super::ICEORYX2_VERSION
            ),
        })?;
        Ok(Self { node, _lock: lock })
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

/// Is any node but our own alive, in whatever language it is written? In doubt, yes.
fn others_live(config: &Config, own: Option<&Node>) -> bool {
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
    alive || (listed.is_err() && own.is_some())
}

fn exists(pid: i32) -> bool {
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

fn entries(directory: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    std::fs::read_dir(directory).into_iter().flatten().flatten()
}

/// Shared-memory objects of the domain's services that are ours and that no process has mapped.
///
/// The names depend on the domain alone. The same user may have another domain of this name below another root directory, in a
/// session with $XDG_RUNTIME_DIR and in one without; what lives there is mapped.
fn unused_memory(domain: &Domain) -> Vec<DirEntry> {
    let path = format!("/dev/shm/{}", domain.prefix());
    let mut mapped = HashSet::new();
    for process in entries(Path::new("/proc")) {
        let maps = std::fs::read_to_string(process.path().join("maps")).unwrap_or_default();
        let names = maps
            .lines()
            .filter_map(|line| line.find(&path).map(|at| line[at..].to_owned()));
        mapped.extend(names);
    }
    let uid = nix::unistd::geteuid().as_raw();
    entries(Path::new("/dev/shm"))
        .filter(|entry| {
            let name = entry.file_name();
            let is_ours = entry.metadata().is_ok_and(|found| found.uid() == uid);
            is_ours
                && name.to_str().is_some_and(|name| {
                    is_service_memory(name, domain.prefix()) && !mapped.contains(&format!("/dev/shm/{name}"))
                })
        })
        .collect()
}

/// The prefix, 40 hexadecimal digits, an underscore. The digits keep domain `a` from domain `a_b`, whose prefix begins with its own.
fn is_service_memory(name: &str, prefix: &str) -> bool {
    name.strip_prefix(prefix)
        .and_then(|rest| rest.split_once('_'))
        .is_some_and(|(hash, _)| hash.len() == 40 && hash.bytes().all(|b| b.is_ascii_hexdigit()))
        && !name.ends_with(".global_mgmt")
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
