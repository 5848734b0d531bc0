//! Gains of the drives from one recording without load and one with a load whose mass is known.
//!
//! ```text
//! τ_j = s_j x_j θ                                         without load, τ by the gains so far        (1)
//! τ_j = s_j x_j (θ + M π)                                 with the load π                            (2)
//! s ~ N(1, a² 1 1ᵀ + b² I)                                common and separate errors of the gains so far  (3)
//! J = x_j T,   T = [s_j I, s_j M, v],   v = θ or θ + M π                                             (4)
//! Λ = Λ₀ + Σ w Tᵀ A T,   Λ Δ = Σ w Tᵀ (b − s_j A v) + prior                                           (5)
//! ```
//!
//! Torques are currents times gains that may be wrong: if all gains are too large, all masses are
//! too large by the same factor, and only an experiment with a known mass can show it. (1) and (2)
//! are bilinear in s and the other unknowns; the torques, which carry the noise, are on the left,
//! so their noise does not bias s. Gauss-Newton steps (5) need only the sums A, b of
//! [`rows`](super::rows). Each recording has its own friction. A better gain is the gain so far
//! divided by s_j.
//!
//! Sources: M. Gautier, S. Briot, J. Dyn. Sys., Meas., Control 136 (2014), on drive gains from a
//! known payload.

use super::error::{IdentifyError, LoadError, SampleFault, is_load};
use super::identify::RobotIdentifier;
use super::identify_options::IdentifyOptions;
use super::model::RobotModel;
use super::payload::Payload;
use super::spatial::{BODY_PARAMETERS, BodyParameters};
use super::state::RobotSample;
use super::sums::JointSums;
use nalgebra::{DMatrix, DVector, Matrix3};

/// a and b of (3): torque constants of data sheets are within some 10 %, and errors of the current
/// sensor and the gears are common to a family of drives.
const GAIN_PRIOR: (f64, f64) = (0.3, 0.1);
/// Gauss–Newton steps; a few suffice, because the problem is nearly linear.
const STEPS: usize = 30;
/// Largest factor by which a gain so far may be wrong.
const LARGEST_FACTOR: f64 = 5.0;
/// Largest distance \[m\] along an axis of the load's centre of mass from the flange.
const FARTHEST_M: f64 = 5.0;
/// Step at which they end, as a part of the standard deviations.
const SETTLED: f64 = 1e-3;
/// The two recordings in messages.
const WITHOUT: &str = "without";
const WITH: &str = "with";

/// The known load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLoad {
    /// Mass \[kg\], > 0.
    pub mass_kg: f64,
    /// Centre of mass in the flange's frame \[m\]; `None` if it is not known.
    pub center_m: Option<[f64; 3]>,
    /// Inertia about the centre of mass in the axes of the flange, xx, xy, yy, xz, yz, zz \[kg
    /// m²\]; `None` if it is not known. Used only with `center_m`.
    pub inertia_kg_m2: Option<[f64; 6]>,
}

impl KnownLoad {
    /// Its ten parameters at the flange; unknown ones are 0.
    pub fn body(&self) -> BodyParameters {
        let [xx, xy, yy, xz, yz, zz] = self.inertia_kg_m2.unwrap_or_default();
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        BodyParameters::new(self.mass_kg, self.center_m.unwrap_or_default().into(), inertia)
    }
}

