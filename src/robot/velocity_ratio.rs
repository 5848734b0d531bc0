//! Whether measured velocities are the rate of change of the positions: their ratio and their lag.
//!
//! ```text
//! v = ∫ q̇ dt / T,   d = Δq / T over pieces of some T = 0.1 s:   v ≈ k d,   k = Σ v d / Σ d²          (1)
//! k′ = Σ v² / Σ v d                                                                              (2)
//! ∫ q̇ dt − Δq = −ε Δq̇ if q̇ is measured ε too late:   ε = −Σ (∫ q̇ dt − Δq) Δq̇ / Σ Δq̇²               (3)
//! ```
//!
//! If the velocities have a wrong unit or scale, viscous friction and inertias are wrong by as
//! much, and no residual shows it. Noise of the positions makes k smaller and noise of the
//! velocities makes k′ larger, so a ratio is wrong only if both say so. A filter acts as a lag
//! does. If velocities lag, inertia and viscous friction absorb it. Of the last pieces, about a
//! thousand count.

use super::state::RobotSample;
use super::tree::Robot;
use crate::estimator::persist::Visit;
use crate::model::MAX_JOINTS;
use std::f64::consts::TAU;
use std::fmt;

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
/// A lag is wrong if it exceeds this many of the standard deviations that the estimate allows for.
const LATE: f64 = 3.0;
/// Steps between samples of this share of a turn are wraps, not motion.
const WRAP: std::ops::Range<f64> = 0.9..1.1;

/// The ratio of one joint.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct VelocityRatio {
    /// Time, position and velocity at which the open piece began, the sample before, and ∫ q̇ dt
    /// since.
    start: Option<(f64, f64, f64)>,
    before: (f64, f64, f64),
    way: f64,
    /// Pieces in which the position moves, and those with a high velocity signal.
    pub count: f64,
    pub fast: f64,
    dd: f64,
    vd: f64,
    vv: f64,
    /// Σ Δq̇², Σ (∫ q̇ dt − Δq) Δq̇ and Σ (∫ q̇ dt − Δq)².
    lag: [f64; 3],
}

impl VelocityRatio {
    /// Adds a sample; a piece ends at a gap above `max_gap_s`, and if a joint that `turns` wraps.
    pub fn take(&mut self, (t_s, q, dq): (f64, f64, f64), max_gap_s: f64, turns: bool) {
        let (before_s, before_q, before_dq) = self.before;
        self.before = (t_s, q, dq);
        let step_s = t_s - before_s;
        let Some((start_s, start_q, start_dq)) = self
            .start
            .filter(|_| step_s <= max_gap_s && !(turns && wraps(before_q, q)))
        else {
            (self.start, self.way) = (Some((t_s, q, dq)), 0.0);
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
            let (more, change) = (self.way - (q - start_q), dq - start_dq);
            let products = [change * change, more * change, more * more];
            self.lag.iter_mut().zip(products).for_each(|(sum, own)| *sum += own); // (3)
        }
        self.fast += if v.abs() > 5.0 * SLOWEST { 1.0 } else { 0.0 };
        (self.start, self.way) = (Some((t_s, q, dq)), 0.0);
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

    /// ε if it is significantly larger than an error of this standard deviation \[s\].
    pub fn late_s(&self, considered_s: f64) -> Option<f64> {
        let [changes, products, squares] = self.lag;
        if self.count < PIECES || !(changes > 0.0) {
            return None;
        }
        let late_s = -products / changes; // (3)
        let misfit = (squares + products * late_s).max(0.0) / (self.count - 1.0);
        let margin_s = SURE * (misfit / changes).sqrt();
        (late_s.abs() - margin_s > LATE * considered_s).then_some(late_s)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.sums().into_iter().for_each(|sum| v.real(sum));
    }

    fn sums(&mut self) -> [&mut f64; 8] {
        let [changes, products, squares] = &mut self.lag;
        [
            &mut self.count,
            &mut self.fast,
            &mut self.dd,
            &mut self.vd,
            &mut self.vv,
            changes,
            products,
            squares,
        ]
    }
}

/// What is wrong with the measured velocities of a joint, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WrongVelocities {
    /// They are `ratio` times the rate of change of its positions.
    Ratio {
        /// The joint.
        joint: usize,
        /// k.
        ratio: f64,
    },
    /// They are later than its positions.
    Late {
        /// The joint.
        joint: usize,
        /// ε \[s\]; negative if they are earlier.
        late_s: f64,
    },
}

impl fmt::Display for WrongVelocities {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Ratio { joint, ratio } => write!(
                f,
                "velocities of joint {} are {ratio:.3} times the rate of change of its positions: check units and sources of both",
                joint + 1
            ),
            Self::Late { joint, late_s } => {
                let later = if late_s > 0.0 { "later" } else { "earlier" };
                let (joint, size_ms) = (joint + 1, 1e3 * late_s.abs());
                write!(
                    f,
                    "velocities of joint {joint} are {size_ms:.1} ms {later} than its positions: leave them out, or align both"
                )
            }
        }
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

    /// The first joint with a wrong ratio, or else with a lag beyond errors of this standard
    /// deviation \[s\].
    pub fn wrong(&self, considered_s: f64) -> Option<WrongVelocities> {
        let mut all = self.0.iter().enumerate();
        let ratio = all.clone().find_map(|(joint, own)| {
            let ratio = own.wrong()?;
            Some(WrongVelocities::Ratio { joint, ratio })
        });
        ratio.or_else(|| {
            all.find_map(|(joint, own)| {
                let late_s = own.late_s(considered_s)?;
                Some(WrongVelocities::Late { joint, late_s })
            })
        })
    }
}

/// True if the position jumps by a whole turn.
pub(super) fn wraps(before: f64, after: f64) -> bool {
    WRAP.contains(&((after - before).abs() / TAU))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 s of two sines whose velocities are `late_s` late and have noise, through an encoder of
    /// 14 bits.
    fn late(late_s: f64) -> Option<f64> {
        let mut ratio = VelocityRatio::default();
        let count = TAU / 16384.0;
        for k in 0..20_000 {
            let t_s = f64::from(k) * 1e-3;
            let q = |t_s: f64| 0.4 * (3.0 * t_s).sin() + 0.1 * (7.0 * t_s).cos();
            let dq = |t_s: f64| 1.2 * (3.0 * t_s).cos() - 0.7 * (7.0 * t_s).sin();
            let noise = 0.01 * (1e4 * t_s).sin();
            ratio.take(
                (t_s, (q(t_s) / count).round() * count, dq(t_s - late_s) + noise),
                0.05,
                true,
            );
        }
        assert_eq!(ratio.wrong(), None);
        ratio.late_s(5e-4)
    }

    #[test]
    fn prop_velocities_that_are_late_or_early_are_found() {
        for late_s in [2e-3, 4e-3, -3e-3] {
            let found = late(late_s).expect("late");
            assert!((found - late_s).abs() < 2e-4, "{late_s}: {found}");
        }
        assert_eq!(late(0.0), None);
        assert_eq!(late(1e-3), None);
    }

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
