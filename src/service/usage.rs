//! What a process of this machine uses, from /proc.

use nix::unistd::{SysconfVar, sysconf};

/// Processor time so far \[s\] and memory in use \[bytes\] of a process; `None` if it is not there.
pub(super) fn of(pid: u32) -> Option<(f64, u64)> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the program's name in brackets, and may hold anything.
    let behind_the_name = stat.rsplit_once(')')?.1;
    let field = |number: usize| behind_the_name.split_whitespace().nth(number - 3)?.parse::<u64>().ok();
    let ticks = field(14)? + field(15)?;
    let per_second = sysconf(SysconfVar::CLK_TCK).ok().flatten()?;
    Some((ticks as f64 / per_second as f64, resident_bytes(pid)?))
}

/// Memory in use by a process (resident set) \[bytes\].
pub(super) fn resident_bytes(pid: u32) -> Option<u64> {
    let statm = std::fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    let pages: u64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    let size = sysconf(SysconfVar::PAGE_SIZE).ok().flatten()?;
    Some(pages * u64::try_from(size).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_this_process_uses_time_and_memory_and_one_that_is_not_there_none() {
        let room = std::hint::black_box(vec![1u8; 32 << 20]);
        let (seconds, bytes) = of(std::process::id()).expect("this process is there");
        assert!(seconds >= 0.0 && bytes as usize > room.len(), "{seconds} {bytes}");
        assert_eq!(of(u32::MAX), None);
    }
}
