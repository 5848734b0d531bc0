//! Finds where a joint is at rest, and the rows whose equation does not hold there.
//!
//! ```text
//! f(t; θ) = s u − F sign q̇ − …        holds while q̇ ≠ 0; at rest friction is anything within ±F
//! ```
//!
//! `sign 0 = 0`, but the friction of a sticking joint balances whatever force acts on it. A row
//! over a standstill would attribute that force to friction, with errors of tens of per cent if a
//! machine rests between its moves. So such rows are left out, only of the equations that require
//! the joint to move.
//!
//! # Rest and reversal
//! A reversal passes through zero without resting and must stay: it distinguishes friction from
//! everything else. The velocity alone cannot distinguish the two, because at rest its sign is that
//! of the noise. Positions can: let t₁ be the time that q stays within W of its resting value, t₉
//! that within 9 W. A reversal at an acceleration a has t₁ = 2√(2W/a) and t₉ = 3 t₁, a joint that
//! creeps through has t₉ = 9 t₁, and one that rests for a time t between a deceleration and an
//! acceleration of any size
//!
//! ```text
//! t₁ = t + τ, t₉ = t + 3 τ        t = (3 t₁ − t₉)/2
//! ```
//!
//! W is the range of a position at rest due to rounding and noise. Rests shorter than a twentieth
//! of a window do not count.
//!
//! # Slow passages
//! A joint may also creep to a stop, or away from one, more slowly than the velocity filter can
//! see; the sign of its velocity is then noise, too. The filter knows a velocity above three of its
//! standard deviations σ_v, and a faster joint passes 2 W within
//!
//! ```text
//! t₁ ≤ 2 W/(3 σ_v)
//! ```
//!
//! A joint that stays within W for longer counts as resting, whether it creeps or reverses.
//!
//! # Slow reversals
//! If a differentiated term jumps, such as friction combined with a winding's inductance, a
//! reversal is an impulse in the equation, and its instant matters: at an acceleration a, the sign
//! of a velocity with noise σ changes σ/a too early or too late, and several times. In that case a
//! joint that stays within W for a fifth of a window counts as resting, so that only reversals
//! whose instant is known remain.

use super::noise::SignalNoise;
use super::passes::terms;
use super::whitening::Whitening;
use crate::model::{AnyPlant, MAX_JOINTS, MAX_PARAMS};
use std::ops::Range;

/// Share of a window that a rest must last.
const SHORTEST: f64 = 0.05;
/// Smallest number of samples of a rest.
const FEWEST: usize = 4;
/// Weight of resting samples in a row above which the row is left out: a stuck joint can change the
/// friction in it by twice this share. This is below the noise of any row, and still lets the
/// tapered ends of a window, its first and last 6 %, lie over a rest.
const SPOILT: f64 = 1e-6;
/// Standard deviations between the smallest and the largest of about a hundred noisy values.
const RANGE: f64 = 6.0;
/// Standard deviations of the filtered velocity above which its sign is known.
const KNOWN_SIGN: f64 = 3.0;
/// Share of a window that a joint may stay at its turning point if a differentiated term jumps
/// there.
const SLOW: f64 = 0.2;
/// Change of a term over a change of the velocity from −δ to δ, as a share of its size, that counts
/// as a jump.
const JUMP: f64 = 0.01;

/// For each equation, the joints (bit j) that must move for it to hold: those that it names, and
/// those at whose reversal one of its terms jumps.
pub(super) fn motion_needed(plant: &dyn AnyPlant) -> Vec<u32> {
    let named = |e: usize| plant.equations()[e].motion;
    let joints = plant.joints().min(MAX_JOINTS);
    (0..plant.equations().len())
        .map(|e| (0..joints).fold(named(e), |mask, j| mask | u32::from(jumps(plant, e, j, 0)) << j))
        .collect()
}

/// The joints that friction can hold: those that must move for an equation to hold.
pub fn sticking_joints(plant: &dyn AnyPlant) -> [bool; MAX_JOINTS] {
    let needed = motion_needed(plant).into_iter().fold(0, |all, mask| all | mask);
    std::array::from_fn(|joint| needed >> joint & 1 == 1)
}