/// Recordings or a load from which no gains follow.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The load.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The options of the identification.
    #[error(transparent)]
    Options(#[from] IdentifyError),
    /// A sample of a recording.
    #[error("the recording {recording} load: at {t_s} s: {source}")]
    Sample {
        /// `with` or `without`.
        recording: &'static str,
        /// Its time \[s\].
        t_s: f64,
        /// Why it was refused.
        source: SampleFault,
    },
    /// A recording without motion.
    #[error("the recording {recording} load: expected at least a second of motion, got none")]
    NoMotion {
        /// `with` or `without`.
        recording: &'static str,
    },
    /// Motions that do not tell the unknowns apart.
    #[error("the recordings: expected motions that can be told apart, got none; move all joints")]
    Alike,
    /// Factors that are not above 0.
    #[error(
        "gains: expected factors above 0, got {0:?}; is the load on the flange in the second recording, and not in the first?"
    )]
    Gains(Vec<f64>),
    /// Factors that no gain is wrong by.
    #[error(
        "gains: expected factors of 0.2 to 5 on the gains so far, got {0:?}; is the load on the flange in the second recording \
         and not in the first, and is its mass right? If the gains so far are only guesses, state rough ones in drive.gain"
    )]
    Factors(Vec<f64>),
    /// An estimated centre of mass that no load on a flange has.
    #[error(
        "centre of mass of the load: expected at most 5 m from the flange, got {0:?} m; is the load on the flange in the second \
         recording and not in the first, and is its mass right?"
    )]
    Center([f64; 3]),
}

/// Factors of the gains.
#[derive(Debug, Clone, PartialEq)]
pub struct GainCalibration {
    /// Factor by which to multiply the gain of each drive: 1/s.
    pub factor: Vec<f64>,
    /// Standard deviation of each.
    pub factor_std: Vec<f64>,
    /// Relative standard deviation, due to the gains alone, of masses estimated with the new gains.
    pub mass_std: f64,
    /// Centre of mass of the load in the flange's frame \[m\], known or estimated.
    pub center_m: [f64; 3],
}

impl GainCalibration {
    /// From the samples of two recordings of the same robot, with torques by the gains so far; one
    /// drive per joint.
    ///
    /// # Errors
    /// If the load is invalid or the recordings are not informative enough.
    pub fn of(
        model: &RobotModel,
        options: &IdentifyOptions,
        empty: &[RobotSample],
        loaded: &[RobotSample],
        load: &KnownLoad,
    ) -> Result<Self, CalibrationError> {
        let mut inertia = load.inertia_kg_m2.iter().flatten();
        if !is_load(load.mass_kg, load.center_m) || inertia.any(|x| !x.is_finite()) {
            return Err(CalibrationError::Load(LoadError::Numbers {
                mass_kg: load.mass_kg,
                center_m: load.center_m,
                inertia_kg_m2: load.inertia_kg_m2,
            }));
        }
        // Weights as the identification finds them.
        let mut identifier = RobotIdentifier::new(
            model.clone(),
            IdentifyOptions {
                payload: false,
                ..*options
            },
        )?;
        for sample in empty {
            identifier.push(sample).map_err(|source| CalibrationError::Sample {
                recording: WITHOUT,
                t_s: sample.t_s,
                source,
            })?;
        }
        if !identifier.end_of_recording() && identifier.blocks() == 0 {
            return Err(CalibrationError::NoMotion { recording: WITHOUT });
        }
        let sums = [
            sums(model, options, empty, WITHOUT)?,
            sums(model, options, loaded, WITH)?,
        ];
        if sums[1].iter().all(|sums| sums.rows == 0) {
            return Err(CalibrationError::NoMotion { recording: WITH });
        }
        let weights: Vec<f64> = (0..model.robot().len())
            .map(|j| (identifier.torque_std(j) * identifier.inflation(j)).powi(-2))
            .collect();
        Problem::new(model, load, sums, weights, identifier.theta()).solve()
    }
}

fn sums(
    model: &RobotModel,
    options: &IdentifyOptions,
    log: &[RobotSample],
    recording: &'static str,
) -> Result<Vec<JointSums>, CalibrationError> {
    let joints = model.robot().len();
    let mut sums: Vec<JointSums> = (0..joints).map(|j| JointSums::new(model.columns(j))).collect();
    let mut rows = options.rows(model)?;
    for sample in log {
        rows.push(model, sample, &mut |row| {
            sums[row.joint].add_row(row.regressor, row.torque)
        })
        .map_err(|source| CalibrationError::Sample {
            recording,
            t_s: sample.t_s,
            source,
        })?;
    }
    sums.iter_mut().for_each(JointSums::mirror);
    Ok(sums)
}

