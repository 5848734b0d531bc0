//! What a model lacks, in words that fit a status.

use crate::estimator::Suspicion;
use crate::messages::{ERROR_TEXT, ErrorCode, FixedText, LastError};
use crate::rows::{Suspect, SuspectKind};
use std::fmt::{self, Write as _};

/// "Coulomb friction at joint 1 would explain 80 % of the misfit (0.33 V)". Rounded, so that the
/// words change only with the matter.
pub fn error(suspect: &Suspect, suspicion: &Suspicion, seq: u64) -> LastError {
    let share = 10.0 * (10.0 * suspicion.share).round();
    let what = format_args!("{:.0} % of the misfit", share.max(10.0));
    explanation(suspect, suspicion.amplitude, what, seq)
}

/// "another drive gain at joint 1 would explain the change (-5.0 %)".
pub fn fault(suspect: &Suspect, suspicion: &Suspicion, seq: u64) -> LastError {
    explanation(suspect, suspicion.amplitude, format_args!("the change"), seq)
}

/// "most of theta_9's std may be an input delay and others, unseen".
pub fn limit(parameter: &str, suspect: &Suspect, seq: u64) -> LastError {
    let mut words = FixedText::<ERROR_TEXT>::default();
    let _cut = write!(words, "most of {parameter}'s std may be {suspect} and others, unseen");
    LastError::with_text(ErrorCode::Misfit, seq, words.as_str())
}

fn explanation(suspect: &Suspect, amplitude: f64, what: fmt::Arguments<'_>, seq: u64) -> LastError {
    let mut words = FixedText::<ERROR_TEXT>::default();
    // longer words than fit are cut, which is what an error means here
    let _cut = write!(words, "{suspect} would explain {what}").and_then(|()| match suspect.kind {
        SuspectKind::InputDelay => write!(words, " ({:.0} us)", 1e6 * amplitude),
        // two masses of unknown ratio: the amplitude is no frequency; a spring's has a long unit
        SuspectKind::Resonance | SuspectKind::Spring => Ok(()),
        SuspectKind::Gain | SuspectKind::Scale | SuspectKind::Clock => write!(words, " ({:+.1} %)", 100.0 * amplitude),
        // one digit, so that the words change only with the matter
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

#[cfg(test)]
mod tests {
    use super::*;

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
                largest: 1.0,
            };
            let error = error(&suspect, &suspicion, 9);
            assert!(
                error.words().contains("would explain 80 % of the misfit"),
                "{}",
                error.words()
            );
            assert!(error.words().len() < 100 && error.code == ErrorCode::Misfit as u32);
            assert!(super::limit("theta_9", &suspect, 9).words().ends_with(", unseen"));
            let fault = fault(&suspect, &suspicion, 9);
            assert!(fault.words().contains("would explain the change"), "{}", fault.words());
        }
    }
}
