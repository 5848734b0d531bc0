//! A machine that publishes its samples.

use crate::{Failure, OK, guarded, hand_out, join, limit, take_back};
use std::ffi::c_char;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use thetabus::bus::{Delivery, Role, RoleLock, SamplePublisher, monotonic_ns};
use thetabus::messages::{Sample, sample_flags};
use thetabus::model::MAX_JOINTS;

/// A machine on the bus.
pub struct Machine {
    samples: SamplePublisher,
    _only_one: RoleLock,
    joints: u32,
    stream_id: u64,
    next_seq: u64,
    has_ended: bool,
}

/// Takes the place of a robot's plant.
///
/// # Safety
/// Texts are null or end with a zero; `out` may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_machine_open(
    domain: *const c_char,
    robot: *const c_char,
    joints: u32,
    consumers: u32,
    timeout_ms: i32,
    out: *mut *mut Machine,
) -> i32 {
    // SAFETY: as the caller promises
    unsafe {
        hand_out(out, || {
            if !(1..=MAX_JOINTS as u32).contains(&joints) {
                return Err(Failure::invalid(format!(
                    "joints: expected 1 to {MAX_JOINTS}, got {joints}"
                )));
            }
            let (domain, bus) = join(domain, robot)?;
            let only_one = RoleLock::acquire(&domain, bus.robot(), Role::Plant)?;
            let delivery = match consumers {
                0 => Delivery::Realtime,
                consumers => Delivery::Lockstep {
                    consumers: consumers as usize,
                    limit: limit(timeout_ms),
                },
            };
            let mut samples = SamplePublisher::new(&bus, delivery, Arc::new(AtomicBool::new(false)))?;
            samples.wait_for_consumers()?;
            Ok(Machine {
                samples,
                _only_one: only_one,
                joints,
                // a number that no earlier start of this machine had, and never 0
                stream_id: (monotonic_ns() ^ u64::from(std::process::id()) << 40).max(1),
                next_seq: 0,
                has_ended: false,
            })
        })
    }
}

/// Sends a sample.
///
/// # Safety
/// `machine` was opened and is used by one thread at a time; `sample` may be read and written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_machine_publish(machine: *mut Machine, sample: *mut Sample) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let (machine, sample) = unsafe { (machine.as_mut(), sample.as_mut()) };
        let (Some(machine), Some(sample)) = (machine, sample) else {
            return Err(Failure::invalid("expected a machine and a sample, got a null pointer"));
        };
        if machine.has_ended {
            return Err(Failure::invalid(
                "the last sample has been published; open a machine anew for another stream",
            ));
        }
        (sample.stream_id, sample.seq, sample.joints, sample.pad) =
            (machine.stream_id, machine.next_seq, machine.joints, 0);
        if sample.t_ns == u64::MAX {
            sample.t_ns = monotonic_ns();
        }
        machine.samples.send(sample)?;
        machine.samples.wake();
        machine.next_seq += 1;
        machine.has_ended = sample.flags & sample_flags::END != 0;
        Ok(OK)
    })
}

/// Leaves samples out.
///
/// # Safety
/// `machine` was opened and is used by one thread at a time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_machine_skip(machine: *mut Machine, samples: u64) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let machine = unsafe { machine.as_mut() };
        let machine = machine.ok_or_else(|| Failure::invalid("expected a machine, got a null pointer"))?;
        machine.next_seq = machine.next_seq.saturating_add(samples);
        Ok(OK)
    })
}

/// Gives consumers a moment, then leaves.
///
/// # Safety
/// `machine` is null or was opened, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_machine_close(machine: *mut Machine) {
    // SAFETY: as the caller promises
    if let Some(machine) = unsafe { machine.as_mut() } {
        guarded(|| {
            if machine.next_seq > 0 {
                machine.samples.linger()?;
            }
            Ok(OK)
        });
    }
    // SAFETY: as the caller promises
    unsafe { take_back(machine) };
}
