//! `thetabus excite ROBOT.toml`: designs an informative motion for a robot; `thetabus config check
//! ROBOT.toml --motion FILE` evaluates a given one.

use super::new_file::{refuse_existing, write_new};
use super::robot::robot_text;
use super::robot_file::robot_with;
use super::{ExciteArgs, Exit, Failure, TableFormat, logging};
use crate::config::RobotConfig;
use crate::pipe::{MAX_TABLE_BYTES, read_text};
use crate::robot::{Excitation, ExcitationOptions, Forecaster, MotionTable, ParameterForecast, RowMisfit, read_motion};
use crate::runner::Shutdown;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Designs a motion and reports its expected information.
///
/// # Errors
/// If the configuration or options are wrong, or the file exists or cannot be written.
pub fn run(args: &ExciteArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let config = robot_with(&args.config, &args.set)?;
    let options = ExcitationOptions {
        duration_s: args.duration.unwrap_or(config.excitation.duration_s),
        harmonics: args.harmonics.unwrap_or(config.excitation.harmonics),
        tries: args.tries.unwrap_or(config.excitation.tries),
        seed: args.seed.unwrap_or(config.excitation.seed),
        ranges: config.excitation.ranges.clone(),
    };
    if !(args.rate > 0.0 && args.rate.is_finite()) {
        return Err(Failure::Usage(format!(
            "--rate: expected a number above 0, got {}",
            args.rate
        )));
    }
    args.out.as_deref().map(refuse_existing).transpose()?;
    let expected = Expected::of(&config, args.residuals.as_deref())?;
    let mut forecaster = expected.forecaster(&config)?;
    let motion =
        Excitation::design(&mut forecaster, &options, &mut |_| !shutdown.requested()).map_err(Failure::usage)?;
    let table = motion.table(1.0 / args.rate).map_err(Failure::usage)?;
    let forecast = forecaster.forecast(&table);
    if let Some(out) = &args.out {
        let turns: Vec<bool> = config.model.robot().joints.iter().map(|joint| joint.turns).collect();
        write_new(out, &table.to_csv(&turns))?;
    }
    match args.format {
        TableFormat::Json => {
            let mut value = as_json(&config, &expected, &forecast);
            value["duration_s"] = json!(motion.duration_s);
            value["gain_nat"] = json!(motion.gain);
            value["random_gain_nat"] = json!(motion.random_gain);
            value["joints"] = joints(&config, &motion, &table)
                .iter()
                .map(|joint| {
                    json!({
                        "name": joint.name, "lower": joint.lower, "upper": joint.upper, "velocity": joint.velocity,
                        "acceleration": joint.acceleration, "effort": joint.effort,
                    })
                })
                .collect();
            logging::result(&format!("{value:#}"))?;
        }
        TableFormat::Text => {
            logging::result(&joint_table(&joints(&config, &motion, &table)))?;
            logging::result(table_of(&config, &expected, &forecast).trim_end())?;
            // The share of the information per parameter is the factor on one standard deviation.
            let part = ((motion.random_gain - motion.gain) / forecast.len() as f64).exp();
            logging::result(&format!(
                "\nstandard deviations are {:.0} % of those of a random motion within the same limits, in the geometric mean",
                100.0 * part
            ))?;
        }
    }
    if let Some(out) = &args.out {
        logging::note(args.format, &format!("motion in {}", out.display()))?;
    }
    Ok(Exit::Done)
}

/// Reports the information of a given motion on a robot's parameters.
///
/// # Errors
/// If the configuration or the motion is wrong.
pub(super) fn check_motion(
    config: &Path,
    set: &[String],
    motion: &Path,
    residuals: Option<&Path>,
) -> Result<(), Failure> {
    if robot_text(config).is_none() {
        return Err(Failure::Usage(format!(
            "--motion: expected a configuration with [model] kind = \"robot\", got {}",
            config.display()
        )));
    }
    let config = robot_with(config, set)?;
    let problem = |e: &dyn std::fmt::Display| Failure::Usage(format!("{}: {e}", motion.display()));
    let text = read_text(motion, MAX_TABLE_BYTES).map_err(|e| problem(&e))?;
    let table = read_motion(&text, &config.columns).map_err(|e| problem(&e))?;
    let expected = Expected::of(&config, residuals)?;
    let forecast = expected.forecaster(&config)?.forecast(&table);
    logging::result(table_of(&config, &expected, &forecast).trim_end())
}

/// The expected misfit, and its source.
struct Expected {
    misfit: RowMisfit,
    source: String,
}

impl Expected {
    fn of(config: &RobotConfig, residuals: Option<&Path>) -> Result<Self, Failure> {
        match residuals {
            Some(path) => Self::measured(path),
            None => Ok(Self::simulated(config)),
        }
    }

    /// White noise as in the simulated robot.
    fn simulated(config: &RobotConfig) -> Self {
        let part = config.simulation.torque_noise.max(1e-6);
        let period_s = config.sample_period_s;
        let sizes = config.model.robot().drive_sizes();
        let noise: Vec<f64> = sizes.iter().map(|size| part * size).collect();
        Self {
            misfit: RowMisfit::white(&noise, period_s, &config.options.windows),
            source: format!(
                "torque noise of {} % of each joint's largest torque, every {period_s} s, and nothing else (key simulate.torque_noise); \
                 a real robot misses its model by more: name the result of an identification by --residuals",
                100.0 * part
            ),
        }
    }

