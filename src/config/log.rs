//! Section `[log]`: the meaning of a log file's columns.

use super::check::Check;
use super::choice::Choice;
use super::schema::FileForm;
use super::sections::LogColumns;
use crate::node::model::SharedModel;

pub(super) fn log(form: &FileForm, model: Option<&SharedModel>, check: &mut Check<'_>) -> LogColumns {
    let section = &form.log;
    // Metres taken for radians would be used unchanged, and nothing in the result would show it.
    if let Some(model) = model.filter(|_| !section.q.is_empty()) {
        let definition = model.definition();
        let linear = definition.position_unit == "m";
        if !definition.is_mixed() && linear != section.position_unit.is_length() {
            let (axis, units) = match linear {
                true => ("moves along a line", "\"m\", \"mm\" or \"um\""),
                false => ("turns", "\"rad\", \"deg\" or \"turn\""),
            };
            // The key that says so is often set elsewhere than the unit.
            let by = match form.model.kind.as_str() {
                "servo_axis" => format!(" (model.servo_axis.motion = \"{}\")", form.servo_axis.motion.word()),
                _ => String::new(),
            };
            let message = format!(
                "expected {units}, since the model {axis}{by}, got \"{}\"",
                section.position_unit.word()
            );
            check.wrong(check.culprit(&["log.position_unit", "log.q"]), message);
        }
    }
    if section.input_unit == 0.0 {
        check.wrong("log.input_unit", "expected a number that is not 0, got 0");
    }
    let turns = model.map_or(&[][..], |model| &model.definition().turns);
    let unit_of = |joint: usize| section.position_unit.of_joint(turns, joint).si();
    LogColumns {
        time: section.time.clone(),
        time_unit_s: section.time_unit.seconds(),
        positions: section.q.clone(),
        position_units: (0..section.q.len()).map(unit_of).collect(),
        inputs: section.input.clone(),
        input_unit: section.input_unit,
        setpoints: section.setpoint.clone(),
    }
}
