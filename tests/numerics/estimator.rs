//! The estimators against golden estimates, batch least squares, and edge cases.

use crate::support::{TestRng, golden_samples};
use proptest::prelude::*;
use std::ops::Range;
use thetabus::estimator::{
    BlockEstimator, Bound, EstimatorError, EstimatorOptions, Forgetting, Held, ParameterPrior, Residuals, Structure,
    batch_least_squares,
};
use thetabus::model::{AutoDiff, JointSample, Manipulator, RawManipulator};
use thetabus::rows::{InputSource, PointwiseBlock, SampleBlock, structure};

/// Rows of a model linear in θ: f = v − φᵀθ, one equation.
pub struct Linear {
    pub rows: Vec<(Vec<f64>, f64)>,
}

impl Residuals for Linear {
    fn len(&self) -> usize {
        self.rows.len()
    }
    fn row(&self, _: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let (phi, v) = &self.rows[index];
        regressor.copy_from_slice(phi);
        v - phi.iter().zip(theta).map(|(x, t)| x * t).sum::<f64>()
    }
}

pub fn one_equation(params: usize) -> Structure {
    Structure {
        params,
        equations: std::iter::once(0..params).collect(),
    }
}

pub fn arm_block(samples: &[JointSample]) -> PointwiseBlock<Manipulator> {
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, samples.len());
    for (k, sample) in samples.iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
    }
    block
}

pub fn golden_estimates(text: &str) -> Vec<Vec<f64>> {
    text.lines()
        .skip(1)
        .map(|line| line.split(',').skip(1).map(|v| v.parse().unwrap()).collect())
        .collect()
}

pub const GOLDEN_START: [f64; 9] = [0.01, 0.01, 0.1, 0.1, 10.0, 0.1, 0.1, 10.0, 0.5];

/// Every value equal to within the relative tolerance.
pub fn agrees(got: &[f64], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len());
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        assert!((got - want).abs() <= tolerance * want.abs(), "{i}: {got:e} {want:e}");
    }
}

fn agrees_with_golden(forgetting: Forgetting, text: &str) {
    let mut options = EstimatorOptions::paper(GOLDEN_START.to_vec(), 2);
    (options.forgetting, options.forgetting_factor, options.information_floor) = (forgetting, 0.95, 1e-3);
    let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options).unwrap();
    let mut worst: f64 = 0.0;
    for (samples, want) in golden_samples().chunks_exact(400).zip(golden_estimates(text)) {
        let report = estimator.update(&arm_block(samples));
        assert_eq!(report.held, None);
        for (got, want) in report.theta.iter().zip(&want) {
            worst = worst.max((got - want).abs() / want.abs());
        }
    }
    // the tolerance stated with the golden data: 60-digit arithmetic against f64
    assert!(worst <= 1e-6, "{}: {worst:e}", forgetting.name());
}

#[test]
fn regress_plain_recursion_agrees_with_golden() {
    agrees_with_golden(
        Forgetting::Exponential,
        include_str!("../data/golden/estimates_plain.csv"),
    );
}

#[test]
fn regress_recursion_bounded_as_printed_agrees_with_golden() {
    agrees_with_golden(
        Forgetting::BoundedAsPrinted,
        include_str!("../data/golden/estimates_as_printed.csv"),
    );
}

#[test]
fn regress_bounded_recursion_agrees_with_golden() {
    agrees_with_golden(
        Forgetting::Bounded,
        include_str!("../data/golden/estimates_corrected.csv"),
    );
}

pub fn random_linear(rng: &mut TestRng, truth: &[f64], rows: usize, noise: f64) -> Linear {
    Linear {
        rows: (0..rows)
            .map(|_| {
                let phi: Vec<f64> = truth.iter().map(|_| rng.between(-1.0, 1.0)).collect();
                let v = phi.iter().zip(truth).map(|(x, t)| x * t).sum::<f64>() + rng.between(-noise, noise);
                (phi, v)
            })
            .collect(),
    }
}

