//! Detects a slipping encoder: a position that jumps without a velocity.
//!
//! ```text
//! m = Δq_k − ½ (q̇_k + q̇_{k−1}) Δt                                                              (1)
//! s = Δq_k − Δq_{k−1}        minus whole turns (an encoder may wrap); Δq_{k−1} without its jump (2)
//! l = max(LEAST, COUNTS · smallest |Δq| > 0)                                                   (3)
//! jump by s:   |m| > max(l, LOUD · mean |m|),   |s| > l,   m/s > SHARE                         (4)
//! slipped:     |Σ s| > LEAST over the jumps of a joint                                         (5)
//! wrong time:  Σ Δq_k·Δq_{k−1} < ALIKE · max(Σ Δq_k², Σ Δq²_{k−1}) over the other joints         (6)
//! ```
//!
//! No machine moves like that: after an impact the velocity, measured or computed from positions,
//! agrees with the positions, and m stays small. Velocities computed over several samples contain
//! the jump too; (4) holds only in the sample of the jump, not in its neighbours. A single wrong
//! sample jumps there and back and leaves (5) unchanged. Time steps of different lengths are not
//! compared, because a wrong stamp would look like a jump. If the other joints stop, or double
//! their step, in the same sample (6), then it is repeated, or one before it is lost: no encoder
//! slipped.

use super::doubt::RobotDoubt;
use super::state::RobotSample;
use super::tree::Robot;
use crate::model::MAX_JOINTS;
use std::f64::consts::TAU;

/// Smallest jump \[rad\]: standard deviations allow for errors of the zero of this size.
const LEAST: f64 = 3e-3;
/// The same in encoder counts, because steps of the encoder are not jumps.
const COUNTS: f64 = 3.0;
/// The same relative to the usual |m|.
const LOUD: f64 = 20.0;
/// Share of a jump that is missing in the velocities: all of it if they are measured, 5/12 if they
/// are computed over five samples; in neighbouring samples at most 1/4.
const SHARE: f64 = 1.0 / 3.0;
/// Steps of time may differ by this factor.
const EVEN: f64 = 1.5;
/// Likeness of two steps of the other joints: 1 if they are equal, 1/2 if one is twice the other, 0
/// if there is only one.
const ALIKE: f64 = 0.75;
/// (6) is judged if the steps of the other joints together exceed this, each relative to its mean
/// |m|, or to a count if that is larger.
const TELLING: f64 = 5.0;
/// Samples for which the last step is kept while (6) holds: a machine may stop within a sample.
const HELD: u32 = 4;
/// Samples in the mean of |m|.
const MEAN_OF: f64 = 1000.0;

/// The jumps so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Jumps {
    last: Option<RobotSample>,
    /// Δq and Δt of the last sample.
    step: [f64; MAX_JOINTS],
    step_s: f64,
    /// Samples since Δq was kept because of (6).
    held: [u32; MAX_JOINTS],
    usual: [f64; MAX_JOINTS],
    /// Smallest |Δq| so far, at least one count; 0 before the joint has moved.
    count: [f64; MAX_JOINTS],
    slipped: [f64; MAX_JOINTS],
}

impl Jumps {
    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Call this if the next sample does not follow the last one.
    pub fn restart(&mut self) {
        (self.last, self.step_s) = (None, 0.0);
    }

    /// Adds a sample; true if a joint jumped in it.
    pub fn take(&mut self, robot: &Robot, sample: &RobotSample) -> bool {
        let mut jumped = false;
        let Some(last) = self.last.replace(*sample) else {
            return false;
        };
        let step_s = sample.t_s - last.t_s;
        let even = step_s < EVEN * self.step_s && self.step_s < EVEN * step_s;
        let others = Others::of(self, &last, sample);
        for (j, joint) in robot.joints.iter().enumerate().take(MAX_JOINTS) {
            let moved = sample.q[j] - last.q[j];
            let missed = moved - 0.5 * (sample.dq[j] + last.dq[j]) * step_s; // (1)
            let jump = moved - self.step[j];
            let jump = jump - (jump / TAU).round() * TAU; // (2)
            if moved != 0.0 && !(self.count[j] > 0.0 && self.count[j] < moved.abs()) {
                self.count[j] = moved.abs();
            }
            let least = LEAST.max(COUNTS * self.count[j]); // (3)
            let is_loud = missed.abs() > least.max(LOUD * self.usual[j]);
            let is_jump = even && joint.turns && is_loud && jump.abs() > least && missed / jump > SHARE;
            if others.show_wrong_time(j) && self.held[j] < HELD {
                self.held[j] += 1;
            } else {
                self.held[j] = 0;
                self.step[j] = moved;
                if is_jump {
                    self.slipped[j] += jump; // (4)
                    self.step[j] -= jump;
                    jumped = true;
                }
            }
            self.usual[j] += (missed.abs().min(LEAST) - self.usual[j]) / MEAN_OF;
        }
        self.step_s = step_s;
        jumped
    }

    /// (5), of the joint that has slipped most.
    pub fn found(&self) -> Option<RobotDoubt> {
        let mut most = (0, 0.0_f64);
        for (joint, by) in self.slipped.iter().copied().enumerate() {
            if by.abs() > most.1.abs() {
                most = (joint, by);
            }
        }
        let (joint, by) = most;
        (by.abs() > LEAST).then_some(RobotDoubt::Slip { joint, by }) // (5)
    }
}

/// Steps of all joints, for (6).
struct Others {
    /// Δq_k·Δq_{k−1}, Δq_k² and Δq²_{k−1} of each joint, in squares of its mean |m|.
    terms: [[f64; 3]; MAX_JOINTS],
    sums: [f64; 3],
}

