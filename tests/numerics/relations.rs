//! Relations between parameters, imposed on what is published.

use crate::estimator::Linear;
use crate::support::TestRng;
use nalgebra::{DMatrix, DVector};
use thetabus::estimator::{BlockEstimator, EstimatorError, EstimatorOptions, Structure};

/// θ₀/θ₂ = θ₁/θ₃, as the arm has it, and one parameter more.
const RELATION: [usize; 4] = [0, 2, 1, 3];
const TRUTH: [f64; 5] = [0.06, 0.3, 0.2, 1.0, 0.5];

/// Rows of all five parameters, the third of which shows least.
fn rows(truth: &[f64; 5], noise: f64, rng: &mut TestRng) -> Linear {
    let rows = (0..300).map(|_| {
        let mut phi: Vec<f64> = (0..5).map(|_| rng.between(-1.0, 1.0)).collect();
        phi[2] *= 0.1;
        let v = phi.iter().zip(truth).map(|(x, t)| x * t).sum::<f64>() + noise * rng.normal();
        (phi, v)
    });
    Linear { rows: rows.collect() }
}

fn options(relations: Vec<[usize; 4]>) -> EstimatorOptions {
    let mut options = EstimatorOptions::paper(vec![0.1; 5], 1);
    (options.forgetting_factor, options.information_floor) = (1.0, 1e-12);
    options.relations = relations;
    options
}

fn structure(equations: &[std::ops::Range<usize>]) -> Structure {
    Structure {
        params: 5,
        equations: equations.to_vec(),
    }
}

fn estimator(options: EstimatorOptions) -> BlockEstimator {
    BlockEstimator::new(structure(&[0..5]), options).unwrap()
}

/// Least squares over (r, a, b, c) with θ = (r a, r b, a, b, c): the relation built in, by
/// Gauss-Newton from the truth.
fn reference(rows: &Linear) -> [f64; 5] {
    let mut p = DVector::from_vec(vec![TRUTH[0] / TRUTH[2], TRUTH[2], TRUTH[3], TRUTH[4]]);
    let theta = |p: &DVector<f64>| [p[0] * p[1], p[0] * p[2], p[1], p[2], p[3]];
    for _ in 0..50 {
        let t = theta(&p);
        let jacobian = DMatrix::from_fn(rows.rows.len(), 4, |i, j| {
            let x = &rows.rows[i].0;
            match j {
                0 => x[0] * p[1] + x[1] * p[2],
                1 => x[0] * p[0] + x[2],
                2 => x[1] * p[0] + x[3],
                _ => x[4],
            }
        });
        let residual = DVector::from_iterator(
            rows.rows.len(),
            rows.rows
                .iter()
                .map(|(x, v)| v - x.iter().zip(&t).map(|(x, t)| x * t).sum::<f64>()),
        );
        p += jacobian.svd(true, true).solve(&residual, 0.0).unwrap();
    }
    theta(&p)
}

#[test]
fn ident_the_published_estimate_is_least_squares_with_the_relation_built_in() {
    let mut rng = TestRng(11);
    for _ in 0..20 {
        let rows = rows(&TRUTH, 0.1, &mut rng);
        let mut estimator = estimator(options(vec![RELATION]));
        let published = estimator.update(&rows).theta.clone();
        for (got, want) in published.iter().zip(reference(&rows)) {
            // what is left of the start's 1e-12 of information beside 1 and more, and of two ways
            // to round
            assert!((got - want).abs() < 1e-9, "{published:?}");
        }
        let ratio = published[0] * published[3] / (published[1] * published[2]);
        assert!((ratio - 1.0).abs() < 1e-12, "{ratio}");
        // the recursion itself continues from the unconstrained estimate
        let mut free = self::estimator(options(Vec::new()));
        assert_eq!(free.update(&rows).theta, estimator.theta());
        assert!(estimator.product_ratio([0, 3], [1, 2]).0.abs() > 1e-6);
    }
}

#[test]
fn ident_deviations_with_a_relation_are_smaller_and_right() {
    const RUNS: usize = 400;
    let mut rng = TestRng(12);
    let (mut squares, mut gain) = ([0.0; 5], [0.0; 5]);
    for _ in 0..RUNS {
        let rows = rows(&TRUTH, 0.02, &mut rng);
        let report = estimator(options(vec![RELATION])).update(&rows).clone();
        let free = estimator(options(Vec::new())).update(&rows).clone();
        for i in 0..5 {
            squares[i] += ((report.theta[i] - TRUTH[i]) / report.theta_std[i]).powi(2) / RUNS as f64;
            gain[i] += report.theta_std[i] / free.theta_std[i] / RUNS as f64;
        }
    }
    for (square, gain) in squares.iter().zip(gain) {
        // the mean of 400 squares has a standard deviation of √(2/400) = 0.07; the learnt noise
        // adds less than 0.01
        assert!((square - 1.0).abs() < 0.25, "{squares:?}");
        assert!(gain < 1.0 + 1e-9, "{gain}");
    }
    // the ratio is known from the first pair, so what showed least gains most
    assert!(gain[2] < 0.9, "{gain:?}");
}

#[test]
fn fault_a_relation_that_cannot_be_told_or_that_the_data_deny_is_not_imposed() {
    let mut rng = TestRng(13);
    // before any data, the start values are published
    let fresh = estimator(options(vec![RELATION]));
    assert_eq!(fresh.report().theta, [0.1; 5]);
    // data that clearly contradict it
    let mut denied = TRUTH;
    denied[0] *= 1.5;
    let mut judge = estimator(options(vec![RELATION]));
    let published = judge.update(&rows(&denied, 1e-3, &mut rng)).theta.clone();
    assert_eq!(published, judge.theta());
    let (off, std) = judge.product_ratio([0, 3], [1, 2]);
    assert!(off > 4.0 * std, "{off} ± {std}");
    // an answer outside the bounds
    let noisy = rows(&TRUTH, 0.1, &mut rng);
    let mut free = estimator(options(vec![RELATION]));
    let with = free.update(&noisy).theta[2];
    let without = free.theta()[2];
    assert!((with - without).abs() > 1e-3);
    let mut bounded = options(vec![RELATION]);
    let between = 0.5 * (with + without);
    if with > without {
        bounded.parameters[2].upper = between;
    } else {
        bounded.parameters[2].lower = between;
    }
    bounded.parameters[2].start = without;
    let mut bounded = estimator(bounded);
    let published = bounded.update(&noisy).theta.clone();
    assert_eq!(published, bounded.theta());
}

#[test]
fn fault_relations_of_parameters_that_nothing_links_are_refused() {
    let refused = |equations: &[std::ops::Range<usize>], relation| {
        let refused = BlockEstimator::new(structure(equations), options(vec![relation]));
        matches!(refused, Err(EstimatorError::Relation { index: 0, got }) if got == relation)
    };
    let one = std::slice::from_ref(&(0..5));
    assert!(refused(one, [0, 0, 1, 2]) && refused(one, [0, 1, 2, 5]));
    let two = BlockEstimator::new(structure(&[0..3, 3..5]), {
        let mut options = EstimatorOptions::paper(vec![0.1; 5], 2);
        options.relations = vec![RELATION];
        options
    });
    assert!(matches!(two, Err(EstimatorError::Relation { .. })));
}