#[test]
fn val_one_block_with_lambda_1_is_batch_least_squares() {
    let block = random_linear(&mut TestRng(1), &[2.0, -1.0, 0.3], 500, 0.1);
    let structure = one_equation(3);
    let batch = batch_least_squares(&structure, &block, &[0.0; 3], 1).unwrap();
    assert_eq!(batch.rank, 3);
    for forgetting in Forgetting::ALL {
        let mut options = EstimatorOptions::paper(vec![0.0; 3], 1);
        (options.forgetting, options.forgetting_factor, options.information_floor) = (forgetting, 1.0, 1e-9);
        let mut estimator = BlockEstimator::new(structure.clone(), options).unwrap();
        for (got, want) in estimator.update(&block).theta.iter().zip(&batch.theta) {
            // the start value pulls with ε over Σφ² = 167: some 1e-11
            assert!((got - want).abs() < 1e-10, "{}: {got} {want}", forgetting.name());
        }
    }
}

#[test]
fn val_many_blocks_with_lambda_1_are_batch_least_squares_of_all() {
    let mut rng = TestRng(2);
    let blocks: Vec<Linear> = (0..7)
        .map(|_| random_linear(&mut rng, &[2.0, -1.0, 0.3], 40, 0.1))
        .collect();
    let all = Linear {
        rows: blocks.iter().flat_map(|b| b.rows.clone()).collect(),
    };
    let structure = one_equation(3);
    let batch = batch_least_squares(&structure, &all, &[0.0; 3], 1).unwrap();
    let mut options = EstimatorOptions::paper(vec![0.0; 3], 1);
    (options.forgetting_factor, options.information_floor) = (1.0, 1e-9);
    let mut estimator = BlockEstimator::new(structure, options).unwrap();
    blocks.iter().for_each(|b| _ = estimator.update(b));
    for i in 0..3 {
        assert!((estimator.theta()[i] - batch.theta[i]).abs() < 1e-10);
        // the blocks are charged 3 degrees of freedom each, the batch 3 in all: 280 rows less 21 or
        // 3
        let ratio = estimator.report().theta_std[i] / batch.theta_std[i];
        assert!((ratio - 1.0).abs() < 0.05, "std ratio {ratio}");
    }
}

#[test]
fn val_batch_least_squares_solves_the_nonlinear_arm() {
    let samples = &golden_samples()[800..2400];
    let batch = batch_least_squares(
        &structure(&Manipulator::default()),
        &arm_block(samples),
        &GOLDEN_START,
        50,
    )
    .unwrap();
    let truth = [
        0.004347826086956522,
        0.02608695652173913,
        0.043478260869565216,
        0.2608695652173913,
        23.0,
    ];
    assert!(batch.converged);
    for (got, want) in batch.theta.iter().zip(truth) {
        // exact signals: rounding of 1e-16 times the condition of the data
        assert!((got - want).abs() < 1e-9 * want, "{got} {want}");
    }
}

#[test]
fn ident_a_model_that_is_not_identifiable_reports_its_rank_and_stays_finite() {
    let plant = RawManipulator::default();
    let structure = structure(&plant);
    let start: Vec<f64> = thetabus::model::Plant::parameters(&plant)
        .iter()
        .map(|p| p.start)
        .collect();
    let samples = &golden_samples()[400..1600];
    let mut block = PointwiseBlock::new(AutoDiff(plant), InputSource::Measured, samples.len());
    samples
        .iter()
        .enumerate()
        .for_each(|(k, s)| assert!(block.push(k as u64, s)));
    assert_eq!(structure.groups().len(), 1, "link 2 couples both equations");

    let batch = batch_least_squares(&structure, &block, &start, 100).unwrap();
    assert_eq!(batch.rank, 8, "twelve parameters act through eight combinations");
    assert!(batch.theta.iter().all(|v| v.is_finite()));
    assert!(batch.theta_std.iter().any(|v| v.is_infinite()));
    // what is identifiable is right: k_e1, k_e2 and l_2 stand for themselves
    for (i, want) in [(5, 23.0), (11, 23.0), (6, 1.0)] {
        assert!(
            (batch.theta[i] - want).abs() < 1e-6 && batch.theta_std[i].is_finite(),
            "{i}: {}",
            batch.theta[i]
        );
    }

    for forgetting in Forgetting::ALL {
        for max_iterations in [1, 10] {
            let mut options = EstimatorOptions::recommended(start.clone(), 2);
            (options.forgetting, options.max_iterations, options.step_factor) = (forgetting, max_iterations, 3.0);
            options.parameters.iter_mut().for_each(|prior| prior.lower = 0.0);
            options.change_detection = None;
            let mut estimator = BlockEstimator::new(structure.clone(), options).unwrap();
            for _ in 0..20 {
                let report = estimator.update(&block);
                assert!(report.theta.iter().all(|v| v.is_finite()), "{}", forgetting.name());
                assert_eq!(report.held, None);
            }
            if max_iterations > 1 {
                assert_eq!(estimator.report().rank, 8, "{}", forgetting.name());
                assert!(
                    (estimator.theta()[5] - 23.0).abs() < 1e-6,
                    "{}: {:?}",
                    forgetting.name(),
                    estimator.theta()
                );
            }
        }
    }
}