/// True if a term of the equation that is differentiated `least` times or more jumps as the joint
/// reverses, at one of a few states and parameter values. (`present_terms::has_jump` also counts
/// jumps that are small beside the rest of a term.)
fn jumps(plant: &dyn AnyPlant, equation: usize, joint: usize, least: usize) -> bool {
    let params = plant.parameters().len().min(MAX_PARAMS);
    let order = plant.equations()[equation].order;
    (0..4).any(|probe| {
        // irregular numbers of order 1, so that nothing cancels
        let number = |i: usize| 0.3 + 0.7 * (1.7 * i as f64 + 2.9 * f64::from(probe)).sin().abs();
        let q: [f64; MAX_JOINTS] = std::array::from_fn(|j| number(j) - 0.5);
        let theta: [f64; MAX_PARAMS] = std::array::from_fn(|i| match plant.parameters().get(i) {
            Some(parameter) => number(3 * i).clamp(parameter.lower, parameter.upper),
            None => 0.0,
        });
        let at = |velocity: f64| {
            let mut dq: [f64; MAX_JOINTS] = std::array::from_fn(|j| number(20 + j) - 0.4);
            dq[joint] = velocity;
            terms(plant, equation, &q, &dq, &theta[..params])
        };
        let (back, forth, fast) = (at(-1e-7), at(1e-7), at(1.0));
        (least..=order).any(|d| {
            let size = back[d].abs().max(forth[d].abs()).max(fast[d].abs());
            (forth[d] - back[d]).abs() > JUMP * size
        })
    })
}

/// The rests of the joints in a block, and the rows to leave out.
#[derive(Debug, Clone)]
pub(super) struct Standstill {
    /// Joints that must move for each equation to hold.
    motion: Vec<u32>,
    /// Joints (bit j) at whose reversal a term jumps.
    jumping: u32,
    /// Joints whose slow reversals also count as rests.
    abrupt: u32,
    /// For each joint, its rests as buffer positions, in order.
    rests: Vec<Vec<(usize, usize)>>,
    /// Running sum of ψ over a window.
    cumulative: Vec<f64>,
    half: usize,
    /// Whether a row is left out: \[equation\]\[row\], and whether any is.
    spoilt: Vec<Vec<bool>>,
    any: bool,
}

impl Standstill {
    /// For windows with the weights `psi` and blocks of at most `capacity` samples and `rows`
    /// windows.
    pub fn new(plant: &dyn AnyPlant, psi: &[f64], capacity: usize, rows: usize) -> Self {
        let motion = motion_needed(plant);
        let total: f64 = psi.iter().sum();
        let mut sum = 0.0;
        let mut cumulative = vec![0.0];
        cumulative.extend(psi.iter().map(|w| {
            sum += w / total;
            sum
        }));
        let needed = motion.iter().fold(0, |all, mask| all | mask);
        let joints = plant.joints().min(MAX_JOINTS);
        let jump = |least: usize| {
            let jumps = |j: &usize| (0..plant.equations().len()).any(|e| jumps(plant, e, *j, least));
            (0..joints).filter(jumps).fold(0, |mask, j| mask | 1 << j)
        };
        Self {
            jumping: jump(0),
            abrupt: jump(1),
            rests: (0..plant.joints())
                .map(|j| Vec::with_capacity(if needed >> j & 1 == 1 { capacity / FEWEST + 1 } else { 0 }))
                .collect(),
            spoilt: motion
                .iter()
                .map(|mask| vec![false; if *mask == 0 { 0 } else { rows }])
                .collect(),
            motion,
            cumulative,
            half: psi.len() / 2,
            any: false,
        }
    }

    /// True if some equation requires the joint to move.
    pub fn concerns(&self, joint: usize) -> bool {
        self.motion.iter().any(|mask| mask >> joint & 1 == 1)
    }

    /// Forgets the rests of a joint; call it before searching a block.
    pub fn begin(&mut self, joint: usize) {
        self.rests[joint].clear();
    }

