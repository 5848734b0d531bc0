//! The Cramér–Rao bound of robots against closed forms, and the six-axis robot against the bound.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::path::Path;
use thetabus::config::RobotConfig;
use thetabus::robot::{
    FrictionTerm, IdentifyOptions, JointFriction, Robot, RobotModel, RobotSimOptions, Selection, SimulatedDrive,
};
use thetabus::studies::efficiency::{KNOWABLE, RobotBound, RobotCase, RobotMethod, RobotMotion, RobotTruth};

const SLIDER: &str = r#"<robot name="slider"><link name="base"/><link name="cart"><inertial><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="2" effort="50"/></joint></robot>"#;
const MASS: f64 = 2.0;
const VISCOUS: f64 = 3.0;
/// What nothing known of a position and a velocity at the start means to the bound.
const UNKNOWN: [f64; 2] = [1e-2, 0.1];

fn slider(terms: &[FrictionTerm]) -> RobotModel {
    let robot = Robot::from_urdf(SLIDER, &Selection::default()).unwrap();
    let friction = JointFriction {
        terms: terms.to_vec(),
        presliding: 1e-4,
        ..JointFriction::default()
    };
    RobotModel::new(robot, false, vec![friction]).unwrap()
}

fn truth(model: &RobotModel, coulomb: f64, sample_period_s: f64, position_std: f64) -> RobotTruth {
    RobotTruth {
        bodies: model.robot().bodies.clone(),
        drives: vec![SimulatedDrive {
            viscous: VISCOUS,
            coulomb,
            offset: 0.0,
            stribeck: 0.0,
            spring: 0.0,
            drag: 0.0,
            asymmetric: 0.0,
            rotor_inertia: 0.0,
        }],
        presliding: 1e-4,
        sample_period_s,
        torque_std: vec![0.25],
        position_std: vec![position_std],
    }
}

/// Position, velocity and acceleration of the cart.
fn motion(t_s: f64) -> [f64; 3] {
    let (a, b) = (TAU * 0.7, TAU * 1.9);
    [
        0.3 * (a * t_s).sin() + 0.05 * (b * t_s).cos(),
        0.3 * a * (a * t_s).cos() - 0.05 * b * (b * t_s).sin(),
        -0.3 * a * a * (a * t_s).sin() - 0.05 * b * b * (b * t_s).cos(),
    ]
}

/// Bounds by the recursion and with exact positions.
fn bounds(model: &RobotModel, truth: RobotTruth, samples: usize) -> [Vec<f64>; 2] {
    let period_s = truth.sample_period_s;
    let mut bound = RobotBound::<1>::new(model, truth).unwrap();
    for k in 0..samples {
        let [x, v, _] = motion(period_s * k as f64);
        let (mut q, mut dq) = ([0.0; 8], [0.0; 8]);
        (q[0], dq[0]) = (x, v);
        bound.advance(&q, &dq);
    }
    bound.std().unwrap()
}

fn std_of(information: DMatrix<f64>, model: &RobotModel) -> Vec<f64> {
    let prior = DMatrix::from_fn(information.nrows(), information.nrows(), |i, j| {
        if i == j {
            model.parameters()[i].scale.powi(-2)
        } else {
            0.0
        }
    });
    let covariance = (information + prior).try_inverse().unwrap();
    covariance.diagonal().map(f64::sqrt).as_slice().to_vec()
}

fn assert_near(got: &[f64], expected: &[f64], tolerance: f64) {
    for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
        assert!(
            (got / expected - 1.0).abs() < tolerance,
            "parameter {i}: {got} instead of {expected}"
        );
    }
}

/// M ẍ + F_v ẋ + f_0 = u with exact positions is a regression on (ẍ, ẋ, 1). The mean of a sample
/// for its middle costs (ω Δ)²/24 = 6e-6; the recursion does not know the state at the start, which
/// costs it a few of 4000 samples.
#[test]
fn val_the_bound_of_a_cart_with_exact_positions_is_that_of_its_regression() {
    let model = slider(&[FrictionTerm::Viscous, FrictionTerm::Offset]);
    let [recursion, exact] = bounds(&model, truth(&model, 0.0, 1e-3, 1e-9), 4001);
    let rows = DMatrix::from_fn(4000, 3, |k, i| {
        let [_, v, a] = motion(1e-3 * (k as f64 + 0.5));
        [a, v, 1.0][i] / 0.25
    });
    let expected = std_of(rows.tr_mul(&rows), &model);
    assert_near(&exact, &expected, 1e-4);
    assert_near(&recursion, &expected, 5e-3);
}

