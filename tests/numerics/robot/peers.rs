//! Random robots of 1 to 8 joints of all kinds against another rigid-body library, PyPI `pin`.

use crate::support::TestRng;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use thetabus::robot::{BaseParameters, EnergyRegressors, Robot, Selection, inverse_dynamics};

/// Three numbers for an attribute.
fn vector(rng: &mut TestRng, limit: f64) -> String {
    let [x, y, z] = [(); 3].map(|()| rng.between(-limit, limit));
    format!("{x} {y} {z}")
}

fn inertial(rng: &mut TestRng) -> String {
    // A Aᵀ of a random A is positive definite; its multiple of the unit matrix makes it that of a
    // body.
    let a: [f64; 9] = std::array::from_fn(|_| rng.between(-0.2, 0.2));
    let entry =
        |i: usize, j: usize| (0..3).map(|k| a[3 * i + k] * a[3 * j + k]).sum::<f64>() + if i == j { 0.1 } else { 0.0 };
    format!(
        r#"<inertial><origin xyz="{}" rpy="{}"/><mass value="{}"/><inertia ixx="{}" ixy="{}" ixz="{}" iyy="{}" iyz="{}" izz="{}"/></inertial>"#,
        vector(rng, 0.3),
        vector(rng, 1.0),
        rng.between(0.1, 10.0),
        entry(0, 0),
        entry(0, 1),
        entry(0, 2),
        entry(1, 1),
        entry(1, 2),
        entry(2, 2),
    )
}

/// A tree of `joints` moving joints, some with branches, with fixed links in between; its text and
/// the names of the moving joints.
fn random_urdf(rng: &mut TestRng, joints: usize) -> (String, Vec<String>) {
    let mut text = String::from("<robot name=\"random\"><link name=\"l0\"/>");
    let (mut links, mut names) = (1, Vec::new());
    let mut last = "l0".to_owned();
    while names.len() < joints {
        let fixed = rng.bits().is_multiple_of(3);
        let kind = match rng.bits() % 3 {
            _ if fixed => "fixed",
            0 => "prismatic",
            1 => "continuous",
            _ => "revolute",
        };
        let axis: [f64; 3] = std::array::from_fn(|_| rng.between(-1.0, 1.0));
        let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = axis.map(|x| x / length);
        let parent = match rng.bits() % 4 {
            0 => format!("l{}", rng.bits() % links),
            _ => last.clone(),
        };
        last = format!("l{links}");
        let (body, origin, turn) = (inertial(rng), vector(rng, 0.5), vector(rng, 3.0));
        let _ = write!(
            text,
            r#"<link name="{last}">{body}</link><joint name="j{links}" type="{kind}"><parent link="{parent}"/><child link="{last}"/>
            <origin xyz="{origin}" rpy="{turn}"/><axis xyz="{x} {y} {z}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>"#
        );
        if !fixed {
            names.push(format!("j{links}"));
        }
        links += 1;
    }
    (text + "</robot>", names)
}

fn rows(robot: &Robot, rng: &mut TestRng, states: usize) -> String {
    let n = robot.len();
    let base = BaseParameters::of(robot, false);
    // By base parameters alone: what they leave out must not matter.
    let mut reduced = robot.clone();
    reduced.bodies.iter_mut().for_each(|body| body.0 = [0.0; 10]);
    for (parameter, value) in base.parameters.iter().zip(base.nominal(robot, &vec![0.0; n])) {
        if let thetabus::robot::Standard::Body { joint, parameter } = parameter.leading {
            reduced.bodies[joint].0[parameter] = value;
        }
    }
    let mut regressors = EnergyRegressors::new(n);
    let mut text = String::new();
    for _ in 0..states {
        let [q, dq, ddq] =
            [3.0, 2.0, 5.0].map(|limit| (0..n).map(|_| rng.between(-limit, limit)).collect::<Vec<f64>>());
        let (mut tau, mut by_base) = (vec![0.0; n], vec![0.0; n]);
        inverse_dynamics(robot, &robot.bodies, &q, &dq, &ddq, &mut tau);
        inverse_dynamics(&reduced, &reduced.bodies, &q, &dq, &ddq, &mut by_base);
        let largest = tau.iter().fold(0.0_f64, |a, t| a.max(t.abs()));
        for i in 0..n {
            assert!(
                (tau[i] - by_base[i]).abs() < 1e-8 * largest,
                "{} {}",
                tau[i],
                by_base[i]
            );
        }
        let with_bodies = |row: &[f64]| -> f64 {
            let parameters = robot.bodies.iter().flat_map(|body| body.0);
            row.iter().zip(parameters).map(|(y, p)| y * p).sum()
        };
        regressors.evaluate(robot, &q, &dq);
        let p: Vec<f64> = (0..n).map(|i| with_bodies(regressors.momentum(i))).collect();
        let moving: Vec<f64> = (0..n).map(|i| with_bodies(regressors.lagrangian(i))).collect();
        regressors.evaluate(robot, &q, &vec![0.0; n]);
        let gravity: Vec<f64> = (0..n).map(|i| -with_bodies(regressors.lagrangian(i))).collect();
        let rate: Vec<f64> = moving.iter().zip(&gravity).map(|(l, g)| l + g).collect();
        let all = [q, dq, ddq, tau, p, rate, gravity].concat();
        let fields: Vec<String> = all.iter().map(|x| format!("{x:e}")).collect();
        text += &(fields.join(",") + "\n");
    }
    text
}

/// The Python that has the package, or `None` with a message; a gate that requires it fails
/// instead.
fn python() -> Option<String> {
    let named = std::env::var("THETABUS_PEERS_PYTHON").ok();
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/ci-venv/bin/python");
    let candidates = [
        named,
        Some(ours.to_string_lossy().into_owned()),
        Some("python3".to_owned()),
    ];
    let found = candidates.into_iter().flatten().find(|python| {
        let done = Command::new(python).args(["-c", "import numpy, pinocchio"]).output();
        done.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        let why = "no Python with the packages numpy and pin (set THETABUS_PEERS_PYTHON)";
        assert!(std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"), "{why}");
        println!("skipped: {why}");
    }
    found
}

#[test]
fn val_random_robots_of_1_to_8_joints_move_as_in_pinocchio() {
    let mut rng = TestRng(8);
    let dir = tempfile::tempdir().unwrap();
    let mut states = 0;
    for robot in 0..40 {
        let (text, names) = random_urdf(&mut rng, 1 + robot % 8);
        let selection = Selection {
            joints: Some(names.clone()),
            ..Selection::default()
        };
        let numbers = rows(&Robot::from_urdf(&text, &selection).unwrap(), &mut rng, 5);
        states += 5;
        let file = |kind: &str| dir.path().join(format!("{robot}.{kind}"));
        for (kind, content) in [("urdf", text), ("names", names.join(" ")), ("csv", numbers)] {
            std::fs::write(file(kind), content).unwrap();
        }
    }
    let Some(python) = python() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/robot_dynamics.py");
    let output = Command::new(python).arg(script).arg(dir.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let numbers: Vec<f64> = String::from_utf8_lossy(&output.stdout)
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    println!("states and largest relative differences of torque, momentum, dT/dq, gravity: {numbers:?}");
    assert_eq!(numbers[0], f64::from(states));
    assert!(numbers[1..].iter().all(|x| *x < 1e-10), "{numbers:?}");
}