impl Others {
    fn of(jumps: &Jumps, last: &RobotSample, sample: &RobotSample) -> Self {
        let (mut terms, mut sums) = ([[0.0; 3]; MAX_JOINTS], [0.0; 3]);
        for (j, term) in terms.iter_mut().enumerate() {
            let least = jumps.count[j].max(jumps.usual[j]);
            if least > 0.0 {
                let (moved, before) = ((sample.q[j] - last.q[j]) / least, jumps.step[j] / least);
                *term = [moved * before, moved * moved, before * before];
            }
            sums.iter_mut().zip(*term).for_each(|(sum, term)| *sum += term);
        }
        Self { terms, sums }
    }

    /// (6) for the joints other than this one.
    fn show_wrong_time(&self, joint: usize) -> bool {
        let [product, now, before] = std::array::from_fn(|i| self.sums[i] - self.terms[joint][i]);
        now.max(before) > TELLING * TELLING && product < ALIKE * now.max(before) // (6)
    }
}

#[cfg(test)]
mod tests {
    use super::super::selection::Selection;
    use super::super::velocity::Velocities;
    use super::*;

    /// The result for a smooth motion of joint 2 with `added` [rad] at sample k.
    fn found(period_s: f64, measured: bool, added: impl Fn(i32) -> f64) -> Option<(usize, f64)> {
        found_by(16, period_s, measured, added)
    }

    /// The same with an encoder of `bits` bits.
    fn found_by(bits: i32, period_s: f64, measured: bool, added: impl Fn(i32) -> f64) -> Option<(usize, f64)> {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        let half = (0.02 / period_s).round() as usize;
        let (mut jumps, mut velocities) = (Jumps::default(), Velocities::new(half, 1.0));
        for k in 0..3000 {
            let t_s = f64::from(k) * period_s;
            let mut sample = RobotSample {
                t_s,
                ..RobotSample::default()
            };
            let count = TAU / 2f64.powi(bits);
            sample.q[1] = (((3.0 * t_s).sin() + added(k)) / count).round() * count;
            sample.dq[1] = 3.0 * (3.0 * t_s).cos();
            if measured {
                jumps.take(&robot, &sample);
            } else if let Some(sample) = velocities.push(&sample) {
                jumps.take(&robot, &sample);
            }
        }
        jumps.found().map(|doubt| match doubt {
            RobotDoubt::Slip { joint, by } => (joint, by),
            _ => unreachable!("an encoder"),
        })
    }

    /// The previous step gives the motion to within an acceleration of 9 rad/s² times the square of
    /// the period; the encoder adds up to two counts.
    #[test]
    fn fault_a_slip_is_found_with_its_size_at_1_khz_and_at_100_hz() {
        for period_s in [1e-3, 1e-2] {
            for measured in [true, false] {
                for by in [0.02, -0.2] {
                    let (joint, found) = found(period_s, measured, |k| if k < 1500 { 0.0 } else { by }).unwrap();
                    let allowed = 9.0 * period_s * period_s + 2.0 * TAU / 65_536.0;
                    assert!(
                        joint == 1 && (found - by).abs() < allowed,
                        "{period_s} {measured}: {found}"
                    );
                }
            }
        }
    }

    /// Of all joints in motion, a row in twenty repeats the one before, or is missing under stamps
    /// made up from the rate; a slip is found all the same.
    #[test]
    fn prop_repeated_and_missing_rows_are_no_slip() {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        for (by, is_missing) in [(0.0, false), (0.0, true), (0.02, false), (0.02, true)] {
            let mut random = crate::random::Random(3);
            let (mut jumps, mut velocities) = (Jumps::default(), Velocities::new(10, 1.0));
            let (mut rows, mut row) = (0, 0);
            let mut q = [0.0; MAX_JOINTS];
            while rows < 20_000 {
                let is_hit = random.normal() > 1.645;
                row += if is_hit && is_missing { 2 } else { 1 };
                let phase = 0.002 * f64::from(row);
                if !is_hit || is_missing {
                    q = std::array::from_fn(|j| ((1.0 + 0.1 * j as f64) * phase).sin());
                    q[1] += if rows < 9_000 { 0.0 } else { by };
                }
                let sample = RobotSample {
                    t_s: 0.002 * f64::from(rows),
                    q,
                    ..RobotSample::default()
                };
                rows += 1;
                if let Some(sample) = velocities.push(&sample) {
                    jumps.take(&robot, &sample);
                }
            }
            match jumps.found() {
                Some(RobotDoubt::Slip { joint: 1, by: found }) => assert!((found - by).abs() < 5e-3, "{found}"),
                other => assert!(by == 0.0 && other.is_none(), "{by} {is_missing}: {other:?}"),
            }
        }
    }

    #[test]
    fn prop_what_is_no_slip_is_not_taken_for_one() {
        for period_s in [1e-3, 1e-2] {
            for measured in [true, false] {
                for bits in [8, 10, 12, 16] {
                    assert_eq!(found_by(bits, period_s, measured, |_| 0.0), None, "{bits} bits");
                }
                // a single wrong sample, a position that wraps, a slip that is undone
                assert_eq!(
                    found(period_s, measured, |k| f64::from(u8::from(k == 1500)) * 0.1),
                    None
                );
                assert_eq!(found(period_s, measured, |k| if k < 1500 { 0.0 } else { -TAU }), None);
                let undone = |k| if (1500..1800).contains(&k) { 0.1 } else { 0.0 };
                assert_eq!(found(period_s, measured, undone), None);
            }
            // an impact: the velocity changes by 1 rad/s at once
            let impact = |k: i32| f64::from((k - 1500).max(0)) * period_s;
            assert_eq!(found(period_s, false, impact), None);
        }
    }
}
