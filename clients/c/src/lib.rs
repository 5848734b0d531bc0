//! thetabus for C: the functions of `include/thetabus.h`. What they mean is written there; what
//! they share is here.
//!
//! A handle is a box of a port with the bus that it joined. Every function catches panics, writes
//! its error's words to a text of the calling thread, and returns a code.

mod control;
mod controller;
mod error;
pub mod header;
mod machine;
mod reader;

pub use control::*;
pub use controller::*;
pub use error::*;
pub use machine::*;
pub use reader::*;

use std::ffi::{CStr, c_char};
use std::time::Duration;
use thetabus::bus::{Bus, Domain};
use thetabus::messages::{Description, Estimate};

/// Version of the library, `0.2.0`.
#[unsafe(no_mangle)]
pub extern "C" fn thetabus_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Schema version of the messages.
#[unsafe(no_mangle)]
pub extern "C" fn thetabus_schema_version() -> u32 {
    thetabus::messages::SCHEMA_VERSION
}

/// CLOCK_MONOTONIC \[ns\].
#[unsafe(no_mangle)]
pub extern "C" fn thetabus_monotonic_ns() -> u64 {
    thetabus::bus::monotonic_ns()
}

/// 1 if parameter `index`, from 0, may be used, else 0.
///
/// # Safety
/// `estimate` is null or points to an estimate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_is_usable(estimate: *const Estimate, index: u32) -> i32 {
    // SAFETY: as the caller promises
    unsafe { estimate.as_ref() }.map_or(0, |estimate| i32::from(estimate.is_usable(index as usize)))
}

/// Index of the parameter of this name, from 0, or -1.
///
/// # Safety
/// `description` is null or points to a description, `name` is null or a text that ends with a
/// zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn thetabus_find_parameter(description: *const Description, name: *const c_char) -> i32 {
    // SAFETY: as the caller promises
    let (description, name) = unsafe { (description.as_ref(), text(name)) };
    let (Some(description), Ok(name)) = (description, name) else {
        return -1;
    };
    let found = description.parameters().iter().position(|p| p.name() == name);
    found.map_or(-1, |index| index as i32)
}

/// A text of the caller's.
///
/// # Safety
/// `text` is null or ends with a zero.
unsafe fn text<'a>(text: *const c_char) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::invalid("expected a text, got a null pointer"));
    }
    // SAFETY: as the caller promises
    let bytes = unsafe { CStr::from_ptr(text) };
    bytes.to_str().map_err(|_| Failure::invalid("expected a text in UTF-8"))
}

/// A domain and a robot by their names; a null pointer means the default of either.
///
/// # Safety
/// Each text is null or ends with a zero.
unsafe fn place<'a>(domain: *const c_char, robot: *const c_char) -> Result<(Domain, &'a str), Failure> {
    let or = |pointer: *const c_char, default: &'static str| match pointer.is_null() {
        true => Ok(default),
        // SAFETY: as the caller promises
        false => unsafe { text(pointer) },
    };
    Ok((Domain::new(or(domain, "default")?)?, or(robot, "arm")?))
}

/// Joins a domain for a robot.
///
/// # Safety
/// See [`place`].
unsafe fn join(domain: *const c_char, robot: *const c_char) -> Result<(Domain, Bus), Failure> {
    // SAFETY: as the caller promises
    let (domain, robot) = unsafe { place(domain, robot)? };
    let bus = Bus::join(&domain, robot, "c_client")?;
    Ok((domain, bus))
}

/// A limit in ms; below 0 for ever.
fn limit(timeout_ms: i32) -> Duration {
    u64::try_from(timeout_ms).map_or(Duration::MAX, Duration::from_millis)
}

/// Hands a handle to the caller.
///
/// # Safety
/// `out` is null or may be written to.
unsafe fn hand_out<T>(out: *mut *mut T, make: impl FnOnce() -> Result<T, Failure>) -> i32 {
    guarded(|| {
        if out.is_null() {
            return Err(Failure::invalid("expected a place for the handle, got a null pointer"));
        }
        // SAFETY: not null, and as the caller promises
        unsafe { out.write(std::ptr::null_mut()) };
        let handle = Box::new(make()?);
        // SAFETY: as above
        unsafe { out.write(Box::into_raw(handle)) };
        Ok(OK)
    })
}

/// Ends a handle; null is none.
///
/// # Safety
/// `handle` is null or was handed out, and is not used again.
unsafe fn take_back<T>(handle: *mut T) {
    if !handle.is_null() {
        guarded(|| {
            // SAFETY: as the caller promises
            drop(unsafe { Box::from_raw(handle) });
            Ok(OK)
        });
    }
}
