//! Exit codes, and the one place where a program ends.

use super::failure::{Exit, Failure};
use super::{CommonArgs, logging};
use crate::runner::{Shutdown, TOGETHER};
use std::process::ExitCode;
use std::time::Duration;

/// The end of every `--help`.
pub const EXIT_CODES: &str = "Exit codes:\n  \
    0    done, or a service ended by a signal\n  \
    1    failed\n  \
    2    wrong usage or configuration, or too few samples for a block\n  \
    3    finished, but data were lost or rejected, or a signal ended `identify` early\n  \
    130  ended by a second signal, half a second or more after the first";

/// Exit code of a launched process that was [interrupted](Exit::Interrupted): 128 + SIGTERM, as in
/// a shell.
pub(super) const INTERRUPTED: u8 = 143;
/// A launched process gets every signal from its launcher, or from the kernel when the launcher
/// dies: once per thread of the launcher, which may take a while on a busy machine. A process that
/// is still running after this time receives SIGKILL from its launcher.
const LAUNCHED_TOGETHER: Duration = Duration::from_secs(10);

/// Logging, signals, the program, its exit code.
pub fn main_with(common: &CommonArgs, program: impl FnOnce(&Shutdown) -> Result<Exit, Failure>) -> ExitCode {
    let quietest = match (common.draws, common.is_launched()) {
        (true, _) => "error",
        (_, true) => "warn",
        _ => "info",
    };
    logging::start(common.log_format, quietest);
    let together = match common.is_launched() {
        true => LAUNCHED_TOGETHER,
        false => TOGETHER,
    };
    let outcome = Shutdown::on_signals(together)
        .map_err(Failure::from)
        .and_then(|shutdown| program(&shutdown));
    match outcome {
        Ok(Exit::Interrupted) if common.is_launched() => ExitCode::from(INTERRUPTED),
        Ok(Exit::Done | Exit::Interrupted) => ExitCode::SUCCESS,
        Ok(Exit::DataLoss) => ExitCode::from(3),
        Err(failure) => {
            logging::failure(common.log_format, &failure.to_string());
            ExitCode::from(match failure {
                Failure::Failed(_) => 1,
                Failure::Usage(_) => 2,
            })
        }
    }
}
