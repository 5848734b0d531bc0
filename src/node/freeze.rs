//! Detects frozen signals: a sensor that hangs gives consistent but wrong data.
//!
//! A repeated value alone is no evidence: an encoder at rest repeats, and a commanded voltage may
//! be constant for long. With a patience of M samples, a joint's signal counts as frozen while
//!
//! | rule | signal | frozen if |
//! |---|---|---|
//! | A | position | after M samples of standstill the input, smoothed over M/4, moved by a fifth of its largest magnitude, or by all of it if friction can hold the joint, and by more than its noise does, or the measured velocity has passed a thousandth of the range of motion, and M samples later it still stands |
//! | B | input | it was constant for M samples, changed with every sample before, is not at its largest magnitude (a drive at its limit), and the position has moved by 5 % of its range |
//! | C | both | both were constant for 5 M samples, and the input changed with every sample before |
//! | D | position | four in five of its last steps of three counts or more follow a sample in which it stood still |
//! | E | input | it has been constant since the start of the stream, and the position has turned round four times, each time after more than half its range so far; not if it is 0 and other joints have inputs |
//!
//! No machine moves as in rule D: the position is read less often than it is reported. Its errors
//! then are the same for some samples, and look like the motion of another machine. A joint whose
//! input is always 0 beside joints that are driven may be a passive one, such as the pole on a cart
//! or the load of a crane.
//!
//! A joint held by friction that its model lacks also satisfies rule A, and a pendulum that swings
//! with its drive off from the start rule E, though such data show no parameter. Therefore M is a
//! configuration key, and 0 turns the detection off.

use crate::model::{JointSample, MAX_JOINTS};

/// Watches the joints of a stream.
#[derive(Debug, Clone)]
pub(super) struct FreezeWatch {
    patience: u64,
    period_s: f64,
    sticking: [bool; MAX_JOINTS],
    joints: [Joint; MAX_JOINTS],
}

/// What a joint is judged by.
#[derive(Debug, Clone, Copy)]
struct Criteria {
    /// M.
    patience: u64,
    /// Rule A: share of the input's largest magnitude.
    drive: f64,
    /// True if any joint has had an input.
    is_driven: bool,
}

#[derive(Debug, Clone, Copy)]
struct Joint {
    seen: bool,
    q: f64,
    u: f64,
    /// Number of samples with the same value.
    q_run: u64,
    u_run: u64,
    /// The input without noise and spikes, its largest magnitude, and its range in a standstill of
    /// at least M samples.
    smooth: f64,
    smooth_peak: f64,
    u_least: f64,
    u_most: f64,
    /// Mean |u_k − u_{k−1}|, from which the input's noise is estimated.
    jitter: f64,
    samples: f64,
    /// Range of the position since the input has been constant.
    q_least: f64,
    q_most: f64,
    /// Smallest change of the position that is not 0: at least one count.
    count: f64,
    /// Number of steps of some counts, and the share of the last ones that follow a standstill.
    steps: u64,
    leaps: f64,
    /// ∫|q̇| since the position has been constant.
    path: f64,
    /// Samples since the position should have moved.
    driven: u64,
    /// The position while the input has been constant since the start.
    swings: Swings,
    /// Largest |u| and range of the position over the whole stream.
    peak: f64,
    range: (f64, f64),
    /// Share of about the last thousand samples in which the input changed.
    lively: f64,
}

impl Joint {
    const NEW: Self = Self {
        seen: false,
        q: 0.0,
        u: 0.0,
        q_run: 0,
        u_run: 0,
        smooth: 0.0,
        smooth_peak: 0.0,
        jitter: 0.0,
        samples: 0.0,
        u_least: 0.0,
        u_most: 0.0,
        q_least: 0.0,
        q_most: 0.0,
        count: f64::INFINITY,
        steps: 0,
        leaps: 0.0,
        path: 0.0,
        driven: 0,
        swings: Swings::NEW,
        peak: 0.0,
        range: (0.0, 0.0),
        lively: 0.0,
    };
}

