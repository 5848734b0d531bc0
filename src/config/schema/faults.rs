//! The keys of a `[[plant.faults]]`.

use super::super::choice::choices;
use super::super::kind::{Interval, Key, Kind};
use super::table::{FINITE, Field, LONGEST_S, choice, table};
use crate::model::MAX_JOINTS;
use crate::sim::FaultSignal;

choices! {
    /// What a fault does.
    FaultChoice {
        /// Nothing comes.
        Off = "off",
        /// The value at the beginning.
        Stuck = "stuck",
        /// NaN, infinities, any number.
        Garbage = "garbage",
        /// A factor and an addend.
        Wrong = "wrong",
        /// A new value once per period.
        Slow = "slow",
        /// Values that come late.
        Delayed = "delayed",
        /// Off in a share of periods.
        Intermittent = "intermittent",
    }
}

table! {
    /// One `[[plant.faults]]`.
    FaultForm {
        kind: FaultChoice, choice::<FaultChoice>(), "",
            "off: nothing comes. stuck: the value at the beginning. garbage: NaN, infinities, any number. wrong: gain x + offset. slow: a new value once per period_s. delayed: the value of delay_s ago, samples come so much later. intermittent: off in a share of periods";
        signal: Option<FaultSignal>, choice::<FaultSignal>(), "",
            "What it happens to: the whole sample (default; off then means that it is lost), its time stamp (stuck and wrong only), or one of its signals (off then clears its bit in the mask, or gives NaN for a single joint)";
        joint: Option<u64>, Kind::Whole(0, MAX_JOINTS as u64), "",
            "Joint of the signal; 0 for all (default)";
        from_s: f64, Kind::Real(Interval::closed(0.0, LONGEST_S)), "s",
            "Beginning in stream time";
        to_s: Option<f64>, Kind::Real(Interval::above(0.0, f64::INFINITY).or_infinite()), "s",
            "First instant that is right again; inf for never (default)";
        gain: Option<f64>, Kind::Real(FINITE), "",
            "Factor of wrong; 1 (default). Of time: how fast the clock runs from from_s on";
        offset: Option<f64>, Kind::Real(FINITE), "unit of the signal, s for time",
            "Addend of wrong; 0 (default)";
        period_s: Option<f64>, Kind::Real(Interval::closed(0.0, LONGEST_S)), "s",
            "Period of slow and intermittent; a sample period at least (default)";
        delay_s: Option<f64>, Kind::Real(Interval::closed(0.0, 10.0)), "s",
            "Delay of delayed, above 0. Whole samples are late only if plant.speed is a number, not \"max\"";
        share: Option<f64>, Kind::Real(Interval::closed(0.0, 1.0)), "",
            "Share of periods that are off, drawn from plant.seed; 0.5 (default)";
    }
}

impl Field for FaultForm {}

/// The keys of each table.
pub(super) const KEYS: &[Key] = &FaultForm::keys("plant.faults");
