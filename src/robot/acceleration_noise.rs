//! Effect of errors of the velocities on rows, whatever the velocities come from.
//!
//! An error a_k of the mean acceleration of joint k over a window makes a row x of joint j wrong by
//! D_jk a_k, D_jk the regressor of the entry M_jk of the mass matrix:
//!
//! ```text
//! E[x (τ − x·θ)] = −Σ_k var(a_k) D_jk M_jk,    M_jk = D_jk·θ                                       (1)
//! Δθ̂ = −P Σ_j w_j Σ_k var(a_k) D_jk M_jk,    P ← P + Δθ̂ Δθ̂ᵀ                                        (2)
//! ```
//!
//! (2) is the bias of least squares with errors in the regressors. It is not subtracted: the
//! correction needs θ and diverges with a θ̂ that is not yet known. Windows are made long enough
//! for it to be small ([`window_review`](super::window_review)), and standard deviations allow for
//! the rest. Source: T. Söderström, Automatica 43 (2007), for (1).

use super::encoder_noise::EncoderNoise;
use super::model::RobotModel;
use super::regressor::EnergyRegressors;
use super::state::RobotSample;
use super::velocity_noise::VelocityNoise;
use crate::model::MAX_JOINTS;
use std::f64::consts::TAU;

/// Errors of the accelerations of windows, by the origin of the velocities.
#[derive(Debug, Clone)]
pub(super) enum AccelerationNoise {
    /// Velocities computed from positions.
    Formed(EncoderNoise),
    /// Velocities with a sensor, or a filter, of their own.
    Measured(VelocityNoise),
}

impl AccelerationNoise {
    /// For velocities computed from positions over this time on either side \[s\].
    pub fn formed(half_s: f64) -> Self {
        Self::Formed(EncoderNoise::new(half_s))
    }

    /// For measured velocities.
    pub fn measured() -> Self {
        Self::Measured(VelocityNoise::default())
    }

    /// How far n joints moved from one sample to the next, for friction that depends on travel.
    /// Velocities that are computed from positions are smoother than these; a sum of measured ones
    /// would drift with their noise, so that friction seemed to reverse at rest.
    pub fn travel(&self, last: &RobotSample, sample: &RobotSample, n: usize) -> [f64; MAX_JOINTS] {
        let gap = sample.t_s - last.t_s;
        let mut travel = [0.0; MAX_JOINTS];
        for (k, travel) in travel.iter_mut().enumerate().take(n) {
            *travel = match self {
                Self::Formed(_) => 0.5 * (last.dq[k] + sample.dq[k]) * gap,
                Self::Measured(_) => {
                    let moved = sample.q[k] - last.q[k];
                    // an encoder may wrap
                    moved - ((moved - sample.dq[k] * gap) / TAU).round() * TAU
                }
            };
        }
        travel
    }

    /// Adds the step from one sample to the next, with the [`travel`](Self::travel) of the joints
    /// and windows of this length \[s\].
    pub fn take(&mut self, last: &RobotSample, sample: &RobotSample, travel: &[f64], length_s: f64) {
        match self {
            Self::Formed(noise) => noise.take(last, sample, travel.len(), length_s),
            Self::Measured(noise) => noise.take(last, sample, travel),
        }
    }

    /// Adds the mean accelerations of n joints over a window of this length \[s\]: by the
    /// velocities, and by the positions.
    pub fn take_window(&mut self, by_velocities: &[f64], by_positions: &[f64], n: usize, length_s: f64) {
        if let Self::Measured(noise) = self {
            noise.take_window(&by_velocities[..n], &by_positions[..n], length_s);
        }
    }

    /// Variances of the accelerations of n joints over a window of this length \[s\].
    pub fn variances(&mut self, n: usize, length_s: f64) -> [f64; MAX_JOINTS] {
        match self {
            Self::Formed(noise) => noise.variances(n, length_s),
            Self::Measured(noise) => *noise.variances(),
        }
    }

    /// Call this if the windows have another length from now on.
    pub fn forget_windows(&mut self) {
        if let Self::Measured(noise) = self {
            noise.forget_windows();
        }
    }
}

/// Effect of errors of the accelerations on the rows of one window.
#[derive(Debug, Clone, Copy)]
pub struct RowErrors<'a> {
    pub(super) regressors: &'a EnergyRegressors,
    /// var(a_k) \[(rad/s²)² or (m/s²)²\].
    pub(super) variances: &'a [f64; MAX_JOINTS],
}

impl RowErrors<'_> {
    /// Adds Σ_k var(a_k) D_jk M_jk of (1) for a row of this joint to `bias`, which has an entry per
    /// column; returns the variance of the row's torque, Σ_k var(a_k) M_jk².
    pub(super) fn bias(&self, model: &RobotModel, joint: usize, theta: &[f64], bias: &mut [f64]) -> f64 {
        let mut variance = 0.0;
        for k in (0..model.robot().len()).filter(|k| self.variances[*k] > 0.0) {
            let inertia = model.inertia(self.regressors, (joint, k), theta);
            let factor = self.variances[k] * inertia;
            model.add_inertia_row(self.regressors, (joint, k), factor, bias); // (1)
            variance += factor * inertia;
        }
        variance
    }
}
