//! Ratio of measured velocities to the rate of change of the positions.
//!
//! ```text
//! v = ∫ q̇ dt / T,   d = Δq / T over pieces of some T = 0.1 s:   v ≈ k d,   k = Σ v d / Σ d²          (1)
//! k′ = Σ v² / Σ v d                                                                              (2)
//! ```
//!
//! If the velocities have a wrong unit or scale, viscous friction and inertias are wrong by as
//! much, and no residual shows it. Noise of the positions makes k smaller and noise of the
//! velocities makes k′ larger, so a ratio is wrong only if both say so. Of the last pieces, about a
//! thousand count.

use super::state::RobotSample;
use super::tree::Robot;
use crate::estimator::persist::Visit;
use crate::model::MAX_JOINTS;
use std::f64::consts::TAU;

/// T of (1) \[s\].
const PIECE_S: f64 = 0.1;
/// Slower pieces are ignored \[rad/s or m/s\].
pub(super) const SLOWEST: f64 = 0.02;
/// Smallest number of pieces.
pub(super) const PIECES: f64 = 10.0;
/// Share of the sums that is left after a piece.
const KEPT: f64 = 0.999;
/// Expected ratio.
const RIGHT: std::ops::Range<f64> = 0.97..1.03;
/// k and k′ must be outside it by this many standard deviations of k.
const SURE: f64 = 5.0;
/// Steps between samples of this share of a turn are wraps, not motion.
const WRAP: std::ops::Range<f64> = 0.9..1.1;

/// The ratio of one joint.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct VelocityRatio {
    /// Time and position at which the open piece began, the sample before, and ∫ q̇ dt since.
    start: Option<(f64, f64)>,
    before: (f64, f64, f64),
    way: f64,
    /// Pieces in which the position moves, and those with a high velocity signal.
    pub count: f64,
    pub fast: f64,
    dd: f64,
    vd: f64,
    vv: f64,
}

impl VelocityRatio {
    /// Adds a sample; a piece ends at a gap above `max_gap_s`, and if a joint that `turns` wraps.
    pub fn take(&mut self, (t_s, q, dq): (f64, f64, f64), max_gap_s: f64, turns: bool) {
        let (before_s, before_q, before_dq) = self.before;
        self.before = (t_s, q, dq);
        let step_s = t_s - before_s;
        let Some((start_s, start_q)) = self
            .start
            .filter(|_| step_s <= max_gap_s && !(turns && wraps(before_q, q)))
        else {
            (self.start, self.way) = (Some((t_s, q)), 0.0);
            return;
        };
        self.way += 0.5 * step_s * (before_dq + dq);
        let span_s = t_s - start_s;
        if span_s < PIECE_S {
            return;
        }
        let (v, d) = (self.way / span_s, (q - start_q) / span_s);
        self.sums().into_iter().for_each(|sum| *sum *= KEPT);
        if d.abs() > SLOWEST {
            self.count += 1.0;
            (self.dd, self.vd, self.vv) = (self.dd + d * d, self.vd + v * d, self.vv + v * v);
        }
        self.fast += if v.abs() > 5.0 * SLOWEST { 1.0 } else { 0.0 };
        (self.start, self.way) = (Some((t_s, q)), 0.0);
    }

    /// Begins a new piece with the next sample.
    pub fn restart(&mut self) {
        self.start = None;
    }

    /// k if it is significantly wrong.
    pub fn wrong(&self) -> Option<f64> {
        if self.count < PIECES {
            return None;
        }
        let k = self.vd / self.dd; // (1)
        let misfit = (self.vv - self.vd * k).max(0.0) / (self.count - 1.0);
        let margin = SURE * (misfit / self.dd).sqrt();
        let is_line = self.vd * self.vd > 0.5 * self.vv * self.dd;
        let other = if is_line { self.vv / self.vd } else { k }; // (2)
        let is_wrong = k.max(other) + margin < RIGHT.start || k.min(other) - margin > RIGHT.end;
        is_wrong.then_some(k)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.sums().into_iter().for_each(|sum| v.real(sum));
    }

    fn sums(&mut self) -> [&mut f64; 5] {
        [
            &mut self.count,
            &mut self.fast,
            &mut self.dd,
            &mut self.vd,
            &mut self.vv,
        ]
    }
}

/// The ratios of all joints.
#[derive(Debug, Clone, Default)]
pub(super) struct VelocityRatios(pub [VelocityRatio; MAX_JOINTS]);

impl VelocityRatios {
    /// Adds a sample.
    pub fn take(&mut self, robot: &Robot, sample: &RobotSample, max_gap_s: f64) {
        for (j, (own, joint)) in self.0.iter_mut().zip(&robot.joints).enumerate() {
            own.take((sample.t_s, sample.q[j], sample.dq[j]), max_gap_s, joint.turns);
        }
    }

    /// Begins new pieces with the next sample.
    pub fn restart(&mut self) {
        self.0.iter_mut().for_each(VelocityRatio::restart);
    }

    /// The first joint with a wrong ratio, and the ratio.
    pub fn wrong(&self) -> Option<(usize, f64)> {
        self.0.iter().enumerate().find_map(|(j, own)| Some((j, own.wrong()?)))
    }
}

/// True if the position jumps by a whole turn.
pub(super) fn wraps(before: f64, after: f64) -> bool {
    WRAP.contains(&((after - before).abs() / TAU))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 s of a sine, whose velocities are `factor` times what they should be; `count` is that of
    /// the encoder.
    fn after(factor: f64, count: f64, amplitude: f64) -> Option<f64> {
        let mut ratio = VelocityRatio::default();
        for k in 0..20_000 {
            let t_s = f64::from(k) * 1e-3;
            let q = amplitude * (3.0 * t_s).sin();
            let q = if count > 0.0 { (q / count).round() * count } else { q };
            ratio.take((t_s, q, factor * 3.0 * amplitude * (3.0 * t_s).cos()), 0.05, true);
        }
        ratio.wrong()
    }

    #[test]
    fn prop_a_ratio_that_is_off_is_found_and_coarse_encoders_are_none() {
        for factor in [-1.0, 0.0, 0.5, 0.95, 1.05, 1.2] {
            let found = after(factor, 1e-4, 0.5).expect("off");
            assert!((found - factor).abs() < 1e-2, "{factor}: {found}");
        }
        // 13 bits, also in motion of a few counts
        for amplitude in [0.5, 0.02] {
            assert_eq!(after(1.0, TAU / 8192.0, amplitude), None, "{amplitude}");
        }
    }
}
