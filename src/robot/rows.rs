//! Rows of the weak form of a linear robot model, from samples at any instants.
//!
//! With the window ψ(s) = (1 − s²)⁴, s = 2 (t − t_c)/T in (−1, 1), one row per joint and window:
//!
//! ```text
//! ∫ψ τ dt = [−∫ψ̇ d dt + ∫ψ c dt] θ                                                            (1)
//! ∫ψ (dd/dt) dt ≈ Σ ½ (ψ_i + ψ_{i+1}) (d_{i+1} − d_i)                                          (2)
//! ∫ψ c dt       ≈ Σ ½ (t_{i+1} − t_i) (ψ_i c_i + ψ_{i+1} c_{i+1})                              (3)
//! ```
//!
//! (2) is summation by parts: it is the trapezoid rule (3) for the derivative without forming one,
//! exact for a constant and consistent with (3) for a straight line, at irregular instants too.
//! Both sides are divided by ∫ψ dt, so that a row is a mean torque. No acceleration is formed.
//! Source of the weak form: A. Preisig, D. Rippin, Computers & Chemical Engineering 17 (1993).

use super::acceleration_noise::{AccelerationNoise, RowErrors};
use super::clipped::Largest;
use super::error::{IdentifyError, SampleFault};
use super::friction::Engagement;
use super::model::RobotModel;
use super::regressor::{EnergyRegressors, HeldSlopes};
use super::state::RobotSample;
use super::windows::{WindowOptions, psi_and_slope};
use crate::model::MAX_JOINTS;

/// Updates per window of the columns of zeros and tilts, which depend on the posture: a robot moves
/// little in 2 ms.
const SLOPES_PER_WINDOW: f64 = 64.0;

/// Share of an acceleration below which its errors are left out: the bias is not larger than it.
const NEGLIGIBLE: f64 = 1e-5;

/// One row (1) of a joint.
#[derive(Debug, Clone, Copy)]
pub struct WeakRow<'a> {
    /// The joint.
    pub joint: usize,
    /// Middle of its window \[s\].
    pub t_s: f64,
    /// Regressor over [`RobotModel::columns`] of the joint.
    pub regressor: &'a [f64],
    /// Mean torque \[N m or N\].
    pub torque: f64,
    /// Effect of errors of the velocities.
    pub errors: RowErrors<'a>,
}

/// Accelerations of windows, and their errors.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    /// Sum of their squares \[(rad/s²)² or (m/s²)²\].
    pub square: [f64; MAX_JOINTS],
    /// Sum of the variances of their errors.
    pub noise: [f64; MAX_JOINTS],
}

impl Motion {
    /// Multiplies the sums by this factor.
    pub fn fade(&mut self, kept: f64) {
        for sum in self.square.iter_mut().chain(&mut self.noise) {
            *sum *= kept;
        }
    }
}

/// Sums of one window.
#[derive(Debug, Clone, Copy, Default)]
struct Window {
    center: f64,
    weight: f64,
    /// ψ and dψ/ds at the previous sample, and the time between that sample and the one before it,
    /// 0 if it opened the window.
    last_psi: f64,
    last_slope: f64,
    last_gap: f64,
    torque: [f64; MAX_JOINTS],
    rest: [f64; MAX_JOINTS],
    acceleration: [f64; MAX_JOINTS],
    /// The same from the positions, times T/2.
    of_positions: [f64; MAX_JOINTS],
}

/// Converts samples to rows: a fixed number of overlapping windows, filled sample by sample without
/// allocation.
#[derive(Debug, Clone)]
pub struct WeakRows {
    options: WindowOptions,
    joints: usize,
    entries: usize,
    needs_motion: [bool; MAX_JOINTS],
    rest_speed: [f64; MAX_JOINTS],
    engagement: [Engagement; MAX_JOINTS],
    largest: [Largest; MAX_JOINTS],
    noise: AccelerationNoise,
    motion: Motion,
    regressors: EnergyRegressors,
    slopes: HeldSlopes,
    last: Option<RobotSample>,
    /// Time of the newest sample, and of the start, without the time between recordings \[s\].
    newest_s: f64,
    start_s: Option<f64>,
    /// d and c of this sample, and of the one before.
    differentiated: [Vec<f64>; 2],
    direct: [Vec<f64>; 2],
    /// d of this sample less that of the one before.
    step: Vec<f64>,
    windows: Vec<Window>,
    sums: Vec<f64>,
    oldest: usize,
    active: usize,
    next_center: f64,
}

