//! Takes a plant's terms apart: what depends on θ, what on the signals.
//!
//! ```text
//! g_{e,d}(q, q̇; θ) = Σ_m μ_m(θ) [ Σ_j a_{d,m,j} q̇_j + b_{d,m}(q, q̇) ]   μ_m ∈ {1, θ_i, θ_i θ_j}
//! ```
//!
//! Terms that are polynomials in θ of degree 2 at most, which the arm's and the servo axis' are,
//! can be projected before θ is known: only the a and b are, and a row is a handful of products at
//! any θ. The coefficients are derivatives in θ at θ = 0 and come from hyper-dual numbers, exactly.
//! Parts that are a constant times a velocity need no velocity: integrated by parts once more they
//! need the position.
//!
//! Which form a plant has is found when it is set up by evaluating it at seeded random points;
//! coefficients that are zero at all of them are zero. Terms that are not such polynomials are
//! evaluated anew at each θ, which costs more.

use super::probes::{Probe, probes};
use super::theta_polynomial::{FeatureTerm, Monomial, Polynomial, VelocityTerm};
use crate::model::{MAX_JOINTS, MAX_PARAMS, Plant};
use num_dual::{Dual64, HyperDual64};

/// One more than the highest derivative d of a term: linear terms are integrated by parts once
/// more.
pub(super) const MAX_ORDER: usize = 3;
/// Agreement that counts as equal: some hundred roundings.
const EQUAL: f64 = 1e-10;

/// Which derivative of a hyper-dual evaluation is a feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Value,
    First,
    Second,
    Mixed,
    /// θ_i²: half the second derivative.
    HalfMixed,
}

/// One hyper-dual evaluation of an equation and what is taken from it.
#[derive(Debug, Clone)]
struct Pass {
    equation: usize,
    seeds: [usize; 2],
    takes: Vec<(Part, usize, usize)>,
}

/// Signals that the remaining, nonlinear part of an equation depends on; for the propagation of
/// sensor noise.
#[derive(Debug, Clone, Default)]
pub(super) struct Sensitivity {
    pub position: Vec<usize>,
    pub velocity: Vec<usize>,
}

impl Sensitivity {
    /// Joints with the kind of their signal, true for the velocity.
    pub fn kinds(&self) -> impl Iterator<Item = (usize, bool)> + '_ {
        let positions = self.position.iter().map(|&joint| (joint, false));
        positions.chain(self.velocity.iter().map(|&joint| (joint, true)))
    }
}

/// The plant's equations taken apart.
#[derive(Debug, Clone)]
pub(super) struct Separation {
    /// `None` for an equation that has to be evaluated at each θ.
    pub equations: Vec<Option<Polynomial>>,
    pub sensitivities: Vec<Sensitivity>,
    /// Features per sample, over all equations.
    pub features: usize,
    passes: Vec<Pass>,
}

type Terms = [f64; MAX_ORDER + 1];

fn values(plant: &impl Plant, equation: usize, q: &[f64], dq: &[f64], theta: &[f64]) -> Terms {
    let mut g = [0.0; MAX_ORDER + 1];
    let order = plant.equations()[equation].order;
    plant.terms::<f64>(equation, q, dq, theta, &mut g[..=order]);
    g
}

/// Hyper-dual evaluation at θ = 0, seeded in two parameters.
fn hyper(
    plant: &impl Plant,
    equation: usize,
    q: &[f64; MAX_JOINTS],
    dq: &[f64; MAX_JOINTS],
    seeds: [usize; 2],
) -> [HyperDual64; MAX_ORDER + 1] {
    let zero = HyperDual64::from_re(0.0);
    let joints = plant.joints();
    let params = plant.parameters().len();
    let mut dual_q = [zero; MAX_JOINTS];
    let mut dual_dq = [zero; MAX_JOINTS];
    for joint in 0..joints {
        dual_q[joint].re = q[joint];
        dual_dq[joint].re = dq[joint];
    }
    let mut theta = [zero; MAX_PARAMS];
    theta[seeds[0]].eps1 = 1.0;
    theta[seeds[1]].eps2 = 1.0;
    let mut g = [zero; MAX_ORDER + 1];
    let order = plant.equations()[equation].order;
    plant.terms(
        equation,
        &dual_q[..joints],
        &dual_dq[..joints],
        &theta[..params],
        &mut g[..=order],
    );
    g
}

