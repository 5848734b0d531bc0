//! The arm's equations against Lagrange, automatic differentiation and finite differences.

use crate::support::{TestRng, golden_samples, random_sample};
use num_dual::{Dual2, Dual64, DualNum};
use thetabus::estimator::Residuals;
use thetabus::model::{
    AutoDiff, Delayed, DerivedValues, DriveInput, JointSample, KnownConstants, MANIPULATOR_PARAMS, MAX_JOINTS,
    Manipulator, ManipulatorDerived, Motion, PdController, PhysicalParameters, Plant, PointwiseModel, RawManipulator,
    ServoAxis,
};
use thetabus::rows::{InputSource, PointwiseBlock, SampleBlock, structure};

/// Section 5 of the paper with m₂ = 150 kg.
const PAPER: PhysicalParameters = PhysicalParameters {
    length_1_m: 0.5,
    mass_1_kg: 100.0,
    length_2_m: 1.0,
    mass_2_kg: 150.0,
    winding_resistance_ohm: [0.04; 2],
    winding_inductance_h: [0.004; 2],
    torque_constant_n_m_per_a: [23.0; 2],
    back_emf_constant_v_s_per_rad: [23.0; 2],
};

/// An arm where no two constants are equal, so that none can stand in for another.
const UNEVEN: PhysicalParameters = PhysicalParameters {
    length_1_m: 0.7,
    mass_1_kg: 40.0,
    length_2_m: 1.3,
    mass_2_kg: 90.0,
    winding_resistance_ohm: [0.05, 0.09],
    winding_inductance_h: [0.003, 0.007],
    torque_constant_n_m_per_a: [17.0, 29.0],
    back_emf_constant_v_s_per_rad: [19.0, 31.0],
};

/// Random states and the places where a formula likes to lose accuracy: the arm straight up, at
/// rest, and both.
fn states() -> Vec<JointSample> {
    let mut rng = TestRng(1);
    let mut states: Vec<JointSample> = (0..200).map(|_| random_sample(&mut rng)).collect();
    for q2 in [
        std::f64::consts::FRAC_PI_2,
        -std::f64::consts::FRAC_PI_2 + 1e-9,
        0.0,
        1e-12,
    ] {
        for speed in [0.0, 1e-9, 3.0] {
            let mut sample = random_sample(&mut rng);
            sample.q[1] = q2;
            sample.dq = [speed; MAX_JOINTS];
            states.push(sample);
        }
    }
    states
}

/// Kinetic minus potential energy, (19) to (22), straight from the positions of the centre of
/// gravity.
fn lagrangian<D: DualNum<Primitive = f64> + Copy>(arm: &PhysicalParameters, gravity: f64, q: [D; 2], dq: [D; 2]) -> D {
    let (lc2, m2) = (arm.length_2_m / 2.0, arm.mass_2_kg);
    // (19) differentiated in time gives the velocity of (20)
    let velocity = [
        q[0].cos() * q[1].cos() * dq[0] * lc2 - q[0].sin() * q[1].sin() * dq[1] * lc2,
        -(q[0].sin() * q[1].cos() * dq[0] * lc2) - q[0].cos() * q[1].sin() * dq[1] * lc2,
        q[1].cos() * dq[1] * lc2,
    ];
    let square = velocity.iter().fold(D::from(0.0), |sum, &v| sum + v * v);
    let jc1 = arm.mass_1_kg * arm.length_1_m.powi(2) / 12.0;
    let jc2 = m2 * arm.length_2_m.powi(2) / 12.0;
    let kinetic = dq[0] * dq[0] * (jc1 / 2.0) + square * (m2 / 2.0) + dq[1] * dq[1] * (jc2 / 2.0); // (21)
    kinetic - (q[1].sin() * lc2 + arm.length_1_m) * (m2 * gravity) // (22)
}

