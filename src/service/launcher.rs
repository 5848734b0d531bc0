//! `thetabus run`: the three processes, one result.
//!
//! ```text
//! run ─┬─ thetabus monitor      waits for estimates
//!      ├─ thetabus identifier   waits for the monitor
//!      ├─ thetabus controller   if one is configured
//!      └─ thetabus plant        waits for the identifier; END ends the identifier, its last status the monitor
//! ```
//!
//! `children.rs` manages the processes.

use super::args::{domain, quoted};
use super::children::{Children, Plan};
use super::live::live_state;
use super::monitor::{SUMMARY_JSON, write_summary};
use super::progress::Progress;
use super::record::RECORDING;
use super::ticker::Ticker;
use super::wiring::simulates;
use super::{Exit, Failure, RunArgs, TableFormat, cell, logging, out_dir, report, warm};
use crate::bus::{Bus, Role, RoleLock, Subscriber};
use crate::config::{Catalog, Config, FeedForward, Source};
use crate::files;
use crate::messages::Status;
use crate::node::simulated_plant::SimulatedLosses;
use crate::recording::Span;
use crate::report::{REPORT_HTML, Summary};
use crate::runner::Shutdown;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Name of the file with the whole configuration of the run.
const CONFIG_TOML: &str = "config.toml";

/// Runs plant, identifier and monitor to the end, then prints the result.
///
/// # Errors
/// If the configuration is wrong, the directory is not empty, there is already a run, or a child
/// fails.
pub fn run(args: &RunArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let start = Instant::now();
    #[cfg(feature = "foxglove")]
    args.web.check()?;
    let config = load(args)?;
    if !simulates(&config, &config.plant.sim) {
        return Err(Failure::Usage(format!(
            "plant.machine: expected {} for the model {}, got a machine that the model {} describes",
            machines(config.model.name()),
            config.model.name(),
            config.plant.sim.model()
        )));
    }
    if args.warm {
        warm::dir(&config)?;
    }
    let domain = domain(&config)?;
    let robot = config.bus.robot.clone();
    let dir = config.monitor.out_dir.clone().unwrap_or_else(out_dir::default_dir);
    out_dir::check(&dir)?;
    let _only_one = RoleLock::acquire(&domain, &robot, Role::Run)?;
    // Report this now, not through a failing child.
    for role in [Role::Plant, Role::Identifier] {
        RoleLock::acquire(&domain, &robot, role)?;
    }
    out_dir::create(&dir)?;
    let config_file = dir.join(CONFIG_TOML);
    files::write_synced(&config_file, as_file(args, &config, &dir)?.as_bytes())
        .map_err(|e| super::monitor::unwritable(&config_file, &e))?;

    let bus = Bus::join(&domain, &robot, "run")?;
    let status = Subscriber::<Status>::new(&bus)?;
    let progress = Arc::new(Progress::new(
        config.plant.sim.sample_count(),
        config.estimator.block_len as u64,
        live_state(&config),
    ));
    let estimates = progress.is_terminal().then(|| Subscriber::new(&bus)).transpose()?;
    let lockstep = config.bus.lockstep(config.plant.speed);
    let plan = Plan {
        program: std::env::current_exe().map_err(|e| Failure::Failed(format!("cannot find this program: {e}")))?,
        config: config_file,
        dir: dir.clone(),
        log_format: args.plant.common.log_format,
        lockstep,
        record: !args.no_record,
        consumers: config.bus.lockstep_consumers,
        controller: config.controller.feed_forward != FeedForward::None,
        web: args.web,
        warm: args.warm,
        checkpoints: config.checkpoint.dir.is_some(),
        supervision: config.supervision,
    };
    let mut children = Children::start(&plan, &progress)?;
    let outcome = children.supervise(&plan, &bus, (status, estimates), &progress, shutdown);
    progress.clear();
    if children.has_killed() {
        bus.clean_up_dead();
    }

    let restarts = children.restarts();
    let restarted = restarts.values().any(|&count| count > 0);
    let result = show_result(&dir, start, restarts, args.format, &config);
    let lost = outcome?;
    let summary = result?;
    if restarted {
        // In any delivery mode, the data that a dead process was handling are lost.
        tracing::error!("processes were restarted; the data they were processing are lost");
        return Ok(Exit::DataLoss);
    }
    let samples = &summary.samples;
    if samples.rejected > samples.accepted {
        tracing::error!(
            "{} of {} samples were rejected; `thetabus identify {}` says why",
            samples.rejected,
            samples.accepted.saturating_add(samples.rejected),
            dir.display()
        );
        return Ok(Exit::DataLoss);
    }
    let sent = samples
        .accepted
        .saturating_add(samples.rejected)
        .saturating_add(samples.missing);
    let incomplete = lost || samples.missing > SimulatedLosses::new(&config.plant.sim).among(sent);
    if lockstep && incomplete {
        tracing::error!("data were lost in a run in which nothing may be lost; the warnings above tell where");
    }
    Ok(if lockstep && incomplete {
        Exit::DataLoss
    } else {
        Exit::Done
    })
}

/// The whole configuration as a file of the results, with the URDF of a robot beside it; the robot
/// may be one of a cell.
fn as_file(args: &RunArgs, config: &Config, dir: &Path) -> Result<String, Failure> {
    let common = &args.plant.common;
    let stated: Vec<_> = args.file.iter().chain(&common.config).cloned().collect();
    let sources = cell::sources(&stated, common.robot.as_deref())?;
    let files = sources.iter().filter_map(|source| match source {
        Source::File(path) => Some(path),
        _ => None,
    });
    let own = super::robot::as_file(files, &common.set, config, dir)?;
    Ok(own.unwrap_or_else(|| config.to_toml()))
}