fn part(value: &HyperDual64, part: Part) -> f64 {
    match part {
        Part::Value => value.re,
        Part::First => value.eps1,
        Part::Second => value.eps2,
        Part::Mixed => value.eps1eps2,
        Part::HalfMixed => 0.5 * value.eps1eps2,
    }
}

/// The coefficient function of a monomial, all d.
fn coefficient(
    plant: &impl Plant,
    equation: usize,
    monomial: Monomial,
    q: &[f64; MAX_JOINTS],
    dq: &[f64; MAX_JOINTS],
) -> Terms {
    let own = plant.equations()[equation].parameters.clone();
    let (seeds, take) = match monomial {
        Monomial::One => ([own.start, own.start], Part::Value),
        Monomial::Linear(i) => ([i, i], Part::First),
        Monomial::Product(i, j) if i == j => ([i, j], Part::HalfMixed),
        Monomial::Product(i, j) => ([i, j], Part::Mixed),
    };
    hyper(plant, equation, q, dq, seeds).map(|g| part(&g, take))
}

impl Separation {
    /// Takes the plant apart.
    pub fn new(plant: &impl Plant) -> Self {
        let mut separation = Self {
            equations: Vec::new(),
            sensitivities: Vec::new(),
            features: 0,
            passes: Vec::new(),
        };
        let probes = probes(plant);
        for equation in 0..plant.equations().len() {
            let polynomial = separation.polynomial(plant, equation, &probes);
            let sensitivity = sensitivity(plant, equation, polynomial.as_ref(), &probes);
            separation.equations.push(polynomial);
            separation.sensitivities.push(sensitivity);
        }
        separation
    }

    fn polynomial(&mut self, plant: &impl Plant, equation: usize, probes: &[Probe]) -> Option<Polynomial> {
        let form = &plant.equations()[equation];
        let own = form.parameters.clone();
        if own.is_empty() {
            return None;
        }
        let all = std::iter::once(Monomial::One)
            .chain(own.clone().map(Monomial::Linear))
            .chain(
                own.clone()
                    .flat_map(|i| (i..own.end).map(move |j| Monomial::Product(i, j))),
            );
        // monomials with their coefficients at every probe
        let table: Vec<(Monomial, Vec<Terms>)> = all
            .map(|monomial| {
                let at = probes
                    .iter()
                    .map(|p| coefficient(plant, equation, monomial, &p.q, &p.dq))
                    .collect();
                (monomial, at)
            })
            .collect();
        for (n, probe) in probes.iter().enumerate() {
            let exact = values(
                plant,
                equation,
                &probe.q[..plant.joints()],
                &probe.dq[..plant.joints()],
                &probe.theta,
            );
            for d in 0..=form.order {
                let parts = table.iter().map(|(m, at)| m.value(&probe.theta) * at[n][d]);
                let (sum, size) = parts.fold((0.0, 0.0), |(sum, size), x| (sum + x, size + x.abs()));
                // a NaN is not a polynomial either
                if !((sum - exact[d]).abs() <= EQUAL * (size + exact[d].abs())) {
                    return None;
                }
            }
        }

        let mut polynomial = Polynomial::default();
        // (monomial, derivative) pairs that need a feature
        let mut wanted: Vec<(Monomial, usize, usize)> = Vec::new();
        for (monomial, at) in &table {
            for d in 0..=form.order {
                if at.iter().all(|g| g[d] == 0.0) {
                    continue;
                }
                let index = polynomial
                    .monomials
                    .iter()
                    .position(|m| m == monomial)
                    .unwrap_or_else(|| {
                        polynomial.monomials.push(*monomial);
                        polynomial.monomials.len() - 1
                    });
                if let Some(slopes) = constant_slopes(plant, equation, *monomial, d, probes, at) {
                    polynomial
                        .velocity
                        .extend(
                            slopes
                                .iter()
                                .enumerate()
                                .filter(|(_, a)| **a != 0.0)
                                .map(|(joint, &coefficient)| VelocityTerm {
                                    monomial: index,
                                    derivative: d,
                                    joint,
                                    coefficient,
                                }),
                        );
                } else {
                    polynomial.features.push(FeatureTerm {
                        monomial: index,
                        derivative: d,
                        feature: self.features,
                    });
                    wanted.push((*monomial, d, self.features));
                    self.features += 1;
                }
            }
        }
        self.plan(equation, own.start, wanted);
        Some(polynomial)
    }

