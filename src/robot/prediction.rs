//! Predicts the standard deviations that identification reaches with a motion, before any torque is
//! measured.
//!
//! ```text
//! Λ = Λ₀ + Σ_j A_j / (f_j σ_j)²,      std_i = √(Λ⁻¹)_ii                                       (1)
//! σ_j² = s_j² Δ ∫ψ² / (∫ψ)²,          f_j² = Σ_k r(k · stride),   r = autocorrelation of ψ     (2)
//! ```
//!
//! (1) is the information of [`identify`](super::identify), which depends only on the motion if the
//! misfit of the torques is known: σ_j of a row and the factor f_j for its correlation. Both come
//! from an earlier identification, or from (2) for white noise of s_j per sample every Δ.

use super::error::IdentifyError;
use super::information::{Information, Solver};
use super::model::RobotModel;
use super::motion_table::MotionTable;
use super::rows::WeakRows;
use super::state::RobotSample;
use super::sums::JointSums;
use super::windows::{WindowOptions, psi};
use crate::estimator::linalg::Cholesky;

/// Samples per window at which a motion is evaluated: the window is smooth, so more of them change
/// the standard deviations by less than 1 %.
const LOOKS_PER_WINDOW: f64 = 10.0;
/// Share of the prior standard deviation below which a parameter is known from data: (1/3)² of the
/// variance.
const KNOWN: f64 = 1.0 / 3.0;
/// Smallest size of a parameter, relative to its scale for a machine of this size.
const SMALLEST_SIZE: f64 = 0.02;

/// Misfit of the rows of each joint.
#[derive(Debug, Clone, PartialEq)]
pub struct RowMisfit {
    /// σ_j: standard deviation of a row \[N m or N\], > 0.
    pub std: Vec<f64>,
    /// f_j ≥ 1: ratio of the misfit over seconds to that of independent rows.
    pub correlation: Vec<f64>,
}

impl RowMisfit {
    /// (2): for torques with white noise only; `std` is that of one sample at each joint.
    pub fn white(std: &[f64], sample_period_s: f64, windows: &WindowOptions) -> Self {
        const STEPS: i32 = 400;
        let step = 2.0 / f64::from(STEPS);
        let overlap = |lag: f64| -> f64 {
            (0..STEPS)
                .map(|i| -1.0 + step * (f64::from(i) + 0.5))
                .map(|x| psi(x) * psi(x + lag) * step)
                .sum()
        };
        let whole: f64 = (0..STEPS).map(|i| psi(-1.0 + step * (f64::from(i) + 0.5)) * step).sum();
        let square = overlap(0.0);
        let half = 0.5 * windows.length_s;
        let factor = (sample_period_s / half * square / (whole * whole)).sqrt(); // (2)
        let lags = (windows.length_s / windows.stride_s).ceil() as i32;
        let correlated: f64 = (1..=lags)
            .map(|k| 2.0 * overlap(f64::from(k) * windows.stride_s / half) / square)
            .sum();
        Self {
            std: std.iter().map(|s| s * factor).collect(),
            correlation: vec![(1.0 + correlated).sqrt(); std.len()], // (2)
        }
    }

    fn validate(&self, joints: usize) -> Result<(), IdentifyError> {
        let sound = |list: &[f64], least: f64| {
            list.len() == joints && list.iter().all(|x| *x >= least && *x > 0.0 && x.is_finite())
        };
        match sound(&self.std, 0.0) && sound(&self.correlation, 1.0) {
            true => Ok(()),
            false => Err(IdentifyError::Misfit {
                joints,
                std: self.std.clone(),
                correlation: self.correlation.clone(),
            }),
        }
    }
}

/// Forecast of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterForecast {
    /// Expected standard deviation.
    pub std: f64,
    /// Its size: the URDF's value, at least 2 % of its scale for a machine of this size.
    pub size: f64,
    /// False if the motion hardly informs on it: the standard deviation stays above a third of the
    /// prior's.
    pub is_told: bool,
}

/// Evaluates motions, reusing its workspace.
#[derive(Debug, Clone)]
pub struct Forecaster {
    model: RobotModel,
    windows: WindowOptions,
    misfit: RowMisfit,
    rows: WeakRows,
    sums: Vec<JointSums>,
    information: Information,
    factor: Cholesky,
    scaled: Vec<f64>,
}

impl Forecaster {
    /// For a model, its windows, and the expected misfit.
    ///
    /// # Errors
    /// If windows or misfit are invalid.
    pub fn new(model: RobotModel, windows: WindowOptions, misfit: RowMisfit) -> Result<Self, IdentifyError> {
        let (joints, n) = (model.robot().len(), model.parameters().len());
        misfit.validate(joints)?;
        Ok(Self {
            rows: WeakRows::new(&model, windows)?,
            sums: (0..joints).map(|j| JointSums::new(model.columns(j))).collect(),
            information: Information::new(n),
            factor: Cholesky::new(n),
            scaled: vec![0.0; n * n],
            model,
            windows,
            misfit,
        })
    }