    /// Finds the rests of a joint in one uninterrupted stretch of its positions. `resolution` is
    /// the size of a count, `noise` the standard deviation besides the rounding, `velocity` that
    /// of the filtered velocity, per sample.
    pub fn find(
        &mut self,
        joint: usize,
        q: &[f64],
        stretch: Range<usize>,
        (resolution, noise): (f64, f64),
        velocity: f64,
    ) {
        let width = 1.01 * resolution + RANGE * noise;
        let unknown = match velocity > 0.0 {
            true => ((2.0 * width / (KNOWN_SIGN * velocity)).ceil() as usize).max(FEWEST),
            false => usize::MAX,
        };
        let shortest = FEWEST.max((SHORTEST * 2.0 * self.half as f64).ceil() as usize);
        let slow = if self.abrupt >> joint & 1 == 1 {
            (SLOW * 2.0 * self.half as f64) as usize
        } else {
            usize::MAX
        };
        let rests = &mut self.rests[joint];
        find(q, stretch, width, shortest, slow.min(unknown), |from, to| {
            rests.push((from, to));
        });
    }

    /// Finds the rows to leave out because of rests; `centres` are the middles of the windows.
    pub fn judge(&mut self, centres: impl Iterator<Item = usize> + Clone) {
        self.any = false;
        for (mask, spoilt) in self.motion.iter().zip(&mut self.spoilt) {
            if *mask == 0 {
                continue;
            }
            for (centre, spoilt) in centres.clone().zip(spoilt.iter_mut()) {
                let (first, end) = (centre - self.half, centre + self.half + 1);
                let weight = |rests: &Vec<(usize, usize)>| -> f64 {
                    let from = rests.partition_point(|rest| rest.1 <= first);
                    rests[from..]
                        .iter()
                        .take_while(|rest| rest.0 < end)
                        .map(|&(a, b)| self.cumulative[b.min(end) - first] - self.cumulative[a.max(first) - first])
                        .sum()
                };
                let resting = |(joint, rests)| *mask >> joint & 1 == 1 && weight(rests) > SPOILT;
                *spoilt = self.rests.iter().enumerate().any(resting);
                self.any |= *spoilt;
            }
        }
    }

    /// True if a term jumps as the joint reverses.
    pub fn jumps(&self, joint: usize) -> bool {
        self.jumping >> joint & 1 == 1
    }

    /// Excludes the rows to leave out from an equation's covariance.
    pub fn exclude(&self, equation: usize, rows: usize, whitening: &mut Whitening) {
        if self.any {
            (0..rows)
                .filter(|&row| self.is_spoilt(equation, row))
                .for_each(|row| whitening.exclude(row));
        }
    }

    /// True if the equation does not hold in a part of these samples.
    pub fn is_within(&self, equation: usize, samples: &Range<usize>) -> bool {
        let overlap = |rest: &(usize, usize)| rest.0 < samples.end && samples.start < rest.1;
        let mut joints = self.rests.iter().enumerate();
        joints.any(|(joint, rests)| self.motion[equation] >> joint & 1 == 1 && rests.iter().any(overlap))
    }

    /// True if the equation does not hold in the row.
    #[inline]
    pub fn is_spoilt(&self, equation: usize, row: usize) -> bool {
        self.any && self.spoilt[equation].get(row).is_some_and(|spoilt| *spoilt)
    }
}

/// Finds the rests in a stretch of positions: whenever they stay within `width` for `shortest`
/// samples and do not merely reverse or pass there. A reversal or a passage of `slow` samples or
/// more is a rest, too.
fn find(q: &[f64], stretch: Range<usize>, width: f64, shortest: usize, slow: usize, rest: impl FnMut(usize, usize)) {
    let band = |x: &[f64]| {
        let width = width.max(1e-12 * x[0].abs()).max(f64::MIN_POSITIVE);
        // the two ends exclude most moving samples at once
        if (x[x.len() - 1] - x[0]).abs() > width {
            return None;
        }
        let (low, high) = x.iter().fold((x[0], x[0]), |(l, h), &v| (l.min(v), h.max(v)));
        (high - low <= width).then_some((0.5 * (low + high), width))
    };
    find_about(q, stretch, band, shortest, slow, 9.0, rest);
}