#[test]
fn val_equations_with_own_parameters_are_groups_and_shared_parameters_join_them() {
    let groups = |ranges: &[Range<usize>]| {
        let structure = Structure {
            params: 9,
            equations: ranges.to_vec(),
        };
        structure
            .groups()
            .iter()
            .map(|g| (g.parameters.clone(), g.equations.clone()))
            .collect::<Vec<_>>()
    };
    assert_eq!(groups(&[0..5, 5..9]), [(0..5, vec![0]), (5..9, vec![1])]);
    assert_eq!(groups(&[3..9, 0..5]), [(0..9, vec![0, 1])]);
    assert_eq!(groups(&[6..9, 0..2, 1..4]), [(0..4, vec![1, 2]), (6..9, vec![0])]);
}

#[test]
fn fault_blocks_at_the_edge_are_defined() {
    let options = || EstimatorOptions::recommended(vec![1.0, 2.0], 1);
    let mut estimator = BlockEstimator::new(one_equation(2), options()).unwrap();
    // empty: held, nothing moves, nothing informed
    let report = estimator.update(&Linear { rows: vec![] });
    assert_eq!(
        (report.held, report.rank, report.excited.len()),
        (Some(Held::Empty), 0, 0)
    );
    assert_eq!(report.theta, [1.0, 2.0]);
    // not finite: held
    let report = estimator.update(&Linear {
        rows: vec![(vec![1.0, f64::NAN], 1.0)],
    });
    assert_eq!(report.held, Some(Held::NotFinite));
    assert_eq!(report.theta, [1.0, 2.0]);
    // all zero: no information, no change, the standard deviation stays
    let report = estimator.update(&Linear {
        rows: vec![(vec![0.0, 0.0], 0.0); 50],
    });
    assert_eq!((report.held, report.rank, report.excited.len()), (None, 0, 0));
    assert_eq!(report.theta, [1.0, 2.0]);
    assert_eq!(report.theta_std, [1.0, 2.0]);
    // N = 1 and identical samples: one direction is met, the other keeps its value
    for rows in [1, 1000] {
        let mut estimator = BlockEstimator::new(one_equation(2), options()).unwrap();
        for _ in 0..300 {
            let report = estimator.update(&Linear {
                rows: vec![(vec![1e5, 1e5], 4e5); rows],
            });
            assert_eq!(report.rank, 1);
            let (a, b) = (report.theta[0], report.theta[1]);
            // met to rounding of 4e5, and moved only along (1, 1), whatever the scaling
            assert!(
                (a + b - 4.0).abs() < 1e-8 && (b - a - 1.0).abs() < 1e-6,
                "{rows}: {a} {b}"
            );
        }
    }
}

