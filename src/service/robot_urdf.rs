//! `thetabus urdf`: writes identified values back into a robot's URDF.

use super::commands::Commands;
use super::new_file::{refuse_existing, write_new};
use super::record::recording_at;
use super::script::Script;
use super::wiring::{identifier_node, identity};
use super::{CommonArgs, Exit, Failure, TableFormat, UrdfArgs, foreign, logging, report};
use crate::checkpoint;
use crate::config::{Config, RobotConfig};
use crate::node::command::NodeState;
use crate::pipe::{MAX_TABLE_BYTES, read_text};
use crate::recording::{Entry, Span};
use crate::robot::{
    FrictionTerm, IdentifyOptions, JointValues, LinkValues, RobotIdentifier, RobotModel, RobotParameter, Standard,
    StandardParameters, write_urdf,
};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// File with the results of `identify LOG.csv --out DIR`.
const SUMMARY: &str = "summary.json";
pub(super) const COVARIANCE: &str = "covariance.csv";
/// Standard deviations by which a written parameter may be off without being reported.
const NAMED: f64 = 2.0;
/// Share of the prior standard deviation below which friction is known from data.
const KNOWN: f64 = 1.0 / 3.0;

/// Writes a URDF with identified values.
///
/// # Errors
/// If nothing has been identified, the input cannot be read, or the file exists or cannot be
/// written.
pub fn run(args: &UrdfArgs) -> Result<Exit, Failure> {
    refuse_existing(&args.out)?;
    let found = Found::of(args)?;
    let model = &found.config.model;
    let fitted = StandardParameters::fit(model, &found.theta, &found.covariance)
        .map_err(|problem| Failure::Usage(format!("{}: {problem}", args.input.display())))?;
    let text = std::fs::read_to_string(&found.config.urdf)
        .map_err(|e| Failure::Usage(format!("{}: {e}", found.config.urdf.display())))?;
    let new = write_urdf(&text, &found.header(), &found.links(&fitted), &found.joints(&fitted))
        .map_err(|e| Failure::Usage(format!("{}: {e}", found.config.urdf.display())))?;
    write_new(&args.out, &new)?;
    found.warn(&args.input);
    match args.format {
        TableFormat::Json => logging::result(&format!("{:#}", found.as_json(&fitted)))?,
        TableFormat::Text => logging::result(found.table(&fitted).trim_end())?,
    }
    logging::note(args.format, &format!("URDF in {}", args.out.display()))?;
    Ok(Exit::Done)
}

/// Estimates with their covariance and robot.
struct Found {
    config: RobotConfig,
    theta: Vec<f64>,
    /// Row-major.
    covariance: Vec<f64>,
    source: String,
}

impl Found {
    fn of(args: &UrdfArgs) -> Result<Self, Failure> {
        let input = &args.input;
        if input.join(COVARIANCE).exists() {
            return Self::of_results(input, robot_config(&args.common)?);
        }
        let is_recording = input.is_dir() || input.extension().is_some_and(|name| name.eq_ignore_ascii_case("mcap"));
        match is_recording {
            true => Self::of_recording(input, &args.common),
            false => Self::of_checkpoint(input, &args.common),
        }
    }