/// Finds the rests in a stretch of a signal. `band` gives the value about which consecutive values
/// may rest, and the width; a passage stays within `far` times that width three times as long.
fn find_about(
    x: &[f64],
    stretch: Range<usize>,
    band: impl Fn(&[f64]) -> Option<(f64, f64)>,
    shortest: usize,
    slow: usize,
    far: f64,
    mut rest: impl FnMut(usize, usize),
) {
    let mut at = stretch.start;
    while at + shortest <= stretch.end {
        let Some((centre, width)) = band(&x[at..at + shortest]) else {
            at += 1;
            continue;
        };
        let within = |times: f64| {
            let near = |k: &usize| (x[*k] - centre).abs() <= times * width;
            let left = (stretch.start..at).rev().take_while(near).last().unwrap_or(at);
            let right = (at..stretch.end).take_while(near).last().unwrap_or(at) + 1;
            (left, right)
        };
        let ((from, to), (far_from, far_to)) = (within(1.0), within(far));
        let rested = 3.0 * (to - from) as f64 - (far_to - far_from) as f64;
        if rested >= 2.0 * shortest as f64 || to - from >= slow {
            rest(from, to);
            at = to;
        } else {
            at += shortest.div_ceil(2);
        }
    }
}

/// The rests of a block of pointwise rows, judged by the measured velocity.
///
/// The band of a velocity at rest is six standard deviations of its noise, learnt from the signal.
/// A reversal crosses it in t₁ and three times as much in 3 t₁, so the same formula distinguishes
/// it from a rest.
#[derive(Debug, Clone)]
pub(super) struct SlowSamples {
    motion: Vec<u32>,
    dq: Vec<Vec<f64>>,
    noise: Vec<SignalNoise>,
    /// Resting joints (bit j), per sample.
    resting: Vec<u32>,
    scratch: Vec<f64>,
}

impl SlowSamples {
    /// For blocks of at most `capacity` samples; `None` if every equation also holds at rest.
    pub fn new(plant: &dyn AnyPlant, capacity: usize) -> Option<Self> {
        let motion = motion_needed(plant);
        motion.iter().any(|mask| *mask != 0).then(|| Self {
            motion,
            dq: (0..plant.joints()).map(|_| Vec::with_capacity(capacity)).collect(),
            noise: vec![SignalNoise::default(); plant.joints()],
            resting: Vec::with_capacity(capacity),
            scratch: Vec::with_capacity(capacity),
        })
    }

    /// Takes the velocities of the next sample.
    pub fn push(&mut self, dq: &[f64; MAX_JOINTS]) {
        for (own, dq) in self.dq.iter_mut().zip(dq) {
            own.push(*dq);
        }
        self.resting.push(0);
    }

    /// Finds the rests of the block.
    pub fn judge(&mut self) {
        let needed = self.motion.iter().fold(0, |all, mask| all | mask);
        for (joint, dq) in self.dq.iter().enumerate().filter(|(j, _)| needed >> j & 1 == 1) {
            let noise = &mut self.noise[joint];
            noise.learn(dq, |_| false, &mut self.scratch);
            let largest = dq.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let band = (noise.resolution() + RANGE * noise.deviation()).max(1e-9 * largest);
            let resting = &mut self.resting;
            find_about(
                dq,
                0..dq.len(),
                |x| x.iter().all(|v| v.abs() <= band).then_some((0.0, band)),
                FEWEST,
                usize::MAX,
                3.0,
                |from, to| {
                    resting[from..to].iter_mut().for_each(|mask| *mask |= 1 << joint);
                },
            );
        }
    }

    /// Forgets the block.
    pub fn clear(&mut self) {
        self.dq.iter_mut().for_each(Vec::clear);
        self.resting.clear();
    }

