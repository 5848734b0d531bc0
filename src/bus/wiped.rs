//! Shared memory that was removed from /dev/shm while programs use it, by a person, a cleaner of
//! temporary files, or a service manager that removes a user's objects at the end of a session.
//!
//! The programs go on with each other, because their mappings outlive the names. A program that
//! starts later finds the files of the services but not their memory, and waits in vain for
//! somebody to finish creating it.

use super::Domain;
use super::objects::{SHM, entries, is_of_domain};
use std::path::Path;
use std::time::Duration;

/// What the kernel appends to the path of a mapped file that has been removed.
const REMOVED: &str = " (deleted)";
/// The object that a service keeps as long as a program has it open.
const OF_A_SERVICE: &str = ".dynamic";
/// A program that leaves as the last one removes the object an instant before its own mapping.
const GRACE: Duration = Duration::from_millis(100);

/// The processes that use memory of the domain's services that is no longer in /dev/shm, as far as
/// this user can see.
pub(super) fn cut_off(domain: &Domain) -> Vec<i32> {
    let first = processes(domain);
    if first.is_empty() {
        return first;
    }
    std::thread::sleep(GRACE);
    let second = processes(domain);
    first.into_iter().filter(|pid| second.contains(pid)).collect()
}

fn processes(domain: &Domain) -> Vec<i32> {
    let mut found: Vec<i32> = entries(Path::new("/proc"))
        .filter_map(|process| {
            let pid = process.file_name().to_str()?.parse().ok()?;
            let maps = std::fs::read_to_string(process.path().join("maps")).ok()?;
            maps.lines().any(|line| is_removed(line, domain)).then_some(pid)
        })
        .collect();
    found.sort_unstable();
    found
}

/// True for a line of proc_pid_maps(5) with removed memory of a service of the domain.
fn is_removed(line: &str, domain: &Domain) -> bool {
    let object = line
        .strip_suffix(REMOVED)
        .and_then(|line| line.rsplit_once(SHM))
        .and_then(|(_, name)| name.strip_prefix('/'));
    object.is_some_and(|name| name.ends_with(OF_A_SERVICE) && is_of_domain(name, domain.prefix()))
}

/// What to do about it, for a message; `None` if nothing was removed.
pub(super) fn advice(domain: &Domain) -> Option<String> {
    let pids = cut_off(domain);
    (!pids.is_empty()).then(|| words(&pids))
}

/// The diagnosis with its advice.
pub(super) fn words(pids: &[i32]) -> String {
    let list = pids.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let what = if pids.len() == 1 { "process" } else { "processes" };
    format!(
        "the shared memory of {what} {list} was removed from {SHM} while in use, so programs that start now cannot reach them: \
         end all programs of this domain and start them again; if nobody removed it by hand, look at RemoveIPC in logind.conf and at \
         cleaners of {SHM}"
    )
}

#[cfg(test)]
mod tests {
    use super::super::Bus;
    use super::super::tests::TestDomain;
    use super::*;
    use crate::bus::Subscriber;
    use crate::messages::Status;

    #[test]
    fn fault_memory_removed_under_a_program_is_found_and_told_to_the_next_one() {
        let domain = TestDomain::new();
        let bus = Bus::join(&domain.0, "arm", "first").expect("join");
        let _topic = Subscriber::<Status>::new(&bus).expect("a topic");
        assert_eq!(cut_off(&domain.0), [] as [i32; 0]);
        for object in super::super::objects::of_domain(&domain.0) {
            std::fs::remove_file(object.path()).expect("removed");
        }
        let own = i32::try_from(std::process::id()).expect("a pid");
        assert_eq!(cut_off(&domain.0), [own]);
        let second = Bus::join(&domain.0, "arm", "second").expect("join");
        let error = Subscriber::<Status>::new(&second).map(|_| ()).expect_err("cut off");
        let (error, pid) = (error.to_string(), format!("process {own} "));
        for words in ["removed from /dev/shm", pid.as_str(), "start them again"] {
            assert!(error.contains(words), "{error}");
        }
    }
}
