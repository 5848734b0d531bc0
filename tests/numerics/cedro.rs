//! The paper on one page, `src/estimator/cedro.rs`: against the golden estimates, against the
//! engine, and against the cost that it minimises.

use crate::estimator::{GOLDEN_START, Linear, agrees, arm_block, golden_estimates, one_equation, random_linear};
use crate::support::{TestRng, golden_samples};
use nalgebra::DVector;
use thetabus::estimator::cedro::{CedroRecursion, CedroRule, cedro_cost};
use thetabus::estimator::{BlockEstimator, EstimatorOptions, Forgetting};
use thetabus::model::Manipulator;
use thetabus::rows::structure;

const RULES: [(CedroRule, Forgetting, &str); 3] = [
    (
        CedroRule::Plain,
        Forgetting::Exponential,
        include_str!("../data/golden/estimates_plain.csv"),
    ),
    (
        CedroRule::AsPrinted,
        Forgetting::BoundedAsPrinted,
        include_str!("../data/golden/estimates_as_printed.csv"),
    ),
    (
        CedroRule::Corrected,
        Forgetting::Bounded,
        include_str!("../data/golden/estimates_corrected.csv"),
    ),
];

#[test]
fn val_the_page_gives_the_golden_estimates_and_the_engine_gives_the_same() {
    let structure = structure(&Manipulator::default());
    for (rule, forgetting, golden) in RULES {
        let mut page = CedroRecursion::new(&GOLDEN_START, 0.95, 1e-3, rule);
        let mut options = EstimatorOptions::paper(GOLDEN_START.to_vec(), 2);
        (options.forgetting, options.forgetting_factor, options.information_floor) = (forgetting, 0.95, 1e-3);
        let mut engine = BlockEstimator::new(structure.clone(), options).unwrap();
        for (samples, want) in golden_samples().chunks_exact(400).zip(golden_estimates(golden)) {
            let block = arm_block(samples);
            page.update(&structure, &block).unwrap();
            let report = engine.update(&block);
            // The tolerance stated with the golden data: 60-digit arithmetic against f64.
            agrees(page.theta.as_slice(), &want, 1e-6);
            agrees(page.theta.as_slice(), &report.theta, 1e-6);
        }
    }
}

#[test]
fn val_the_recursion_minimises_the_cost_of_equation_6_and_of_equation_2() {
    let structure = one_equation(3);
    // Blocks of 40 rows are (6), blocks of one row are (2).
    for rows in [40, 1] {
        let start = CedroRecursion::new(&[0.3, -0.2, 1.0], 0.9, 1e-2, CedroRule::Plain);
        let mut rng = TestRng(7);
        let blocks: Vec<Linear> = (0..6)
            .map(|_| random_linear(&mut rng, &[2.0, -1.0, 0.3], rows, 0.5))
            .collect();
        let mut recursion = start.clone();
        blocks
            .iter()
            .for_each(|block| recursion.update(&structure, block).unwrap());
        let cost = |theta: &DVector<f64>| cedro_cost(&structure, &blocks, theta, &start);
        let least = cost(&recursion.theta);
        for i in 0..3 {
            // The cost is a parabola in each parameter, so its minimum lies midway between points
            // of equal cost.
            let at = |step: f64| {
                let mut theta = recursion.theta.clone();
                theta[i] += step;
                cost(&theta)
            };
            assert!(at(1e-3) > least && at(-1e-3) > least);
            let curvature = (at(1e-3) + at(-1e-3) - 2.0 * least) / 1e-6;
            let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
            // Rounding of the difference of two costs, over the curvature: the offset of the
            // minimum.
            assert!((slope / curvature).abs() < 1e-9, "{rows} {i}: {slope:e} {curvature:e}");
        }
    }
}

#[test]
fn fault_a_block_that_is_not_finite_leaves_the_estimate_as_it_was() {
    let structure = one_equation(2);
    let mut recursion = CedroRecursion::new(&[1.0, 2.0], 0.95, 1e-3, CedroRule::Corrected);
    let before = recursion.clone();
    let broken = Linear {
        rows: vec![(vec![f64::NAN, 1.0], 0.0)],
    };
    assert!(recursion.update(&structure, &broken).is_err());
    assert_eq!(recursion, before);
}