    /// As found by an identification.
    fn measured(path: &Path) -> Result<Self, Failure> {
        let path = match path.is_dir() {
            true => path.join("summary.json"),
            false => path.to_owned(),
        };
        let problem = |e: &dyn std::fmt::Display| Failure::Usage(format!("--residuals: {}: {e}", path.display()));
        let text = read_text(&path, MAX_TABLE_BYTES).map_err(|e| problem(&e))?;
        let summary: Value = serde_json::from_str(&text).map_err(|e| problem(&e))?;
        let list = |key: &str| -> Option<Vec<f64>> {
            let joints = summary["joints"].as_array()?;
            joints.iter().map(|joint| joint[key].as_f64()).collect()
        };
        let (Some(std), Some(correlation)) = (list("torque_std"), list("misfit_correlation")) else {
            return Err(problem(
                &"expected torque_std and misfit_correlation of each joint, as `thetabus identify LOG.csv --out DIR` writes them",
            ));
        };
        Ok(Self {
            misfit: RowMisfit { std, correlation },
            source: format!("misfit of each joint as in {}", path.display()),
        })
    }

    fn forecaster(&self, config: &RobotConfig) -> Result<Forecaster, Failure> {
        Forecaster::new(config.model.clone(), config.options.windows, self.misfit.clone()).map_err(Failure::usage)
    }
}

/// Use of a joint by a motion.
struct JointUse {
    name: String,
    lower: f64,
    upper: f64,
    velocity: f64,
    acceleration: f64,
    effort: f64,
    effort_limit: Option<f64>,
}

fn joints(config: &RobotConfig, motion: &Excitation, table: &MotionTable) -> Vec<JointUse> {
    let robot = config.model.robot();
    let mut all: Vec<JointUse> = robot
        .joints
        .iter()
        .zip(&motion.effort)
        .map(|(joint, effort)| JointUse {
            name: joint.name.clone(),
            lower: f64::INFINITY,
            upper: f64::NEG_INFINITY,
            velocity: 0.0,
            acceleration: 0.0,
            effort: *effort,
            effort_limit: joint.limits.effort.filter(|x| *x > 0.0),
        })
        .collect();
    let looks = (table.duration_s() / 0.005).ceil() as usize;
    for look in 0..looks {
        let setpoints = motion.at(0.005 * look as f64);
        for (joint, [q, dq, ddq]) in all.iter_mut().zip(setpoints) {
            (joint.lower, joint.upper) = (joint.lower.min(q), joint.upper.max(q));
            joint.velocity = joint.velocity.max(dq.abs());
            joint.acceleration = joint.acceleration.max(ddq.abs());
        }
    }
    all
}

fn joint_table(joints: &[JointUse]) -> String {
    let mut text = format!(
        "{:<24} {:>8} {:>8} {:>9} {:>13} {:>10} {:>10}\n",
        "joint", "from", "to", "speed", "acceleration", "torque", "of limit"
    );
    for joint in joints {
        let part = joint
            .effort_limit
            .map_or("-".to_owned(), |limit| format!("{:.0} %", 100.0 * joint.effort / limit));
        let _ = writeln!(
            text,
            "{:<24} {:>8.3} {:>8.3} {:>9.3} {:>13.3} {:>10.2} {:>10}",
            joint.name, joint.lower, joint.upper, joint.velocity, joint.acceleration, joint.effort, part
        );
    }
    text.push_str("(rad or m; torques of the URDF's bodies without friction. Collisions are not checked: play it in a simulation first.)\n");
    text
}

fn table_of(config: &RobotConfig, expected: &Expected, forecast: &[ParameterForecast]) -> String {
    let mut text = format!(
        "{:<12} {:>12} {:>12} {:>10}  {:<10} {}\n",
        "parameter", "URDF", "std", "of size", "unit", "meaning"
    );
    let (mut untold, mut rough) = (Vec::new(), Vec::new());
    for (p, forecast) in config.model.parameters().iter().zip(forecast) {
        let part = match forecast.is_told {
            true => format!("{:.1} %", 100.0 * forecast.std / forecast.size),
            false => "unknown".to_owned(),
        };
        if !forecast.is_told {
            untold.push(p.name.as_str());
        } else if forecast.std >= forecast.size {
            rough.push(p.name.as_str());
        }
        let _ = writeln!(
            text,
            "{:<12} {:>12.5} {:>12.5} {part:>10}  {:<10} {}",
            p.name, p.nominal, forecast.std, p.unit, p.meaning
        );
    }
    let _ = writeln!(text, "\nexpected: {}", expected.source);
    let count = forecast.len() - untold.len() - rough.len();
    let _ = match count == forecast.len() {
        true => write!(text, "the motion determines all {count} parameters"),
        false => write!(text, "the motion determines {count} of {} parameters", forecast.len()),
    };
    if !untold.is_empty() {
        let _ = write!(text, "; not {}", untold.join(", "));
    }
    if !rough.is_empty() {
        let _ = write!(text, "; no better than to their own size {}", rough.join(", "));
    }
    text.push('\n');
    text
}

fn as_json(config: &RobotConfig, expected: &Expected, forecast: &[ParameterForecast]) -> Value {
    let parameters: Vec<Value> = config
        .model
        .parameters()
        .iter()
        .zip(forecast)
        .map(|(p, forecast)| {
            json!({
                "name": p.name, "unit": p.unit, "meaning": p.meaning, "urdf": p.nominal,
                "std": forecast.std, "size": forecast.size, "is_told": forecast.is_told,
            })
        })
        .collect();
    json!({ "robot": config.model.robot().name, "expected": expected.source, "parameters": parameters })
}
