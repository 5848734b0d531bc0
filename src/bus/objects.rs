//! A domain's objects in /dev/shm: their names, owners, and the processes that have them open.

use super::{BusError, Domain};
use std::collections::HashSet;
use std::fs::DirEntry;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;

/// Directory of shared memory.
pub(super) const SHM: &str = "/dev/shm";

pub(super) fn entries(directory: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    std::fs::read_dir(directory).into_iter().flatten().flatten()
}

pub(super) fn is_ours(entry: &DirEntry) -> bool {
    let uid = nix::unistd::geteuid().as_raw();
    entry.metadata().is_ok_and(|found| found.uid() == uid)
}

/// The prefix, 40 hexadecimal digits, an underscore. The digits distinguish domain `a` from domain
/// `a_b`, whose prefix begins with that of `a`.
pub(super) fn is_service_memory(name: &str, prefix: &str) -> bool {
    is_of_domain(name, prefix) && !name.ends_with(".global_mgmt")
}

/// The object that iceoryx2 keeps once per domain and never removes.
pub(super) fn is_management(name: &str, prefix: &str) -> bool {
    is_of_domain(name, prefix) && name.ends_with(".global_mgmt")
}

pub(super) fn is_of_domain(name: &str, prefix: &str) -> bool {
    name.strip_prefix(prefix)
        .and_then(|rest| rest.split_once('_'))
        .is_some_and(|(hash, _)| hash.len() == 40 && hash.bytes().all(|b| b.is_ascii_hexdigit()))
}

/// All objects of a domain, of any owner.
pub(super) fn of_domain(domain: &Domain) -> impl Iterator<Item = DirEntry> + use<> {
    let prefix = domain.prefix().to_owned();
    entries(Path::new(SHM)).filter(move |entry| {
        let name = entry.file_name();
        name.to_str().is_some_and(|name| is_of_domain(name, &prefix))
    })
}

/// This user's objects of a domain that are not `mapped` and whose names `belong`.
///
/// The names depend only on the domain. The same user may have another domain of this name below
/// another root directory, from sessions with and without $XDG_RUNTIME_DIR; objects in use there
/// are mapped.
pub(super) fn unused(
    domain: &Domain,
    mapped: &HashSet<String>,
    belongs: fn(name: &str, prefix: &str) -> bool,
) -> impl Iterator<Item = DirEntry> {
    entries(Path::new(SHM)).filter(move |entry| {
        let name = entry.file_name();
        is_ours(entry)
            && name
                .to_str()
                .is_some_and(|name| belongs(name, domain.prefix()) && !mapped.contains(&format!("{SHM}/{name}")))
    })
}

/// Refuses a domain if another user has an object under its names: the owner could read, damage or
/// never complete it.
pub(super) fn refuse_foreign(domain: &Domain) -> Result<(), BusError> {
    let uid = nix::unistd::geteuid().as_raw();
    for entry in of_domain(domain) {
        let Ok(found) = entry.metadata() else { continue };
        if found.uid() != uid || !found.is_file() {
            return Err(BusError::ForeignObject {
                domain: domain.name().into(),
                path: entry.path(),
                uid,
                found: found.uid(),
            });
        }
    }
    Ok(())
}

/// The domain's objects that processes have mapped, by path; `None` if the mappings of one of
/// `living` are not visible.
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

/// Number of checks before a file counts as held, and the pause between them: a process that waits
/// for a creator opens the file for an instant once per millisecond.
const LOOKS: usize = 10;
const PAUSE: Duration = Duration::from_millis(2);

/// Processes that keep this file open, as far as this user can see.
pub(super) fn holders(path: &Path) -> Vec<i32> {
    let Ok(file) = std::fs::symlink_metadata(path) else {
        return Vec::new();
    };
    let is_it = |descriptor: &Path| {
        std::fs::metadata(descriptor).is_ok_and(|found| (found.dev(), found.ino()) == (file.dev(), file.ino()))
    };
    let mut open = Vec::new();
    for process in entries(Path::new("/proc")) {
        let Some(pid) = process.file_name().to_str().and_then(|name| name.parse().ok()) else {
            continue;
        };
        let descriptors = entries(&process.path().join("fd")).map(|entry| entry.path());
        open.extend(descriptors.filter(|path| is_it(path)).map(|path| (pid, path)));
    }
    for _ in 0..LOOKS {
        if open.is_empty() {
            break;
        }
        std::thread::sleep(PAUSE);
        open.retain(|(_, descriptor)| is_it(descriptor));
    }
    open.into_iter().map(|(pid, _)| pid).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_shared_memory_of_a_domain_whose_name_begins_alike_is_left_alone() {
        let hash = "0354a209029e7d094a819e2d4030ea331e6caaf0";
        assert!(is_service_memory(
            &format!("thetabus_7_a_{hash}_123.data"),
            "thetabus_7_a_"
        ));
        assert!(!is_service_memory(
            &format!("thetabus_7_a_b_{hash}_123.data"),
            "thetabus_7_a_"
        ));
        assert!(!is_service_memory("thetabus_7_a_b", "thetabus_7_a_"));
        assert!(!is_service_memory(
            &format!("thetabus_7_a_{hash}_node.0_10_0.global_mgmt"),
            "thetabus_7_a_"
        ));
    }

    #[test]
    fn prop_a_file_is_held_as_long_as_a_process_has_it_open() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let own = i32::try_from(std::process::id()).expect("a pid");
        assert_eq!(holders(file.path()), [own]);
        let path = file.into_temp_path();
        assert_eq!(holders(&path), [] as [i32; 0]);
    }
}
