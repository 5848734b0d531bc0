//! Physically possible standard parameters of every body that agree with identified base
//! parameters.
//!
//! ```text
//! min ½ (K π − β̂)ᵀ P⁻¹ (K π − β̂) + γ Σ_k [tr(J₀ₖ⁻¹ Jₖ) − ln det Jₖ] + γ Σ_i [I_i/I₀ᵢ − ln I_i]    (1)
//! πₖ = own link of body k + links that keep the URDF's values                                     (2)
//! ```
//!
//! β̂ and P are the identified base parameters and their covariance, J the pseudo-inertia of the
//! link, J₀ that of the URDF, I the inertias of the rotors. Torques do not depend on about 40 % of
//! π: there (1) keeps to the URDF, and if no possible body has the estimate, to the boundary of
//! possible bodies. The divergence in (1) is that of two densities, so it depends neither on frames
//! nor on units, and it is convex: damped Newton steps with decreasing γ suffice.
//!
//! Sources: P. Wensing, S. Kim, J.-J. Slotine, IEEE RA-L 3 (2018); T. Lee, P. Wensing, F. Park,
//! IEEE T-RO 36 (2020).

use super::base_parameters::Standard;
use super::error::StandardError;
use super::model::RobotModel;
use super::physical::{directions, is_physical, log_determinant, pseudo_inertia, shortened};
use super::spatial::{BODY_PARAMETERS, BodyParameters};
use super::tree::Robot;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix4};

/// γ at the start and at the end, in nats of a likelihood: the URDF counts for a tenth of one
/// observation.
const WEIGHTS: (f64, f64) = (1e5, 0.1);
/// Largest total number of Newton steps.
const STEPS: usize = 400;
/// Newton decrement, relative to γ, at which γ is reduced.
const SETTLED: f64 = 1e-4;
/// Share of the prior standard deviation below which a parameter is known from data.
const KNOWN: f64 = 1.0 / 3.0;
/// Second moments of a URDF's link count as at least this share of those of a ball of its mass and
/// of this density [kg/m³], because many URDFs contain placeholders.
const LEAST_MOMENT: f64 = 0.1;
const DENSITY: f64 = 2000.0;
/// Size of an unknown rotor, relative to its scale for a machine of this size.
const ROTOR: f64 = 0.02;

/// Physically possible bodies, links and rotors.
#[derive(Debug, Clone, PartialEq)]
pub struct StandardParameters {
    /// The body after each joint, in the joint's frame.
    pub bodies: Vec<BodyParameters>,
    /// The changed link of each body: index in [`Robot::links`] and its parameters in its own
    /// frame. The others keep the URDF's values.
    pub links: Vec<(usize, BodyParameters)>,
    /// Inertia of each drive's rotor at its joint \[kg m² or kg\]; 0 without rotors in the model.
    pub rotors: Vec<f64>,
    /// K π.
    pub base: Vec<f64>,
    /// K π − β̂ in standard deviations of β̂.
    pub deviation: Vec<f64>,
}

