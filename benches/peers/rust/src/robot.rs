//! A six-axis robot from a log of positions, velocities and torques: the logs for all programs, and
//! thetabus on them.
//!
//! `robot_train.csv` is what a drive reports over 40 s, `robot_judge.csv` another motion, low-pass
//! filtered and differentiated once for all: how well the parameters of the first predict the
//! torques of the second is the accuracy.

use crate::Failure;
use crate::report::{fastest, line, write};
use std::path::Path;
use thetabus::model::MAX_JOINTS;
use thetabus::robot::{
    FilteredSample, IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions,
    RobotSimulator, Selection, TorqueFit, filtered,
};

const COUNT: usize = 40_000;
const URDF: &str = include_str!("../../../../config/robots/six_axis.urdf");

/// A motion of one and the same machine, whose bodies differ from the URDF.
fn log(robot: &Robot, seed: u64) -> Result<Vec<RobotSample>, Failure> {
    let options = RobotSimOptions {
        seed,
        has_velocity: true,
        ..RobotSimOptions::new(robot)
    };
    let period = options.sample_period_s;
    let samples = RobotSimulator::new(robot, options)?.take(COUNT).enumerate();
    Ok(samples
        .map(|(k, sample)| {
            let mut out = RobotSample {
                t_s: k as f64 * period,
                ..RobotSample::default()
            };
            for joint in 0..MAX_JOINTS.min(robot.len()) {
                out.q[joint] = sample.q[joint];
                out.dq[joint] = sample.dq[joint];
                out.tau[joint] = sample.input[joint];
            }
            out
        })
        .collect())
}

/// Writes the logs and prints the line of thetabus: worst and median relative residual of the torques
/// over the joints.
pub fn run(folder: &Path) -> Result<(), Failure> {
    let robot = Robot::from_urdf(URDF, &Selection::default())?;
    let n = robot.len();
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); n])?;
    let (train, judge) = (log(model.robot(), 1)?, log(model.robot(), 2)?);
    let judge: Vec<FilteredSample> = filtered(&model, &judge);
    let head = |names: &[&str]| {
        let columns = names
            .iter()
            .flat_map(|name| (1..=n).map(move |i| format!("{name}_{i}")));
        columns.collect::<Vec<_>>().join(",")
    };
    std::fs::write(folder.join("robot.urdf"), URDF)?;
    write(
        folder,
        "robot_train.csv",
        &head(&["q", "dq", "tau"]),
        train.iter().map(|s| [&s.q[..n], &s.dq[..n], &s.tau[..n]].concat()),
    )?;
    write(
        folder,
        "robot_judge.csv",
        &head(&["q", "dq", "ddq", "tau"]),
        judge
            .iter()
            .map(|s| [&s.q[..n], &s.dq[..n], &s.ddq[..n], &s.tau[..n]].concat()),
    )?;
    let fresh = RobotIdentifier::new(model, IdentifyOptions::default())?;
    let (seconds, identifier) = fastest(|| {
        let mut identifier = fresh.clone();
        for sample in &train {
            let _ = identifier.push(sample);
        }
        identifier.end_of_recording();
        identifier
    });
    let fit = TorqueFit::of(identifier.model(), identifier.theta(), &judge);
    let residuals = (0..n).map(|joint| fit.relative_residual(joint).unwrap_or(f64::NAN) / 100.0);
    line(
        "robot",
        "thetabus, RobotIdentifier (on line)",
        COUNT,
        seconds,
        residuals.collect(),
    );
    Ok(())
}