/// The values of `plant.machine` for a machine that a model describes.
fn machines(model: &str) -> &'static str {
    match model {
        "manipulator" => "\"arm\", or \"model\" to simulate the model's own equations,",
        "servo_axis" => "\"servo_axis\", or \"model\" to simulate the model's own equations,",
        _ => "\"model\"",
    }
}

/// The configuration with the consumers to wait for, as `run` determines them.
fn load(args: &RunArgs) -> Result<Config, Failure> {
    let files: Vec<_> = args.file.iter().cloned().collect();
    let file = cell::sources(&files, args.plant.common.robot.as_deref())?;
    let out = quoted(args.out.as_ref().map(|dir| dir.display().to_string()));
    let own = [("monitor.out_dir", out)];
    let own: Vec<_> = args.plant.overrides().into_iter().chain(own).collect();
    let config = args.plant.common.load(file, &own)?;
    let consumers = consumers(&config, args);
    Ok(config.with_number("bus.lockstep_consumers", consumers as f64)?)
}

/// The number of sample consumers: the identifier, the monitor if it records or shows samples, and
/// a controller.
fn consumers(config: &Config, args: &RunArgs) -> usize {
    let monitor = !args.no_record || args.web.takes_samples();
    let controller = config.controller.feed_forward != FeedForward::None;
    1 + usize::from(monitor) + usize::from(controller)
}

/// Reads the monitor's results, adds the wall time, and prints the table and, last, the directory
/// and the page to open.
fn show_result(
    dir: &Path,
    start: Instant,
    restarts: BTreeMap<String, u64>,
    format: TableFormat,
    config: &Config,
) -> Result<Summary, Failure> {
    let path = dir.join(SUMMARY_JSON);
    let read = || -> std::io::Result<Summary> { Ok(serde_json::from_str(&std::fs::read_to_string(&path)?)?) };
    let result = read()
        .map_err(|e| Failure::Failed(format!("no result: {} cannot be read: {e}", path.display())))
        .and_then(|summary: Summary| {
            let mut summary = summary.of_blocks(config.estimator.block_len);
            summary.wall_s = Some((start.elapsed().as_secs_f64() * 1e3).round() / 1e3);
            summary.restarts = Some(restarts);
            write_summary(dir, &summary)?;
            let told = logging::table(&summary, format);
            make_report(dir, &summary, config.catalog())?;
            told.map(|()| summary)
        });
    let page = dir.join(REPORT_HTML);
    logging::note(format, &format!("results in {}", dir.display()))
        .and_then(|()| match page.is_file() {
            true => logging::note(format, &format!("open {}", page.display())),
            false => Ok(()),
        })
        .and(result)
}

/// Figures and page, if there is a recording.
fn make_report(dir: &Path, summary: &Summary, catalog: &Catalog) -> Result<(), Failure> {
    let recording = dir.join(RECORDING);
    if !recording.exists() {
        return Ok(());
    }
    let ticker = Ticker::start("reading the recording for the report");
    let run = report::read(&recording, Span::default(), catalog, |share| ticker.at(share))?;
    report::write(dir, &run, summary, &ticker)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::CommonArgs;
    use crate::service::args::BUILT_IN;

    #[test]
    fn regress_run_and_the_single_programs_mean_the_same_without_a_file_and_with_one() {
        let own_file = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml"));
        let built_in = Config::load(&[Config::embedded(BUILT_IN).expect("built in")], &[]).expect("valid");
        let servo = Config::load(&[Source::File(own_file.clone())], &[]).expect("valid");
        assert_ne!(built_in.config_hash(), servo.config_hash());
        for (files, expected) in [(Vec::new(), &built_in), (vec![own_file], &servo)] {
            let common = CommonArgs {
                config: files.clone(),
                ..CommonArgs::default()
            };
            let mut run = RunArgs::default();
            run.plant.common = common.clone();
            let named = RunArgs {
                file: files.first().cloned(),
                ..RunArgs::default()
            };
            // plant, identifier, monitor, identify and ctl load it in this way
            for config in [common.load(Vec::new(), &[]), super::load(&run), super::load(&named)] {
                let config = config.expect("valid");
                assert_eq!(config.config_hash(), expected.config_hash());
                assert_eq!((&config.plant, &config.model), (&expected.plant, &expected.model));
            }
        }
    }

    #[test]
    fn regress_the_results_of_a_cells_robot_hold_its_whole_configuration() {
        let cell = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/cell.toml"));
        let dir = std::env::temp_dir().join(format!("thetabus-launcher-cell-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("a directory");
        for robot in ["welder", "axis-2"] {
            let mut run = RunArgs {
                file: Some(cell.clone()),
                ..RunArgs::default()
            };
            run.plant.common.robot = Some(robot.to_owned());
            let config = super::load(&run).expect("valid");
            let text = as_file(&run, &config, &dir).expect("written");
            std::fs::write(dir.join(CONFIG_TOML), text).expect("written");
            let again = CommonArgs {
                config: vec![dir.join(CONFIG_TOML)],
                ..CommonArgs::default()
            };
            let again = again.load(Vec::new(), &[]).expect("valid");
            assert_eq!(again.config_hash(), config.config_hash(), "{robot}");
            assert_eq!(again.bus.robot, robot);
        }
        std::fs::remove_dir_all(dir).expect("removed");
    }
}