    /// From the results of `identify LOG.csv --out DIR`.
    fn of_results(dir: &Path, config: RobotConfig) -> Result<Self, Failure> {
        let at = |name: &str| dir.join(name);
        let wrong = |name: &str, e: &dyn std::fmt::Display| Failure::Usage(format!("{}: {e}", at(name).display()));
        let text = read_text(&at(SUMMARY), MAX_TABLE_BYTES).map_err(|e| wrong(SUMMARY, &e))?;
        let summary: Value = serde_json::from_str(&text).map_err(|e| wrong(SUMMARY, &e))?;
        let listed = summary["parameters"].as_array().cloned().unwrap_or_default();
        let text = |p: &Value, key: &str| p[key].as_str().unwrap_or_default().to_owned();
        let found: Vec<(String, String)> = listed.iter().map(|p| (text(p, "name"), text(p, "meaning"))).collect();
        let wanted = config
            .model
            .parameters()
            .iter()
            .map(|p| (p.name.clone(), p.meaning.clone()));
        if let Some((expected, got)) = first_difference(&wanted.collect::<Vec<_>>(), &found) {
            return Err(wrong(
                SUMMARY,
                &format!(
                    "expected the parameter {expected} of {}, got {got}; name the configuration that it was identified with by --config",
                    config.urdf.display()
                ),
            ));
        }
        let theta: Option<Vec<f64>> = listed.iter().map(|p| p["estimate"].as_f64()).collect();
        let theta = theta.ok_or_else(|| wrong(SUMMARY, &"expected an estimate of each parameter, got none"))?;
        let text = read_text(&at(COVARIANCE), MAX_TABLE_BYTES).map_err(|e| wrong(COVARIANCE, &e))?;
        let numbers: Result<Vec<f64>, _> = text
            .lines()
            .skip(1)
            .flat_map(|line| line.split(','))
            .map(str::parse)
            .collect();
        let covariance = numbers.map_err(|e| wrong(COVARIANCE, &e))?;
        Ok(Self {
            source: format!("{} blocks of a log, {}", summary["blocks"], dir.display()),
            config,
            theta,
            covariance,
        })
    }

    /// By processing a recording again, with its commands.
    fn of_recording(input: &Path, common: &CommonArgs) -> Result<Self, Failure> {
        let own = match &common.config[..] {
            [] => CommonArgs {
                config: vec![own_config(input)?],
                ..common.clone()
            },
            _ => common.clone(),
        };
        let robot = robot_config(&own)?;
        let recording = recording_at(input);
        let mut reader = report::open(&recording, Span::default())?;
        let recorded = super::robot::beside(input, &common.catalog)
            .ok()
            .and_then(|catalog| report::config_of(reader.info(), &catalog).ok());
        let config = own.load(vec![report::source_of(reader.info())], &[])?;
        foreign::check_recording(reader.info(), recorded.as_ref(), &config)?;
        let mut script = Script::read(&recording, Commands::recorded(&config))?;
        let mut node = identifier_node(&config)?;
        while let Some(entry) = reader.next_entry().map_err(report::unreadable)? {
            let Entry::Sample { sample, .. } = entry else { continue };
            script.before(sample, &mut *node);
            node.on_sample(sample, &mut |_| {});
        }
        let mut state = NodeState::default();
        node.save(&mut state);
        Self::of_state(robot, &state, &recording)
    }

    fn of_checkpoint(path: &Path, common: &CommonArgs) -> Result<Self, Failure> {
        let robot = robot_config(common)?;
        let wrong = |e: &dyn std::fmt::Display| Failure::Usage(format!("{}: {e}", path.display()));
        let bytes = checkpoint::read(path)
            .map_err(|e| wrong(&e))?
            .ok_or_else(|| wrong(&"expected a checkpoint or a directory of results, got nothing"))?;
        let config: Config = common.load(Vec::new(), &[])?;
        let state = checkpoint::decode(&bytes, &identity(&config)).map_err(|e| wrong(&e))?;
        Self::of_state(robot, &state, path)
    }

    fn of_state(config: RobotConfig, state: &NodeState, path: &Path) -> Result<Self, Failure> {
        let wrong = |e: &dyn std::fmt::Display| Failure::Usage(format!("{}: {e}", path.display()));
        let options = IdentifyOptions {
            payload: config.payload,
            ..config.options
        };
        let mut identifier = RobotIdentifier::new(config.model.clone(), options).map_err(|e| wrong(&e))?;
        identifier.load_state(&state.estimator).map_err(|e| wrong(&e))?;
        let (theta, covariance) = arm(&identifier);
        Ok(Self {
            source: format!("{} blocks, {}", identifier.blocks(), path.display()),
            config,
            theta,
            covariance,
        })
    }

    fn std(&self, i: usize) -> f64 {
        self.covariance[i * (self.theta.len() + 1)].max(0.0).sqrt()
    }

    /// Warns if the data hardly inform on the robot's bodies.
    fn warn(&self, input: &Path) {
        let bodies = &self.config.model.parameters()[..self.config.model.base().parameters.len()];
        let is_known = |&(i, own): &(usize, &RobotParameter)| self.std(i) <= KNOWN * own.scale;
        let known = bodies.iter().enumerate().filter(is_known).count();
        if 2 * known < bodies.len() {
            tracing::warn!(
                "{}: only {known} of the {} parameters of the bodies are known from data; the others are those of the old URDF or uncertain",
                input.display(),
                bodies.len()
            );
        }
    }

