//! How σ allows for an error that the rows contain, on rows of two parameters whose answer is known.

use super::*;

/// y = φ₁ θ₁ + φ₂ θ₂ + a d, one block: linear, so that every derivative in a is a difference.
struct Line {
    rows: Vec<([f64; 2], f64, f64)>,
    std: f64,
    /// Standard deviation of an error that acts exactly like θ₁; 0 if the rows do not know it yet.
    inseparable_std: f64,
}

impl Line {
    /// `seen`: how much of the error's column the parameters cannot imitate.
    fn new(block: u64, a: f64, std: f64, seen: f64) -> Self {
        let mut rng = TestRng(block);
        let rows = (0..40).map(|_| {
            let phi = [rng.between(-1.0, 1.0), rng.between(-1.0, 2.0)];
            let d = seen * rng.between(-1.0, 1.0) + 0.5 * phi[0] + 0.4 * phi[1];
            (phi, phi[0] * 3.0 - phi[1] + a * d, d)
        });
        Self {
            rows: rows.collect(),
            std,
            inseparable_std: 0.0,
        }
    }
}

impl Residuals for Line {
    fn len(&self) -> usize {
        self.rows.len()
    }
    fn row(&self, _: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let (phi, y, _) = self.rows[index];
        regressor.copy_from_slice(&phi);
        y - phi[0] * theta[0] - phi[1] * theta[1]
    }
    fn suspect_rows(&self) -> &dyn SuspectRows {
        self
    }
}

impl SuspectRows for Line {
    fn count(&self) -> usize {
        1
    }
    fn row(&self, _: usize, index: usize, columns: &mut [f64]) {
        columns[0] = self.rows[index].2;
    }
    fn std(&self, _: usize) -> f64 {
        self.std
    }
    fn inseparable_std(&self, parameter: usize) -> f64 {
        if parameter == 0 { self.inseparable_std } else { 0.0 }
    }
}

fn estimator_of_lines() -> BlockEstimator {
    let structure = Structure {
        params: 2,
        equations: vec![0..2],
    };
    let mut options = EstimatorOptions::recommended(vec![1.0, 1.0], 1);
    options.forgetting = Forgetting::Exponential;
    options.forgetting_factor = 0.8;
    options.equations = vec![EquationNoise::WHITENED];
    options.change_detection = None;
    BlockEstimator::new(structure, options).unwrap()
}

/// Rows learn how large the error is while the joint moves. A new stream, or a program that starts
/// again from a checkpoint, has rows that do not know it yet.
#[test]
fn regress_rows_that_start_anew_do_not_end_the_allowance_for_an_inseparable_error() {
    let known = Line {
        inseparable_std: 0.5,
        ..Line::new(1, 0.0, 0.0, 1.0)
    };
    let mut estimator = estimator_of_lines();
    let mut judge = StateMachine::new(estimator.theta());
    estimator.update(&known);
    let mut state = EstimatorState::default();
    estimator.save(&mut judge, &mut state);
    let mut warm = estimator_of_lines();
    warm.load(&mut judge, &state).unwrap();

    for mut estimator in [estimator, warm] {
        estimator.update(&Line::new(2, 0.0, 0.0, 1.0));
        // from 80 rows the noise alone leaves 0.2
        let std = &estimator.report().theta_std;
        assert!((0.5..0.6).contains(&std[0]) && std[1] < 0.3, "{std:?}");
    }
}

#[test]
fn val_sigma_grows_by_what_the_data_leave_open_of_an_error() {
    let run = |a: f64, std: f64, seen: f64| {
        let mut estimator = estimator_of_lines();
        (1..=5).for_each(|block| {
            estimator.update(&Line::new(block, a, std, seen));
        });
        estimator.report().clone()
    };
    for seen in [0.0, 1.0] {
        let (right, shifted, wide) = (run(0.0, 0.0, seen), run(0.1, 0.0, seen), run(0.0, 2.0, seen));
        for i in 0..2 {
            let slope = (shifted.theta[i] - right.theta[i]) / 0.1;
            assert!(slope.abs() > 0.05, "the error shifts the estimate");
            let prior = right.theta_std[i].hypot(2.0 * slope);
            let got = wide.theta_std[i];
            if seen == 0.0 {
                // the parameters imitate the error, so all of it stays open; ε = 1e-6 of the start
                // value, which the recursion carries apart, against some ten of information
                assert!((got / prior - 1.0).abs() < 1e-5, "{i}: {got} {prior}");
            } else {
                // 200 rows with a column of variance 1/3 and noise 1 know the amplitude to
                // 1/√(200/3) = 0.12 instead of 2
                let known = right.theta_std[i].hypot(0.12 * slope);
                assert!(got > right.theta_std[i] && got < 1.1 * known, "{i}: {got} {known}");
            }
        }
    }
}