/// The unknowns in order: θ without load, friction with load, π, s.
struct Problem<'a> {
    model: &'a RobotModel,
    payload: Payload,
    sums: [Vec<JointSums>; 2],
    weights: Vec<f64>,
    /// Number of the arm's parameters, and of its base parameters.
    arm: usize,
    base: usize,
    first_load: usize,
    first_gain: usize,
    x: DVector<f64>,
    prior_mean: DVector<f64>,
    prior: DMatrix<f64>,
    known: Vec<bool>,
}

impl<'a> Problem<'a> {
    fn new(
        model: &'a RobotModel,
        load: &KnownLoad,
        sums: [Vec<JointSums>; 2],
        weights: Vec<f64>,
        theta: &[f64],
    ) -> Self {
        let (arm, base, joints) = (model.parameters().len(), model.base().parameters.len(), weights.len());
        let first_load = 2 * arm - base;
        let first_gain = first_load + BODY_PARAMETERS;
        let count = first_gain + joints;
        let payload = Payload::new(model);
        let mut mean = DVector::zeros(count);
        let mut prior = DMatrix::zeros(count, count);
        let mut x = DVector::zeros(count);
        for (i, p) in model.parameters().iter().enumerate() {
            let others = (i >= base).then(|| arm + i - base);
            for at in [Some(i), others].into_iter().flatten() {
                mean[at] = p.nominal;
                prior[(at, at)] = p.scale.powi(-2);
                x[at] = theta[i];
            }
        }
        let mut known = vec![false; count];
        let body = load.body();
        for p in 0..BODY_PARAMETERS {
            let at = first_load + p;
            prior[(at, at)] = payload.prior[p].powi(-2);
            let is_known = match p {
                0 => true,
                1..4 => load.center_m.is_some(),
                _ => load.center_m.is_some() && load.inertia_kg_m2.is_some(),
            };
            if is_known {
                known[at] = true;
                x[at] = body.0[p];
            }
        }
        let (together, apart) = GAIN_PRIOR;
        // Inverse of (3).
        let common = together.powi(2) / (apart.powi(2) * (apart.powi(2) + joints as f64 * together.powi(2)));
        for i in 0..joints {
            mean[first_gain + i] = 1.0;
            x[first_gain + i] = 1.0;
            for j in 0..joints {
                let own = if i == j { apart.powi(-2) } else { 0.0 };
                prior[(first_gain + i, first_gain + j)] = own - common; // (3)
            }
        }
        Self {
            model,
            payload,
            sums,
            weights,
            arm,
            base,
            first_load,
            first_gain,
            x,
            prior_mean: mean,
            prior,
            known,
        }
    }

    /// T of (4) with v, for a joint of one recording.
    fn tangent(&self, joint: usize, is_loaded: bool) -> (DMatrix<f64>, DVector<f64>) {
        let columns = self.model.columns(joint);
        let s = self.x[self.first_gain + joint];
        let mut v = DVector::zeros(columns.len());
        let mut t = DMatrix::zeros(columns.len(), self.x.len());
        for (c, &i) in columns.iter().enumerate() {
            let at = match is_loaded && i >= self.base {
                true => self.arm + i - self.base,
                false => i,
            };
            v[c] = self.x[at];
            t[(c, at)] = s; // (4)
            if is_loaded {
                for (p, factor) in self.payload.row(i).iter().enumerate() {
                    v[c] += factor * self.x[self.first_load + p];
                    t[(c, self.first_load + p)] = s * factor; // (4)
                }
            }
        }
        t.set_column(self.first_gain + joint, &v); // (4)
        (t, v)
    }

