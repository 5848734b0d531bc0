//! Scheduling, CPUs and memory of the calling thread and its process, as far as the system permits.

use crate::config::RealtimeSettings;
use crate::messages::RealtimeStatus;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::unistd::Pid;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Bits of [`RealtimeStatus::refused`].
const PRIORITY_REFUSED: u32 = 1 << 0;
const AFFINITY_REFUSED: u32 = 1 << 1;
const MEMORY_REFUSED: u32 = 1 << 2;

/// Requests the settings for the calling thread and, for memory, for its process. Refusals are
/// logged with a remedy, and are missing in the result. Call it after everything is set up, because
/// later threads inherit CPUs and priority.
pub fn apply_realtime(settings: &RealtimeSettings) -> RealtimeStatus {
    let mut granted = RealtimeStatus::default();
    if !settings.cpu_affinity.is_empty() {
        match pin(&settings.cpu_affinity) {
            Ok(mask) => granted.affinity = mask,
            Err(e) => {
                granted.refused |= AFFINITY_REFUSED;
                tracing::warn!(cpus = ?settings.cpu_affinity, "cpu_affinity is refused: {e}");
            }
        }
    }
    if settings.lock_memory {
        match lock_memory() {
            Ok(()) => granted.memory_locked = 1,
            Err(e) => {
                granted.refused |= MEMORY_REFUSED;
                tracing::warn!("lock_memory is refused: {e}; allow it by `ulimit -l`, LimitMEMLOCK= or CAP_IPC_LOCK");
            }
        }
    }
    // Last, so that none of the above runs at that priority.
    if let Some(priority) = settings.scheduler_priority {
        match schedule(priority) {
            Ok(()) => {
                granted.policy = 1;
                granted.priority = u32::from(priority);
            }
            Err(e) => {
                granted.refused |= PRIORITY_REFUSED;
                tracing::warn!(
                    priority,
                    "scheduler_priority is refused: {e}; allow it by `ulimit -r`, LimitRTPRIO= or CAP_SYS_NICE"
                );
            }
        }
    }
    granted
}

/// The CPUs that the thread now runs on, as far as 64 bits show them.
fn pin(cpus: &[usize]) -> nix::Result<u64> {
    let mut set = CpuSet::new();
    for &cpu in cpus {
        set.set(cpu)?;
    }
    let this_thread = Pid::from_raw(0);
    sched_setaffinity(this_thread, &set)?;
    let now = sched_getaffinity(this_thread)?;
    let is_set = |cpu: &usize| now.is_set(*cpu).unwrap_or(false);
    Ok((0..64).filter(is_set).fold(0, |mask, cpu| mask | 1 << cpu))
}

fn lock_memory() -> nix::Result<()> {
    let limited = getrlimit(Resource::RLIMIT_MEMLOCK).is_ok_and(|(soft, _)| soft != RLIM_INFINITY);
    let flags = if limited && !may_lock_anything() {
        // If future pages were locked as well, the first allocation beyond the limit would fail.
        MlockAllFlags::MCL_CURRENT
    } else {
        MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE
    };
    mlockall(flags)
}

/// CAP_IPC_LOCK, to which the limit does not apply.
fn may_lock_anything() -> bool {
    const CAP_IPC_LOCK: u64 = 1 << 14;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = effective.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    effective.is_some_and(|mask| mask & CAP_IPC_LOCK != 0)
}

fn schedule(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| e.to_string())?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy)
        .map_err(|e| format!("{e:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rt_an_affinity_that_the_system_has_is_granted_and_one_that_it_has_not_is_refused() {
        // Settings of a thread end with it.
        std::thread::spawn(|| {
            let free = sched_getaffinity(Pid::from_raw(0)).expect("known");
            let cpu = (0..64)
                .find(|cpu| free.is_set(*cpu).unwrap_or(false))
                .expect("some CPU");
            let pinned = |cpus: Vec<usize>| {
                apply_realtime(&RealtimeSettings {
                    cpu_affinity: cpus,
                    ..RealtimeSettings::default()
                })
            };
            let granted = pinned(vec![cpu]);
            assert_eq!((granted.affinity, granted.refused), (1 << cpu, 0));
            let refused = pinned(vec![1_023]);
            assert_eq!((refused.affinity, refused.refused), (0, AFFINITY_REFUSED));
        })
        .join()
        .expect("no panic");
    }

    #[test]
    fn rt_nothing_asked_is_nothing_changed() {
        assert_eq!(apply_realtime(&RealtimeSettings::default()), RealtimeStatus::default());
    }
}
