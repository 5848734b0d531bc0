//! A robot whose friction has terms that the identified model leaves out: this is reported, and no
//! usable value is wrong.
//!
//! A block is *dangerous* if it may be used and holds a usable parameter, or a derived value of the
//! payload, that is off by more than 5 of its standard deviations and more than 0.5 %.

use super::{SIX_AXIS, SUBSTEPS, robot};
use crate::support::TestRng;
use FrictionTerm::{Coulomb, Offset, Viscous};
use nalgebra::{Rotation3, Vector3};
use thetabus::messages::{Estimate, Sample, State, signals};
use thetabus::model::JointSample;
use thetabus::node::identifier::IdentifierOptions;
use thetabus::node::robot::{RobotLearner, RobotNode};
use thetabus::robot::{
    Drives, FrictionTerm, IdentifyOptions, JointFriction, Motions, Robot, RobotIdentifier, RobotModel, RobotSimOptions,
    RobotSimulator, Velocities, WindowOptions,
};

/// Fourier series that begin anew every 20 s, and moves from posture to posture with rests.
const MOTIONS: [bool; 2] = [false, true];

/// Result of a run.
#[derive(Debug, Default)]
pub(super) struct Run {
    pub usable: usize,
    pub dangerous: usize,
    misfits: usize,
    /// Status at the last misfit.
    pub(super) words: String,
}

pub(super) fn simulation(has_rests: bool, seed: u64) -> RobotSimOptions {
    let mut options = RobotSimOptions {
        seed,
        machine_seed: seed,
        difference: 0.15,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot(SIX_AXIS))
    };
    if has_rests {
        options.motions = Motions::Moves { rest_s: 0.5 };
    }
    options
}

/// Identifies as the service does by default; `terms` are those of the model.
pub(super) fn run(terms: &[FrictionTerm], presliding: f64, simulation: RobotSimOptions, seconds: usize) -> Run {
    run_of(&robot(SIX_AXIS), terms, presliding, simulation, seconds)
}

/// The same on a machine that differs from the URDF.
fn run_of(
    machine: &Robot,
    terms: &[FrictionTerm],
    presliding: f64,
    simulation: RobotSimOptions,
    seconds: usize,
) -> Run {
    run_with(machine, terms, presliding, simulation, seconds, None)
}

/// Errors of measured velocities.
#[derive(Debug, Clone, Copy)]
pub(super) struct VelocityErrors {
    /// Standard deviation of white noise \[rad/s\].
    pub noise: f64,
    /// Time constant of a filter of first order \[s\].
    pub filter_s: f64,
    /// True if they are differences of the positions.
    pub differs: bool,
}

/// The same; `velocities` are measured with these errors if not `None`, otherwise formed from
/// positions.
pub(super) fn run_with(
    machine: &Robot,
    terms: &[FrictionTerm],
    presliding: f64,
    simulation: RobotSimOptions,
    seconds: usize,
    velocities: Option<VelocityErrors>,
) -> Run {
    let friction = JointFriction {
        terms: terms.to_vec(),
        presliding,
        ..JointFriction::default()
    };
    run_with_friction(machine, friction, simulation, seconds, velocities)
}

/// The same with this friction of each joint in the model.
fn run_with_friction(
    machine: &Robot,
    friction: JointFriction,
    simulation: RobotSimOptions,
    seconds: usize,
    velocities: Option<VelocityErrors>,
) -> Run {
    run_disturbed(machine, friction, simulation, seconds, velocities, &|_| {})
}

