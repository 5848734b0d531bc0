//! A simulated seven-axis robot: forward dynamics in closed loop, encoders, noisy torques; then
//! what is identified is compared with the truth.

use super::{SEVEN_AXIS, robot};
use crate::support::TestRng;
use thetabus::robot::{
    FrictionTerm, IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, WindowOptions,
    forward_dynamics, inverse_dynamics, with_velocities,
};
use thetabus::rows::savitzky_golay;

const PERIOD_S: f64 = 0.001;
/// Counts of an encoder per turn, 16 bit.
const COUNT: f64 = std::f64::consts::TAU / 65_536.0;
/// Noise of the torques as a share of their range.
const NOISE: f64 = 0.005;
/// Inertia of the rotors [kg m²].
const ROTORS: [f64; 7] = [0.4, 0.4, 0.2, 0.2, 0.1, 0.05, 0.03];
/// Viscous and Coulomb friction [N m s/rad, N m].
const FRICTION: [[f64; 2]; 7] = [
    [8.0, 6.0],
    [8.0, 6.0],
    [5.0, 4.0],
    [5.0, 4.0],
    [3.0, 2.0],
    [1.5, 1.0],
    [1.0, 0.8],
];

/// Four sines of 0.05 to 0.25 Hz, different at each joint.
fn reference(joint: usize, t: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for k in 1..=4 {
        let w = std::f64::consts::TAU * (0.05 * k as f64 + 0.007 * joint as f64);
        let phase = 1.7 * joint as f64 + 2.3 * k as f64;
        let a = [0.35, 0.3, 0.25, 0.2][k - 1];
        let (sin, cos) = (w * t + phase).sin_cos();
        sum[0] += a * sin;
        sum[1] += a * w * cos;
        sum[2] -= a * w * w * sin;
    }
    sum
}

fn friction(joint: usize, dq: f64) -> f64 {
    let [viscous, coulomb] = FRICTION[joint];
    viscous * dq + coulomb * (dq / 1e-3).tanh()
}

