//! Obtains many coefficient functions from few evaluations of a plant's terms.
//!
//! ```text
//! g_d(q, q̇; θ) = Σ_m μ_m(θ) b_{d,m}(q, q̇)        μ_m ∈ {1, θ_i, θ_i θ_j}
//! θ = Σ_{i∈I} e_i + ε e_j, j ∉ I:
//! g_d = Σ (b_{d,m} with μ_m of I alone) + ε Σ (b_{d,m} with μ_m = θ_j or θ_j θ_i, i ∈ I)
//! ```
//!
//! e_i sets parameter i to 1, and ε² = 0: a dual number. A b that is the only one in one of the two
//! sums equals that sum. I and j are chosen when the plant is set up, so that one evaluation gives
//! many b. A b that is alone in no sum is a second derivative at θ = 0, from hyper-dual numbers.

use super::theta_polynomial::{MAX_ORDER, Monomial};
use crate::model::{AnyPlant, MAX_JOINTS, Number};
use num_dual::{Dual64, HyperDual64};
use std::ops::Range;

/// A value for each derivative d of a term.
pub(super) type Terms<D = f64> = [D; MAX_ORDER + 1];

/// Terms of an equation at q, q̇ and θ, for any type of number.
pub(super) fn terms<D: Number>(
    plant: &dyn AnyPlant,
    equation: usize,
    q: &[f64; MAX_JOINTS],
    dq: &[f64; MAX_JOINTS],
    theta: &[D],
) -> Terms<D> {
    let mut terms = [D::from(0.0); MAX_ORDER + 1];
    let signals = |joint: usize, _: usize| (q[joint], dq[joint]);
    let shape = Shape::of(plant, equation);
    each(plant, shape, theta, 0..1, &signals, |_, g| terms = *g);
    terms
}

/// θ = 0, seeded in the parameters of a monomial.
fn seeded(monomial: Monomial, params: usize) -> Vec<HyperDual64> {
    let mut theta = vec![HyperDual64::from_re(0.0); params];
    match monomial {
        Monomial::One => {}
        Monomial::Linear(i) => theta[i].eps1 = 1.0,
        Monomial::Product(i, j) => (theta[i].eps1, theta[j].eps2) = (1.0, 1.0),
    }
    theta
}

/// b of a monomial, from terms at θ = 0 that are [seeded] in its parameters.
fn derivative(g: &HyperDual64, monomial: Monomial) -> f64 {
    match monomial {
        Monomial::One => g.re,
        Monomial::Linear(_) => g.eps1,
        Monomial::Product(i, j) if i == j => 0.5 * g.eps1eps2,
        Monomial::Product(..) => g.eps1eps2,
    }
}

/// The coefficient function of a monomial, all d.
pub(super) fn coefficient(
    plant: &dyn AnyPlant,
    equation: usize,
    monomial: Monomial,
    q: &[f64; MAX_JOINTS],
    dq: &[f64; MAX_JOINTS],
) -> Terms {
    let theta = seeded(monomial, plant.parameters().len());
    terms(plant, equation, q, dq, &theta).map(|g| derivative(&g, monomial))
}

/// A coefficient function needed at each sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub monomial: Monomial,
    pub derivative: usize,
    pub feature: usize,
}

/// One of the two sums of an evaluation: its value or its slope, the factor of ε.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Value,
    Slope,
}

/// θ of an evaluation, as the parameters that are set to 1, I, and the one that is seeded, j.
#[derive(Debug, Clone, Default)]
struct Point {
    ones: Vec<usize>,
    seed: Option<usize>,
}

impl Point {
    /// The sum that contains a monomial's b; `None` if neither does.
    fn part(&self, monomial: Monomial) -> Option<Part> {
        let one = |i: usize| self.ones.contains(&i);
        let seed = |i: usize| self.seed == Some(i);
        let (value, slope) = match monomial {
            Monomial::One => (true, false),
            Monomial::Linear(i) => (one(i), seed(i)),
            Monomial::Product(i, j) => (one(i) && one(j), one(i) && seed(j) || seed(i) && one(j)),
        };
        if value {
            Some(Part::Value)
        } else {
            slope.then_some(Part::Slope)
        }
    }

    /// The sum that contains only this b; `present` are all that are not zero.
    fn alone(&self, wanted: &Wanted, present: &[(Monomial, usize)]) -> Option<Part> {
        let part = self.part(wanted.monomial)?;
        let beside = |(monomial, derivative): &&(Monomial, usize)| {
            *derivative == wanted.derivative && self.part(*monomial) == Some(part)
        };
        (present.iter().filter(beside).count() == 1).then_some(part)
    }

    /// Number of wanted b that an evaluation here gives.
    fn gain(&self, wanted: &[Wanted], present: &[(Monomial, usize)]) -> usize {
        wanted.iter().filter(|w| self.alone(w, present).is_some()).count()
    }

