//! A robot whose friction has terms that the identified model leaves out: said, not wrong.

use super::{SIX_AXIS, robot};
use thetabus::messages::{Estimate, Sample, State, signals};
use thetabus::node::identifier::IdentifierOptions;
use thetabus::node::robot::{RobotLearner, RobotNode};
use thetabus::robot::{
    Drives, FrictionTerm, IdentifyOptions, JointFriction, Motions, RobotIdentifier, RobotModel, RobotSimOptions,
    RobotSimulator, Velocities, WindowOptions,
};

const SECONDS: usize = 100;

struct Seen {
    ok: usize,
    dangerous: usize,
    misfits: usize,
    first_misfit: u64,
    worst: f64,
    worst_name: String,
    words: String,
}

fn seen(
    terms: &[FrictionTerm],
    moves: bool,
    seed: u64,
    presliding: f64,
    change: impl Fn(&mut RobotSimOptions),
) -> Seen {
    let robot = robot(SIX_AXIS);
    let friction = JointFriction {
        terms: terms.to_vec(),
        presliding,
        ..JointFriction::default()
    };
    let model = RobotModel::new(robot.clone(), true, vec![friction; 6]).unwrap();
    let options = IdentifyOptions {
        windows: WindowOptions {
            length_s: 0.1,
            stride_s: 0.02,
            max_gap_s: 0.02,
            ..WindowOptions::default()
        },
        payload: true,
        ..IdentifyOptions::default()
    };
    let identifier = RobotIdentifier::new(model, options).unwrap();
    let mut simulation = RobotSimOptions {
        seed,
        machine_seed: seed,
        difference: 0.15,
        ..RobotSimOptions::new(&robot)
    };
    if moves {
        simulation.motions = Motions::Moves { rest_s: 0.5 };
    }
    change(&mut simulation);
    let simulator = RobotSimulator::new(&robot, simulation).unwrap();
    let truth = simulator.truth(identifier.model(), 0.0);
    let mut node = RobotNode::new(
        IdentifierOptions {
            sample_period_ns: 1_000_000,
            ..IdentifierOptions::new(1000, 6, signals::Q | signals::INPUT)
        },
        RobotLearner::new(Drives::torque(6), identifier, Some(Velocities::new(20, 0.02))),
        1,
    );
    let mut seen = Seen {
        ok: 0,
        dangerous: 0,
        misfits: 0,
        first_misfit: 0,
        worst: 0.0,
        worst_name: String::new(),
        words: String::new(),
    };
    let names: Vec<String> = node
        .learner()
        .robot()
        .parameters()
        .iter()
        .map(|p| p.name.clone())
        .collect();
    for (seq, joints) in simulator.take(1000 * SECONDS).enumerate() {
        let seq = seq as u64;
        let sample = Sample::new(1, seq, seq * 1_000_000, 6, signals::Q | signals::INPUT, &joints);
        let mut estimates: Vec<Estimate> = Vec::new();
        node.on_sample(&sample, &mut |estimate| estimates.push(*estimate));
        for estimate in estimates {
            if std::env::var("TRACE").is_ok() {
                println!(
                    "{} state {} {:?}",
                    estimate.block,
                    estimate.state,
                    node.learner().robot().left_out_friction()
                );
            }
            if estimate.state == State::Misfit as u32 {
                seen.misfits += 1;
                if seen.first_misfit == 0 {
                    seen.first_misfit = estimate.block;
                }
                seen.words = node.status().error.words().to_owned();
            }
            if estimate.use_ok == 0 {
                continue;
            }
            seen.ok += 1;
            let mut dangerous = false;
            for i in estimate.usable.iter() {
                let error = (estimate.theta[i] - truth[i]).abs();
                let sigmas = error / estimate.theta_std[i];
                if error > 0.005 * truth[i].abs() && sigmas > 5.0 {
                    dangerous = true;
                }
                if error > 0.005 * truth[i].abs() && sigmas > seen.worst {
                    seen.worst = sigmas;
                    seen.worst_name = names[i].clone();
                }
            }
            seen.dangerous += usize::from(dangerous);
        }
    }
    seen
}

#[test]
fn report_left_out() {
    use FrictionTerm::{Coulomb, Offset, Viscous};
    let none = |_: &mut RobotSimOptions| {};
    let offset = |o: &mut RobotSimOptions| o.drives.iter_mut().for_each(|d| d.offset = 0.3 * d.coulomb);
    let no_viscous = |o: &mut RobotSimOptions| o.drives.iter_mut().for_each(|d| d.viscous = 0.0);
    type Change<'a> = &'a dyn Fn(&mut RobotSimOptions);
    let cases: [(&str, &[FrictionTerm], f64, Change); 8] = [
        ("C on V+C", &[Coulomb], 1e-4, &none),
        ("C on V+C, presliding x2", &[Coulomb], 2e-4, &none),
        ("C+V on V+C", &[Coulomb, Viscous], 1e-4, &none),
        ("C+V on V+C, presliding x2", &[Coulomb, Viscous], 2e-4, &none),
        ("V on V+C", &[Viscous], 1e-4, &none),
        ("V on C", &[Viscous], 1e-4, &no_viscous),
        ("C+V on V+C+O", &[Coulomb, Viscous], 1e-4, &offset),
        ("C+V+O on V+C+O", &[Coulomb, Viscous, Offset], 1e-4, &offset),
    ];
    for (k, (name, terms, presliding, change)) in cases.iter().enumerate() {
        if let Ok(only) = std::env::var("CASES")
            && !only.split(',').any(|x| x == k.to_string())
        {
            continue;
        }
        for moves in [false, true] {
            for seed in 1..=std::env::var("SEEDS").map_or(2, |x| x.parse().unwrap()) {
                let s = seen(terms, moves, seed, *presliding, change);
                println!(
                    "{name:26} moves {moves} seed {seed}: ok {:3} dangerous {:3} misfits {:3} from {:3} worst {:.1} {} {}",
                    s.ok, s.dangerous, s.misfits, s.first_misfit, s.worst, s.worst_name, s.words
                );
            }
        }
    }
}
