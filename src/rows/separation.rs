//! Separates a plant's terms into factors that depend on θ and factors that depend on the signals.
//!
//! ```text
//! g_{e,d}(q, q̇; θ) = Σ_m μ_m(θ) [ Σ_j a_{d,m,j} q̇_j + b_{d,m}(q, q̇) ]   μ_m ∈ {1, θ_i, θ_i θ_j}
//! ```
//!
//! Terms that are polynomials in θ of degree 2 at most, such as those of the arm and the servo
//! axis, can be projected before θ is known: only a and b are projected, and a row at any θ takes a
//! few products. The coefficients are derivatives in θ at θ = 0, computed exactly with hyper-dual
//! numbers; for each sample, fewer evaluations at other θ give the same coefficients (`passes.rs`).
//! The distinct b are the features of a sample; a b with two monomials is evaluated once. Parts
//! that are a constant times a velocity are integrated by parts once more and need only the
//! position.
//!
//! The form of a plant is found at construction by evaluating it at seeded random points;
//! coefficients that are zero at all of them are taken as zero. Terms that are not such polynomials
//! are evaluated again at each θ, which costs more.

use super::partials::{Kind, Partials};
use super::passes::{Pass, Shape, Terms, Wanted, coefficient, plan, terms};
use super::probes::{Probe, probes};
use super::theta_polynomial::{FeatureTerm, Monomial, Polynomial, VelocityTerm};
use crate::model::{AnyPlant, MAX_JOINTS};
use std::ops::Range;

/// Relative difference that counts as equal: about a hundred rounding units.
const EQUAL: f64 = 1e-10;

/// A monomial with its coefficients at every probe.
type Coefficients = (Monomial, Vec<Terms>);

/// Signals on which the nonlinear part of an equation depends, for the propagation of sensor noise.
#[derive(Debug, Clone, Default)]
pub(super) struct Sensitivity {
    /// Positions first.
    pub kinds: Vec<Kind>,
    /// The range of derivatives d whose terms depend on each of them.
    pub derivatives: Vec<Range<usize>>,
}

/// The separated equations of a plant.
#[derive(Debug, Clone)]
pub(super) struct Separation {
    /// `None` for an equation that must be evaluated at each θ.
    pub equations: Vec<Option<Polynomial>>,
    pub sensitivities: Vec<Sensitivity>,
    /// Features per sample, over all equations.
    pub features: usize,
    /// Pairs of parameters, see [`Residuals::products`](crate::estimator::Residuals::products).
    pub products: Vec<(usize, usize)>,
    passes: Vec<Pass>,
}

impl Separation {
    /// Separates a plant.
    pub fn new(plant: &dyn AnyPlant) -> Self {
        let mut separation = Self {
            equations: Vec::new(),
            sensitivities: Vec::new(),
            features: 0,
            products: Vec::new(),
            passes: Vec::new(),
        };
        let (probes, mut seen) = (probes(plant), Vec::new());
        for equation in 0..plant.equations().len() {
            let polynomial = separation.polynomial(plant, equation, &probes, &mut seen);
            let sensitivity = sensitivity(plant, equation, polynomial.as_ref(), &probes);
            separation.equations.push(polynomial);
            separation.sensitivities.push(sensitivity);
        }
        separation.features = seen.len();
        separation.products = products(&separation.equations);
        separation
    }