    /// The same with more parameters set to 1, as long as that gives more.
    fn grown(mut self, own: &[usize], wanted: &[Wanted], present: &[(Monomial, usize)]) -> Self {
        for &i in own {
            if self.seed != Some(i) && !self.ones.contains(&i) {
                let before = self.gain(wanted, present);
                self.ones.push(i);
                if self.gain(wanted, present) <= before {
                    self.ones.pop();
                }
            }
        }
        self
    }
}

/// θ of an evaluation, and what its terms give: (derivative, feature).
#[derive(Debug, Clone)]
enum Evaluation {
    /// Without j.
    Values {
        theta: Vec<f64>,
        values: Vec<(usize, usize)>,
    },
    /// With j.
    Slopes {
        theta: Vec<Dual64>,
        values: Vec<(usize, usize)>,
        slopes: Vec<(usize, usize)>,
    },
    /// At θ = 0, for one monomial.
    Second {
        theta: Vec<HyperDual64>,
        monomial: Monomial,
        seconds: Vec<(usize, usize)>,
    },
}

/// An equation, the number of joints of its plant, and the highest derivative of its terms.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub equation: usize,
    pub joints: usize,
    pub order: usize,
}

impl Shape {
    /// Of an equation of a plant.
    pub fn of(plant: &dyn AnyPlant, equation: usize) -> Self {
        Self {
            equation,
            joints: plant.joints(),
            order: plant.equations()[equation].order,
        }
    }
}

/// One evaluation of an equation.
#[derive(Debug, Clone)]
pub(super) struct Pass {
    shape: Shape,
    evaluation: Evaluation,
}

/// The evaluations of an equation that give the wanted b. `present` are all of its b that are not
/// zero, `params` is the number of the plant's parameters.
pub(super) fn plan(shape: Shape, params: usize, present: &[(Monomial, usize)], mut wanted: Vec<Wanted>) -> Vec<Pass> {
    let mut passes = Vec::new();
    while let Some(&first) = wanted.first() {
        let best = best_point(&wanted, present);
        let monomial = first.monomial;
        let (mut values, mut slopes, mut seconds) = (Vec::new(), Vec::new(), Vec::new());
        // no sum consists of a single b: take the second derivatives of one monomial
        let stuck = best.gain(&wanted, present) == 0;
        wanted.retain(|w| {
            let list = match best.alone(w, present) {
                Some(Part::Value) => &mut values,
                Some(Part::Slope) => &mut slopes,
                None if stuck && w.monomial == monomial => &mut seconds,
                None => return true,
            };
            list.push((w.derivative, w.feature));
            false
        });
        let at = |i: usize| if best.ones.contains(&i) { 1.0 } else { 0.0 };
        let evaluation = match best.seed {
            _ if stuck => Evaluation::Second {
                theta: seeded(monomial, params),
                monomial,
                seconds,
            },
            None => Evaluation::Values {
                theta: (0..params).map(at).collect(),
                values,
            },
            Some(j) => Evaluation::Slopes {
                theta: (0..params)
                    .map(|i| Dual64::new(at(i), if i == j { 1.0 } else { 0.0 }))
                    .collect(),
                values,
                slopes,
            },
        };
        passes.push(Pass { shape, evaluation });
    }
    passes
}

/// I and j that give most of the wanted b, without j if that gives as many.
fn best_point(wanted: &[Wanted], present: &[(Monomial, usize)]) -> Point {
    let mut own = Vec::new();
    let mut points = vec![Point::default()];
    let point = |one: usize, seed: Option<usize>| Point { ones: vec![one], seed };
    for w in wanted {
        match w.monomial {
            Monomial::One => {}
            Monomial::Linear(i) => {
                own.push(i);
                points.push(point(i, None));
                points.push(Point {
                    seed: Some(i),
                    ..Point::default()
                });
            }
            Monomial::Product(i, j) => {
                own.extend([i, j]);
                points.push(point(i, None));
                if i != j {
                    points.extend([point(i, Some(j)), point(j, Some(i))]);
                }
            }
        }
    }
    let grown = points.into_iter().map(|point| point.grown(&own, wanted, present));
    let worth = |point: &Point| (point.gain(wanted, present), point.seed.is_none());
    grown.max_by_key(worth).unwrap_or_default()
}

