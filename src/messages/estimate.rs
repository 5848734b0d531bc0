//! Topic `estimate`.

use super::table::message;
use super::{MAX_DERIVED, ParameterSet};
use crate::model::{MAX_JOINTS, MAX_PARAMS};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;

/// What the identifier is doing; `state` of [`Estimate`] and [`Status`](super::Status).
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum State {
    /// Fewer data than one block.
    #[default]
    Collecting = 0,
    /// Estimates exist and still move.
    Converging = 1,
    /// Estimates have settled within their standard deviations.
    Converged = 2,
    /// Stopped by a command.
    Paused = 3,
    /// The data carry too little information.
    PoorlyExcited = 4,
    /// A change of the plant is being tracked.
    Changing = 5,
    /// Samples are missing or rejected.
    Degraded = 6,
    /// The estimate must not be used.
    Invalid = 7,
    /// The stream ended and everything received has been processed (status only).
    Ended = 8,
    /// The model does not fit the block: residuals exceed the noise, signals are unexplained, or
    /// the data push a parameter against a bound.
    Misfit = 9,
}

impl State {
    const ALL: [(Self, &'static str); 10] = [
        (Self::Collecting, "collecting"),
        (Self::Converging, "converging"),
        (Self::Converged, "converged"),
        (Self::Paused, "paused"),
        (Self::PoorlyExcited, "poorly_excited"),
        (Self::Changing, "changing"),
        (Self::Degraded, "degraded"),
        (Self::Invalid, "invalid"),
        (Self::Ended, "ended"),
        (Self::Misfit, "misfit"),
    ];

    /// The name as in files and tables.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// The state with this wire value; `None` for a value that this schema does not have.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.get(value as usize).map(|&(state, _)| state)
    }
}

message! {
    /// Topic `estimate`: θ̂ with its evidence, once per block.
    pub struct Estimate = "ThetabusEstimateV3" {
        stream_id: u64, One, "", "stream_id of the samples";
        block: u64, One, "", "Number of the block, the paper's m: seq div N + 1";
        t_first_ns: u64, One, "ns", "Stream time of the first sample of the block";
        t_last_ns: u64, One, "ns", "Stream time of the last sample of the block";
        model_hash: u64, One, "", "Identifies the model: name, parameters, equations";
        config_hash: u64, One, "", "Identifies the configuration that determines estimates";
        accepted: u64, One, "", "Samples used since the start of the stream";
        missing: u64, One, "", "Samples lost since the start of the stream, gaps in seq";
        rejected: u64, One, "", "Samples refused since the start of the stream: not finite, out of range, out of order";
        excited: ParameterSet, One, "", "Parameters about which the block's data are informative";
        /// [`Self::is_usable`] explains both.
        usable: ParameterSet, One, "", "Parameters known from data well enough to be used, if use_ok is 1, too";
        fixed: ParameterSet, One, "", "Parameters held by configuration or command";
        t_change_ns: u64, One, "ns", "Located stream time of the last change, 0 if none was found";
        /// See [`State`].
        state: u32, One, "", "0 collecting, 1 converging, 2 converged, 3 paused, 4 poorly excited, 5 changing, 6 degraded, 7 invalid, 9 misfit";
        /// See [`Self::is_usable`].
        use_ok: u32, One, "", "1 if controllers may use what is marked in usable, else 0";
        /// See [`estimate_flags`](super::estimate_flags).
        flags: u32, One, "", "Bits: 0 changed, 1 incomplete, 2 held, 3 warm, 4 commanded, 5 sensor";
        params: u32, One, "", "Number of parameters, at most 128";
        equations: u32, One, "", "Number of equations, at most 8";
        derived_len: u32, One, "", "Number of derived values, at most 32";
        iterations: u32, One, "", "Gauss-Newton iterations of this block";
        outliers: u32, One, "", "Rows of this block treated as outliers, and samples replaced because they were spikes";
        condition: f64, One, "", "Condition number of the column-scaled information, inf if singular";
        innovation_rms: [f64; MAX_JOINTS], Equation, "", "Root mean square of the innovation f(theta before the update)";
        residual_rms: [f64; MAX_JOINTS], Equation, "", "Root mean square of the residual f(theta after the update)";
        fit: [f64; MAX_JOINTS], Equation, "", "chi^2 of the whitened residuals over their number: 1 on average if the block fits";
        explained: [f64; MAX_JOINTS], Equation, "", "Share of the signal's power that the model explains, in the last block in which the signal stood out of the noise";
        fit_probability: f64, One, "", "Probability of residuals as large as these, in the block or in its last part, if the model is right: below 2e-4 it is a misfit";
        theta: [f64; MAX_PARAMS], Parameter, "{parameter}", "Estimate";
        theta_std: [f64; MAX_PARAMS], Parameter, "{parameter}", "Standard deviation of the estimate, NaN if the estimator gives none";
        derived: [f64; MAX_DERIVED], Derived, "{derived}", "Value computed from the estimate";
        derived_std: [f64; MAX_DERIVED], Derived, "{derived}", "Its standard deviation, NaN if it is not known";
    }
}