/// Motor torques by (23) and their rates along a motion, from the energies alone.
///
/// With p = ∂ℒ/∂q̇ the torque is dp/dt − ∂ℒ/∂q. Time enters as a dual number of order 2, the
/// partial derivatives as dual numbers outside it.
fn torque_and_rate(arm: &PhysicalParameters, gravity: f64, sample: &JointSample, joint: usize) -> [f64; 2] {
    type InTime = Dual2<f64>;
    let series = |a: f64, b: f64, c: f64| InTime::new(a, b, c);
    let partial = |of_velocity: bool| -> InTime {
        let mut q = [num_dual::Dual::<InTime>::from_re(series(0.0, 0.0, 0.0)); 2];
        let mut dq = q;
        for j in 0..2 {
            q[j].re = series(sample.q[j], sample.dq[j], sample.ddq[j]);
            dq[j].re = series(sample.dq[j], sample.ddq[j], sample.dddq[j]);
        }
        let one = series(1.0, 0.0, 0.0);
        if of_velocity {
            dq[joint].eps = one
        } else {
            q[joint].eps = one
        }
        lagrangian(arm, gravity, q, dq).eps
    };
    let (momentum, force) = (partial(true), partial(false));
    [momentum.v1 - force.re, momentum.v2 - force.v1]
}

#[test]
fn val_equation_26_follows_from_lagrange_and_the_motor_equation() {
    let gravity = 9.81;
    let arm = Manipulator::new(gravity).unwrap();
    for physical in [PAPER, UNEVEN] {
        let theta = physical.theta();
        for mut sample in states() {
            let mut scale = [0.0; 2];
            for (joint, scale) in scale.iter_mut().enumerate() {
                let [torque, rate] = torque_and_rate(&physical, gravity, &sample, joint);
                let km = physical.torque_constant_n_m_per_a[joint];
                // (12) with (14)-(16), the current from (18)
                let parts = [
                    physical.winding_resistance_ohm[joint] * torque / km,
                    physical.winding_inductance_h[joint] * rate / km,
                    physical.back_emf_constant_v_s_per_rad[joint] * sample.dq[joint],
                ];
                sample.input[joint] = parts.iter().sum();
                *scale = 12.0 * parts.iter().map(|part| part.abs()).sum::<f64>();
            }
            let features = arm.features(&sample);
            for (equation, scale) in scale.iter().enumerate() {
                let residual = arm.row(equation, &features, &theta, &mut [0.0; 5]);
                // Some twenty operations; cancellation inside the sums costs two digits at most for
                // these states.
                assert!(
                    residual.abs() <= 1e-12 * (scale + 1.0),
                    "equation {equation}: {residual} of {scale}"
                );
            }
        }
    }
}

/// Sum of magnitudes that a residual is made of: what rounding is relative to.
fn magnitude(
    model: &impl PointwiseModel,
    plant: &impl Plant,
    equation: usize,
    sample: &JointSample,
    theta: &[f64],
) -> f64 {
    let mut regressor = [0.0; 16];
    let form = &plant.equations()[equation];
    model.row(
        equation,
        &model.features(sample),
        theta,
        &mut regressor[..form.parameters.len()],
    );
    let terms: f64 = form
        .parameters
        .clone()
        .zip(&regressor)
        .map(|(p, r)| (theta[p] * r).abs())
        .sum();
    terms + form.input_scale * sample.input[form.input].abs() + 1.0
}

fn random_theta(rng: &mut TestRng) -> Vec<f64> {
    PAPER
        .theta()
        .iter()
        .map(|value| value * rng.between(-3.0, 3.0))
        .collect()
}

#[test]
fn val_hand_written_rows_equal_automatic_differentiation() {
    let arm = Manipulator::default();
    let reference = AutoDiff(arm);
    let mut rng = TestRng(2);
    for sample in states() {
        let theta = random_theta(&mut rng);
        let features = arm.features(&sample);
        for (equation, form) in arm.equations().iter().enumerate() {
            let count = form.parameters.len();
            let (mut by_hand, mut automatic) = ([0.0; 5], [0.0; 5]);
            let f = arm.row(equation, &features, &theta, &mut by_hand[..count]);
            let f_reference = reference.row(equation, &sample, &theta, &mut automatic[..count]);
            // Sums of some ten terms in another order; the largest single term can exceed its
            // regressor a hundredfold.
            let scale = magnitude(&arm, &arm, equation, &sample, &theta);
            assert!(
                (f - f_reference).abs() <= 1e-12 * scale,
                "equation {equation}: {f} {f_reference} of {scale}"
            );
            let largest = automatic.iter().fold(1.0f64, |m, r| m.max(r.abs()));
            for (a, b) in by_hand.iter().zip(&automatic) {
                assert!(
                    (a - b).abs() <= 1e-12 * largest,
                    "equation {equation}: {by_hand:?} {automatic:?}"
                );
            }
        }
    }
}

