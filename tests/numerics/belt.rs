//! A servo axis whose load hangs on a belt, with the encoder on either side of it.
//!
//! ```text
//! m q̈_m = k u − b − F_v q̇_m − F_c sign q̇_m − K (q_m − q_l) − C (q̇_m − q̇_l)
//! m q̈_l = K (q_m − q_l) + C (q̇_m − q̇_l)                  m: half of the mass, K = m ω²/2
//! ```
//!
//! Encoder on the motor: the mass appears larger, at s² larger by 1 − s²/ω² to first order. Encoder
//! on the load: smaller by as much. At each reversal the friction of the motor makes the belt ring.

use super::support::TestRng;
use std::f64::consts::{PI, TAU};
use thetabus::estimator::{BlockEstimator, EquationNoise, EstimatorOptions, Forgetting};
use thetabus::model::{DriveInput, JointSample, MAX_JOINTS, Motion, ServoAxis};
use thetabus::rows::{
    Considered, InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, SuspectKind, priors, structure,
};
use thetabus::sim::ServoAxisOptions;

const N: usize = 1900;
const BLOCKS: usize = 16;
const RESOLUTION: f64 = 5e-8;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Encoder {
    Motor,
    Load,
}

/// Positions and inputs, 1 ms apart, of the motion of config/servo_axis.toml under a PD loop of
/// 8 Hz. Euler's method, with friction that stops the motor within a step.
fn samples(machine: &ServoAxisOptions, hertz: f64, encoder: Encoder, seed: u64) -> Vec<(f64, f64)> {
    const H: f64 = 5e-5;
    let mut rng = TestRng(seed);
    let tones = [(0.4, 0.08), (1.7, 0.0128), (5.0, 0.0024)].map(|(f, a)| (TAU * f, a, rng.between(-PI, PI)));
    let half = 0.5 * machine.mass.mass_kg(0.0);
    let omega = TAU * hertz;
    let (stiffness, damping) = (0.5 * half * omega * omega, 0.03 * half * omega);
    let loop_rate = 16.0 * PI;
    let per_volt = 2.0 * half / machine.gain;
    let swing = |t: f64| tones.iter().map(|(w, a, p)| a * (w * t + p).sin()).sum::<f64>();
    let reference = |t: f64| swing(t) - swing(0.0) * (-t / 0.3).exp();
    let (mut motor, mut load) = ([0.0f64; 2], [0.0f64; 2]);
    (0..BLOCKS * N)
        .map(|k| {
            let position = match encoder {
                Encoder::Motor => motor[0],
                Encoder::Load => load[0],
            };
            let error = reference(k as f64 * 1e-3) - position;
            let input = per_volt * (loop_rate * loop_rate * error - 1.6 * loop_rate * motor[1]);
            let input = input.clamp(-10.0, 10.0);
            for _ in 0..(1e-3 / H).round() as usize {
                let belt = stiffness * (motor[0] - load[0]) + damping * (motor[1] - load[1]);
                load[1] += H * belt / half;
                load[0] += H * load[1];
                let force = machine.gain * input - machine.offset - belt;
                let slowed = 1.0 + H * machine.viscous_friction / half;
                let (free, friction) = (motor[1] + H * force / half, H * machine.coulomb_friction / half);
                motor[1] = free.signum() * (free.abs() - friction).max(0.0) / slowed;
                motor[0] += H * motor[1];
            }
            let rounded = (position / RESOLUTION).round() * RESOLUTION;
            (rounded, input + 0.05 * rng.normal())
        })
        .collect()
}

/// Usable masses, those of them more than 5 σ and more than 0.5 % off, and whether a resonance is
/// named at the end.
fn masses(machine: &ServoAxisOptions, hertz: f64, encoder: Encoder, seed: u64) -> (usize, usize, bool) {
    let axis = || ServoAxis::new(Motion::Linear, DriveInput::Voltage, machine.gain).unwrap();
    let rows = ProjectedOptions {
        window_s: 0.04,
        stride_s: 0.008,
        timing: InputTiming::Held,
        noise: SensorNoise {
            position_resolution: [RESOLUTION; MAX_JOINTS],
            input_noise: [0.05; MAX_JOINTS],
            ..SensorNoise::NONE
        },
        considered: Considered::default(),
        ..ProjectedOptions::recommended()
    };
    let mut options = EstimatorOptions::recommended(priors(&axis()), 1);
    options.forgetting = Forgetting::Exponential;
    options.forgetting_factor = 1.0;
    options.equations.fill(EquationNoise::LEARNT);
    options.drift_per_s = rows.considered.drift_per_s;
    options.change_detection = None;
    let mut block = ProjectedBlock::new(axis(), rows, N).unwrap();
    let mut estimator = BlockEstimator::new(structure(&axis()), options).unwrap();
    let truth = machine.mass.mass_kg(0.0);
    let (mut usable, mut dangerous, mut named) = (0, 0, false);
    for (k, (q, u)) in samples(machine, hertz, encoder, seed).into_iter().enumerate() {
        let mut sample = JointSample::default();
        (sample.q[0], sample.input[0]) = (q, u);
        assert!(block.push(k as u64 * 1_000_000, &sample));
        if k % N == N - 1 {
            block.prepare(estimator.theta());
            let report = estimator.update(&block);
            let off = (report.theta[0] - truth).abs();
            let is_usable = report.usable.contains(0);
            usable += usize::from(is_usable);
            dangerous += usize::from(is_usable && off > 5.0 * report.theta_std[0] && off > 0.005 * truth);
            named = report.suspicion.is_some_and(|s| {
                let suspect = block.suspect(s.suspect).unwrap();
                suspect.kind == SuspectKind::Resonance
            });
            block.clear();
        }
    }
    (usable, dangerous, named)
}

/// Whitened rows show a third of the resonance's amplitude here, because the belt rings: by them
/// alone, it is not named, and the mass stays usable at 30 Hz.
#[test]
fn ident_a_belt_is_found_on_either_side_of_its_encoder() {
    let machine = ServoAxisOptions::emps();
    for encoder in [Encoder::Motor, Encoder::Load] {
        for (hertz, seed) in [(30.0, 1), (40.0, 2)] {
            let (usable, dangerous, named) = masses(&machine, hertz, encoder, seed);
            println!("{encoder:?} {hertz} Hz: {usable} usable, {dangerous} dangerous, resonance named: {named}");
            assert!(dangerous == 0 && named, "{encoder:?} {hertz} Hz");
        }
    }
}

/// A coupling stiff enough: the mass stays usable, and nothing is confidently wrong.
#[test]
fn ident_a_stiff_coupling_costs_nothing() {
    let machine = ServoAxisOptions::emps();
    for encoder in [Encoder::Motor, Encoder::Load] {
        let (usable, dangerous, _) = masses(&machine, 150.0, encoder, 1);
        println!("{encoder:?}: {usable} usable, {dangerous} dangerous");
        assert!(dangerous == 0 && usable >= BLOCKS - 3, "{encoder:?}: {usable}");
    }
}
