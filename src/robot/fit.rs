//! How well a model predicts the torques of a log.
//!
//! ```text
//! RRE_j = 100 ‖τ_j − τ̂_j‖ / ‖τ_j‖ [%],     fit_j = 100 (1 − ‖τ_j − τ̂_j‖ / ‖τ_j − mean τ_j‖) [%]   (1)
//! ```
//!
//! r_j(l) = Σ_k e_k e_{k+l} / Σ_k e_k², e = τ_j − τ̂_j: correlation time l Δ with r_j(l) = 1/e (2)
//!
//! τ_j is the torque as recorded, unfiltered. τ̂_j comes from q and zero-phase filtered q̇ and q̈
//! (Butterworth of order 5 at 0.15 of the Nyquist frequency; q̈ by central differences, filtered
//! again), which is the usual check in the literature on robot identification. (2) is the time for
//! which a misfit keeps its sign: a few samples for noise, as long as a movement for friction and
//! for bodies missing in the model.

use super::butterworth::ZeroPhaseLowPass;
use super::friction::Engagement;
use super::model::RobotModel;
use super::state::{FilteredSample, RobotSample};
use crate::model::MAX_JOINTS;

/// Share of moving samples below which a joint is not judged by its residual.
pub(super) const MOVING: f64 = 0.1;
/// Fewest moving samples to judge by: the low-pass of (1) forgets its ends within about 20.
const FEWEST_MOVING: usize = 50;

/// Filters a log of a model's robot; fewer than 3 samples give none.
pub fn filtered(model: &RobotModel, log: &[RobotSample]) -> Vec<FilteredSample> {
    let Some(filter) = ZeroPhaseLowPass::new(5, 0.15) else {
        return Vec::new();
    };
    let len = log.len();
    if len < 3 {
        return Vec::new();
    }
    let mut samples: Vec<FilteredSample> = log
        .iter()
        .map(|sample| FilteredSample {
            t_s: sample.t_s,
            q: sample.q,
            tau: sample.tau,
            ..FilteredSample::default()
        })
        .collect();
    for (joint, friction) in model.friction().iter().enumerate() {
        let raw: Vec<f64> = log.iter().map(|sample| sample.dq[joint]).collect();
        let dq = filter.apply(&raw);
        let rate = |a: usize, b: usize| (dq[b] - dq[a]) / (log[b].t_s - log[a].t_s);
        let differences: Vec<f64> = (0..len)
            .map(|i| rate(i.saturating_sub(1), (i + 1).min(len - 1)))
            .collect();
        let ddq = filter.apply(&differences);
        let (mut engagement, mut last) = (Engagement::default(), (log[0].t_s, dq[0]));
        for (i, sample) in samples.iter_mut().enumerate() {
            let travel = 0.5 * (last.1 + dq[i]) * (sample.t_s - last.0);
            engagement = friction.engagement(travel, engagement);
            last = (sample.t_s, dq[i]);
            (sample.dq[joint], sample.ddq[joint], sample.engagement[joint]) = (dq[i], ddq[i], engagement);
        }
    }
    samples
}

/// (2): the time after which the autocorrelation of a joint's misfit has fallen to 1/e \[s\];
/// `None` if it does not within half of the log, or for fewer than 3 samples.
pub fn correlation_time_s(model: &RobotModel, theta: &[f64], log: &[FilteredSample], joint: usize) -> Option<f64> {
    let n = model.robot().len();
    let mut predicted = [0.0; MAX_JOINTS];
    let error: Vec<f64> = log
        .iter()
        .map(|sample| {
            model.torques(theta, sample, &mut predicted[..n]);
            sample.tau[joint] - predicted[joint]
        })
        .collect();
    let (first, last) = (log.first()?, log.last()?);
    let square: f64 = error.iter().map(|e| e * e).sum();
    if log.len() < 3 || !(square > 0.0) {
        return None;
    }
    let mean_step = (last.t_s - first.t_s) / (log.len() - 1) as f64;
    let forgotten = (1..log.len() / 2).find(|lag| {
        let product: f64 = error.iter().zip(&error[*lag..]).map(|(a, b)| a * b).sum();
        product < square / std::f64::consts::E // (2)
    })?;
    Some(forgotten as f64 * mean_step)
}