#[test]
fn fault_blocks_of_one_sample_and_of_identical_samples_keep_the_arm_finite_and_find_it_later() {
    let truth = [
        0.004347826086956522,
        0.02608695652173913,
        0.043478260869565216,
        0.2608695652173913,
        23.0,
    ];
    let samples = golden_samples();
    let error = |estimator: &BlockEstimator| {
        let pairs = estimator.theta().iter().zip(&truth);
        pairs.map(|(got, want)| (got / want - 1.0).abs()).fold(0.0, f64::max)
    };
    for forgetting in Forgetting::ALL {
        let options = || EstimatorOptions {
            forgetting,
            ..EstimatorOptions::recommended(GOLDEN_START.map(ParameterPrior::positive), 2)
        };
        // N = 1: two rows for nine parameters, 300 times
        let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options()).unwrap();
        for sample in &samples[400..700] {
            let report = estimator.update(&arm_block(std::slice::from_ref(sample)));
            assert!(report.rank <= 2, "{}: {}", forgetting.name(), report.rank);
            let finite = report.theta.iter().chain(&report.theta_std).all(|v| v.is_finite());
            assert!(finite && report.held.is_none(), "{}", forgetting.name());
        }
        // identical samples: the two directions of one sample, whatever their number; nothing is
        // usable of what they leave open
        let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options()).unwrap();
        for _ in 0..20 {
            let report = estimator.update(&arm_block(&vec![samples[500]; 400]));
            assert!(report.rank <= 2 && report.usable.len() <= 2, "{}", forgetting.name());
            let finite = report.theta.iter().chain(&report.theta_std).all(|v| v.is_finite());
            assert!(finite && report.held.is_none(), "{}", forgetting.name());
        }
        // and motion afterwards finds the arm
        for block in samples[400..2400].chunks_exact(400) {
            estimator.update(&arm_block(block));
        }
        // within the standard deviation for exact signals and the information left by the frozen
        // blocks
        assert!(
            error(&estimator) < 1e-3,
            "{}: {:e}",
            forgetting.name(),
            error(&estimator)
        );
    }
}

#[test]
fn ident_the_structure_of_the_products_shows_as_what_it_is() {
    let options = EstimatorOptions::recommended(GOLDEN_START.map(ParameterPrior::positive), 2);
    let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options).unwrap();
    let mut rng = TestRng(9);
    for block in golden_samples()[..2400].chunks_exact(400) {
        let noisy: Vec<JointSample> = block
            .iter()
            .map(|sample| {
                let mut sample = *sample;
                sample.input[0] += rng.between(-0.05, 0.05);
                sample.input[1] += rng.between(-0.05, 0.05);
                sample
            })
            .collect();
        estimator.update(&arm_block(&noisy));
    }
    // θ₁θ₄ = θ₂θ₃ holds for the arm and is not imposed: the data agree with it to within their
    // standard deviation
    let (ratio, std) = estimator.product_ratio([0, 3], [1, 2]);
    assert!(std > 0.0 && ratio.abs() < 4.0 * std, "{ratio} ± {std}");
    // a relation that does not hold is off by many standard deviations
    let (ratio, std) = estimator.product_ratio([5, 8], [6, 7]);
    assert!(ratio.abs() > 4.0 * std, "{ratio} ± {std}");
    // the correlation matrix: a unit diagonal, symmetric, within ±1, nothing across independent
    // equations; θ₆ and θ₉ act as a product
    let mut correlation = [0.0; 81];
    estimator.correlation(&mut correlation);
    for i in 0..9 {
        assert_eq!(correlation[i * 9 + i], 1.0);
        for j in 0..9 {
            let value = correlation[i * 9 + j];
            assert!(value == correlation[j * 9 + i] && value.abs() <= 1.0);
            assert!((i < 5) == (j < 5) || value == 0.0);
        }
    }
    assert!(correlation[6 * 9 + 8] < -0.5, "θ₇ and θ₉: {}", correlation[6 * 9 + 8]);
    let report = estimator.report();
    assert!(report.condition > 1.0 && report.condition.is_finite());
    assert!(report.excitation.iter().all(|share| (0.0..=1.0).contains(share)));
    assert_eq!((report.rank, report.excited.len()), (9, 9));
}