impl Pass {
    /// Evaluates the pass at samples, where `signals(joint, at)` is (q, q̇), and passes each result
    /// to `put(feature, at, value)`.
    #[inline]
    pub fn evaluate(
        &self,
        plant: &dyn AnyPlant,
        samples: Range<usize>,
        signals: &impl Fn(usize, usize) -> (f64, f64),
        put: &mut impl FnMut(usize, usize, f64),
    ) {
        let shape = self.shape;
        match &self.evaluation {
            Evaluation::Values { theta, values } => each(plant, shape, theta, samples, signals, |at, g| {
                values.iter().for_each(|&(d, feature)| put(feature, at, g[d]));
            }),
            Evaluation::Slopes { theta, values, slopes } => each(plant, shape, theta, samples, signals, |at, g| {
                values.iter().for_each(|&(d, feature)| put(feature, at, g[d].re));
                slopes.iter().for_each(|&(d, feature)| put(feature, at, g[d].eps));
            }),
            Evaluation::Second {
                theta,
                monomial,
                seconds,
            } => each(plant, shape, theta, samples, signals, |at, g| {
                for &(d, feature) in seconds {
                    put(feature, at, derivative(&g[d], *monomial));
                }
            }),
        }
    }
}

/// Terms of an equation at several samples and a θ of any type of number.
#[inline]
fn each<D: Number>(
    plant: &dyn AnyPlant,
    shape: Shape,
    theta: &[D],
    samples: Range<usize>,
    signals: &impl Fn(usize, usize) -> (f64, f64),
    mut take: impl FnMut(usize, &Terms<D>),
) {
    let Shape {
        equation,
        joints,
        order,
    } = shape;
    let zero = D::from(0.0);
    let (mut q, mut dq) = ([zero; MAX_JOINTS], [zero; MAX_JOINTS]);
    let mut g = [zero; MAX_ORDER + 1];
    for at in samples {
        for joint in 0..joints {
            let (position, velocity) = signals(joint, at);
            (q[joint], dq[joint]) = (D::from(position), D::from(velocity));
        }
        D::terms(plant, equation, &q[..joints], &dq[..joints], theta, &mut g[..=order]);
        take(at, &g);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape {
        equation: 0,
        joints: 2,
        order: 2,
    };

    fn wanted(list: &[(Monomial, usize)]) -> Vec<Wanted> {
        let each = list.iter().enumerate();
        each.map(|(feature, &(monomial, derivative))| Wanted {
            monomial,
            derivative,
            feature,
        })
        .collect()
    }

    /// The kinds of evaluations, and how many b each gives.
    fn kinds(passes: &[Pass]) -> Vec<(&'static str, usize)> {
        let kind = |pass: &Pass| match &pass.evaluation {
            Evaluation::Values { values, .. } => ("values", values.len()),
            Evaluation::Slopes { values, slopes, .. } => ("slopes", values.len() + slopes.len()),
            Evaluation::Second { seconds, .. } => ("second", seconds.len()),
        };
        passes.iter().map(kind).collect()
    }

    #[test]
    fn val_terms_of_different_derivatives_share_an_evaluation_without_slopes() {
        // the arm's first joint: θ₅ q̇₁, θ₃ q̇₁, θ₁ q̇₁, and 3 cos²q₂ q̇₁ with θ₄ and with θ₂
        let features = [(Monomial::Linear(3), 1), (Monomial::Linear(1), 2)];
        let velocities = [
            (Monomial::Linear(4), 0),
            (Monomial::Linear(2), 1),
            (Monomial::Linear(0), 2),
        ];
        let present = [&features[..], &velocities[..]].concat();
        assert_eq!(kinds(&plan(SHAPE, 9, &present, wanted(&features))), [("values", 2)]);
    }

    #[test]
    fn val_products_and_their_factors_share_an_evaluation() {
        // the arm's second joint: centrifugal with θ₇θ₉ and θ₆θ₉, weight with θ₇ and θ₆
        let features = [
            (Monomial::Product(6, 8), 0),
            (Monomial::Linear(6), 0),
            (Monomial::Product(5, 8), 1),
            (Monomial::Linear(5), 1),
        ];
        let velocities = [
            (Monomial::Linear(7), 0),
            (Monomial::Product(6, 8), 1),
            (Monomial::Product(5, 8), 2),
        ];
        let present = [&features[..], &velocities[..]].concat();
        let passes = plan(SHAPE, 9, &present, wanted(&features));
        let given: usize = kinds(&passes).iter().map(|(_, count)| count).sum();
        assert_eq!((passes.len(), given), (2, 4));
        assert!(kinds(&passes).iter().all(|(kind, _)| *kind == "slopes"));
    }

    #[test]
    fn val_what_stands_alone_nowhere_is_a_second_derivative() {
        // (1 + θ₁)(1 + θ₂) + θ₁² in one term
        let all = [
            (Monomial::One, 0),
            (Monomial::Linear(0), 0),
            (Monomial::Linear(1), 0),
            (Monomial::Product(0, 1), 0),
            (Monomial::Product(0, 0), 0),
        ];
        let passes = plan(SHAPE, 2, &all, wanted(&all));
        let seconds = kinds(&passes).iter().filter(|(kind, _)| *kind == "second").count();
        let given: usize = kinds(&passes).iter().map(|(_, count)| count).sum();
        assert_eq!((seconds, given), (2, 5));
    }
}