/// Sums of (1) for each joint.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TorqueFit {
    samples: usize,
    error: [f64; MAX_JOINTS],
    square: [f64; MAX_JOINTS],
    sum: [f64; MAX_JOINTS],
    /// Samples in which a joint moves.
    moving: [usize; MAX_JOINTS],
}

impl TorqueFit {
    /// The fit of a model with parameters `theta` to a log.
    pub fn of(model: &RobotModel, theta: &[f64], log: &[FilteredSample]) -> Self {
        let mut fit = Self::default();
        log.iter().for_each(|sample| fit.add(model, theta, sample));
        fit
    }

    /// Adds one sample, predicted with `theta`.
    pub fn add(&mut self, model: &RobotModel, theta: &[f64], sample: &FilteredSample) {
        let n = model.robot().len();
        let mut predicted = [0.0; MAX_JOINTS];
        model.torques(theta, sample, &mut predicted[..n]);
        self.samples += 1;
        for i in 0..n {
            self.error[i] += (sample.tau[i] - predicted[i]).powi(2);
            self.square[i] += sample.tau[i].powi(2);
            self.sum[i] += sample.tau[i];
            self.moving[i] += usize::from(sample.dq[i].abs() > model.friction()[i].rest_speed);
        }
    }

    /// True if a joint moves in enough of the samples for its residual to tell something about the
    /// model: friction holds a joint at rest under any torque, and the filter needs some samples.
    pub fn can_be_judged(&self, joint: usize) -> bool {
        self.moving[joint] >= FEWEST_MOVING && self.moving[joint] as f64 > MOVING * self.samples as f64
    }

    /// RRE \[%\] of a joint; `None` without a torque.
    pub fn relative_residual(&self, joint: usize) -> Option<f64> {
        (self.square[joint] > 0.0).then(|| 100.0 * (self.error[joint] / self.square[joint]).sqrt()) // (1)
    }

    /// Fit \[%\] of a joint: 100 is perfect, 0 is as good as the mean; `None` for a torque that
    /// does not change.
    pub fn fit(&self, joint: usize) -> Option<f64> {
        let spread = self.square[joint] - self.sum[joint].powi(2) / self.samples.max(1) as f64;
        (spread > 1e-12 * self.square[joint]).then(|| 100.0 * (1.0 - (self.error[joint] / spread).sqrt())) // (1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::selection::Selection;
    use super::super::tree::Robot;
    use super::*;

    #[test]
    fn regress_a_joint_at_rest_and_a_handful_of_samples_judge_no_model() {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).expect("sound");
        let model = RobotModel::new(robot, true, vec![Default::default(); 6]).expect("sound");
        let theta: Vec<f64> = model.parameters().iter().map(|p| p.nominal).collect();
        // Joint 1 moves in a part of the samples, the others rest.
        let judged = |count: usize, moving: usize| {
            let sample = |k| {
                let mut sample = FilteredSample::default();
                sample.dq[0] = if k < moving { 0.3 } else { 0.001 };
                sample.tau = [1.0; MAX_JOINTS];
                sample
            };
            let samples: Vec<FilteredSample> = (0..count).map(sample).collect();
            let fit = TorqueFit::of(&model, &theta, &samples);
            assert!((1..6).all(|joint| !fit.can_be_judged(joint)));
            fit.can_be_judged(0)
        };
        assert!(judged(1000, 1000) && judged(1000, 110));
        assert!(!judged(1000, 90) && !judged(1000, 0) && !judged(5, 5));
    }
}