    /// Separates an equation; `seen` are the features so far, at every probe. Coefficient functions
    /// that agree at all probes to the last bit are one feature.
    fn polynomial(
        &mut self,
        plant: &dyn AnyPlant,
        equation: usize,
        probes: &[Probe],
        seen: &mut Vec<Vec<f64>>,
    ) -> Option<Polynomial> {
        let form = &plant.equations()[equation];
        let own = form.parameters.clone();
        if own.is_empty() {
            return None;
        }
        let coefficients = |monomial: Monomial| -> Coefficients {
            let at = probes
                .iter()
                .map(|p| coefficient(plant, equation, monomial, &p.q, &p.dq));
            (monomial, at.collect())
        };
        let table: Vec<Coefficients> = Monomial::all(own).map(coefficients).collect();
        if !reproduces(&table, plant, equation, probes) {
            return None;
        }

        let mut polynomial = Polynomial::default();
        // coefficient functions that are not zero, and those of them that need a feature
        let mut present: Vec<(Monomial, usize)> = Vec::new();
        let mut wanted: Vec<Wanted> = Vec::new();
        for (monomial, at) in &table {
            for d in 0..=form.order {
                if at.iter().all(|g| g[d] == 0.0) {
                    continue;
                }
                present.push((*monomial, d));
                let index = polynomial.index_of(*monomial);
                if let Some(slopes) = constant_slopes(plant, equation, *monomial, d, probes, at) {
                    for (joint, &coefficient) in slopes.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                        polynomial.velocity.push(VelocityTerm {
                            monomial: index,
                            derivative: d,
                            joint,
                            coefficient,
                        });
                    }
                } else {
                    let values: Vec<f64> = at.iter().map(|g| g[d]).collect();
                    let feature = seen.iter().position(|other| *other == values).unwrap_or_else(|| {
                        wanted.push(Wanted {
                            monomial: *monomial,
                            derivative: d,
                            feature: seen.len(),
                        });
                        seen.push(values);
                        seen.len() - 1
                    });
                    polynomial.features.push(FeatureTerm {
                        monomial: index,
                        derivative: d,
                        feature,
                    });
                }
            }
        }
        let passes = plan(Shape::of(plant, equation), plant.parameters().len(), &present, wanted);
        self.passes.extend(passes);
        Some(polynomial)
    }

    /// Passes the features of samples to `put(feature, at, value)`; `signals(joint, at)` is (q,
    /// q̇).
    #[inline]
    pub fn extract(
        &self,
        plant: &dyn AnyPlant,
        samples: Range<usize>,
        signals: impl Fn(usize, usize) -> (f64, f64),
        mut put: impl FnMut(usize, usize, f64),
    ) {
        for pass in &self.passes {
            pass.evaluate(plant, samples.clone(), &signals, &mut put);
        }
    }
}

/// True if the sum of the monomials times their coefficients is the equation, at every probe.
fn reproduces(table: &[Coefficients], plant: &dyn AnyPlant, equation: usize, probes: &[Probe]) -> bool {
    let order = plant.equations()[equation].order;
    probes.iter().enumerate().all(|(n, probe)| {
        let exact = terms(plant, equation, &probe.q, &probe.dq, &probe.theta);
        (0..=order).all(|d| {
            let parts = table.iter().map(|(m, at)| m.value(&probe.theta) * at[n][d]);
            let (sum, size) = parts.fold((0.0, 0.0), |(sum, size), x| (sum + x, size + x.abs()));
            // false for NaN
            (sum - exact[d]).abs() <= EQUAL * (size + exact[d].abs())
        })
    })
}

