//! Status texts about errors that a model lacks.

use crate::estimator::{Cause, Suspicion};
use crate::messages::{ERROR_TEXT, ErrorCode, FixedText, LastError};
use crate::rows::{Suspect, SuspectKind};
use std::fmt::{self, Write as _};

/// "Coulomb friction at joint 1 would explain 80 % of the misfit (0.33 V)". Rounded, so that the
/// text does not change with every block.
pub fn error(suspect: &Suspect, suspicion: &Suspicion, seq: u64) -> LastError {
    let share = 10.0 * (10.0 * suspicion.share).round();
    let what = format_args!("{:.0} % of the misfit", share.max(10.0));
    explanation("", suspect, suspicion.amplitude, what, seq)
}

/// "another drive gain at joint 1 would explain the change (-5.0 %)", after "changed parameters or"
/// if these explain it as well.
pub fn fault(suspect: &Suspect, cause: &Cause, seq: u64) -> LastError {
    let before = if cause.or_parameters {
        "changed parameters or "
    } else {
        ""
    };
    explanation(before, suspect, cause.error.amplitude, format_args!("the change"), seq)
}

/// "theta_9's std covers unseen errors, mostly an input delay".
pub fn limit(parameter: &str, suspect: &Suspect, seq: u64) -> LastError {
    let mut words = FixedText::<ERROR_TEXT>::default();
    let _cut =
        write!(words, "{parameter}'s std covers unseen errors, mostly ").and_then(|()| suspect.write(1.0, &mut words));
    LastError::with_text(ErrorCode::Misfit, seq, words.as_str())
}

fn explanation(before: &str, suspect: &Suspect, amplitude: f64, what: fmt::Arguments<'_>, seq: u64) -> LastError {
    let mut words = FixedText::<ERROR_TEXT>::default();
    // an error only means that the text was truncated
    let cause = words
        .write_str(before)
        .and_then(|()| suspect.write(amplitude, &mut words));
    let _cut = cause
        .and_then(|()| write!(words, " would explain {what}"))
        .and_then(|()| match suspect.kind {
            SuspectKind::InputDelay => write!(words, " ({:.0} us)", 1e6 * amplitude),
            // with two masses of unknown ratio the amplitude gives no frequency; those of a spring
            // and of an inertia have long units
            SuspectKind::Resonance
            | SuspectKind::Spring
            | SuspectKind::Inertia
            | SuspectKind::Viscous
            | SuspectKind::ViscousByDirection => Ok(()),
            SuspectKind::Gain
            | SuspectKind::GainByDirection
            | SuspectKind::LoadFriction
            | SuspectKind::Scale
            | SuspectKind::Clock => {
                write!(words, " ({:+.1} %)", 100.0 * amplitude)
            }
            // one digit, so that the text does not change with every block
            SuspectKind::Drift => write!(words, " ({amplitude:.0e} per second)"),
            SuspectKind::Coulomb
            | SuspectKind::Stribeck
            | SuspectKind::Offset
            | SuspectKind::DeadBand
            | SuspectKind::Eccentricity
            | SuspectKind::Zero => write!(words, " ({:.1e} {})", amplitude.abs(), suspect.unit),
        });
    LastError::with_text(ErrorCode::Misfit, seq, words.as_str())
}

/// The identifier's text about an error that the model lacks; outside the state `misfit` the
/// residuals show the error but are within their limit.
pub fn lacking_words(words: &str, is_misfit: bool) -> String {
    match words.split_once(" of the misfit") {
        Some((cause, size)) if !is_misfit => format!("too little for a misfit: {cause} of it{size}"),
        _ => words.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_what_residuals_show_is_no_misfit_without_that_state() {
        let words = "an input delay would explain 100 % of the misfit (-2 us)";
        assert_eq!(lacking_words(words, true), words);
        assert_eq!(
            lacking_words(words, false),
            "too little for a misfit: an input delay would explain 100 % of it (-2 us)"
        );
    }

    #[test]
    fn prop_every_cause_has_words_that_fit() {
        let suspicion = Suspicion {
            suspect: 2,
            drifting: None,
            amplitude: 1.5e-4,
            deviations: 12.0,
            share: 0.83,
        };
        for kind in [
            SuspectKind::InputDelay,
            SuspectKind::Gain,
            SuspectKind::Coulomb,
            SuspectKind::Stribeck,
            SuspectKind::Offset,
            SuspectKind::DeadBand,
            SuspectKind::Spring,
            SuspectKind::GainByDirection,
            SuspectKind::ViscousByDirection,
            SuspectKind::LoadFriction,
            SuspectKind::Inertia,
            SuspectKind::Viscous,
            SuspectKind::Eccentricity,
            SuspectKind::Resonance,
            SuspectKind::Zero,
            SuspectKind::Scale,
            SuspectKind::Clock,
            SuspectKind::Drift,
        ] {
            let suspect = Suspect {
                kind,
                parameter: (kind == SuspectKind::Drift).then_some("inertia_8"),
                joint: (kind != SuspectKind::InputDelay).then_some(7),
                unit: "N m",
                smallest: 0.0,
                largest: 1.0,
            };
            let error = error(&suspect, &suspicion, 9);
            assert!(
                error.words().contains("would explain 80 % of the misfit"),
                "{}",
                error.words()
            );
            assert!(error.words().len() < ERROR_TEXT && error.code == ErrorCode::Misfit as u32);
            assert!(super::limit("coulomb_friction_2", &suspect, 9).words().len() < ERROR_TEXT);
            for (or_parameters, first) in [(false, ""), (true, "changed parameters or ")] {
                let cause = Cause {
                    error: suspicion,
                    or_parameters,
                };
                let fault = fault(&suspect, &cause, 9);
                let words = fault.words();
                assert!(
                    words.starts_with(first) && words.contains("would explain the change"),
                    "{words}"
                );
            }
        }
    }

    #[test]
    fn regress_friction_that_bends_either_way_is_not_said_to_fall_with_speed() {
        let stribeck = Suspect {
            kind: SuspectKind::Stribeck,
            parameter: None,
            joint: Some(0),
            unit: "V",
            smallest: 0.0,
            largest: 1.0,
        };
        for (amplitude, words) in [
            (0.2, "friction not linear in speed (Stribeck, drag) at joint 1 would"),
            (-0.2, "friction that is low at low speed at joint 1 would"),
        ] {
            let suspicion = Suspicion {
                suspect: 2,
                drifting: None,
                amplitude,
                deviations: 12.0,
                share: 0.83,
            };
            let error = error(&stribeck, &suspicion, 9);
            assert!(error.words().starts_with(words), "{}", error.words());
        }
    }
}