/// The same with samples that `disturb` changes.
fn run_disturbed(
    machine: &Robot,
    friction: JointFriction,
    mut simulation: RobotSimOptions,
    seconds: usize,
    velocities: Option<VelocityErrors>,
    disturb: &dyn Fn(&mut JointSample),
) -> Run {
    let robot = robot(SIX_AXIS);
    let model = RobotModel::new(robot, true, vec![friction; 6]).unwrap();
    let options = IdentifyOptions {
        windows: WindowOptions::for_period(1e-3),
        lengthens: true,
        formed_over_s: velocities.is_none().then_some(0.02),
        payload: true,
        ..IdentifyOptions::default()
    };
    let identifier = RobotIdentifier::new(model, options).unwrap();
    simulation.has_velocity = velocities.is_some();
    let mut random = TestRng(simulation.seed + 1);
    let simulator = RobotSimulator::new(machine, simulation).unwrap();
    let truth = simulator.truth(identifier.model(), 0.0);
    let mask = signals::Q | signals::INPUT | if velocities.is_some() { signals::DQ } else { 0 };
    let options = IdentifierOptions {
        sample_period_ns: 1_000_000,
        ..IdentifierOptions::new(1000, 6, mask)
    };
    let former = velocities.is_none().then(|| Velocities::new(20, 0.02));
    let learner = RobotLearner::new(Drives::torque(6), identifier, former);
    let mut node = RobotNode::new(options, learner, 1);
    let mut run = Run::default();
    let (mut filtered, mut q) = (None, None);
    for (seq, mut joints) in (0..).zip(simulator.take(1000 * seconds)) {
        if let Some(VelocityErrors {
            noise,
            filter_s,
            differs,
        }) = velocities
        {
            let q = q.get_or_insert(joints.q);
            for (i, q) in q.iter_mut().enumerate().filter(|_| differs) {
                joints.dq[i] = (joints.q[i] - *q) / 1e-3;
                *q = joints.q[i];
            }
            let followed = 1e-3 / filter_s.max(1e-3);
            let filtered = filtered.get_or_insert(joints.dq);
            for (filtered, dq) in filtered.iter_mut().zip(&mut joints.dq).take(6) {
                *filtered += followed * (*dq - *filtered);
                *dq = *filtered + noise * random.normal();
            }
        }
        disturb(&mut joints);
        let sample = Sample::new(1, seq, seq * 1_000_000, 6, mask, &joints);
        let mut closed: Option<Estimate> = None;
        node.on_sample(&sample, &mut |estimate| closed = Some(*estimate));
        let Some(estimate) = closed else { continue };
        if estimate.state == State::Misfit as u32 {
            run.misfits += 1;
            run.words = node.status().error.words().to_owned();
        }
        if estimate.use_ok == 1 {
            run.usable += 1;
            // Nothing is carried: a derived value that is not 0 is wrong altogether.
            let derived = estimate.derived[..estimate.derived_len as usize].iter();
            let weighs = derived.zip(&estimate.derived_std).any(|(x, std)| x.abs() > 5.0 * std);
            let is_wrong = |i: usize| {
                let error = (estimate.theta[i] - truth[i]).abs();
                error > 5.0 * estimate.theta_std[i] && error > 0.005 * truth[i].abs()
            };
            run.dangerous += usize::from(weighs || estimate.usable.iter().any(is_wrong));
        }
    }
    run
}

/// The term `reversal` describes a small excess of the travel only.
#[test]
fn fault_reversals_that_take_far_longer_are_named() {
    let all = JointFriction::default();
    // moves with rests and nine times the travel look like a change that never becomes clear
    for (has_rests, times) in [(false, 5.0), (false, 9.0), (true, 5.0)] {
        let mut simulation = simulation(has_rests, 3);
        simulation.presliding = times * all.presliding;
        let run = run(&all.terms, all.presliding, simulation, 40);
        println!("rests {has_rests}, {times} times: {run:?}");
        assert!(run.dangerous == 0 && run.misfits > 0, "{run:?}");
        // "reversals of joint 5 take some 7 times its presliding: state about 1e-3"
        let mut words = run
            .words
            .split(' ')
            .skip_while(|word| !matches!(*word, "some" | "over"));
        let told: f64 = words.nth(1).expect("the travel").parse().expect("a number");
        // a factor of two: the travel is estimated by a term that is linear in it
        assert!((0.5..=2.0).contains(&(told / times)), "{run:?}");
        assert!(run.words.contains("times its presliding"), "{run:?}");
    }
}