/// An error that the parameters imitate shifts the estimate of every block alike, so it is no cause
/// of a change. A change within a block makes its residuals larger, which is no reason to think
/// otherwise.
#[test]
fn regress_an_error_that_every_estimate_contains_explains_no_change() {
    let structure = Structure {
        params: 2,
        equations: vec![0..2],
    };
    let mut options = EstimatorOptions::recommended(vec![1.0, 1.0], 1);
    options.equations = vec![EquationNoise::WHITENED];
    let mut estimator = BlockEstimator::new(structure, options).unwrap();
    for block in 1..=5 {
        let change = estimator.update(&Line::new(block, 0.0, 2.0, 0.0)).change;
        assert!(change.is_none(), "{block}");
    }
    let mut changed = Line::new(6, 0.0, 2.0, 0.0);
    // in the direction of the error, by twenty of its standard deviations
    for (_, y, d) in &mut changed.rows[20..] {
        *y += 40.0 * *d;
    }
    assert!(estimator.update(&changed).change.is_some());
}

/// y = φ₁ θ₁ + φ₂ θ₂ at 100 instants a second apart in tens of milliseconds, where θ_k(t) = θ_k
/// (1 + rate_k (t − 5 s)).
struct Moving(Vec<([f64; 2], f64, u64)>);

impl Moving {
    const THETA: [f64; 2] = [3.0, -1.0];

    fn new(block: u64, rates: [f64; 2]) -> Self {
        let mut rng = TestRng(block);
        let rows = (1..=100).map(|k| {
            let phi = [rng.between(-1.0, 1.0), rng.between(-1.0, 2.0)];
            let hundredths = 100 * (block - 1) + k;
            let at = |i: usize| Self::THETA[i] * (1.0 + rates[i] * (hundredths as f64 * 0.01 - 5.0));
            (phi, phi[0] * at(0) + phi[1] * at(1), hundredths * 10_000_000)
        });
        Self(rows.collect())
    }
}

impl Residuals for Moving {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn row(&self, _: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let (phi, y, _) = self.0[index];
        regressor.copy_from_slice(&phi);
        y - phi[0] * theta[0] - phi[1] * theta[1]
    }
    fn span(&self, index: usize) -> (u64, u64) {
        (self.0[index].2, self.0[index].2)
    }
}

#[test]
fn val_a_considered_drift_widens_sigma_by_the_lag_that_it_causes() {
    let run = |rates: [f64; 2], drift_per_s: f64| {
        let structure = Structure {
            params: 2,
            equations: vec![0..2],
        };
        let mut options = EstimatorOptions::recommended(vec![1.0, -0.5], 1);
        options.forgetting = Forgetting::Exponential;
        options.forgetting_factor = 0.8;
        options.equations = vec![EquationNoise::WHITENED];
        options.change_detection = None;
        options.drift_per_s = drift_per_s;
        let mut estimator = BlockEstimator::new(structure, options).unwrap();
        (1..=5).for_each(|block| {
            estimator.update(&Moving::new(block, rates));
        });
        estimator.report().clone()
    };
    // so small a prior that the data do not narrow it: some 1e3 of information times its square
    let prior = 1e-5;
    let (still, wide) = (run([0.0; 2], 0.0), run([0.0; 2], prior));
    for i in 0..2 {
        let lag = |k: usize| {
            let mut rates = [0.0; 2];
            rates[k] = 1e-3;
            (run(rates, 0.0).theta[i] - still.theta[i]) / 1e-3
        };
        let own = lag(i) / Moving::THETA[i];
        // five blocks of a second with weights 0.8^k: their middle is 1.8 + 0.5 s before the end,
        // and a little less as θ̂ is only 5 s old
        assert!((-2.5..-1.5).contains(&own), "{own}");
        let expected = prior * lag(0).hypot(lag(1));
        let got = (wide.theta_std[i].powi(2) - still.theta_std[i].powi(2)).sqrt();
        // θ̂ began elsewhere with 1e-6 of information, and the prior is narrowed by 1e-7
        assert!((got / expected - 1.0).abs() < 1e-3, "{i}: {got} {expected}");
    }
}

#[test]
fn ident_a_drift_is_narrowed_by_the_data_and_named() {
    let wrong = Wrong {
        heating: 0.1,
        ..Wrong::default()
    };
    for seed in [1, 2] {
        let answers = identify(&arm(minimum_jerk(), seed, 30, wrong), Considered::default(), wrong);
        let (words, kind, ..) = answers[25].named.as_ref().expect("something is named");
        assert_eq!(*kind, SuspectKind::Drift, "seed {seed}: {words}");
    }
}