/// Compares regressors with −Δf/Δθ by central differences.
fn assert_regressors_match_differences(
    model: &impl PointwiseModel,
    plant: &impl Plant,
    theta: &[f64],
    sample: &JointSample,
) {
    let features = model.features(sample);
    for (equation, form) in plant.equations().iter().enumerate() {
        let count = form.parameters.len();
        let (mut regressor, mut scratch) = (vec![0.0; count], vec![0.0; count]);
        model.row(equation, &features, theta, &mut regressor);
        let scale = magnitude(model, plant, equation, sample, theta);
        for (slot, parameter) in form.parameters.clone().enumerate() {
            let h = 1e-5 * theta[parameter].abs().max(1e-3);
            let mut at = |delta: f64| {
                let mut moved = theta.to_vec();
                moved[parameter] += delta;
                model.row(equation, &features, &moved, &mut scratch)
            };
            let difference = -(at(h) - at(-h)) / (2.0 * h);
            // Rounding of f over the step, and h² times the third derivative, which for quotients
            // is some 10 f/θ³.
            let tolerance =
                1e-14 * scale / h + 1e-8 * (regressor[slot].abs() + scale / theta[parameter].abs().max(1e-3));
            assert!(
                (difference - regressor[slot]).abs() <= tolerance,
                "equation {equation}, {}: {difference} {}, tolerance {tolerance}",
                plant.parameters()[parameter].name,
                regressor[slot]
            );
        }
    }
}

#[test]
fn val_regressors_equal_finite_differences_of_the_residual() {
    let arm = Manipulator::default();
    let mut rng = TestRng(3);
    for sample in states() {
        let theta = random_theta(&mut rng);
        assert_regressors_match_differences(&arm, &arm, &theta, &sample);
        assert_regressors_match_differences(&AutoDiff(arm), &arm, &theta, &sample);
    }
}

#[test]
fn val_raw_parameters_have_the_residual_of_theta_and_right_regressors() {
    let arm = Manipulator::default();
    let raw = RawManipulator::new(arm);
    let u = &UNEVEN;
    let raw_theta = [
        u.length_1_m,
        u.mass_1_kg,
        u.winding_resistance_ohm[0],
        u.winding_inductance_h[0],
        u.torque_constant_n_m_per_a[0],
        u.back_emf_constant_v_s_per_rad[0],
        u.length_2_m,
        u.mass_2_kg,
        u.winding_resistance_ohm[1],
        u.winding_inductance_h[1],
        u.torque_constant_n_m_per_a[1],
        u.back_emf_constant_v_s_per_rad[1],
    ];
    let theta = UNEVEN.theta();
    for sample in states() {
        for equation in 0..2 {
            let f = arm.row(equation, &arm.features(&sample), &theta, &mut [0.0; 5]);
            let count = raw.equations()[equation].parameters.len();
            let f_raw = AutoDiff(raw).row(equation, &sample, &raw_theta, &mut [0.0; 8][..count]);
            let scale = magnitude(&arm, &arm, equation, &sample, &theta);
            assert!((f - f_raw).abs() <= 1e-12 * scale, "{f} {f_raw}");
        }
        assert_regressors_match_differences(&AutoDiff(raw), &raw, &raw_theta, &sample);
    }
}

#[test]
fn regress_golden_samples_satisfy_26_at_the_true_parameters() {
    let arm = Manipulator::default();
    let (before, after) = (
        PAPER.theta(),
        PhysicalParameters {
            mass_2_kg: 170.0,
            ..PAPER
        }
        .theta(),
    );
    for (k, sample) in golden_samples().iter().enumerate() {
        let theta = if k < 2500 { &before } else { &after };
        for equation in 0..2 {
            let residual = arm.row(equation, &arm.features(sample), theta, &mut [0.0; 5]);
            let scale = magnitude(&arm, &arm, equation, sample, theta);
            assert!(
                residual.abs() <= 1e-12 * scale,
                "sample {k}, equation {equation}: {residual} of {scale}"
            );
        }
    }
}

