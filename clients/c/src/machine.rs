//! A machine that publishes its samples.

use crate::{Failure, OK, guarded, hand_out, limit, place};
use std::ffi::c_char;
use thetabus::bus::{Delivery, Machine, monotonic_ns};
use thetabus::messages::Sample;

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
            let (domain, robot) = place(domain, robot)?;
            let delivery = match consumers {
                0 => Delivery::Realtime,
                consumers => Delivery::Lockstep {
                    consumers: consumers as usize,
                    limit: limit(timeout_ms),
                },
            };
            Ok(Machine::delivering(&domain, robot, joints as usize, delivery)?)
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
        if sample.t_ns == u64::MAX {
            sample.t_ns = monotonic_ns();
        }
        machine.send(sample)?;
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
        machine.skip(samples);
        Ok(OK)
    })
}

/// Gives consumers a moment, then leaves.
///
/// # Safety
/// `machine` is null or was opened, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_machine_close(machine: *mut Machine) {
    if !machine.is_null() {
        guarded(|| {
            // SAFETY: not null, and as the caller promises
            let machine = unsafe { Box::from_raw(machine) };
            machine.close()?;
            Ok(OK)
        });
    }
}
