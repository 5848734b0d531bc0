//! Readers of the topics.

use crate::{Failure, OK, TIMEOUT, guarded, hand_out, join, limit, take_back};
use std::ffi::c_char;
use std::time::Duration;
use thetabus::bus::{Bus, BusError, Latched, SampleSubscriber, Subscriber};
use thetabus::messages::{Description, Estimate, MachineCommand, Sample, Status};

/// What every reader can do.
trait Reads: Sized {
    type Message: Copy;
    fn open(bus: &Bus) -> Result<Self, BusError>;
    fn take(&mut self, limit: Duration) -> Result<Option<(Self::Message, u64)>, BusError>;
}

impl<T: Latched> Reads for Subscriber<T> {
    type Message = T;
    fn open(bus: &Bus) -> Result<Self, BusError> {
        Self::new(bus)
    }
    fn take(&mut self, limit: Duration) -> Result<Option<(T, u64)>, BusError> {
        self.next(limit)
    }
}

impl Reads for SampleSubscriber {
    type Message = Sample;
    fn open(bus: &Bus) -> Result<Self, BusError> {
        Self::new(bus)
    }
    fn take(&mut self, limit: Duration) -> Result<Option<(Sample, u64)>, BusError> {
        self.next(limit)
    }
}

/// # Safety
/// As of the exported functions.
unsafe fn open<R: Reads>(domain: *const c_char, robot: *const c_char, out: *mut *mut R) -> i32 {
    // SAFETY: as the caller promises
    unsafe {
        hand_out(out, || {
            let (_, bus) = join(domain, robot)?;
            Ok(R::open(&bus)?)
        })
    }
}

/// # Safety
/// As of the exported functions.
unsafe fn next<R: Reads>(reader: *mut R, out: *mut R::Message, sent_ns: *mut u64, timeout_ms: i32) -> i32 {
    guarded(|| {
        // SAFETY: as the caller promises
        let reader = unsafe { reader.as_mut() };
        let reader = reader.ok_or_else(|| Failure::invalid("expected a reader, got a null pointer"))?;
        if out.is_null() {
            return Err(Failure::invalid("expected a place for the message, got a null pointer"));
        }
        let Some((message, sent)) = reader.take(limit(timeout_ms))? else {
            return Ok(TIMEOUT);
        };
        // SAFETY: not null, and as the caller promises; sent_ns may be null
        unsafe {
            out.write(message);
            if !sent_ns.is_null() {
                sent_ns.write(sent);
            }
        }
        Ok(OK)
    })
}

macro_rules! reader {
    ($port:ty, $message:ty, $open:ident, $next:ident, $close:ident) => {
        /// Opens a reader.
        ///
        /// # Safety
        /// Texts are null or end with a zero; `out` may be written to.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $open(domain: *const c_char, robot: *const c_char, out: *mut *mut $port) -> i32 {
            // SAFETY: as the caller promises
            unsafe { open(domain, robot, out) }
        }

        /// Waits for the next message.
        ///
        /// # Safety
        /// `reader` was opened and is used by one thread at a time; `out` may be written to,
        /// `sent_ns`, too, or is null.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $next(
            reader: *mut $port,
            out: *mut $message,
            sent_ns: *mut u64,
            timeout_ms: i32,
        ) -> i32 {
            // SAFETY: as the caller promises
            unsafe { next(reader, out, sent_ns, timeout_ms) }
        }

        /// Closes a reader.
        ///
        /// # Safety
        /// `reader` is null or was opened, and is not used again.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $close(reader: *mut $port) {
            // SAFETY: as the caller promises
            unsafe { take_back(reader) };
        }
    };
}

reader!(
    Subscriber<Estimate>,
    Estimate,
    thetabus_estimates_open,
    thetabus_estimates_next,
    thetabus_estimates_close
);
reader!(
    Subscriber<Status>,
    Status,
    thetabus_statuses_open,
    thetabus_statuses_next,
    thetabus_statuses_close
);
reader!(
    Subscriber<Description>,
    Description,
    thetabus_descriptions_open,
    thetabus_descriptions_next,
    thetabus_descriptions_close
);
reader!(
    SampleSubscriber,
    Sample,
    thetabus_samples_open,
    thetabus_samples_next,
    thetabus_samples_close
);
reader!(
    Subscriber<MachineCommand>,
    MachineCommand,
    thetabus_commands_open,
    thetabus_commands_next,
    thetabus_commands_close
);
