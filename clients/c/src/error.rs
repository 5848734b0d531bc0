//! Codes, and the words of the last error of each thread.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use thetabus::bus::BusError;

/// Done.
pub const OK: i32 = 0;
/// Nothing came within the limit.
pub const TIMEOUT: i32 = 1;
/// The bus failed; the words say what to do.
pub const ERROR: i32 = 2;
/// A wrong argument.
pub const INVALID: i32 = 3;
/// The identifier refused a command, or could not do it.
pub const REFUSED: i32 = 4;

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Why a function did not do what it should.
pub(crate) struct Failure {
    code: i32,
    words: String,
}

impl Failure {
    pub(crate) fn invalid(words: impl Into<String>) -> Self {
        Self {
            code: INVALID,
            words: words.into(),
        }
    }

    pub(crate) fn refused(words: &str) -> Self {
        Self {
            code: REFUSED,
            words: words.to_owned(),
        }
    }
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Self {
        let code = match error {
            BusError::Machine { .. } => INVALID,
            _ => ERROR,
        };
        Self {
            code,
            words: error.to_string(),
        }
    }
}

/// Runs `act`; keeps the words of its failure, and of a panic.
pub(crate) fn guarded(act: impl FnOnce() -> Result<i32, Failure>) -> i32 {
    let outcome = catch_unwind(AssertUnwindSafe(act)).unwrap_or_else(|_| {
        Err(Failure {
            code: ERROR,
            words: "a defect in the library; please report it".to_owned(),
        })
    });
    outcome.unwrap_or_else(|failure| {
        let words = CString::new(failure.words.replace('\0', " ")).unwrap_or_default();
        LAST.with(|last| *last.borrow_mut() = words);
        failure.code
    })
}

/// Words of the last error of this thread; they stay until the next one.
#[unsafe(no_mangle)]
pub extern "C" fn thetabus_last_error() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}
