//! Differences in a process started by `thetabus run`.

use super::{CommonArgs, Failure};
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::Signal;
use nix::unistd::getppid;

/// Makes the kernel send SIGTERM to this process when its launcher dies, even by kill -9.
pub(super) fn follow_launcher(common: &CommonArgs) -> Result<(), Failure> {
    let Some(launcher) = common.launched.launched_by else {
        return Ok(());
    };
    set_pdeathsig(Signal::SIGTERM).map_err(|e| Failure::Failed(format!("cannot follow the launcher: {e}")))?;
    // The launcher may have died before this call.
    if getppid().as_raw().cast_unsigned() == launcher {
        Ok(())
    } else {
        Err(Failure::Failed(format!("the launcher, process {launcher}, has gone")))
    }
}
