//! Commands to an identifier.

use crate::{Failure, OK, guarded, hand_out, join, limit, take_back, text};
use std::ffi::c_char;
use thetabus::bus::ControlClient;
use thetabus::messages::{Command, Request, Response, response_code};

/// Finds the identifier of a robot.
///
/// # Safety
/// Texts are null or end with a zero; `out` may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_control_open(
    domain: *const c_char,
    robot: *const c_char,
    out: *mut *mut ControlClient,
) -> i32 {
    // SAFETY: as the caller promises
    unsafe {
        hand_out(out, || {
            let (_, bus) = join(domain, robot)?;
            Ok(ControlClient::new(&bus)?)
        })
    }
}

/// Sends a command and waits for its answer.
///
/// # Safety
/// `control` was opened and is used by one thread at a time; `name` is null or ends with a zero;
/// `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_control_ask(
    control: *mut ControlClient,
    command: u32,
    name: *const c_char,
    value: f64,
    from_seq: u64,
    out: *mut Response,
    timeout_ms: i32,
) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let control = unsafe { control.as_ref() };
        let control = control.ok_or_else(|| Failure::invalid("expected a control, got a null pointer"))?;
        let known = Command::from_wire(command)
            .filter(|command| command.is_plain())
            .ok_or_else(|| {
                Failure::invalid(format!(
                    "command: expected 1 to 8, got {command}; declare a payload with thetabus_control_payload()"
                ))
            })?;
        let mut request = Request::new(known);
        if !name.is_null() {
            // SAFETY: not null, and as the caller promises
            request = request.named(unsafe { text(name) }?);
        }
        // NaN is no value of anything
        if !value.is_nan() {
            request = request.with_value(value);
        }
        request.from_seq = from_seq;
        // SAFETY: as the caller promises
        unsafe { answered(control, &request, out, timeout_ms) }
    })
}

/// Asks, and hands the answer out.
///
/// # Safety
/// `out` is null or may be written to.
unsafe fn answered(
    control: &ControlClient,
    request: &Request,
    out: *mut Response,
    timeout_ms: i32,
) -> Result<i32, Failure> {
    let response = control.ask(request, limit(timeout_ms))?;
    if !out.is_null() {
        // SAFETY: not null, and as the caller promises
        unsafe { out.write(response) };
    }
    match response.code {
        response_code::DONE => Ok(OK),
        _ => Err(Failure::refused(response.text())),
    }
}

/// Says what the flange of a robot carries.
///
/// # Safety
/// `control` was opened and is used by one thread at a time; `center_m` is null or has three
/// numbers, `inertia_kg_m2` is null or has six; `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_control_payload(
    control: *mut ControlClient,
    mass_kg: f64,
    center_m: *const [f64; 3],
    inertia_kg_m2: *const [f64; 6],
    out: *mut Response,
    timeout_ms: i32,
) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let (control, center, inertia) = unsafe { (control.as_ref(), center_m.as_ref(), inertia_kg_m2.as_ref()) };
        let control = control.ok_or_else(|| Failure::invalid("expected a control, got a null pointer"))?;
        let request = Request::load(mass_kg, center.copied().unwrap_or_default(), inertia.copied());
        // SAFETY: as the caller promises
        unsafe { answered(control, &request, out, timeout_ms) }
    })
}

/// Leaves.
///
/// # Safety
/// `control` is null or was opened, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_control_close(control: *mut ControlClient) {
    // SAFETY: as the caller promises
    unsafe { take_back(control) };
}
