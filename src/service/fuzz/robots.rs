//! The file of a robot from its URDF and the file of a cell, each followed by the programs' way to
//! a configuration.

use super::corpora::Corpora;
use super::mutate::Random;
use crate::config::{Catalog, CellRobot, Config, ConfigError, Origin, RobotConfig, Source};
use crate::service::robot;
use std::fs;
use std::path::{Path, PathBuf};

const ROBOT: &str = include_str!("../../../config/robots/six_axis.toml");
const URDF: &str = include_str!("../../../config/robots/six_axis.urdf");
const CELL: &str = include_str!("../../../config/robots/cell.toml");

/// A mutated file with this name in the directory of a worker, and its text.
fn mutated(random: &mut Random, corpora: &Corpora, name: &str, text: &str) -> (PathBuf, String) {
    let mut bytes = text.as_bytes().to_vec();
    random.mutate(&mut bytes);
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let path = corpora.dir.join(name);
    fs::write(&path, &text).expect("a disk");
    (path, text)
}

/// Each problem names a file of this directory, and a line or a key or how many there are more.
fn explained(error: &ConfigError, dir: &Path) {
    assert!(
        !error.problems.is_empty() && error.to_string().len() < 100_000,
        "{error}"
    );
    for problem in &error.problems {
        let Origin::File { name, line } = &problem.origin else {
            panic!("no file: {problem}")
        };
        assert!(Path::new(name).starts_with(dir), "{problem}");
        let is_count = problem.message.starts_with("and ");
        assert!(*line > 0 || !problem.key.is_empty() || is_count, "{problem}");
    }
}

pub(super) fn robot(random: &mut Random, corpora: &Corpora) {
    fs::write(corpora.dir.join("six_axis.urdf"), URDF).expect("a disk");
    // As it is shipped, or with every key that has a value.
    let text = match random.once_in(2) {
        true => ROBOT.to_owned(),
        false => {
            let form = RobotConfig::own_sections(ROBOT, &corpora.dir, &[]).expect("valid");
            form.to_toml() + "[plant]\nsample_period_s = 0.002\nduration_s = 5\n[estimator]\nblock_len = 300\n"
        }
    };
    let (path, text) = mutated(random, corpora, "fuzz_robot.toml", &text);
    if let Err(error) = RobotConfig::parse(&text, &path) {
        explained(&error, &corpora.dir);
    }
    let Ok(Some(robot)) = robot::source(&path, &Catalog::default(), &[], None) else {
        return;
    };
    let sources = [robot.source];
    match Config::load_for(&robot.catalog, &sources, &[]) {
        Err(error) => assert!(!error.problems.is_empty()),
        Ok(config) => {
            let file = robot::as_file([&path].into_iter(), &[], &config, &corpora.dir).expect("a file");
            let file = file.expect("a robot's");
            RobotConfig::parse(&file, &path).expect("what is written out loads");
        }
    }
}

pub(super) fn cell(random: &mut Random, corpora: &Corpora) {
    let (path, text) = mutated(random, corpora, "fuzz_cell.toml", CELL);
    match CellRobot::parse(&text, &path) {
        Err(error) => explained(&error, &corpora.dir),
        Ok(None) => {}
        Ok(Some(robots)) => {
            assert!((1..=4096).contains(&robots.len()), "{}", robots.len());
            assert!(robots.iter().all(|robot| crate::words::is_name(&robot.name)));
        }
    }
    // The shared settings, or a file without entries.
    for source in [Source::Shared(path.clone()), Source::File(path)] {
        if let Err(error) = Config::load(&[source], &[]) {
            assert!(!error.problems.is_empty() && error.to_string().len() < 100_000);
        }
    }
}