/// Without the test of `left_out.rs` 113 of 114 blocks of these runs that may be used are dangerous.
/// On the motion of seed 2 without rests the watch takes the misfit for changes of friction in each
/// block: nothing may be used, and nothing is named.
#[test]
fn fault_viscous_friction_that_the_model_leaves_out_is_named() {
    for (has_rests, seed) in [(false, 1), (false, 3), (true, 2), (true, 3)] {
        let run = run(&[Coulomb], 1e-4, simulation(has_rests, seed), 75);
        println!("rests {has_rests}, seed {seed}: {run:?}");
        assert_eq!(run.dangerous, 0);
        assert!(run.misfits > 50, "{}", run.misfits);
        let said = run.words.strip_prefix("viscous friction at joint ").unwrap_or_default();
        assert!(said.contains("which the model leaves out"), "{}", run.words);
    }
}

/// A hose pack at each joint, of 0.5 to 2 % of the largest torque per radian, looks like the links'
/// weight.
#[test]
fn fault_a_spring_that_the_model_leaves_out_makes_nothing_surely_wrong() {
    for (has_rests, seed, share) in [(false, 1, 0.02), (true, 2, 0.02), (false, 3, 0.005)] {
        let mut simulation = simulation(has_rests, seed);
        let efforts = robot(SIX_AXIS).joints.into_iter().map(|joint| joint.limits.effort);
        for (drive, effort) in simulation.drives.iter_mut().zip(efforts) {
            drive.spring = share * effort.expect("stated");
        }
        let terms = JointFriction::default().terms;
        let run_without = run(&terms, 1e-4, simulation.clone(), 75);
        println!("rests {has_rests}, seed {seed}: {run_without:?}");
        assert_eq!(run_without.dangerous, 0, "{run_without:?}");
        if share > 0.01 {
            assert!(run_without.words.contains("spring"), "{}", run_without.words);
            let run_with = run(&[&terms[..], &[FrictionTerm::Spring]].concat(), 1e-4, simulation, 75);
            assert!(run_with.dangerous == 0 && run_with.usable > 30, "{run_with:?}");
        }
    }
}

/// Drag of 1 to 3 % of the largest torque at the largest speed, and viscous friction that differs by
/// 2 % of it between the directions.
#[test]
fn fault_drag_and_asymmetric_friction_that_the_model_leaves_out_make_nothing_surely_wrong() {
    let cases = [
        (false, 1, 0.03, 0.0),
        (true, 2, 0.03, 0.0),
        (false, 3, 0.01, 0.0),
        (false, 1, 0.0, 0.02),
        (true, 2, 0.0, 0.02),
        (false, 3, 0.0, 0.005),
    ];
    for (has_rests, seed, drag, asymmetric) in cases {
        let mut simulation = simulation(has_rests, seed);
        for (drive, joint) in simulation.drives.iter_mut().zip(robot(SIX_AXIS).joints) {
            let effort = joint.limits.effort.expect("stated");
            let speed = joint.limits.velocity.expect("stated");
            (drive.drag, drive.asymmetric) = (drag * effort / speed.powi(2), asymmetric * effort / speed);
        }
        let terms = JointFriction::default().terms;
        let without = run(&terms, 1e-4, simulation.clone(), 75);
        println!("rests {has_rests}, seed {seed}, {drag}, {asymmetric}: {without:?}");
        let with = run(
            &[&terms[..], &[FrictionTerm::Drag, FrictionTerm::Asymmetric]].concat(),
            1e-4,
            simulation,
            75,
        );
        println!("modelled: {with:?}");
        assert_eq!(without.dangerous, 0, "{without:?}");
        assert!(with.dangerous == 0 && with.usable > 30, "{with:?}");
    }
}