    /// Few evaluations for many features: each gives a product, both its factors and the constant.
    fn plan(&mut self, equation: usize, first: usize, mut wanted: Vec<(Monomial, usize, usize)>) {
        while let Some(&(monomial, ..)) = wanted
            .iter()
            .max_by_key(|(m, ..)| u8::from(matches!(m, Monomial::Product(..))))
        {
            let seeds = match monomial {
                Monomial::Product(i, j) => [i, j],
                Monomial::Linear(i) => {
                    let other = wanted.iter().find_map(|(m, ..)| match m {
                        Monomial::Linear(j) if *j != i => Some(*j),
                        _ => None,
                    });
                    [i, other.unwrap_or(i)]
                }
                Monomial::One => [first, first],
            };
            let mut takes = Vec::new();
            wanted.retain(|&(m, d, feature)| {
                let part = match m {
                    Monomial::One => Part::Value,
                    Monomial::Linear(i) if i == seeds[0] => Part::First,
                    Monomial::Linear(i) if i == seeds[1] => Part::Second,
                    Monomial::Product(i, j) if [i, j] == seeds && i == j => Part::HalfMixed,
                    Monomial::Product(i, j) if [i, j] == seeds => Part::Mixed,
                    _ => return true,
                };
                takes.push((part, d, feature));
                false
            });
            self.passes.push(Pass { equation, seeds, takes });
        }
    }

    /// Writes the features of a sample, `put(feature, value)`.
    #[inline]
    pub fn extract(
        &self,
        plant: &impl Plant,
        q: &[f64; MAX_JOINTS],
        dq: &[f64; MAX_JOINTS],
        mut put: impl FnMut(usize, f64),
    ) {
        for pass in &self.passes {
            let g = hyper(plant, pass.equation, q, dq, pass.seeds);
            for &(take, d, feature) in &pass.takes {
                put(feature, part(&g[d], take));
            }
        }
    }
}

/// The a_j if the coefficient function is Σ a_j q̇_j with constant a_j, and not zero.
fn constant_slopes(
    plant: &impl Plant,
    equation: usize,
    monomial: Monomial,
    d: usize,
    probes: &[Probe],
    at: &[Terms],
) -> Option<[f64; MAX_JOINTS]> {
    let mut slopes = [0.0; MAX_JOINTS];
    for joint in 0..plant.joints() {
        let mut unit = [0.0; MAX_JOINTS];
        unit[joint] = 1.0;
        slopes[joint] = coefficient(plant, equation, monomial, &probes[0].q, &unit)[d];
    }
    let linear = probes.iter().zip(at).all(|(probe, g)| {
        let parts = slopes.iter().zip(&probe.dq).map(|(a, v)| a * v);
        let (sum, size) = parts.fold((0.0, 0.0), |(sum, size), x: f64| (sum + x, size + x.abs()));
        (sum - g[d]).abs() <= EQUAL * (size + g[d].abs())
    });
    (linear && slopes.iter().any(|a| *a != 0.0)).then_some(slopes)
}

/// Partial derivatives of an equation's terms in the position and velocity of one joint at θ,
/// `(∂g/∂q, ∂g/∂q̇)` for each d.
#[inline]
pub(super) fn partials(
    plant: &impl Plant,
    equation: usize,
    q: &[f64; MAX_JOINTS],
    dq: &[f64; MAX_JOINTS],
    theta: &[f64],
    joint: usize,
    velocity: bool,
) -> Terms {
    let zero = Dual64::from_re(0.0);
    let joints = plant.joints();
    let mut dual_q = [zero; MAX_JOINTS];
    let mut dual_dq = [zero; MAX_JOINTS];
    for j in 0..joints {
        dual_q[j].re = q[j];
        dual_dq[j].re = dq[j];
    }
    if velocity {
        dual_dq[joint].eps = 1.0;
    } else {
        dual_q[joint].eps = 1.0;
    }
    let mut dual_theta = [zero; MAX_PARAMS];
    for (dual, &value) in dual_theta.iter_mut().zip(theta) {
        dual.re = value;
    }
    let mut g = [zero; MAX_ORDER + 1];
    let order = plant.equations()[equation].order;
    plant.terms(
        equation,
        &dual_q[..joints],
        &dual_dq[..joints],
        &dual_theta[..theta.len()],
        &mut g[..=order],
    );
    g.map(|g| g.eps)
}