/// Counts how often a joint turns round, for rule E. If the input is constant all along, an offset
/// explains it exactly, with all other parameters 0.
#[derive(Debug, Clone, Copy)]
struct Swings {
    /// False once the input has changed.
    open: bool,
    samples: f64,
    /// The position without its noise, its range, and the mean of its steps.
    smooth: f64,
    range: (f64, f64),
    jitter: f64,
    /// Last extreme, the direction since, and the number of turns.
    extreme: f64,
    upwards: bool,
    turns: u32,
}

impl Swings {
    const NEW: Self = Self {
        open: true,
        samples: 0.0,
        smooth: 0.0,
        range: (0.0, 0.0),
        jitter: 0.0,
        extreme: 0.0,
        upwards: false,
        turns: 0,
    };
    /// Number of turns after which the input counts as frozen.
    const ENOUGH: u32 = 4;
    /// Share of the range so far that the joint must cover between two turns.
    const SWING: f64 = 0.5;
    /// Noise alone keeps the range of the smoothed position below this many times its mean step.
    const NOISE: f64 = 20.0;

    fn end(&mut self) {
        self.open = false;
    }

    /// Takes a position that is `step` away from the one before; true if the joint has turned often
    /// enough.
    #[inline]
    fn take(&mut self, q: f64, step: f64, patience: u64) -> bool {
        if !self.open {
            return false;
        }
        if self.samples == 0.0 {
            (self.smooth, self.range, self.extreme) = (q, (q, q), q);
        }
        let share = (8.0 / patience as f64).min(1.0);
        self.samples += 1.0;
        self.jitter += (step - self.jitter) / self.samples;
        self.smooth += (q - self.smooth) * share;
        self.range = (self.range.0.min(self.smooth), self.range.1.max(self.smooth));
        let range = self.range.1 - self.range.0;
        let away = self.smooth - self.extreme;
        if (away > 0.0) == self.upwards {
            self.extreme = self.smooth;
        } else if away.abs() > Self::SWING * range && range > Self::NOISE * self.jitter * share.sqrt() {
            (self.upwards, self.extreme) = (!self.upwards, self.smooth);
            self.turns += 1;
        }
        self.turns >= Self::ENOUGH
    }
}

impl FreezeWatch {
    /// Rule A: share of the input's largest magnitude, and for a joint that friction can hold.
    const DRIVE: f64 = 0.2;
    const STICKING_DRIVE: f64 = 1.0;
    /// Rule A: standard deviations of the smoothed input's noise.
    const NOISE: f64 = 20.0;
    /// Rule A: share of the range of motion.
    const PATH: f64 = 1e-3;
    /// Rule B: share of the range of motion.
    const MOTION: f64 = 0.05;
    /// Rules B and C: share of samples in which a lively input changes.
    const LIVELY: f64 = 0.9;
    /// Rule C: patience of M times this.
    const STILL: u64 = 5;

    /// Rule D: a step of this many counts is more than the encoder's rounding.
    const COUNTS: f64 = 2.5;
    /// Rule D: number of steps that the share is of, and the smallest number that is judged.
    const STEPS: u64 = 200;
    const FEWEST: u64 = 100;
    /// Rule D: share of the steps that follow a standstill.
    const LEAPS: f64 = 0.8;

    /// With M = `patience` samples, 0 to turn it off, every `period_s`, and the joints that
    /// friction can hold.
    pub(super) fn new(patience: u64, period_s: f64, sticking: [bool; MAX_JOINTS]) -> Self {
        Self {
            patience,
            period_s,
            sticking,
            joints: [Joint::NEW; MAX_JOINTS],
        }
    }

    /// Forgets the stream.
    pub(super) fn reset(&mut self) {
        self.joints = [Joint::NEW; MAX_JOINTS];
    }