#[test]
fn regress_theta_of_the_paper_has_the_printed_values() {
    let printed = [
        0.00434783, 0.0260870, 0.0434783, 0.260870, 23.0, 0.0260870, 0.260870, 23.0, 1.0,
    ];
    for (value, printed) in PAPER.theta().iter().zip(printed) {
        // Six digits are printed.
        assert!((value - printed).abs() <= 5e-6 * printed, "{value} {printed}");
    }
}

#[test]
fn prop_derived_values_are_the_physical_parameters_that_theta_was_made_of() {
    for physical in [PAPER, UNEVEN] {
        let derived = ManipulatorDerived::new(physical.known()).unwrap();
        let [inductance_1, inductance_2] = physical.winding_inductance_h;
        let expected = [physical.mass_2_kg, physical.mass_1_kg, inductance_1, inductance_2];
        for (index, expected) in expected.into_iter().enumerate() {
            let value = derived.value_and_gradient(index, &physical.theta(), &mut [0.0; 9]);
            // A handful of multiplications and divisions.
            assert!((value - expected).abs() <= 1e-14 * expected, "{value} {expected}");
        }
        let nothing = derived.value_and_gradient(0, &[0.0; 9], &mut [0.0; 9]);
        assert!(nothing.is_nan(), "{nothing}");
    }
    let unknown = KnownConstants {
        torque_constant_n_m_per_a: [23.0, 0.0],
        ..PAPER.known()
    };
    let wrong = ManipulatorDerived::new(unknown).unwrap_err();
    assert_eq!((wrong.name, wrong.value), ("torque_constant_n_m_per_a", 0.0));
}

#[test]
fn val_derived_mass_has_the_deviation_of_first_order_error_propagation() {
    let derived = ManipulatorDerived::new(UNEVEN.known()).unwrap();
    let theta = UNEVEN.theta();
    // Relative standard deviations of θ₇ and θ₉ with a correlation: var(ln m₂) = a² + b² − 2 ρ a b
    // for m₂ ∝ θ₇/θ₉.
    let (a, b, rho) = (0.01, 0.003, 0.6);
    let (s7, s9) = (a * theta[6], b * theta[8]);
    let covariance = |i: usize, j: usize| match (i, j) {
        (6, 6) => s7 * s7,
        (8, 8) => s9 * s9,
        (6, 8) | (8, 6) => rho * s7 * s9,
        (i, j) if i == j => 1.0,
        _ => 0.0,
    };
    let (mass, std) = derived.value_and_std(0, &theta, &covariance);
    assert_eq!(derived.quantities()[0].name, "mass_2");
    assert!((mass - 90.0).abs() < 1e-11);
    let expected = 90.0 * (a * a + b * b - 2.0 * rho * a * b).sqrt();
    assert!((std - expected).abs() < 1e-12 * expected, "{std} {expected}");

    let truth = [90.0, 40.0, 0.003, 0.007];
    for (index, truth) in truth.into_iter().enumerate() {
        let (value, _) = derived.value_and_std(index, &theta, &covariance);
        assert!(
            (value - truth).abs() < 1e-14 * truth.max(1.0),
            "{index}: {value} {truth}"
        );
    }
    let (value, _) = derived.value_and_std(0, &[0.0; MANIPULATOR_PARAMS], &covariance);
    assert!(value.is_nan());
}

#[test]
fn prop_a_block_gives_the_rows_of_its_samples_and_refuses_more_than_it_holds() {
    let arm = Manipulator::default();
    let mut block = PointwiseBlock::new(arm, InputSource::Measured, 3);
    let samples = golden_samples();
    assert!(block.is_empty());
    for sample in &samples[1000..1003] {
        assert!(block.push(0, sample));
    }
    assert!(!block.push(0, &samples[1003]));
    assert_eq!((block.len(), block.capacity()), (3, 3));
    let theta = UNEVEN.theta();
    for (index, sample) in samples[1000..1003].iter().enumerate() {
        let (mut a, mut b) = ([0.0; 5], [0.0; 5]);
        let f = block.row(0, index, &theta, &mut a);
        assert_eq!(f, arm.row(0, &arm.features(sample), &theta, &mut b));
        assert_eq!(a, b);
    }
    block.clear();
    assert!(block.is_empty());
    let structure = structure(&arm);
    assert_eq!((structure.params, structure.equations), (9, vec![0..5, 5..9]));
}