impl WeakRows {
    /// For a model and measured velocities.
    ///
    /// # Errors
    /// See [`WindowOptions::validate`].
    pub fn new(model: &RobotModel, options: WindowOptions) -> Result<Self, IdentifyError> {
        options.validate()?;
        let joints = model.robot().len();
        let entries = model.row_entries();
        let slots = (options.length_s / options.stride_s).ceil() as usize + 1;
        let mut needs_motion = [false; MAX_JOINTS];
        let mut rest_speed = [0.0; MAX_JOINTS];
        for (i, friction) in model.friction().iter().enumerate() {
            needs_motion[i] = friction.needs_motion();
            rest_speed[i] = friction.rest_speed;
        }
        let room = || [vec![0.0; entries], vec![0.0; entries]];
        Ok(Self {
            options,
            joints,
            entries,
            needs_motion,
            rest_speed,
            engagement: [Engagement::default(); MAX_JOINTS],
            largest: [Largest::default(); MAX_JOINTS],
            noise: AccelerationNoise::measured(),
            motion: Motion::default(),
            regressors: EnergyRegressors::new(joints),
            slopes: HeldSlopes::new(options.length_s / SLOPES_PER_WINDOW),
            last: None,
            newest_s: 0.0,
            start_s: None,
            differentiated: room(),
            direct: room(),
            step: vec![0.0; entries],
            windows: vec![Window::default(); slots],
            sums: vec![0.0; slots * entries],
            oldest: 0,
            active: 0,
            next_center: 0.0,
        })
    }

    /// The same for velocities computed from positions over this time on either side \[s\].
    #[must_use]
    pub fn with_formed_velocities(self, half_s: f64) -> Self {
        Self {
            noise: AccelerationNoise::formed(half_s),
            ..self
        }
    }

    /// Changes the windows, which must have as many strides; drops the open ones.
    pub(super) fn set_windows(&mut self, options: WindowOptions) {
        self.options = options;
        self.slopes = HeldSlopes::new(options.length_s / SLOPES_PER_WINDOW);
        self.active = 0;
        self.motion = Motion::default();
        self.noise.forget_windows();
        if let Some(last) = &self.last {
            self.next_center = last.t_s + 0.5 * options.length_s;
        }
    }

    /// Time since the start, without that between recordings \[s\].
    pub(super) fn elapsed_s(&self) -> f64 {
        self.start_s.map_or(0.0, |start_s| self.newest_s - start_s)
    }

    /// The regressors at the newest sample.
    pub(super) fn regressors(&self) -> &EnergyRegressors {
        &self.regressors
    }

    /// Accelerations of the joints in the windows so far.
    pub(super) fn motion(&mut self) -> &mut Motion {
        &mut self.motion
    }

    /// Forgets the samples so far: the next one begins a new recording.
    pub fn restart(&mut self) {
        self.last = None;
        self.active = 0;
        self.slopes.forget();
        self.engagement = [Engagement::default(); MAX_JOINTS];
    }

    /// The same, and forgets the largest torques.
    pub(super) fn reset(&mut self) {
        self.restart();
        self.largest = Default::default();
        self.motion = Motion::default();
        self.start_s = None;
    }

    /// The limit at which a joint's torque is clipped in motion, with the share of the samples at
    /// it, 0 to 1; `None` for a torque that is not clipped.
    pub fn clipped(&self, joint: usize) -> Option<(f64, f64)> {
        self.largest[joint].clipped()
    }