    /// Checks a sample of finite numbers; true if a signal of one of the first `joints` is frozen.
    /// `dq` and the input are used only if they are measured.
    pub(super) fn check(&mut self, sample: &JointSample, joints: usize, measured: bool, driven: bool) -> bool {
        if self.patience == 0 {
            return false;
        }
        let mut frozen = false;
        let is_driven = self.joints[..joints].iter().any(|joint| joint.peak > 0.0);
        for (index, joint) in self.joints[..joints].iter_mut().enumerate() {
            let u = if driven { sample.input[index] } else { 0.0 };
            let speed = if measured { sample.dq[index].abs() } else { 0.0 };
            let criteria = Criteria {
                patience: self.patience,
                drive: match self.sticking[index] {
                    true => Self::STICKING_DRIVE,
                    false => Self::DRIVE,
                },
                is_driven,
            };
            frozen |= joint.check(sample.q[index], u, speed * self.period_s, criteria);
        }
        frozen
    }
}

impl Joint {
    /// True if the position or the input is frozen; `step` is the distance that the joint covers in
    /// a period according to its measured velocity.
    #[inline]
    fn check(&mut self, q: f64, u: f64, step: f64, criteria: Criteria) -> bool {
        let Criteria { patience, drive, .. } = criteria;
        if !self.seen {
            *self = Self {
                seen: true,
                range: (q, q),
                q,
                u,
                smooth: u,
                ..Self::NEW
            };
        }
        self.peak = self.peak.max(u.abs());
        self.samples = (self.samples + 1.0).min(1e3);
        self.jitter += ((u - self.u).abs() - self.jitter) / self.samples;
        self.smooth += (u - self.smooth) * (4.0 / patience as f64).min(1.0);
        self.smooth_peak = self.smooth_peak.max(self.smooth.abs());
        self.range = (self.range.0.min(q), self.range.1.max(q));
        let range = self.range.1 - self.range.0;
        let q_same = q.to_bits() == self.q.to_bits();
        let u_same = u.to_bits() == self.u.to_bits();
        let was_lively = self.lively > FreezeWatch::LIVELY;
        let mut rule_e = false;
        if u_same {
            self.u_run += 1;
            rule_e = self.swings.take(q, (q - self.q).abs(), patience);
            (self.q_least, self.q_most) = (self.q_least.min(q), self.q_most.max(q));
        } else {
            self.lively += 1e-3 * (1.0 - self.lively);
            self.u_run = 0;
            self.swings.end();
            (self.q_least, self.q_most) = (q, q);
        }
        // an input that stops changing still counts as lively until it has been constant for long
        if u_same && self.u_run > 20 * FreezeWatch::STILL * patience {
            self.lively *= 0.999;
        }
        if q_same {
            self.q_run += 1;
            self.path += step;
            // the input of a joint that comes to rest first settles
            (self.u_least, self.u_most) = match self.q_run <= patience {
                true => (self.smooth, self.smooth),
                false => (self.u_least.min(self.smooth), self.u_most.max(self.smooth)),
            };
            // noise alone must not count as drive: √(2/M) of white noise passes the filter
            let noise = FreezeWatch::NOISE * self.jitter * (2.0 / patience as f64).sqrt();
            let is_pushed = self.u_most - self.u_least > noise.max(drive * self.smooth_peak);
            let slides = range > 0.0 && self.path > FreezeWatch::PATH * range;
            self.driven = if is_pushed || slides { self.driven + 1 } else { 0 };
        } else {
            self.step(q);
            (self.q_run, self.path, self.driven) = (0, 0.0, 0);
        }
        (self.q, self.u) = (q, u);
        let at_limit = u.abs() >= self.peak * (1.0 - 1e-9);
        let moved = range > 0.0 && self.q_most - self.q_least > FreezeWatch::MOTION * range;
        let rule_a = self.driven >= patience;
        let rule_b = self.u_run >= patience && was_lively && !at_limit && moved;
        let rule_c = was_lively && self.u_run.min(self.q_run) >= FreezeWatch::STILL * patience;
        rule_e &= self.peak > 0.0 || !criteria.is_driven;
        let rule_d = self.steps >= FreezeWatch::FEWEST && self.leaps > FreezeWatch::LEAPS;
        rule_a || rule_b || rule_c || rule_d || rule_e
    }