impl StandardParameters {
    /// (1) for estimates `theta` of a model's parameters with their covariance (row-major, as long
    /// as `theta` squared); base parameters come first in both.
    ///
    /// # Errors
    /// If nothing has been identified, the numbers are not an estimate, or no possible body is
    /// near.
    pub fn fit(model: &RobotModel, theta: &[f64], covariance: &[f64]) -> Result<Self, StandardError> {
        let (all, count) = (theta.len(), model.base().parameters.len());
        if all < count || covariance.len() != all * all || theta.iter().chain(covariance).any(|x| !x.is_finite()) {
            return Err(StandardError::Estimates {
                least: count,
                got: all,
                covariance: covariance.len(),
            });
        }
        let std = |i: usize| covariance[i * (all + 1)].max(0.0).sqrt();
        if (0..count).all(|i| !(std(i) < KNOWN * model.parameters()[i].scale)) {
            return Err(StandardError::NothingIdentified);
        }
        // A fixed parameter has no variance: it is taken as known to a millionth of its size.
        let least = |i: usize| 1e-12 * model.parameters()[i].scale.powi(2);
        let p = DMatrix::from_fn(count, count, |i, j| {
            covariance[i * all + j] + if i == j { least(i) } else { 0.0 }
        });
        let information = inverse(&p).ok_or(StandardError::Covariance)?;
        let beta = DVector::from_column_slice(&theta[..count]);
        let problem = Problem::new(model, &beta, information)?;
        let x = problem.solve()?;
        let bodies = problem.bodies(&x);
        let links = problem.links(model.robot(), &x);
        let rotors = problem.rotors(&x);
        let base = &problem.k * &x + &problem.constant;
        let deviation = (0..count)
            .map(|i| (base[i] - beta[i]) / std(i).max(least(i).sqrt()))
            .collect();
        Ok(Self {
            bodies,
            links,
            rotors,
            base: base.as_slice().to_vec(),
            deviation,
        })
    }
}

/// Inverse of a covariance, by a matrix of unit diagonal.
fn inverse(p: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = p.diagonal().map(|x| x.sqrt().recip());
    let scaled = DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| p[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    }))
}

/// (1) over x: the ten parameters of each body's own link in the body's frame, then the rotors.
struct Problem {
    joints: usize,
    has_rotors: bool,
    /// K over x, and the contribution of the unchanged links.
    k: DMatrix<f64>,
    constant: DVector<f64>,
    /// β̂ and P⁻¹.
    beta: DVector<f64>,
    information: DMatrix<f64>,
    /// The own link of each body, and the sum of the others.
    own: Vec<usize>,
    rest: Vec<BodyParameters>,
    prior: Vec<BodyParameters>,
    inverse_prior: Vec<Matrix4<f64>>,
    rotor_prior: Vec<f64>,
    directions: [Matrix4<f64>; BODY_PARAMETERS],
}

impl Problem {
    fn new(model: &RobotModel, beta: &DVector<f64>, information: DMatrix<f64>) -> Result<Self, StandardError> {
        let robot = model.robot();
        let n = robot.len();
        let has_rotors = model
            .base()
            .rows()
            .flatten()
            .any(|(standard, _)| matches!(standard, Standard::Rotor { .. }));
        let own: Vec<usize> = (0..n).map(|joint| own_link(robot, joint)).collect::<Result<_, _>>()?;
        let prior: Vec<BodyParameters> = own
            .iter()
            .map(|link| plausible(&robot.links[*link].body.unwrap_or_default()))
            .collect();
        let rest: Vec<BodyParameters> = (0..n)
            .map(|joint| {
                let others = robot.links.iter().enumerate();
                others
                    .filter(|(index, link)| link.joint == joint && *index != own[joint])
                    .filter_map(|(_, link)| link.body)
                    .fold(BodyParameters::default(), |sum, body| sum.plus(&body))
            })
            .collect();
        let columns = n * BODY_PARAMETERS + if has_rotors { n } else { 0 };
        let mut k = DMatrix::zeros(beta.len(), columns);
        let mut constant = DVector::zeros(beta.len());
        for (row, entries) in model.base().rows().enumerate() {
            for (standard, factor) in entries {
                match standard {
                    Standard::Body { joint, parameter } => {
                        k[(row, joint * BODY_PARAMETERS + parameter)] += factor;
                        constant[row] += factor * rest[joint].0[parameter]; // (2)
                    }
                    Standard::Rotor { joint } => k[(row, n * BODY_PARAMETERS + joint)] += factor,
                }
            }
        }
        let inverse_prior = prior
            .iter()
            .map(|body| pseudo_inertia(body).try_inverse())
            .collect::<Option<_>>()
            .ok_or(StandardError::Urdf)?;
        Ok(Self {
            joints: n,
            has_rotors,
            rotor_prior: rotor_priors(model, beta),
            k,
            constant,
            beta: beta.clone(),
            information,
            own,
            rest,
            prior,
            inverse_prior,
            directions: directions(),
        })
    }

