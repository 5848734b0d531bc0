//! Behaviour of the input between samples, on which identifier and simulated controller must agree.
//!
//! Confusing the two shifts the input by half a sample period, which acts as a delay of 0.5 ms at
//! 1 kHz (docs/encoder-results.md, "An input that acts late").

use super::check::Check;
use super::choice::Choice;
use super::schema::{FileForm, MachineKind, RowsKind};
use crate::rows::InputTiming;
use crate::sim::ControllerKind;

const KIND: &str = "plant.controller.kind";
const TIMING: &str = "identifier.projected.timing";

/// If the timing is not stated, it follows a stated controller; if both are stated, they must
/// agree. If the controller is not stated, the identifier may be used with a real machine. A
/// machine of the model's own equations has another controller.
pub(super) fn decide_on_timing(form: &mut FileForm, check: &mut Check<'_>) {
    let simulated = matches!(form.plant.machine, MachineKind::Arm | MachineKind::ServoAxis);
    let Some(kind) = form.controller.kind else { return };
    if form.identifier.rows != RowsKind::Projected || !simulated {
        return;
    }
    let (timing, other, means) = match kind {
        ControllerKind::Analog => (InputTiming::Continuous, ControllerKind::Sampled, "runs on"),
        ControllerKind::Sampled => (InputTiming::Held, ControllerKind::Analog, "is held"),
    };
    if form.projected.timing == timing || !check.stated(TIMING) {
        form.projected.timing = timing;
        return;
    }
    // A recording's settings are accepted regardless of what was simulated.
    if [KIND, TIMING, "identifier.rows"].iter().all(|key| check.recorded(key)) {
        form.controller.kind = None;
        return;
    }
    let message = format!(
        "expected {wanted:?}, because the input {means} between samples under {KIND} = {:?} ({}), got {:?}: set {TIMING} = {wanted:?}, or {KIND} = {:?}; \
         beside a real machine leave {KIND} out",
        kind.word(),
        check.layers.origin(KIND),
        form.projected.timing.word(),
        other.word(),
        wanted = timing.word(),
    );
    check.wrong(TIMING, message);
}
