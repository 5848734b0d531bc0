//! Checks before a sample enters the rows: joints and signals, finite numbers, increasing time, an
//! input within its limit, and no frozen signal.

use super::freeze::FreezeWatch;
use super::identifier_options::IdentifierOptions;
use super::stream::{StreamClock, Tick};
use crate::messages::{ErrorCode, SIGNALS, Sample, signals};
use crate::model::MAX_JOINTS;

/// Largest plausible position, velocity, setpoint and input \[SI units\].
const LARGEST: f64 = 1e9;
/// The same for accelerations and jerks.
const LARGEST_DERIVATIVE: f64 = 1e12;

/// The checks with their memory of the stream.
pub(super) struct SampleGate {
    joints: usize,
    signals: u32,
    input_limit: [f64; MAX_JOINTS],
    clock: StreamClock,
    freeze: FreezeWatch,
}

/// Result of the checks on a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Judgement {
    /// Why the sample is refused.
    pub result: Result<(), ErrorCode>,
    /// True if the clock was set back: earlier samples belong to another time.
    pub set_back: bool,
}

impl SampleGate {
    /// For the samples that these options describe.
    pub fn new(options: &IdentifierOptions) -> Self {
        let period_s = options.sample_period_ns as f64 * 1e-9;
        Self {
            joints: options.joints,
            signals: options.signals,
            input_limit: options.input_limit,
            clock: StreamClock::new(options.sample_period_ns),
            freeze: FreezeWatch::new(options.frozen_after, period_s, options.sticking),
        }
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.clock.reset();
        self.freeze.reset();
    }

    /// Judges a sample that is at its place in the stream.
    pub fn judge(&mut self, sample: &Sample) -> Judgement {
        let mut set_back = false;
        let result = self.check(sample, &mut set_back);
        Judgement { result, set_back }
    }

    fn check(&mut self, sample: &Sample, set_back: &mut bool) -> Result<(), ErrorCode> {
        if sample.joints as usize != self.joints {
            return Err(ErrorCode::WrongJoints);
        }
        if sample.signals & self.signals != self.signals {
            return Err(ErrorCode::WrongSignals);
        }
        if !self.are_numbers(sample) {
            return Err(ErrorCode::NotFinite);
        }
        match self.clock.check(sample.seq, sample.t_ns) {
            Tick::Good | Tick::Set { back: false } => {}
            Tick::Jump => return Err(ErrorCode::ClockJump),
            Tick::Set { back: true } => *set_back = true,
        }
        let joints = self.joints.min(MAX_JOINTS);
        let driven = self.signals & signals::INPUT != 0;
        let inputs = sample.input.iter().zip(&self.input_limit).take(joints);
        if driven && inputs.into_iter().any(|(input, limit)| input.abs() >= *limit) {
            return Err(ErrorCode::Saturated);
        }
        let measured = self.signals & signals::DQ != 0;
        if self.freeze.check(&sample.joint_sample(), joints, measured, driven) {
            return Err(ErrorCode::Frozen);
        }
        Ok(())
    }

    /// True if the needed signals of a sample are plausible numbers.
    fn are_numbers(&self, sample: &Sample) -> bool {
        let joints = self.joints.min(MAX_JOINTS);
        // NaN also fails
        let needed = |flag: u32| self.signals & flag != 0;
        let within = |flag: u32, values: &[f64]| values.iter().all(|value| value.abs() <= largest(flag));
        let mut signals = SIGNALS.iter().zip(sample.arrays());
        signals.all(|(signal, values)| !needed(signal.flag) || within(signal.flag, &values[..joints]))
    }
}

/// Largest magnitude of a signal that a machine can have \[SI units\].
pub(super) fn largest(signal: u32) -> f64 {
    match signal {
        signals::DDQ | signals::DDDQ => LARGEST_DERIVATIVE,
        _ => LARGEST,
    }
}