    fn link(&self, x: &DVector<f64>, joint: usize) -> BodyParameters {
        BodyParameters(std::array::from_fn(|i| x[joint * BODY_PARAMETERS + i]))
    }

    fn rotors(&self, x: &DVector<f64>) -> Vec<f64> {
        match self.has_rotors {
            true => (0..self.joints).map(|i| x[self.joints * BODY_PARAMETERS + i]).collect(),
            false => vec![0.0; self.joints],
        }
    }

    fn bodies(&self, x: &DVector<f64>) -> Vec<BodyParameters> {
        (0..self.joints).map(|i| self.link(x, i).plus(&self.rest[i])).collect()
    }

    fn links(&self, robot: &Robot, x: &DVector<f64>) -> Vec<(usize, BodyParameters)> {
        (0..self.joints)
            .map(|i| {
                let index = self.own[i];
                (index, self.link(x, i).moved(&robot.links[index].placement.inverse()))
            })
            .collect()
    }

    /// (1); `None` for impossible bodies.
    fn cost(&self, x: &DVector<f64>, gamma: f64) -> Option<f64> {
        let off = &self.k * x + &self.constant - &self.beta;
        let mut cost = 0.5 * off.dot(&(&self.information * &off));
        for joint in 0..self.joints {
            let j = pseudo_inertia(&self.link(x, joint));
            cost += gamma * ((self.inverse_prior[joint] * j).trace() - log_determinant(j)?); // (1)
        }
        if self.has_rotors {
            for (inertia, prior) in self.rotors(x).iter().zip(&self.rotor_prior) {
                if !(*inertia > 0.0) {
                    return None;
                }
                cost += gamma * (inertia / prior - inertia.ln()); // (1)
            }
        }
        cost.is_finite().then_some(cost)
    }

    /// Gradient and Hessian of (1).
    fn slopes(&self, x: &DVector<f64>, gamma: f64) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let off = &self.k * x + &self.constant - &self.beta;
        let mut gradient = self.k.tr_mul(&(&self.information * off));
        let mut hessian = self.k.tr_mul(&(&self.information * &self.k));
        for joint in 0..self.joints {
            let inverse = pseudo_inertia(&self.link(x, joint)).try_inverse()?;
            let turned = self.directions.map(|direction| inverse * direction);
            let first = joint * BODY_PARAMETERS;
            for i in 0..BODY_PARAMETERS {
                let wanted = (self.inverse_prior[joint] * self.directions[i]).trace();
                gradient[first + i] += gamma * (wanted - turned[i].trace());
                for j in 0..BODY_PARAMETERS {
                    hessian[(first + i, first + j)] += gamma * (turned[i] * turned[j]).trace();
                }
            }
        }
        if self.has_rotors {
            for (joint, inertia) in self.rotors(x).iter().enumerate() {
                let at = self.joints * BODY_PARAMETERS + joint;
                gradient[at] += gamma * (1.0 / self.rotor_prior[joint] - 1.0 / inertia);
                hessian[(at, at)] += gamma / (inertia * inertia);
            }
        }
        Some((gradient, hessian))
    }

    /// Damped Newton steps from the URDF, with decreasing γ.
    fn solve(&self) -> Result<DVector<f64>, StandardError> {
        let columns = self.k.ncols();
        let mut x = DVector::from_fn(columns, |i, _| {
            let joint = i / BODY_PARAMETERS;
            match self.prior.get(joint) {
                Some(body) => body.0[i % BODY_PARAMETERS],
                None => self.rotor_prior[i - self.joints * BODY_PARAMETERS],
            }
        });
        let mut gamma = WEIGHTS.0;
        for _ in 0..STEPS {
            let (gradient, hessian) = self.slopes(&x, gamma).ok_or(StandardError::Impossible)?;
            let scale = hessian.diagonal().map(|d| d.sqrt().recip());
            let scaled = DMatrix::from_fn(columns, columns, |i, j| {
                hessian[(i, j)] * scale[i] * scale[j] + if i == j { 1e-14 } else { 0.0 }
            });
            let right = DVector::from_fn(columns, |i, _| -gradient[i] * scale[i]);
            let step = scaled.cholesky().ok_or(StandardError::Impossible)?.solve(&right);
            let decrement = right.dot(&step);
            let step = step.component_mul(&scale);
            let now = self.cost(&x, gamma).ok_or(StandardError::Impossible)?;
            let next = shortened(now, decrement, |part| &x + &step * part, |x| self.cost(x, gamma));
            let is_minimum = decrement < SETTLED * gamma || next.is_none();
            x = next.unwrap_or(x);
            if is_minimum {
                if gamma <= WEIGHTS.1 {
                    break;
                }
                gamma = (0.1 * gamma).max(WEIGHTS.1);
            }
        }
        match self.bodies(&x).iter().all(is_physical) {
            true => Ok(x),
            false => Err(StandardError::Impossible),
        }
    }
}