#[test]
fn fault_options_out_of_range_are_refused_with_name_and_number() {
    let check = |change: &dyn Fn(&mut EstimatorOptions), text: &str| {
        let mut options = EstimatorOptions::paper(vec![1.0, 2.0], 1);
        change(&mut options);
        let error = BlockEstimator::new(one_equation(2), options).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    check(
        &|o| o.forgetting_factor = 0.0,
        "forgetting_factor: expected a number in (0, 1], got 0",
    );
    check(&|o| o.forgetting_factor = f64::NAN, "got NaN");
    check(
        &|o| (o.forgetting, o.forgetting_factor) = (Forgetting::Bounded, 0.4),
        "at least 0.5",
    );
    check(&|o| o.information_floor = -1.0, "information_floor");
    check(&|o| o.parameters.truncate(1), "theta_start: expected 2 values, got 1");
    check(&|o| o.parameters[1].start = f64::INFINITY, "theta_start, entry 1");
    check(
        &|o| o.parameters[0].upper = 0.5,
        "theta_start, entry 0: expected -inf to 0.5, got 1",
    );
    check(&|o| o.max_iterations = 0, "max_iterations");
    assert_eq!("bounded".parse(), Ok(Forgetting::Bounded));
    assert!(matches!(
        "boundd".parse::<Bound>(),
        Err(EstimatorError::UnknownName { .. })
    ));
    // the rational bound takes any λ
    let mut options = EstimatorOptions::paper(vec![1.0, 2.0], 1);
    (options.forgetting, options.bound, options.forgetting_factor) = (Forgetting::Bounded, Bound::Rational, 0.3);
    assert!(BlockEstimator::new(one_equation(2), options).is_ok());
}

#[test]
fn val_time_constant_gives_lambda() {
    let lambda = thetabus::estimator::forgetting_factor(19.0, 1900, 1e-3).unwrap();
    assert!((lambda - (-0.1f64).exp()).abs() < 1e-15);
    assert!(thetabus::estimator::forgetting_factor(0.0, 1900, 1e-3).is_err());
}

#[test]
fn ident_a_fixed_parameter_and_an_active_bound_leave_the_others_optimal() {
    let truth = [2.0, -1.0, 0.3];
    let block = random_linear(&mut TestRng(3), &truth, 400, 0.0);
    let mut options = EstimatorOptions::recommended(vec![1.0; 3], 1);
    (options.information_floor, options.change_detection) = (1e-9, None);
    (options.parameters[0].fixed, options.parameters[1].lower) = (true, 0.0);
    options.max_iterations = 40;
    let mut estimator = BlockEstimator::new(one_equation(3), options).unwrap();
    for _ in 0..5 {
        estimator.update(&block);
    }
    // by hand: θ₁ = 1 held, θ₂ = 0 at its bound, θ₃ from its own normal equation
    let (mut s, mut b) = (0.0, 0.0);
    for (phi, v) in &block.rows {
        s += phi[2] * phi[2];
        b += phi[2] * (v - phi[0]);
    }
    let theta = estimator.theta();
    assert_eq!(theta[0], 1.0);
    assert!(theta[1].abs() < 1e-12, "{theta:?}");
    assert!((theta[2] - b / s).abs() < 1e-9, "{theta:?} {}", b / s);
    assert_eq!(estimator.report().theta_std[0], 0.0);
    // data that pull it inwards take it off its bound again
    let inside = random_linear(&mut TestRng(4), &[1.0, 0.5, 0.3], 40_000, 0.0);
    estimator.update(&inside);
    assert!(estimator.theta()[1] > 0.1, "{:?}", estimator.theta());
}

proptest! {
    #[test]
    fn prop_information_is_symmetric_positive_definite_after_any_update(
        rule in 0usize..5,
        lambda in 0.5..1.0f64,
        floor_exponent in -8.0..0.0f64,
        blocks in prop::collection::vec((0usize..12, -6.0..6.0f64, 0u64..1000), 1..40),
    ) {
        let mut options = EstimatorOptions::recommended(vec![1.0, -2.0, 0.5], 1);
        options.forgetting = Forgetting::ALL[rule];
        (options.forgetting_factor, options.information_floor) = (lambda, 10f64.powf(floor_exponent));
        let mut estimator = BlockEstimator::new(one_equation(3), options).unwrap();
        for (rows, size, seed) in blocks {
            let mut block = random_linear(&mut TestRng(seed), &[2.0, -1.0, 0.3], rows, 0.1);
            for (phi, _) in &mut block.rows {
                phi.iter_mut().for_each(|x| *x *= 10f64.powf(size));
            }
            let report = estimator.update(&block);
            prop_assert!(report.theta.iter().chain(&report.theta_std).all(|v| v.is_finite()));
            let (_, information) = estimator.information(0).unwrap();
            let matrix = nalgebra::DMatrix::from_row_slice(3, 3, information);
            prop_assert_eq!(&matrix, &matrix.transpose());
            prop_assert!(matrix.cholesky().is_some(), "{:?}", information);
        }
    }
}