    /// The model.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// The expected misfit.
    pub fn misfit(&self) -> &RowMisfit {
        &self.misfit
    }

    /// Time between two evaluations of a motion \[s\].
    pub fn step_s(&self) -> f64 {
        (self.windows.length_s / LOOKS_PER_WINDOW).min(0.9 * self.windows.max_gap_s)
    }

    /// (1), from the states of a motion at increasing times.
    pub(super) fn sample_motion(&mut self, motion: impl Iterator<Item = RobotSample>) {
        self.rows.restart();
        self.sums.iter_mut().for_each(JointSums::clear);
        for sample in motion {
            let sums = &mut self.sums;
            // A valid motion has finite numbers at increasing times.
            let _ = self.rows.push(&self.model, &sample, &mut |row| {
                sums[row.joint].add_row(row.regressor, 0.0);
            });
        }
        self.sums.iter_mut().for_each(JointSums::mirror);
        let RowMisfit { std, correlation } = &self.misfit;
        let weight = |joint: usize| (std[joint] * correlation[joint]).powi(-2);
        self.information.clear();
        for (i, parameter) in self.model.parameters().iter().enumerate() {
            self.information.set_prior(i, parameter.nominal, parameter.scale);
        }
        for (joint, sums) in self.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            sums.scatter(weight(joint), &mut self.information); // (1)
        }
    }

    /// ½ ln det Λ − ½ ln det Λ₀ of the last motion \[nat\]: the larger, the smaller the confidence
    /// ellipsoid. `None` if Λ is not positive definite because of rounding.
    pub(super) fn gain(&mut self) -> Option<f64> {
        let n = self.information.n;
        for (i, parameter) in self.model.parameters().iter().enumerate() {
            for (j, other) in self.model.parameters().iter().enumerate() {
                self.scaled[i * n + j] = self.information.matrix[i * n + j] * parameter.scale * other.scale;
            }
        }
        self.factor
            .factor(n, &self.scaled)
            .then(|| 0.5 * self.factor.log_determinant())
    }

    /// The forecast of each parameter for a motion.
    pub fn forecast(&mut self, motion: &MotionTable) -> Vec<ParameterForecast> {
        let (step, joints) = (self.step_s(), motion.joints());
        let count = (motion.duration_s() / step).floor() as usize;
        self.sample_motion((0..=count).map(|k| sample(motion, joints, step * k as f64)));
        let n = self.information.n;
        let mut covariance = vec![0.0; n * n];
        Solver::new(n).covariance(&self.information, &vec![false; n], &mut covariance);
        let forecast = self.model.parameters().iter().enumerate().map(|(i, parameter)| {
            let std = covariance[i * n + i].max(0.0).sqrt();
            ParameterForecast {
                std,
                size: parameter.nominal.abs().max(SMALLEST_SIZE * parameter.scale),
                is_told: std < KNOWN * parameter.scale,
            }
        });
        forecast.collect()
    }
}

fn sample(motion: &MotionTable, joints: usize, t_s: f64) -> RobotSample {
    let setpoints = motion.at(t_s);
    let mut sample = RobotSample {
        t_s,
        ..RobotSample::default()
    };
    for j in 0..joints {
        (sample.q[j], sample.dq[j]) = (setpoints[j][0], setpoints[j][1]);
    }
    sample
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ψ² / (∫ψ)² of (1 − x²)⁴ over (−1, 1) is 0.59908/0.81270² = 0.90705; rows a whole window
    /// apart are independent.
    #[test]
    fn val_white_noise_in_rows() {
        let windows = WindowOptions {
            length_s: 0.2,
            stride_s: 0.2,
            ..WindowOptions::default()
        };
        let misfit = RowMisfit::white(&[2.0], 0.001, &windows);
        assert!((misfit.std[0] / (2.0 * (0.001_f64 / 0.1 * 0.90705).sqrt()) - 1.0).abs() < 1e-4);
        assert!((misfit.correlation[0] - 1.0).abs() < 1e-9);
        // Dense rows: Σ r(k · stride) → (∫ψ)² / (stride ∫ψ²) = T/2 / (0.90705 stride).
        let dense = WindowOptions {
            length_s: 0.2,
            stride_s: 0.02,
            ..WindowOptions::default()
        };
        let misfit = RowMisfit::white(&[2.0], 0.001, &dense);
        assert!((misfit.correlation[0].powi(2) * 0.90705 / 5.0 - 1.0).abs() < 1e-3);
    }
}