#[test]
fn val_the_controller_input_of_27_equals_the_measured_voltage_of_an_analog_loop() {
    let mut controllers = [PdController::default(); MAX_JOINTS];
    controllers[..2].fill(PdController {
        proportional_gain_v_per_rad: 191.304,
        derivative_gain_v_s_per_rad: 31.6957,
    });
    let source = InputSource::Controller(controllers);
    for sample in golden_samples() {
        let seen = source.apply(&JointSample {
            input: [f64::NAN; MAX_JOINTS],
            ..sample
        });
        for joint in 0..2 {
            // The same law in another program: rounding of terms of some 200 V.
            assert!((seen.input[joint] - sample.input[joint]).abs() < 1e-12 * 200.0);
        }
    }
}

#[test]
fn prop_gravity_outside_its_domain_is_refused() {
    assert_eq!(Manipulator::new(f64::NAN), None);
    assert_eq!(Manipulator::new(-9.81), None);
    assert_eq!(Manipulator::new(1.62).map(|arm| arm.gravity_m_s2()), Some(1.62));
}

#[test]
fn val_dual_numbers_of_this_version_carry_derivatives_and_not_taylor_coefficients() {
    // The order-2 part is the second derivative itself; the rows rely on it.
    let t = Dual2::new(Dual64::from(0.0), Dual64::from(1.0), Dual64::from(0.0));
    assert_eq!((t * t).v2.re, 2.0);
}

#[test]
fn val_the_servo_axis_equals_its_hand_derivation_and_finite_differences() {
    let gain = 35.15;
    let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, gain).unwrap();
    let mut rng = TestRng(11);
    for sample in states() {
        let theta = [
            rng.between(0.1, 200.0),
            rng.between(0.0, 300.0),
            rng.between(0.0, 50.0),
            rng.between(-5.0, 5.0),
        ];
        let mut regressor = [0.0; 4];
        let f = AutoDiff(axis.clone()).row(0, &sample, &theta, &mut regressor);
        // M q̈ + F_v q̇ + F_c sign q̇ + offset = gain u, and its derivatives in the parameters;
        // sign 0 is that of the number, +1
        let (dq, ddq) = (sample.dq[0], sample.ddq[0]);
        let by_hand = [ddq, dq, dq.signum(), 1.0];
        let terms: Vec<f64> = theta.iter().zip(by_hand).map(|(t, r)| t * r).collect();
        let scale: f64 = terms.iter().map(|t| t.abs()).sum::<f64>() + (gain * sample.input[0]).abs();
        let expected = gain * sample.input[0] - terms.iter().sum::<f64>();
        // five products of numbers of that size
        assert!((f - expected).abs() <= 1e-14 * scale, "{f} {expected}");
        assert_eq!(regressor, by_hand);
        assert_regressors_match_differences(&AutoDiff(axis.clone()), &axis, &theta, &sample);
    }
}

#[test]
fn val_the_arm_with_a_delay_to_be_found_has_the_regressors_of_the_arm() {
    let arm = Manipulator::default();
    let delayed = Delayed::new(arm, 0.0, 5e-3);
    let mut rng = TestRng(12);
    for sample in states() {
        let mut theta = random_theta(&mut rng);
        let mut alone = [0.0; 5];
        let f = AutoDiff(arm).row(0, &sample, &theta, &mut alone);
        theta.push(1e-3);
        let count = delayed.equations()[0].parameters.len();
        let mut with = vec![0.0; count];
        let f_delayed = AutoDiff(delayed.clone()).row(0, &sample, &theta, &mut with);
        // pointwise, the delay has no part: its terms are the plant's own
        assert_eq!((f_delayed, &with[..5]), (f, &alone[..]));
        assert!(with[5..].iter().all(|&v| v == 0.0));
    }
}
