//! How the input runs between samples, which the identifier and the simulated controller must agree
//! on.
//!
//! Either mistaken for the other acts half a sample period early or late, 0.5 ms at 1 kHz. Under
//! `config/encoder_only.toml`, one mass, that costs 435 % of θ₃ and 18 % of θ₉ if the analog
//! controller is taken for a sampled one, all of θ₃ and 19 % of θ₉ the other way round.

use super::check::Check;
use super::choice::Choice;
use super::schema::{FileForm, MachineKind, RowsKind};
use crate::rows::InputTiming;
use crate::sim::ControllerKind;

const KIND: &str = "plant.controller.kind";
const TIMING: &str = "identifier.projected.timing";

/// The timing follows a stated controller if it is not stated itself; if both are, they must agree.
/// Without a word on the controller the identifier may stand beside a machine that nobody
/// simulates. A machine of the model's own equations has another controller.
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
    // What a recording says is there to be read, whatever was simulated then.
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