    /// Adds a sample and passes each row that it completes to `take`. After a gap longer than
    /// allowed the windows restart.
    ///
    /// # Errors
    /// If the sample cannot be used; it is left out and nothing else changes.
    pub fn push(
        &mut self,
        model: &RobotModel,
        sample: &RobotSample,
        take: &mut dyn FnMut(WeakRow<'_>),
    ) -> Result<(), SampleFault> {
        let n = self.joints;
        let signals = [&sample.q, &sample.dq, &sample.tau];
        if !(sample.t_s.is_finite() && signals.iter().all(|s| s[..n].iter().all(|x| x.is_finite()))) {
            return Err(SampleFault::NotFinite);
        }
        let gap = match &self.last {
            Some(last) if sample.t_s <= last.t_s => return Err(SampleFault::NotLater),
            Some(last) => sample.t_s - last.t_s,
            None => {
                self.start_s = Some(sample.t_s - self.elapsed_s());
                f64::INFINITY
            }
        };
        let travel = match &self.last {
            Some(last) => self.noise.travel(last, sample, n),
            None => [0.0; MAX_JOINTS],
        };
        for (i, friction) in model.friction().iter().enumerate() {
            self.engagement[i] = friction.engagement(travel[i], self.engagement[i]);
            if sample.dq[i].abs() > self.rest_speed[i] {
                self.largest[i].take(sample.tau[i]);
            }
        }
        self.differentiated.swap(0, 1);
        self.direct.swap(0, 1);
        model.rows_of(
            &mut self.regressors,
            &mut self.slopes,
            sample,
            &self.engagement[..n],
            &mut self.differentiated[1],
            &mut self.direct[1],
        );
        if gap > self.options.max_gap_s {
            self.active = 0;
            self.next_center = sample.t_s + 0.5 * self.options.length_s;
        } else if let Some(last) = self.last {
            self.open_until(sample.t_s);
            self.noise.take(&last, sample, &travel[..n], self.options.length_s);
            let [before, now] = &self.differentiated;
            for ((step, before), now) in self.step.iter_mut().zip(before).zip(now) {
                *step = now - before;
            }
            for age in 0..self.active {
                self.add((self.oldest + age) % self.windows.len(), (&last, sample), &travel, gap);
            }
            while self.active > 0 && self.windows[self.oldest].center + 0.5 * self.options.length_s <= sample.t_s {
                self.close(model, take);
            }
        }
        self.last = Some(*sample);
        self.newest_s = sample.t_s;
        Ok(())
    }

    /// Opens the windows that begin before a time.
    fn open_until(&mut self, t_s: f64) {
        while self.active < self.windows.len() && self.next_center - 0.5 * self.options.length_s < t_s {
            let slot = (self.oldest + self.active) % self.windows.len();
            self.windows[slot] = Window {
                center: self.next_center,
                ..Window::default()
            };
            self.sums[slot * self.entries..(slot + 1) * self.entries].fill(0.0);
            self.active += 1;
            self.next_center += self.options.stride_s;
        }
    }

    /// Adds the time between two samples to a window.
    fn add(&mut self, slot: usize, (last, sample): (&RobotSample, &RobotSample), travel: &[f64; MAX_JOINTS], gap: f64) {
        let window = &mut self.windows[slot];
        let s = 2.0 * (sample.t_s - window.center) / self.options.length_s;
        let (psi, slope) = psi_and_slope(s);
        let before = std::mem::replace(&mut window.last_psi, psi);
        let gap_before = std::mem::replace(&mut window.last_gap, gap);
        let mean = 0.5 * (before + psi); // (2)
        let (left, right) = (0.5 * gap * before, 0.5 * gap * psi); // (3)
        let mean_slope = 0.5 * (std::mem::replace(&mut window.last_slope, slope) + slope);
        window.weight += left + right;
        for i in 0..self.joints {
            window.torque[i] += left * last.tau[i] + right * sample.tau[i]; // (3)
            window.acceleration[i] += mean * (sample.dq[i] - last.dq[i]); // (2)
            window.of_positions[i] -= mean_slope * travel[i]; // (1) of velocity_noise.rs
            let resting = |x: &RobotSample| x.dq[i].abs() < self.rest_speed[i];
            window.rest[i] += if resting(last) { left } else { 0.0 } + if resting(sample) { right } else { 0.0 };
        }
        // both terms of a sample in (3) together, once the next sample has arrived; the last sample
        // of a window, with ψ = 0, has none
        let own = 0.5 * (gap_before + gap) * before;
        let sums = &mut self.sums[slot * self.entries..(slot + 1) * self.entries];
        for ((sum, step), direct) in sums.iter_mut().zip(&self.step).zip(&self.direct[0]) {
            *sum += mean * step + own * direct; // (1)
        }
    }

    /// Closes the oldest window and passes its rows to `take`.
    fn close(&mut self, model: &RobotModel, take: &mut dyn FnMut(WeakRow<'_>)) {
        let slot = self.oldest;
        self.oldest = (self.oldest + 1) % self.windows.len();
        self.active -= 1;
        let window = &self.windows[slot];
        if !(window.weight > 0.0) {
            return;
        }
        let sums = &mut self.sums[slot * self.entries..(slot + 1) * self.entries];
        sums.iter_mut().for_each(|x| *x /= window.weight);
        let acceleration = window.acceleration.map(|sum| sum / window.weight);
        let per_weight = 2.0 / (self.options.length_s * window.weight);
        let of_positions = window.of_positions.map(|sum| sum * per_weight);
        self.noise
            .take_window(&acceleration, &of_positions, self.joints, self.options.length_s);
        let mut variances = self.noise.variances(self.joints, self.options.length_s);
        for (k, variance) in variances.iter_mut().enumerate().take(self.joints) {
            self.motion.square[k] += acceleration[k].powi(2);
            self.motion.noise[k] += *variance;
            if self.motion.noise[k] < NEGLIGIBLE * self.motion.square[k] {
                *variance = 0.0;
            }
        }
        let errors = RowErrors {
            regressors: &self.regressors,
            variances: &variances,
        };
        let elapsed_s = self.start_s.map_or(0.0, |start_s| window.center - start_s);
        let mut at = 0;
        for joint in 0..self.joints {
            let len = model.columns(joint).len();
            if model.ends_with_time(joint) {
                sums[at + len - 1] = elapsed_s;
            }
            let rests = self.needs_motion[joint] && window.rest[joint] > self.options.max_rest * window.weight;
            if !rests {
                take(WeakRow {
                    joint,
                    t_s: window.center,
                    regressor: &sums[at..at + len],
                    torque: window.torque[joint] / window.weight,
                    errors,
                });
            }
            at += len;
        }
    }
}