/// The machine's Stribeck friction, a tenth of Coulomb friction, falls over twice the model's speed.
#[test]
fn fault_another_stribeck_speed_makes_nothing_surely_wrong() {
    for (has_rests, seed) in [(false, 1), (true, 2)] {
        let mut simulation = simulation(has_rests, seed);
        for drive in &mut simulation.drives {
            drive.stribeck = 0.1 * drive.coulomb;
        }
        let friction = JointFriction {
            presliding: 1e-4,
            stribeck_speed: 0.05,
            ..JointFriction::default()
        };
        let run = run_with_friction(&robot(SIX_AXIS), friction, simulation, 75, None);
        println!("rests {has_rests}, seed {seed}: {run:?}");
        assert!(run.dangerous == 0 && run.usable > 30, "{run:?}");
    }
}

/// Cogging torques with six periods a turn, of 5 % of Coulomb friction, and friction that grows by
/// 15 % of the torque. Without `block_scatter.rs` the first case has a dangerous block.
#[test]
fn fault_cogging_and_friction_that_grows_with_the_load_make_nothing_surely_wrong() {
    let cases = [
        (false, 1, 0.05, 0.0),
        (true, 2, 0.05, 0.0),
        (false, 2, 0.0, 0.15),
        (true, 1, 0.0, 0.15),
    ];
    for (has_rests, seed, cogging, by_load) in cases {
        let simulation = simulation(has_rests, seed);
        let friction = JointFriction {
            presliding: 1e-4,
            ..JointFriction::default()
        };
        let coulomb: Vec<f64> = simulation.drives.iter().map(|drive| drive.coulomb).collect();
        let disturb = |joints: &mut JointSample| {
            for (i, coulomb) in coulomb.iter().enumerate() {
                let load = joints.input[i].abs() * (joints.dq[i] / 0.005).tanh();
                joints.input[i] += cogging * coulomb * (6.0 * joints.q[i] + 0.3).sin() + by_load * load;
            }
        };
        let run = run_disturbed(&robot(SIX_AXIS), friction, simulation, 75, None, &disturb);
        println!("rests {has_rests}, seed {seed}, cogging {cogging}, by load {by_load}: {run:?}");
        assert!(run.dangerous == 0 && run.usable > 30, "{run:?}");
    }
}

/// The machine with its base tilted about x and y \[degrees\].
fn tilted(about: [f64; 2]) -> Robot {
    let mut machine = robot(SIX_AXIS);
    let turn = Rotation3::new(Vector3::new(about[0].to_radians(), about[1].to_radians(), 0.0));
    machine.gravity = turn * machine.gravity;
    machine
}

/// Of a degree and more; that of half a degree may pass, standard deviations allow for it. A spring
/// at a joint whose axis is upright looks like a tilt in short motion.
#[test]
fn fault_a_tilted_base_is_named_or_does_no_harm() {
    let cases = [
        (false, 3, [1.0, 0.0], true),
        (true, 1, [1.0, 0.0], true),
        (false, 2, [0.0, 3.0], true),
        (true, 2, [-4.0, 2.0], true),
        (true, 1, [0.5, 0.0], false),
    ];
    for (has_rests, seed, about, is_named) in cases {
        let terms = JointFriction::default().terms;
        let run = run_of(&tilted(about), &terms, 1e-4, simulation(has_rests, seed), 60);
        println!("rests {has_rests}, seed {seed}, {about:?} degrees: {run:?}");
        assert_eq!(run.dangerous, 0);
        if is_named {
            assert!(
                run.misfits > 40 && run.words.starts_with("a tilted base"),
                "{}",
                run.words
            );
        } else {
            assert!(run.usable > 40, "{}", run.usable);
        }
    }
}

#[test]
fn prop_a_model_with_the_terms_that_the_machine_has_is_no_misfit() {
    for (has_rests, seed) in [(false, 1), (true, 2)] {
        let run = run(&[Coulomb, Viscous], 1e-4, simulation(has_rests, seed), 75);
        println!("rests {has_rests}, seed {seed}: {run:?}");
        // a block may not fit by chance of noise; no term is named
        assert!(
            run.dangerous == 0 && run.misfits <= 1 && run.words.is_empty(),
            "{run:?}"
        );
        assert!(run.usable > 60, "{}", run.usable);
    }
}