    /// (5).
    fn equations(&self) -> (DMatrix<f64>, DVector<f64>) {
        let mut information = self.prior.clone();
        let mut gradient = &self.prior * (&self.prior_mean - &self.x);
        for (sums, is_loaded) in self.sums.iter().zip([false, true]) {
            for (joint, sums) in sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let (t, v) = self.tangent(joint, is_loaded);
                let m = v.len();
                let gram = DMatrix::from_row_slice(m, m, &sums.gram);
                let moment = DVector::from_column_slice(&sums.moment);
                let s = self.x[self.first_gain + joint];
                let weight = self.weights[joint];
                gradient += t.tr_mul(&(moment - &gram * v * s)) * weight; // (5)
                information += t.tr_mul(&(gram * &t)) * weight; // (5)
            }
        }
        for (i, _) in self.known.iter().enumerate().filter(|(_, known)| **known) {
            information.row_mut(i).fill(0.0);
            information.column_mut(i).fill(0.0);
            information[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
        (information, gradient)
    }

    fn solve(mut self) -> Result<GainCalibration, CalibrationError> {
        let mut covariance = DMatrix::zeros(0, 0);
        for _ in 0..STEPS {
            let (information, gradient) = self.equations();
            let scale = information.diagonal().map(|d| d.sqrt().recip());
            let count = self.x.len();
            let scaled = DMatrix::from_fn(count, count, |i, j| information[(i, j)] * scale[i] * scale[j]);
            let factor = scaled.cholesky().ok_or(CalibrationError::Alike)?;
            let step = factor.solve(&gradient.component_mul(&scale)).component_mul(&scale);
            self.x += &step;
            let inverse = factor.inverse();
            covariance = DMatrix::from_fn(count, count, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
            let is_small = |i: usize| self.known[i] || step[i].abs() < SETTLED * covariance[(i, i)].sqrt();
            if (0..count).all(is_small) {
                break;
            }
        }
        let joints = self.weights.len();
        let gain = |j: usize| self.x[self.first_gain + j];
        if (0..joints).any(|j| !(gain(j) > 0.0 && gain(j).is_finite())) {
            return Err(CalibrationError::Gains((0..joints).map(gain).collect()));
        }
        let factors: Vec<f64> = (0..joints).map(|j| 1.0 / gain(j)).collect();
        if factors
            .iter()
            .any(|f| !(1.0 / LARGEST_FACTOR..=LARGEST_FACTOR).contains(f))
        {
            return Err(CalibrationError::Factors(factors));
        }
        let mass = self.x[self.first_load];
        let center_m: [f64; 3] = std::array::from_fn(|i| self.x[self.first_load + 1 + i] / mass);
        if center_m.iter().any(|x| !(x.abs() <= FARTHEST_M)) {
            return Err(CalibrationError::Center(center_m));
        }
        // Each gain is weighted by the joint's information on a mass.
        let share: Vec<f64> = (0..joints)
            .map(|j| {
                let sums = &self.sums[1][j];
                let m = sums.columns().len();
                let along: Vec<f64> = sums.columns().iter().map(|i| self.payload.row(*i)[0]).collect();
                let moment = |a: usize| -> f64 { (0..m).map(|b| sums.gram[a * m + b] * along[b]).sum() };
                self.weights[j] * (0..m).map(|a| along[a] * moment(a)).sum::<f64>()
            })
            .collect();
        let total: f64 = share.iter().sum();
        let mut variance = 0.0;
        for i in 0..joints {
            for j in 0..joints {
                let at = (self.first_gain + i, self.first_gain + j);
                variance += share[i] / total * share[j] / total * covariance[at] / (gain(i) * gain(j));
            }
        }
        Ok(GainCalibration {
            factor: factors,
            factor_std: (0..joints)
                .map(|j| covariance[(self.first_gain + j, self.first_gain + j)].max(0.0).sqrt() / gain(j).powi(2))
                .collect(),
            mass_std: variance.max(0.0).sqrt(),
            center_m,
        })
    }
}