/// Friction that reverses acts through its own state in the recursion, and as two columns in the
/// regression: with exact positions both say the same. A reversal takes 6 ms at 5 m/s², of which the
/// regression has six rows with trapezoids between: 2 % of f_r, which depends on reversals alone.
#[test]
fn val_reversals_count_the_same_as_states_and_as_columns() {
    use FrictionTerm::{Coulomb, Offset, Reversal, Viscous};
    let model = slider(&[Viscous, Coulomb, Offset, Reversal]);
    let [recursion, exact] = bounds(&model, truth(&model, 4.0, 1e-3, 1e-9), 4001);
    assert_near(&recursion, &exact, 0.03);
}

/// Positions with noise that matters, against the Fisher information of all of them at once: they
/// are normal with the covariance σ² H Hᵀ + r² 1 + what is not known of the start, H the response to
/// the torque of each sample, and their mean moves with θ by −H y, y the regressor.
#[test]
fn val_the_recursion_is_the_fisher_information_of_all_positions() {
    let model = slider(&[FrictionTerm::Viscous, FrictionTerm::Offset]);
    let (h, count, noise) = (5e-3, 500, 1e-3);
    let [recursion, exact] = bounds(&model, truth(&model, 0.0, h, noise), count);
    let time = MASS / VISCOUS;
    // way under a constant torque of 1 since t = 0
    let step = |t: f64| {
        if t <= 0.0 {
            0.0
        } else {
            t / VISCOUS - MASS / VISCOUS.powi(2) * (1.0 - (-t / time).exp())
        }
    };
    let response = DMatrix::from_fn(count, count - 1, |k, j| {
        let t = h * (k as f64 - j as f64);
        step(t) - step(t - h)
    });
    let rows = DMatrix::from_fn(count - 1, 3, |k, i| {
        let [_, v, a] = motion(h * (k as f64 + 0.5));
        [a, v, 1.0][i]
    });
    let speed = DVector::from_fn(count, |k, _| time * (1.0 - (-h * k as f64 / time).exp()));
    let mut covariance = &response * response.transpose() * 0.25_f64.powi(2);
    covariance += &speed * speed.transpose() * UNKNOWN[1].powi(2);
    covariance.add_scalar_mut(UNKNOWN[0].powi(2));
    for k in 0..count {
        covariance[(k, k)] += noise * noise;
    }
    let moved = response * rows;
    let information = moved.tr_mul(&covariance.cholesky().unwrap().solve(&moved));
    // the recursion advances in quarters of a sample: (Δ/4) F_v/M = 2e-3
    assert_near(&recursion, &std_of(information, &model), 5e-3);
    assert!(
        recursion[0] > 1.1 * exact[0],
        "noise that matters: {} and {}",
        recursion[0],
        exact[0]
    );
}

/// The study assumes the same robot as the shipped file.
#[test]
fn regress_the_study_has_the_shipped_robot() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/robots/six_axis.toml");
    let config = RobotConfig::from_file(&path).unwrap();
    let case = RobotCase::new(RobotMotion::Fourier).unwrap();
    assert_eq!(case.model().parameters(), config.model.parameters());
    assert_eq!(case.model().friction(), config.model.friction());
    let shipped = IdentifyOptions {
        zero_rad: 0.0,
        delay_s: 0.0,
        friction_shape: 0.0,
        spring_share: 0.0,
        payload: config.payload,
        ..config.options
    };
    assert_eq!(RobotCase::identification(case.model().robot()), shipped);
    assert_eq!(config.velocity_s, Some(0.02));
    let own = case.options(0);
    let without_what_differs = RobotSimOptions {
        drives: own.drives.clone(),
        payloads: Vec::new(),
        seed: own.seed,
        machine_seed: own.machine_seed,
        ..config.simulation
    };
    assert_eq!(own, without_what_differs);
}

/// Windows with the right weights lose little, and nothing without bias is below the bound. Some
/// twenty parameters of two runs tell a root mean square to 15 % or so.
#[test]
fn val_weighted_windows_are_near_the_bound_of_the_six_axis_robot() {
    let case = RobotCase::new(RobotMotion::Fourier).unwrap();
    let runs: Vec<_> = (0..2).map(|seed| case.run(seed, 20.0).unwrap()).collect();
    let known: Vec<usize> = (0..runs[0].truth.len())
        .filter(|&i| runs.iter().all(|run| run.bound[i] < KNOWABLE * run.truth[i].abs()))
        .collect();
    assert!(known.len() > 10, "{known:?}");
    for method in [RobotMethod::WeightedWindows, RobotMethod::Ours] {
        let squares = runs
            .iter()
            .flat_map(|run| known.iter().map(|&i| run.ratio(method, i).unwrap().powi(2)));
        let lost = (squares.sum::<f64>() / (runs.len() * known.len()) as f64).sqrt();
        assert!((0.6..1.8).contains(&lost), "{method:?}: {lost}");
    }
    // rounding costs something, and exact positions are never worse
    for run in &runs {
        assert!(known.iter().all(|&i| run.bound[i] > 0.98 * run.exact_bound[i]));
    }
}