    /// Counts a step of the position for rule D.
    #[inline]
    fn step(&mut self, q: f64) {
        let step = (q - self.q).abs();
        // −0 differs from 0 to the bit
        if step > 0.0 {
            self.count = self.count.min(step);
        }
        if step > FreezeWatch::COUNTS * self.count {
            self.steps += 1;
            let leaps = if self.q_run > 0 { 1.0 } else { 0.0 };
            self.leaps += (leaps - self.leaps) / self.steps.min(FreezeWatch::STEPS) as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const M: u64 = 200;

    /// A joint that swings and rests, with its encoder and noisy input; `spoil` modifies them
    /// before the watch.
    fn frozen_samples(spoil: impl Fn(u64, &mut f64, &mut f64)) -> Vec<u64> {
        let mut watch = FreezeWatch::new(M, 1e-3, [false; MAX_JOINTS]);
        let mut frozen = Vec::new();
        let mut noise = 1u64;
        for k in 0..20_000u64 {
            let t = k as f64 * 1e-3;
            // swings for 2 s, rests for 2 s; 16 bit
            let phase = if t % 4.0 < 2.0 { t % 4.0 } else { 2.0 };
            let q = 0.5 * (std::f64::consts::PI * phase).cos();
            let swinging = phase < 2.0;
            let mut q = (q * 10_430.0).round() / 10_430.0;
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let force = if swinging {
                -30.0 * (std::f64::consts::PI * phase).cos()
            } else {
                5.0
            };
            let mut u = force + 0.1 * ((noise >> 40) as f64 / (1u64 << 24) as f64 - 0.5);
            spoil(k, &mut q, &mut u);
            let mut sample = JointSample::default();
            (sample.q[0], sample.input[0]) = (q, u);
            if watch.check(&sample, 1, false, true) {
                frozen.push(k);
            }
        }
        frozen
    }

    #[test]
    fn fault_a_joint_that_moves_and_rests_is_not_frozen_and_each_rule_sees_its_fault() {
        assert_eq!(frozen_samples(|_, _, _| ()).first(), None, "a healthy joint");
        // the encoder hangs in motion while the input continues
        let hung = frozen_samples(|k, q, _| {
            if k >= 8_500 {
                *q = 0.01;
            }
        });
        assert!((8_900..9_500).contains(&hung[0]), "{:?}", hung.first());
        assert_eq!(hung.len() as u64, 20_000 - hung[0], "until the end");
        // the input hangs in motion, not at its limit
        let hung = frozen_samples(|k, _, u| {
            if k >= 8_400 {
                *u = 7.0;
            }
        });
        assert!((8_600..8_700).contains(&hung[0]), "{:?}", hung.first());
        // the whole sample hangs, at rest
        let hung = frozen_samples(|k, q, u| {
            if k >= 7_000 {
                (*q, *u) = (0.5, 5.01);
            }
        });
        assert!((7_999..8_300).contains(&hung[0]), "{:?}", hung.first());
        // and recovers
        let hung = frozen_samples(|k, q, _| {
            if (8_500..9_900).contains(&k) {
                *q = 0.01;
            }
        });
        assert_eq!(hung.last(), Some(&9_899));
    }

    /// Every second, third and fifth sample is new, and a twentieth of them at random; in the last
    /// case nothing is frozen.
    #[test]
    fn fault_a_position_that_is_read_every_few_samples_is_frozen() {
        for period in [2, 3, 5, 0] {
            let mut held = 0.0;
            let mut random = 7u64;
            let found = std::cell::RefCell::new((&mut held, &mut random));
            let frozen = frozen_samples(|k, q, _| {
                let (held, random) = &mut *found.borrow_mut();
                **random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let is_new = match period {
                    0 => (**random >> 33) % 20 != 0,
                    _ => k % period == 0,
                };
                if is_new {
                    **held = *q;
                }
                *q = **held;
            });
            match period {
                0 => assert_eq!(frozen.first(), None),
                _ => assert!(
                    frozen[0] < 2_000 && frozen.last() == Some(&19_999),
                    "{period}: {frozen:?}"
                ),
            }
        }
    }

    #[test]
    fn regress_a_zero_with_a_sign_is_no_step() {
        let signed = frozen_samples(|k, q, _| {
            *q = match k {
                0 => 0.0,
                1 => -0.0,
                _ => (*q * 200.0).round() / 200.0,
            }
        });
        assert_eq!(signed.first(), None);
    }

    /// The input rises from minus a share of its largest magnitude to plus it at rest.
    #[test]
    fn fault_a_joint_that_friction_can_hold_is_frozen_only_if_the_input_moves_by_all_of_it() {
        for (sticking, share, expected) in [(false, 0.4, true), (true, 0.4, false), (true, 0.8, true)] {
            let mut watch = FreezeWatch::new(M, 1e-3, [sticking; MAX_JOINTS]);
            let frozen = (0..6_000_u64).any(|k| {
                let t = k as f64 * 1e-3;
                let (swing, rise) = ((6.0 * t).sin(), (0.5 * (t - 3.5)).clamp(0.0, 1.0));
                let mut sample = JointSample::default();
                (sample.q[0], sample.input[0]) = match k {
                    0..3_000 => (swing, swing),
                    _ => (0.5, share * (2.0 * rise - 1.0)),
                };
                watch.check(&sample, 1, false, true)
            });
            assert_eq!(frozen, expected, "{sticking} {share}");
        }
    }

    #[test]
    fn fault_an_input_of_zero_is_frozen_unless_another_joint_is_driven() {
        for (other, input, expected) in [(1.0, 0.0, false), (0.0, 0.0, true), (1.0, 2.0, true)] {
            let mut watch = FreezeWatch::new(M, 1e-3, [false; MAX_JOINTS]);
            let frozen = (0..20_000_u64).any(|k| {
                let swing = (k as f64 * 5e-3).sin();
                let mut sample = JointSample::default();
                sample.q[..2].copy_from_slice(&[swing, swing]);
                sample.input[..2].copy_from_slice(&[other * swing, input]);
                watch.check(&sample, 2, false, true)
            });
            assert_eq!(frozen, expected, "{other} {input}");
        }
    }

    #[test]
    fn fault_a_joint_that_rests_from_the_beginning_under_a_noisy_input_is_not_frozen() {
        let resting = frozen_samples(|k, q, u| {
            // at rest the input is only noise of ±0.05
            if k < 15_000 {
                let mixed = k.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                (*q, *u) = (0.1, mixed as f64 / u64::MAX as f64 * 0.1 - 0.05);
            }
        });
        assert_eq!(resting.first(), None);
    }

    #[test]
    fn fault_an_input_that_hangs_from_the_beginning_is_frozen_until_it_changes() {
        let hung = frozen_samples(|k, _, u| {
            if k < 12_000 {
                *u = 5.0;
            }
        });
        // the joint swings to and fro in two seconds of every four
        assert!((2_000..9_000).contains(&hung[0]), "{:?}", hung.first());
        assert_eq!(hung.last(), Some(&11_999));
    }

    #[test]
    fn prop_a_constant_input_of_a_joint_that_rests_or_goes_one_way_is_not_frozen() {
        // with an encoder that flickers, with an analog one, and in a turn table
        let flickers =
            frozen_samples(|k, q, u| (*q, *u) = (f64::from(k.wrapping_mul(0x9E37_79B9) as u32 >> 31) * 1e-4, 0.0));
        let noisy = frozen_samples(|k, q, u| {
            let mixed = k.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            (*q, *u) = (1e-3 * mixed as f64 / u64::MAX as f64, 0.0);
        });
        let turns = frozen_samples(|k, q, u| (*q, *u) = (k as f64 * 1e-3 + 0.01 * (k as f64 * 1e-2).sin(), 3.0));
        assert_eq!((flickers.first(), noisy.first(), turns.first()), (None, None, None));
    }

    #[test]
    fn prop_a_commanded_input_that_is_constant_by_nature_is_not_frozen() {
        let stairs = frozen_samples(|k, q, u| {
            *u = if (k / 3_000) % 2 == 0 { 12.0 } else { -6.0 };
            *q = (k as f64 * 1e-3).sin();
        });
        assert_eq!(stairs.first(), None);
    }
}
