//! Texts that explain the states of an estimate.

use crate::estimator::{LEAST_EXPLAINED, MISFIT};
use crate::messages::Estimate;

/// Share of an input's power below which a model has little to do with the machine.
const MEANINGLESS: f64 = 0.5;

/// Why an estimate is in the state `misfit`, as far as it shows; `least_explained` is the share of
/// each signal's power that the model is [expected](super::model::Model::least_explained) to
/// explain, if that is known.
pub fn misfit_words(estimate: &Estimate, least_explained: Option<f64>) -> String {
    let p = estimate.fit_probability;
    if p < MISFIT {
        return format!(
            "the residuals are larger than noise explains: p = {p:.1e} in the block or in its last part, below {MISFIT:e}"
        );
    }
    let shares = estimate.explained.iter().take(estimate.equations as usize);
    let worst = shares.copied().fold(f64::INFINITY, f64::min);
    match least_explained {
        // 0 until a block shows it, see `Report::explained`
        _ if worst == 0.0 => {
            "the noise is too large to judge the model: no block's input has exceeded it by 20 dB yet \
             (30 dB if it is learnt; 10 dB in several blocks if the sensors' noise is known)"
                .to_owned()
        }
        _ if worst < MEANINGLESS => format!(
            "the model explains {:.0} % of an input's power: check sign, unit and order of the inputs, and whether this \
             is the machine of the model",
            100.0 * worst.max(0.0)
        ),
        Some(least) if worst < least => format!(
            "the model explains {:.1} % of an input's power, less than the {:.1} % expected of it",
            100.0 * worst,
            100.0 * least
        ),
        // no model is expected to explain more
        None if worst < LEAST_EXPLAINED => format!(
            "the model explains {:.1} % of an input's power, a parameter is at its bound, or the model lacks a term",
            100.0 * worst
        ),
        _ => "a parameter is at its bound, or the model lacks a term".to_owned(),
    }
}

/// Explains the state `poorly_excited` for a model of `all` parameters, of which `usable` may be
/// used.
pub fn poorly_excited_words(usable: usize, all: usize) -> String {
    format!("the motion leaves some parameters open; {usable} of {all} may be used all the same")
}

#[cfg(test)]
mod tests {
    use super::super::monitor::tests::estimate;
    use super::*;

    /// p, the explained share and the expected share decide independently.
    #[test]
    fn regress_a_misfit_is_explained_by_what_the_estimate_tells_and_by_the_limit_of_its_model() {
        for (p, explained, least, said) in [
            (
                1.7e-4,
                1.0,
                Some(0.995),
                "p = 1.7e-4 in the block or in its last part, below 2e-4",
            ),
            (1e-9, 0.5, Some(0.9), "p = 1.0e-9"),
            (
                0.5,
                0.97,
                Some(0.995),
                "explains 97.0 % of an input's power, less than the 99.5 %",
            ),
            (
                0.5,
                0.97,
                Some(0.9),
                "a parameter is at its bound, or the model lacks a term",
            ),
            (0.5, 0.85, Some(0.9), "less than the 90.0 %"),
            (0.5, -3.1, None, "explains 0 % of an input's power: check sign, unit"),
            (0.5, 0.0, Some(0.9), "the noise is too large to judge the model"),
            (0.5, 0.0, None, "the noise is too large to judge the model"),
            (
                0.5,
                0.97,
                None,
                "explains 97.0 % of an input's power, a parameter is at its bound, or",
            ),
        ] {
            let mut message = estimate(3, 10.0);
            (message.fit_probability, message.explained[0]) = (p, explained);
            let words = misfit_words(&message, least);
            assert!(words.contains(said), "{words}");
        }
        let mut message = estimate(3, 10.0);
        (message.fit_probability, message.explained[0]) = (0.5, 0.9999);
        assert!(misfit_words(&message, None).starts_with("a parameter is at its bound, or"));
    }
}
