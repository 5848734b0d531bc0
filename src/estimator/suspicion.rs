//! A term that the model lacks, and the evidence for it.

/// Share of all χ² that a term must explain if the noise was learnt.
const OF_ALL: f64 = 0.2;

/// A term that the model lacks, with its evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspicion {
    /// Which error of [`SuspectRows`](super::SuspectRows); larger than these if a parameter drifts.
    pub suspect: usize,
    /// The drifting parameter, if that is the cause; the amplitude is then its relative rate
    /// \[1/s\].
    pub drifting: Option<usize>,
    /// Its amplitude if it is the only missing term.
    pub amplitude: f64,
    /// |z|: standard deviations that the amplitude is from 0.
    pub deviations: f64,
    /// Share of the misfit that it would explain, 0 to 1.
    pub share: f64,
}

/// The evidence for one term.
pub(super) struct Judged {
    /// χ² that it would take away.
    pub explained: f64,
    /// χ² per row of its groups, weighted by what they inform.
    pub level: f64,
    /// Exponentially weighted number of informative blocks.
    pub blocks: f64,
    /// y of `score_test.rs`.
    pub repeated: f64,
    /// The noise of all its rows was specified.
    pub noise_is_configured: bool,
    pub suspicion: Suspicion,
}

impl Judged {
    /// If the noise level was learnt from the residuals, these contain many effects, so a term that
    /// explains little of them does not count.
    pub fn counts(&self) -> bool {
        self.noise_is_configured || self.explains_much()
    }

    /// True if the term explains a notable share of all χ².
    pub fn explains_much(&self) -> bool {
        self.suspicion.share > OF_ALL
    }

    /// True if z and y exceed these.
    pub fn is_beyond(&self, deviations: f64, repeated: f64) -> bool {
        self.suspicion.deviations > deviations && self.repeated > repeated
    }
}