#[test]
fn fault_each_other_term_that_is_left_out_is_named_or_does_no_harm() {
    let mut with_offset = simulation(false, 1);
    let mut with_stribeck = simulation(true, 1);
    for drive in &mut with_offset.drives {
        drive.offset = 0.3 * drive.coulomb;
    }
    for drive in &mut with_stribeck.drives {
        drive.stribeck = 0.5 * drive.coulomb;
    }
    let cases: [(&[FrictionTerm], f64, RobotSimOptions, &str); 4] = [
        (&[Viscous], 1e-4, simulation(false, 1), "Coulomb friction at joint "),
        (
            &[Coulomb, Viscous],
            1e-4,
            with_offset,
            "a constant torque (offset) at joint ",
        ),
        (
            &[Coulomb, Viscous, Offset],
            1e-4,
            with_stribeck,
            "", // reversals hardly differ from slow motion in such moves: either may be named
        ),
        (&[Coulomb, Viscous], 3e-4, simulation(false, 1), ""),
    ];
    for (terms, presliding, simulation, words) in cases {
        let run = run(terms, presliding, simulation, 40);
        println!("{terms:?}: {run:?}");
        assert_eq!(run.dangerous, 0);
        assert!(run.words.starts_with(words), "{}", run.words);
    }
}

/// What is left over many seeds; `THETABUS_SEEDS` says how many.
#[test]
#[ignore = "minutes; prints a table"]
fn study_of_dangerous_blocks() {
    let seeds = std::env::var("THETABUS_SEEDS").map_or(4, |seeds| seeds.parse().unwrap());
    let only = std::env::var("THETABUS_CASE").ok();
    type Machine<'a> = &'a dyn Fn(&mut RobotSimOptions);
    let as_it_is = |_: &mut RobotSimOptions| {};
    let dry = |o: &mut RobotSimOptions| o.drives.iter_mut().for_each(|d| d.viscous = 0.0);
    let biased = |o: &mut RobotSimOptions| o.drives.iter_mut().for_each(|d| d.offset = 0.3 * d.coulomb);
    let sticky = |o: &mut RobotSimOptions| o.drives.iter_mut().for_each(|d| d.stribeck = 0.5 * d.coulomb);
    let all = JointFriction::default().terms;
    let cases: [(&str, &[FrictionTerm], f64, Machine); 11] = [
        ("coulomb | viscous, coulomb", &[Coulomb], 1e-4, &as_it_is),
        (
            "coulomb | viscous, coulomb, twice presliding",
            &[Coulomb],
            2e-4,
            &as_it_is,
        ),
        ("viscous | viscous, coulomb", &[Viscous], 1e-4, &as_it_is),
        ("viscous | coulomb", &[Viscous], 1e-4, &dry),
        ("coulomb, viscous | offset, too", &[Coulomb, Viscous], 1e-4, &biased),
        ("coulomb, viscous | Stribeck, too", &[Coulomb, Viscous], 1e-4, &sticky),
        (
            "coulomb, viscous | twice presliding",
            &[Coulomb, Viscous],
            2e-4,
            &as_it_is,
        ),
        ("coulomb, viscous | the same", &[Coulomb, Viscous], 1e-4, &as_it_is),
        (
            "coulomb, viscous, offset | the same",
            &[Coulomb, Viscous, Offset],
            1e-4,
            &biased,
        ),
        (
            "coulomb, viscous, offset | twice presliding",
            &[Coulomb, Viscous, Offset],
            2e-4,
            &as_it_is,
        ),
        ("all | Stribeck, too", &all, 1e-4, &sticky),
    ];
    for (name, terms, presliding, machine) in cases {
        if only.as_ref().is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        for has_rests in MOTIONS {
            for seed in 1..=seeds {
                let mut simulation = simulation(has_rests, seed);
                machine(&mut simulation);
                println!(
                    "{name}, rests {has_rests}, seed {seed}: {:?}",
                    run(terms, presliding, simulation, 75)
                );
            }
        }
    }
}