/// The a_j if the coefficient function is Σ a_j q̇_j with constant a_j, and not zero.
fn constant_slopes(
    plant: &dyn AnyPlant,
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

/// Pairs (b, a): b occurs only in products, one of them with a, which also occurs alone or squared.
fn products(equations: &[Option<Polynomial>]) -> Vec<(usize, usize)> {
    let monomials: Vec<Monomial> = equations
        .iter()
        .flatten()
        .flat_map(|p| p.monomials.iter().copied())
        .collect();
    let alone = |i: usize| monomials.contains(&Monomial::Linear(i)) || monomials.contains(&Monomial::Product(i, i));
    let pairs = monomials.iter().filter_map(|monomial| match *monomial {
        Monomial::Product(i, j) if alone(i) && !alone(j) => Some((j, i)),
        Monomial::Product(i, j) if alone(j) && !alone(i) => Some((i, j)),
        _ => None,
    });
    pairs.collect()
}

fn sensitivity(
    plant: &dyn AnyPlant,
    equation: usize,
    polynomial: Option<&Polynomial>,
    probes: &[Probe],
) -> Sensitivity {
    let order = plant.equations()[equation].order;
    let derivatives = |kind: &Kind| {
        let mut found: Option<Range<usize>> = None;
        for probe in probes {
            let mut partials = Partials::new(plant, equation, &probe.theta, &[*kind]);
            let [mut slopes, _] = partials.at(|joint| (probe.q[joint], probe.dq[joint]));
            let size = slopes.map(f64::abs);
            if let (true, Some(polynomial)) = (kind.velocity, polynomial) {
                for term in polynomial.velocity.iter().filter(|term| term.joint == kind.joint) {
                    let m = polynomial.monomials[term.monomial].value(&probe.theta);
                    slopes[term.derivative] -= m * term.coefficient;
                }
            }
            for d in (0..=order).filter(|&d| slopes[d].abs() > EQUAL * size[d]) {
                let known = found.clone().unwrap_or(d..d + 1);
                found = Some(known.start.min(d)..known.end.max(d + 1));
            }
        }
        found
    };
    let kinds = [false, true].into_iter().flat_map(|velocity| {
        let joints = 0..plant.joints();
        joints.map(move |joint| Kind { joint, velocity })
    });
    let found = kinds.filter_map(|kind| Some((kind, derivatives(&kind)?)));
    let (kinds, derivatives) = found.unzip();
    Sensitivity { kinds, derivatives }
}

#[cfg(test)]
mod tests {
    use super::super::probes::signed;
    use super::*;
    use crate::model::{Manipulator, RawManipulator};
    use crate::random::Random;

    #[test]
    fn val_the_arm_comes_apart_as_its_equations_are_written() {
        let separation = Separation::new(&Manipulator::default());
        let joint_1 = separation.equations[0].as_ref().unwrap();
        // θ₅ q̇₁, θ₃ q̇₁ and θ₁ q̇₁ need no velocity; 3 cos²q₂ q̇₁ has the factors θ₄ and θ₂
        assert_eq!(joint_1.velocity.len(), 3);
        assert_eq!(joint_1.features.len(), 2);
        let joint_2 = separation.equations[1].as_ref().unwrap();
        // θ₈ q̇₂, θ₇θ₉ q̇₂, θ₆θ₉ q̇₂; centrifugal and weight, each with θ₇ and θ₆
        assert_eq!(joint_2.velocity.len(), 3);
        assert_eq!(joint_2.features.len(), 4);
        // 3 cos²q₂ q̇₁, the centrifugal term and the weight, each twice
        assert_eq!(separation.features, 3);
        assert_eq!(separation.passes.len(), 2);
        for sensitivity in &separation.sensitivities {
            let kinds = sensitivity.kinds.iter().map(|kind| (kind.joint, kind.velocity));
            assert_eq!(kinds.collect::<Vec<_>>(), [(1, false), (0, true)]);
        }
        // the nonlinear terms of joint 1 are differentiated once and twice, those of joint 2 not at
        // all and once
        let derivatives = [1..3, 0..2];
        for (sensitivity, expected) in separation.sensitivities.iter().zip(derivatives) {
            assert_eq!(sensitivity.derivatives, [expected.clone(), expected]);
        }
    }

    #[test]
    fn val_the_parts_add_up_to_the_terms() {
        let plant = Manipulator::default();
        let separation = Separation::new(&plant);
        let mut random = Random(5);
        for _ in 0..200 {
            let mut q = [0.0; MAX_JOINTS];
            let mut dq = [0.0; MAX_JOINTS];
            for joint in 0..2 {
                (q[joint], dq[joint]) = (signed(&mut random, 3.0), signed(&mut random, 20.0));
            }
            let theta: Vec<f64> = (0..9).map(|_| signed(&mut random, 30.0)).collect();
            let mut features = vec![0.0; separation.features];
            let signals = |joint: usize, _: usize| (q[joint], dq[joint]);
            separation.extract(&plant, 0..1, signals, |feature, _, value| features[feature] = value);
            for (e, polynomial) in separation.equations.iter().enumerate() {
                let polynomial = polynomial.as_ref().unwrap();
                let exact = terms(&plant, e, &q, &dq, &theta);
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
