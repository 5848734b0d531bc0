//! Your robot from its URDF and a log: base parameters with standard deviations, and how well the
//! torques are predicted.
//!
//! ```text
//! cargo run --release --example robot_from_urdf -- \
//!     arm.urdf train.csv [validate.csv] [--gain 14.87,13.26,…] [--tip LINK]
//! ```
//!
//! Columns of the logs are t, then q, q̇ and the drives' currents or torques of each joint, in SI
//! units.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use thetabus::robot::{
    Drives, IdentifyOptions, JointFriction, LogColumns, Robot, RobotIdentifier, RobotModel, RobotSample, Selection,
    TorqueFit, filtered, read_log,
};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let (mut files, mut gain, mut selection) = (Vec::new(), None, Selection::default());
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg}: expected a value, got nothing"));
        match arg.as_str() {
            "--gain" => gain = Some(numbers(&value()?)?),
            "--tip" => selection.tip = Some(value()?),
            _ => files.push(arg),
        }
    }
    let [urdf, train, rest @ ..] = &files[..] else {
        return Err("expected a URDF and a log: robot_from_urdf arm.urdf train.csv [validate.csv]".into());
    };
    let robot = Robot::from_file(Path::new(urdf), &selection)?;
    let n = robot.len();
    let columns = LogColumns::in_order(n, true);
    let drives = Drives {
        gain: gain.unwrap_or_else(|| vec![1.0; n]),
        coupling: None,
    };
    let read = |path: &str| -> Result<Vec<RobotSample>, String> {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
        let log = read_log(&text, &columns, &drives).map_err(|e| format!("{path}: {e}"))?;
        if log.skipped.count() > 0 {
            eprintln!("{path}: {}", log.skipped);
        }
        Ok(log.samples)
    };
    let log = read(train)?;
    let validation = rest.first().map(|path| read(path)).transpose()?;

    let model = RobotModel::new(robot, true, vec![JointFriction::default(); n])?;
    let mut identifier = RobotIdentifier::new(model, IdentifyOptions::default())?;
    for (line, sample) in log.iter().enumerate() {
        identifier
            .push(sample)
            .map_err(|e| format!("sample {}: {e}", line + 1))?;
    }
    identifier.end_of_recording();

    println!("| parameter | estimate | standard deviation | URDF | unit | meaning |\n|---|---|---|---|---|---|");
    let model = identifier.model();
    for (i, parameter) in model.parameters().iter().enumerate() {
        let (estimate, std) = (identifier.theta()[i], identifier.theta_std(i));
        let (name, unit, meaning) = (&parameter.name, parameter.unit, &parameter.meaning);
        println!(
            "| {name} | {estimate:.4} | {std:.4} | {:.4} | {unit} | {meaning} |",
            parameter.nominal
        );
    }
    println!(
        "\n| joint | fit [%] | relative residual [%] |{}",
        if validation.is_some() { " validation [%] |" } else { "" }
    );
    println!("|---|---|---|{}", if validation.is_some() { "---|" } else { "" });
    let of = |log: &[RobotSample]| TorqueFit::of(model, identifier.theta(), &filtered(model, log));
    let (train, validation) = (of(&log), validation.map(|log| of(&log)));
    let percent = |value: Option<f64>| value.map_or("-".to_owned(), |x| format!("{x:.1}"));
    for (joint, description) in model.robot().joints.iter().enumerate() {
        let held_out = validation.as_ref().map_or(String::new(), |fit| {
            format!(" {} |", percent(fit.relative_residual(joint)))
        });
        let [fit, residual] = [train.fit(joint), train.relative_residual(joint)].map(percent);
        println!("| {} | {fit} | {residual} |{held_out}", description.name);
    }
    Ok(())
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(|word| {
            word.trim()
                .parse()
                .map_err(|_| format!("--gain: expected numbers, got \"{word}\""))
        })
        .collect()
}
