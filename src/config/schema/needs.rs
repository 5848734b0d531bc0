//! Keys that have an effect only if another key has a certain value.

use super::super::choice::Choice;
use super::estimator::{BoundsKind, OutliersKind};
use super::identifier::{InputKind, RowsKind};
use super::plant::MachineKind;
use super::setpoint::SetpointKind;

/// The condition for a key to have an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Need {
    /// The key that makes the choice.
    pub key: &'static str,
    /// Its required value.
    pub wanted: &'static str,
}

/// Keys and sections with the choice that they belong to; those of `plant.setpoint` follow from
/// their names.
fn table() -> [(&'static [&'static str], &'static str, &'static str); 11] {
    [
        (
            &[
                "identifier.proportional_gain_v_per_rad",
                "identifier.derivative_gain_v_s_per_rad",
            ],
            "identifier.input",
            InputKind::Controller.word(),
        ),
        (
            &["identifier.projected", "identifier.considered"],
            "identifier.rows",
            RowsKind::Projected.word(),
        ),
        (&["plant.arm", "plant.mass_2"], "plant.machine", MachineKind::Arm.word()),
        (&["plant.servo_axis"], "plant.machine", MachineKind::ServoAxis.word()),
        (&["plant.model"], "plant.machine", MachineKind::Model.word()),
        (&["model.coulomb_friction", "model.offset"], "model.kind", "manipulator"),
        (&["model.servo_axis"], "model.kind", "servo_axis"),
        (
            &["estimator.lower", "estimator.upper"],
            "estimator.bounds",
            BoundsKind::Listed.word(),
        ),
        (
            &["estimator.huber_limit"],
            "estimator.outliers",
            OutliersKind::Huber.word(),
        ),
        (
            &["estimator.gate_limit"],
            "estimator.outliers",
            OutliersKind::Gate.word(),
        ),
        (
            &["estimator.false_alarm_rate", "estimator.change_margin_s"],
            "estimator.change_detection",
            "true",
        ),
    ]
}

impl Need {
    /// The condition for this key; `None` if it always has an effect.
    pub fn of(section: &str, name: &str) -> Option<Self> {
        if let Some(kind) = section.strip_prefix("plant.setpoint.") {
            let wanted = SetpointKind::WORDS.iter().find(|word| **word == kind)?;
            return Some(Self {
                key: "plant.setpoint.kind",
                wanted,
            });
        }
        let is_meant = |what: &&str| match what.strip_prefix(section) {
            Some("") => true,
            Some(rest) => rest.strip_prefix('.') == Some(name),
            None => false,
        };
        let table = table();
        let (_, key, wanted) = table.iter().find(|(what, ..)| what.iter().any(is_meant))?;
        Some(Self { key, wanted })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::kind::Kind;
    use super::super::{key, keys};
    use super::*;

    #[test]
    fn regress_every_need_names_keys_and_words_that_exist() {
        for (what, choice, wanted) in table() {
            for what in what {
                assert!(key(what).is_some() || keys().any(|key| key.section == *what), "{what}");
            }
            match key(choice).expect(choice).kind {
                Kind::Choice(words) => assert!(words.contains(&wanted), "{choice} {wanted}"),
                Kind::Flag => assert!(["true", "false"].contains(&wanted), "{choice} {wanted}"),
                kind => assert_eq!(kind, Kind::Name, "{choice}"),
            }
        }
        for word in SetpointKind::WORDS {
            let section = format!("plant.setpoint.{word}");
            let inside = keys().find(|key| key.section == section).expect(word);
            assert_eq!(Need::of(&section, inside.name).map(|need| need.wanted), Some(*word));
        }
    }
}