/// Computed torque at 1 kHz, held; five Runge–Kutta steps of the joints between.
fn simulate(robot: &Robot, seconds: f64) -> Vec<RobotSample> {
    let n = robot.len();
    let still = vec![0.0; n];
    let mut state: [Vec<f64>; 2] = [0, 1].map(|d| (0..n).map(|i| reference(i, 0.0)[d]).collect());
    let mut samples = Vec::new();
    let mut k = 0_u32;
    while PERIOD_S * f64::from(k) < seconds {
        let t = PERIOD_S * f64::from(k);
        let (mut wanted, mut tau) = (still.clone(), still.clone());
        for i in 0..n {
            let [q, dq, ddq] = reference(i, t);
            wanted[i] = ddq + 400.0 * (q - state[0][i]) + 40.0 * (dq - state[1][i]);
        }
        inverse_dynamics(robot, &robot.bodies, &state[0], &state[1], &wanted, &mut tau);
        let mut sample = RobotSample {
            t_s: t,
            ..RobotSample::default()
        };
        for i in 0..n {
            tau[i] += ROTORS[i] * wanted[i] + friction(i, reference(i, t)[1]);
            (sample.q[i], sample.dq[i], sample.tau[i]) = (state[0][i], state[1][i], tau[i]);
        }
        samples.push(sample);
        let rate = |q: &[f64], dq: &[f64]| -> Vec<f64> {
            let net: Vec<f64> = (0..n).map(|i| tau[i] - friction(i, dq[i])).collect();
            let mut ddq = still.clone();
            forward_dynamics(robot, &robot.bodies, &ROTORS[..n], q, dq, &net, &mut ddq);
            ddq
        };
        // The friction's jump is steep: five steps per sample.
        let h = PERIOD_S / 5.0;
        for _ in 0..5 {
            let [q, dq] = state.clone();
            let at = |v: &[f64], a: &[f64], h: f64| -> Vec<f64> { v.iter().zip(a).map(|(v, a)| v + h * a).collect() };
            let a1 = rate(&q, &dq);
            let v2 = at(&dq, &a1, h / 2.0);
            let a2 = rate(&at(&q, &dq, h / 2.0), &v2);
            let v3 = at(&dq, &a2, h / 2.0);
            let a3 = rate(&at(&q, &v2, h / 2.0), &v3);
            let v4 = at(&dq, &a3, h);
            let a4 = rate(&at(&q, &v3, h), &v4);
            for i in 0..n {
                state[0][i] += h / 6.0 * (dq[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
                state[1][i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
            }
        }
        k += 1;
    }
    samples
}

/// What sensors make of it: rounded positions, velocities from these by a polynomial over 41
/// samples, torques with noise. The torque is held over the period after its sample, which is half
/// a sample later than the state.
fn measured(truth: &[RobotSample], robot: &Robot, seed: u64) -> Vec<RobotSample> {
    const HALF: usize = 20;
    let mut rng = TestRng(seed);
    let weights = savitzky_golay(HALF, 3, 1).unwrap();
    let rounded = |sample: &RobotSample, joint: usize| (sample.q[joint] / COUNT).round() * COUNT;
    (HALF..truth.len() - HALF)
        .map(|k| {
            let mut sample = truth[k];
            for (i, joint) in robot.joints.iter().enumerate() {
                sample.q[i] = rounded(&truth[k], i);
                let window = truth[k - HALF..=k + HALF].iter().zip(&weights);
                sample.dq[i] = window.map(|(s, w)| w * rounded(s, i)).sum::<f64>() / PERIOD_S;
                // A sum of 12 uniform numbers is normal enough, standard deviation 1.
                let normal: f64 = (0..12).map(|_| rng.between(-0.5, 0.5)).sum();
                let held = 0.5 * (truth[k].tau[i] + truth[k - 1].tau[i]);
                sample.tau[i] = held + NOISE * joint.limits.effort.unwrap() * normal;
            }
            sample
        })
        .collect()
}

fn model() -> RobotModel {
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: 1e-5,
        ..JointFriction::default()
    };
    RobotModel::new(robot(SEVEN_AXIS), true, vec![friction; 7]).unwrap()
}

fn truth(model: &RobotModel) -> Vec<f64> {
    let mut theta = model.base().nominal(model.robot(), &ROTORS);
    for [viscous, coulomb] in FRICTION {
        theta.extend([viscous, coulomb, 0.0]);
    }
    theta
}

fn identify(log: &[RobotSample]) -> RobotIdentifier {
    let options = IdentifyOptions {
        windows: WindowOptions {
            length_s: 0.1,
            stride_s: 0.02,
            ..WindowOptions::default()
        },
        friction_walk: 0.0,
        ..IdentifyOptions::default()
    };
    let mut identifier = RobotIdentifier::new(model(), options).unwrap();
    for sample in log {
        identifier.push(sample).unwrap();
    }
    identifier.end_of_recording();
    identifier
}

#[test]
fn ident_a_seven_axis_robot_with_encoders_and_noise() {
    let clean = simulate(&robot(SEVEN_AXIS), 60.0);
    let theta = truth(&model());
    let (mut inside, mut count, mut worst) = (0, 0, 0.0_f64);
    for seed in 1..=6 {
        let identifier = identify(&measured(&clean, &robot(SEVEN_AXIS), seed));
        for (i, parameter) in identifier.model().parameters().iter().enumerate() {
            let (error, std) = (identifier.theta()[i] - theta[i], identifier.theta_std(i));
            if seed == 1 {
                println!(
                    "{:10} {:9.4} {:9.4} ± {std:.4}, {:6.2} std",
                    parameter.name,
                    theta[i],
                    identifier.theta()[i],
                    error / std
                );
            }
            // What the motion excites: known to 0.2 % by its own standard deviation.
            if std < 0.002 * theta[i].abs() {
                worst = worst.max((error / theta[i]).abs());
            }
            count += 1;
            inside += usize::from(error.abs() < 1.96 * std);
        }
        println!("f {:.2?}", (0..7).map(|j| identifier.inflation(j)).collect::<Vec<_>>());
    }
    let coverage = f64::from(inside as u32) / f64::from(count as u32);
    println!(
        "worst of what is excited: {:.3} %; 95 % intervals hold in {:.1} %",
        100.0 * worst,
        100.0 * coverage
    );
    assert!(worst < 0.005, "{worst}");
    assert!(coverage > 0.9, "{coverage}");
}

/// Velocities from rounded positions against exact ones, with the same noise of the torques.
#[test]
fn ident_a_log_without_velocities_gives_what_a_log_with_exact_ones_gives() {
    let clean = simulate(&robot(SEVEN_AXIS), 60.0);
    let theta = truth(&model());
    let mut exact = measured(&clean, &robot(SEVEN_AXIS), 1);
    let mut positions = exact.clone();
    let first = clean.iter().position(|sample| sample.t_s == exact[0].t_s).unwrap();
    for (k, (exact, positions)) in exact.iter_mut().zip(&mut positions).enumerate() {
        (exact.dq, positions.dq) = (clean[first + k].dq, [0.0; 8]);
    }
    let formed = with_velocities(&positions, 0.02, 0.02);
    assert_eq!(formed.len(), positions.len() - 40);
    let [with, without] = [&exact, &formed].map(|log| identify(log));
    let rms = |of: &dyn Fn(usize) -> f64| {
        let sum: f64 = (0..theta.len()).map(|i| of(i).powi(2)).sum();
        (sum / theta.len() as f64).sqrt()
    };
    let apart = rms(&|i| (without.theta()[i] - with.theta()[i]) / with.theta_std(i));
    let error = |identifier: &RobotIdentifier| rms(&|i| (identifier.theta()[i] - theta[i]) / identifier.theta_std(i));
    let (of_exact, of_formed) = (error(&with), error(&without));
    println!("{apart:.2} std apart; errors of {of_exact:.2} std with velocities, {of_formed:.2} std without");
    assert!(
        apart < 0.5 && of_formed < 1.2 * of_exact.max(1.0),
        "{apart} {of_exact} {of_formed}"
    );
}