fn sensitivity(plant: &impl Plant, equation: usize, polynomial: Option<&Polynomial>, probes: &[Probe]) -> Sensitivity {
    let order = plant.equations()[equation].order;
    let mut found = Sensitivity::default();
    for joint in 0..plant.joints() {
        let depends = |velocity: bool| {
            probes.iter().any(|probe| {
                let mut slopes = partials(plant, equation, &probe.q, &probe.dq, &probe.theta, joint, velocity);
                let size = slopes.map(f64::abs);
                if let (true, Some(polynomial)) = (velocity, polynomial) {
                    for term in polynomial.velocity.iter().filter(|term| term.joint == joint) {
                        let m = polynomial.monomials[term.monomial].value(&probe.theta);
                        slopes[term.derivative] -= m * term.coefficient;
                    }
                }
                (0..=order).any(|d| slopes[d].abs() > EQUAL * size[d])
            })
        };
        if depends(false) {
            found.position.push(joint);
        }
        if depends(true) {
            found.velocity.push(joint);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::probes::Random;
    use super::*;
    use crate::model::{Manipulator, RawManipulator};

    #[test]
    fn val_the_arm_comes_apart_as_its_equations_are_written() {
        let separation = Separation::new(&Manipulator::default());
        let joint_1 = separation.equations[0].as_ref().unwrap();
        // θ₅ q̇₁, θ₃ q̇₁ and θ₁ q̇₁ need no velocity; 3 cos²q₂ q̇₁ stands with θ₄ and with θ₂
        assert_eq!(joint_1.velocity.len(), 3);
        assert_eq!(joint_1.features.len(), 2);
        let joint_2 = separation.equations[1].as_ref().unwrap();
        // θ₈ q̇₂, θ₇θ₉ q̇₂, θ₆θ₉ q̇₂; centrifugal and weight, each with θ₇ and θ₆
        assert_eq!(joint_2.velocity.len(), 3);
        assert_eq!(joint_2.features.len(), 4);
        assert_eq!(separation.features, 6);
        assert_eq!(separation.passes.len(), 3);
        assert_eq!(
            (
                separation.sensitivities[0].position.as_slice(),
                separation.sensitivities[0].velocity.as_slice()
            ),
            (&[1][..], &[0][..])
        );
        assert_eq!(
            (
                separation.sensitivities[1].position.as_slice(),
                separation.sensitivities[1].velocity.as_slice()
            ),
            (&[1][..], &[0][..])
        );
    }

    #[test]
    fn val_the_parts_add_up_to_the_terms() {
        let plant = Manipulator::default();
        let separation = Separation::new(&plant);
        let mut random = Random::new(5);
        for _ in 0..200 {
            let mut q = [0.0; MAX_JOINTS];
            let mut dq = [0.0; MAX_JOINTS];
            for joint in 0..2 {
                (q[joint], dq[joint]) = (random.signed(3.0), random.signed(20.0));
            }
            let theta: Vec<f64> = (0..9).map(|_| random.signed(30.0)).collect();
            let mut features = vec![0.0; separation.features];
            separation.extract(&plant, &q, &dq, |feature, value| features[feature] = value);
            for (e, polynomial) in separation.equations.iter().enumerate() {
                let polynomial = polynomial.as_ref().unwrap();
                let exact = values(&plant, e, &q[..2], &dq[..2], &theta);
                for d in 0..=2 {
                    let mut sum = 0.0;
                    for term in polynomial.velocity.iter().filter(|t| t.derivative == d) {
                        sum += polynomial.monomials[term.monomial].value(&theta) * term.coefficient * dq[term.joint];
                    }
                    for term in polynomial.features.iter().filter(|t| t.derivative == d) {
                        sum += polynomial.monomials[term.monomial].value(&theta) * features[term.feature];
                    }
                    // sums of a few products of sizes up to 1e5
                    assert!(
                        (sum - exact[d]).abs() <= 1e-9 * (1.0 + exact[d].abs()),
                        "{e} {d}: {sum} {}",
                        exact[d]
                    );
                }
            }
        }
    }

    #[test]
    fn prop_quotients_of_parameters_are_left_to_evaluation() {
        let separation = Separation::new(&RawManipulator::default());
        assert!(separation.equations.iter().all(Option::is_none));
        assert_eq!(separation.features, 0);
    }
}