/// The heaviest link fixed to a joint, which gets the identified values.
fn own_link(robot: &Robot, joint: usize) -> Result<usize, StandardError> {
    let mass = |index: &usize| robot.links[*index].body.map_or(0.0, |body| body.mass());
    let fixed =
        (0..robot.links.len()).filter(|index| robot.links[*index].joint == joint && !robot.links[*index].is_held);
    // The first of several with equal mass.
    let heaviest = fixed.rev().max_by(|a, b| mass(a).total_cmp(&mass(b)));
    heaviest
        .filter(|index| mass(index) > 0.0)
        .ok_or_else(|| StandardError::NoLink(robot.joints[joint].name.clone()))
}

/// A link of a URDF with second moments that are possible for its mass.
fn plausible(body: &BodyParameters) -> BodyParameters {
    let mass = body.mass();
    let center = body.first_moment() / mass;
    let about_center =
        body.inertia() - mass * (Matrix3::identity() * center.norm_squared() - center * center.transpose());
    // Second moments: Σ = ½ tr(I) 1 − I.
    let second = Matrix3::identity() * (0.5 * about_center.trace()) - about_center;
    let radius = (mass / DENSITY * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
    let least = LEAST_MOMENT * 0.2 * mass * radius * radius;
    let eigen = second.symmetric_eigen();
    let raised = eigen.eigenvalues.map(|x| x.max(least));
    let second = eigen.eigenvectors * Matrix3::from_diagonal(&raised) * eigen.eigenvectors.transpose();
    let inertia = Matrix3::identity() * second.trace() - second;
    BodyParameters::new(mass, center, inertia)
}

/// I₀: the estimate of a rotor that is a base parameter by itself, the mean of these for the
/// others.
fn rotor_priors(model: &RobotModel, beta: &DVector<f64>) -> Vec<f64> {
    let n = model.robot().len();
    let mut priors = vec![None; n];
    for (row, parameter) in model.base().parameters.iter().enumerate() {
        if let Standard::Rotor { joint } = parameter.leading {
            let least = 1e-3 * ROTOR * model.parameters()[row].scale;
            priors[joint] = Some(beta[row].max(least));
        }
    }
    let known: Vec<f64> = priors.iter().flatten().copied().collect();
    let mean = match known.len() {
        0 => {
            ROTOR
                * model
                    .robot()
                    .bodies
                    .iter()
                    .map(|body| body.inertia().trace())
                    .sum::<f64>()
        }
        count => known.iter().sum::<f64>() / count as f64,
    };
    priors.into_iter().map(|prior| prior.unwrap_or(mean)).collect()
}
