//! A controller that sends feed-forward to a machine.

use crate::{Failure, OK, guarded, hand_out, join, take_back};
use std::ffi::c_char;
use thetabus::bus::{Publisher, Role, RoleLock};
use thetabus::messages::MachineCommand;

/// A controller on the bus.
pub struct Controller {
    commands: Publisher<MachineCommand>,
    _only_one: RoleLock,
}

/// Takes the place of a robot's controller.
///
/// # Safety
/// Texts are null or end with a zero; `out` may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_controller_open(
    domain: *const c_char,
    robot: *const c_char,
    out: *mut *mut Controller,
) -> i32 {
    // SAFETY: as the caller promises
    unsafe {
        hand_out(out, || {
            let (domain, bus) = join(domain, robot)?;
            let only_one = RoleLock::acquire(&domain, bus.robot(), Role::Controller)?;
            Ok(Controller {
                commands: Publisher::new(&bus)?,
                _only_one: only_one,
            })
        })
    }
}

/// Sends a command.
///
/// # Safety
/// `controller` was opened and is used by one thread at a time; `command` may be read.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_controller_send(controller: *mut Controller, command: *const MachineCommand) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let (controller, command) = unsafe { (controller.as_mut(), command.as_ref()) };
        let (Some(controller), Some(command)) = (controller, command) else {
            return Err(Failure::invalid(
                "expected a controller and a command, got a null pointer",
            ));
        };
        controller.commands.send(command)?;
        Ok(OK)
    })
}

/// Leaves.
///
/// # Safety
/// `controller` is null or was opened, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_controller_close(controller: *mut Controller) {
    // SAFETY: as the caller promises
    unsafe { take_back(controller) };
}