    fn header(&self) -> Vec<String> {
        vec![
            format!(
                "Inertial values and friction identified by thetabus {} from",
                env!("CARGO_PKG_VERSION")
            ),
            format!("{}.", self.source),
            "Torques depend on combinations of the values alone, which stand beside the links with their standard"
                .to_owned(),
            "deviations. How each combination is shared among the bodies follows the values that were here before."
                .to_owned(),
        ]
    }

    fn links(&self, fitted: &StandardParameters) -> Vec<LinkValues> {
        let model = &self.config.model;
        let robot = model.robot();
        let values = fitted.links.iter().map(|(index, body)| {
            let link = &robot.links[*index];
            let mut source = vec!["identified:".to_owned()];
            for (i, parameter) in model.base().parameters.iter().enumerate() {
                let own = matches!(parameter.leading, Standard::Body { joint, .. } if joint == link.joint);
                if own {
                    let p = &model.parameters()[i];
                    source.push(format!(
                        "{} = {:.6} ± {:.6} {}, here {:.6}",
                        p.meaning,
                        self.theta[i],
                        self.std(i),
                        p.unit,
                        fitted.base[i]
                    ));
                }
            }
            if source.len() == 1 {
                source[0] = "torques depend on no parameter of this body alone".to_owned();
            }
            LinkValues {
                name: link.name.clone(),
                body: *body,
                source,
            }
        });
        values.collect()
    }

    fn joints(&self, fitted: &StandardParameters) -> Vec<JointValues> {
        let model = &self.config.model;
        let joints = model.robot().joints.iter().enumerate().map(|(j, joint)| {
            let mut values = JointValues {
                name: joint.name.clone(),
                damping: None,
                friction: None,
                source: vec!["identified:".to_owned()],
            };
            for (term, i) in model.friction()[j].terms.iter().zip(model.friction_of(j)) {
                let p = &model.parameters()[i];
                if !(self.std(i) < KNOWN * p.scale) {
                    continue;
                }
                let line = format!(
                    "{} = {:.6} ± {:.6} {}, {}",
                    p.name,
                    self.theta[i],
                    self.std(i),
                    p.unit,
                    p.meaning
                );
                values.source.push(line);
                match term {
                    FrictionTerm::Viscous => values.damping = Some(self.theta[i]),
                    FrictionTerm::Coulomb => values.friction = Some(self.theta[i]),
                    // a URDF has no element for the others
                    _ => {}
                }
            }
            if fitted.rotors[j] > 0.0 {
                let unit = if joint.turns { "kg m^2" } else { "kg" };
                values.source.push(format!(
                    "rotor inertia = {:.6} {unit} at the joint, which a URDF has no element for",
                    fitted.rotors[j]
                ));
            }
            values
        });
        joints.filter(|joint| joint.source.len() > 1).collect()
    }

    /// Names of base parameters that the written bodies do not reproduce.
    fn missed(&self, fitted: &StandardParameters) -> Vec<&str> {
        let named = self.config.model.parameters().iter().zip(&fitted.deviation);
        named
            .filter(|(_, deviation)| deviation.abs() > NAMED)
            .map(|(p, _)| p.name.as_str())
            .collect()
    }

    fn table(&self, fitted: &StandardParameters) -> String {
        let mut text = format!(
            "{:<12} {:>12} {:>12} {:>12} {:>9}  {:<10} {}\n",
            "parameter", "identified", "std", "written", "off [std]", "unit", "meaning"
        );
        for (i, written) in fitted.base.iter().enumerate() {
            let p = &self.config.model.parameters()[i];
            let _ = writeln!(
                text,
                "{:<12} {:>12.5} {:>12.5} {:>12.5} {:>9.2}  {:<10} {}",
                p.name,
                self.theta[i],
                self.std(i),
                written,
                fitted.deviation[i],
                p.unit,
                p.meaning
            );
        }
        let robot = self.config.model.robot();
        let _ = writeln!(
            text,
            "\n{:<24} {:>10} {:>24} {:>14}",
            "link", "mass [kg]", "centre of mass [m]", "URDF mass [kg]"
        );
        for (index, body) in &fitted.links {
            let link = &robot.links[*index];
            let c = body.first_moment() / body.mass();
            let before = link.body.map_or(0.0, |body| body.mass());
            let center = format!("{:.4} {:.4} {:.4}", c.x, c.y, c.z);
            let _ = writeln!(
                text,
                "{:<24} {:>10.4} {center:>24} {before:>14.4}",
                link.name,
                body.mass()
            );
        }
        let missed = self.missed(fitted);
        if !missed.is_empty() {
            let _ = writeln!(
                text,
                "\nno body that can exist has what was identified of {}: the nearest one is written",
                missed.join(", ")
            );
        }
        text
    }