    /// True if the equation does not hold at the sample.
    #[inline]
    pub fn is_spoilt(&self, equation: usize, index: usize) -> bool {
        self.resting[index] & self.motion[equation] != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{DriveInput, Manipulator, Motion, ServoAxis};

    fn rests(q: &[f64], width: f64) -> Vec<(usize, usize)> {
        let mut found = Vec::new();
        find(q, 0..q.len(), width, 5, usize::MAX, |a, b| found.push((a, b)));
        found
    }

    /// In counts of 1e-4: from −2 to 2 s about a reversal with `pause` s at rest in it.
    fn turn(acceleration: f64, pause: f64) -> Vec<f64> {
        (-2000..2000)
            .map(|k| {
                let t = (f64::from(k) * 1e-3).abs() - 0.5 * pause;
                let q = 0.5 * acceleration * t.max(0.0).powi(2) + 0.1234;
                (q / 1e-4).round() * 1e-4
            })
            .collect()
    }

    #[test]
    fn prop_a_reversal_is_a_rest_only_while_the_encoder_sees_none_of_it_and_a_pause_in_it_is_one_of_its_length() {
        for acceleration in [0.05_f64, 0.3, 1.0, 5.0, 30.0] {
            // duration of both ends within two and a half counts of the rest: the band is a count
            // wide, and either edge rounds
            let ends = 2.0 * (2.0 * 2.6e-4 / acceleration).sqrt();
            for pause in [0.0, 0.05, 0.2, 1.0] {
                let found = rests(&turn(acceleration, pause), 1.01e-4);
                assert!(found.len() <= 1, "{acceleration} {pause}");
                let length = found.iter().map(|rest| (rest.1 - rest.0) as f64 * 1e-3).sum::<f64>();
                assert!(
                    length >= pause - 2e-3 && length <= pause + ends + 2e-3,
                    "{acceleration} {pause}: {length}"
                );
            }
        }
        // fast reversals are distinguished from rests
        assert_eq!(rests(&turn(30.0, 0.0), 1.01e-4), []);
    }

    #[test]
    fn prop_where_a_derivative_jumps_slow_reversals_are_left_out_and_fast_ones_stay() {
        use crate::model::{ExtendedManipulator, ExtraTerms};
        let terms = ExtraTerms {
            coulomb_friction: true,
            offset: false,
        };
        let arm = ExtendedManipulator::new(Manipulator::default(), terms);
        let found = |arm: &ExtendedManipulator, acceleration: f64| {
            let q = turn(acceleration, 0.0);
            let mut standstill = Standstill::new(arm, &[1.0; 101], q.len(), 10);
            standstill.find(0, &q, 0..q.len(), (1e-4, 0.0), 0.0);
            standstill.rests[0].len()
        };
        // within a count for 2 √(2 W/a): 28 ms at 1 rad/s², 9 ms at 10 rad/s², a fifth of the
        // window are 20 ms
        assert_eq!((found(&arm, 1.0), found(&arm, 10.0)), (1, 0));
        // an offset has no jump and needs no motion
        let offset = ExtraTerms {
            coulomb_friction: false,
            offset: true,
        };
        let arm = ExtendedManipulator::new(Manipulator::default(), offset);
        assert_eq!(Standstill::new(&arm, &[1.0; 101], 10, 10).abrupt, 0);
        // the friction of a servo axis is in a term that is not differentiated
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Force, 1.0).unwrap();
        assert_eq!(Standstill::new(&axis, &[1.0; 101], 10, 10).abrupt, 0);
    }

    #[test]
    fn prop_a_creeping_joint_does_not_rest_however_slow() {
        for speed in [2e-3, 5e-3, 0.02, 0.1, 1.0] {
            let q: Vec<f64> = (0..4000)
                .map(|k| (speed * f64::from(k) * 1e-3 / 1e-4).round() * 1e-4)
                .collect();
            assert_eq!(rests(&q, 1.01e-4), [], "{speed}");
        }
    }

    #[test]
    fn prop_a_joint_that_creeps_rests_if_the_filter_does_not_know_its_sign() {
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Force, 1.0).unwrap();
        // 21 samples of an encoder with a count of 1e-4: σ_v is 0.03 counts per sample, so that
        // 0.09 counts per sample are known and pass 2 W in 22
        for (speed, known) in [(0.01, false), (0.05, false), (0.2, true), (1.0, true)] {
            let q: Vec<f64> = (0..4000).map(|k| (speed * f64::from(k)).round() * 1e-4).collect();
            let mut standstill = Standstill::new(&axis, &[1.0; 41], q.len(), 10);
            standstill.find(0, &q, 0..q.len(), (1e-4, 0.0), 0.03e-4);
            assert_eq!(standstill.rests[0].is_empty(), known, "{speed}");
        }
    }

    #[test]
    fn val_terms_that_jump_are_found_and_smooth_ones_are_not() {
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Force, 1.0).unwrap();
        assert!(jumps(&axis, 0, 0, 0));
        assert_eq!(motion_needed(&axis), [1]);
        assert_eq!(motion_needed(&Manipulator::default()), [0, 0]);
    }
}