    fn as_json(&self, fitted: &StandardParameters) -> Value {
        let robot = self.config.model.robot();
        let parameters: Vec<Value> = (0..fitted.base.len())
            .map(|i| {
                let p = &self.config.model.parameters()[i];
                json!({
                    "name": p.name, "unit": p.unit, "meaning": p.meaning, "identified": self.theta[i],
                    "std": self.std(i), "written": fitted.base[i], "off_std": fitted.deviation[i],
                })
            })
            .collect();
        let links: Vec<Value> = fitted
            .links
            .iter()
            .map(|(index, body)| {
                let c = body.first_moment() / body.mass();
                json!({ "name": robot.links[*index].name, "mass_kg": body.mass(), "center_m": [c.x, c.y, c.z] })
            })
            .collect();
        json!({ "source": self.source, "parameters": parameters, "links": links, "rotor_inertia": fitted.rotors })
    }
}

/// The estimates of the arm alone with their covariance.
pub(super) fn arm(identifier: &RobotIdentifier) -> (Vec<f64>, Vec<f64>) {
    let n = identifier.model().parameters().len();
    let covariance = (0..n * n).map(|k| identifier.covariance(k / n, k % n)).collect();
    (identifier.theta()[..n].to_vec(), covariance)
}

/// The covariance as a table under the names of the parameters.
pub(super) fn covariance_csv(model: &RobotModel, covariance: &[f64]) -> String {
    let names: Vec<&str> = model.parameters().iter().map(|p| p.name.as_str()).collect();
    let mut text = names.join(",");
    text.push('\n');
    for row in covariance.chunks(names.len().max(1)) {
        let row: Vec<String> = row.iter().map(f64::to_string).collect();
        text.push_str(&row.join(","));
        text.push('\n');
    }
    text
}

fn first_difference(wanted: &[(String, String)], found: &[(String, String)]) -> Option<(String, String)> {
    let none = ("no more".to_owned(), String::new());
    let longest = wanted.len().max(found.len());
    let at = |list: &[(String, String)], i: usize| list.get(i).cloned().unwrap_or(none.clone());
    let different = (0..longest).find(|i| at(wanted, *i) != at(found, *i))?;
    let said = |(name, meaning): (String, String)| match meaning.is_empty() || meaning == name {
        true => name,
        false => format!("{name} ({meaning})"),
    };
    Some((said(at(wanted, different)), said(at(found, different))))
}

/// The configuration that `thetabus run` leaves in the directory of a recording.
fn own_config(input: &Path) -> Result<PathBuf, Failure> {
    let dir = if input.is_dir() { Some(input) } else { input.parent() };
    let path = dir.unwrap_or(Path::new("")).join("config.toml");
    match path.is_file() {
        true => Ok(path),
        false => Err(Failure::Usage(format!(
            "{}: expected the configuration of the run beside its recording, {}, got none; name one with [model] kind = \"robot\" by --config",
            input.display(),
            path.display()
        ))),
    }
}

fn one_config(common: &CommonArgs) -> Result<&PathBuf, Failure> {
    match &common.config[..] {
        [path] => Ok(path),
        other => Err(Failure::Usage(format!(
            "--config: expected one file with [model] kind = \"robot\", got {}",
            other.len()
        ))),
    }
}

fn robot_config(common: &CommonArgs) -> Result<RobotConfig, Failure> {
    Ok(RobotConfig::from_file_with(one_config(common)?, &common.set)?)
}
