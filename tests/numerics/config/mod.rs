//! Configuration files: which ones load, and what they load to.

mod fault_tables;
mod messages;
mod models;

use std::path::Path;
use thetabus::config::{Catalog, Config, Delivery, Kind, Source, Speed, keys};
use thetabus::estimator::{EquationNoise, ParameterPrior, cedro2022_estimator};
use thetabus::model::{Equation, Parameter, Plant, PlantDefinition, Scalar};
use thetabus::rows::RowForm;
use thetabus::sim::SimOptions;

fn root(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn load(text: &str, sets: &[&str]) -> Result<Config, String> {
    let source = Source::Embedded {
        name: "test.toml".to_owned(),
        text: text.to_owned(),
    };
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    Config::load(&[source], &sets).map_err(|e| e.to_string())
}

/// `THETABUS_WRITE=1 cargo test config` writes the file anew after a change of the keys.
#[test]
fn regress_the_reference_file_lists_every_key_as_the_code_has_it() {
    let path = root("config/default.toml");
    if std::env::var_os("THETABUS_WRITE").is_some() {
        std::fs::write(&path, Config::reference()).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(
        text,
        Config::reference(),
        "config/default.toml differs from the keys in src/config/schema"
    );
    for key in keys() {
        let stated = text
            .lines()
            .any(|l| l.trim_start_matches('#').starts_with(&format!("{} =", key.name)));
        assert!(stated, "{} is not in config/default.toml", key.path());
        // A quantity's unit shows in its comment, too.
        let suffix = ["_s", "_rad", "_hz", "_kg", "_m", "_ohm", "_h", "_a", "_s2", "_v"];
        let quantity = suffix.iter().any(|s| key.name.ends_with(s)) && !matches!(key.kind, Kind::Path);
        assert!(
            !quantity || !key.unit.is_empty(),
            "{} has a unit in its name but none in its comment",
            key.path()
        );
    }
}

#[test]
fn regress_the_reference_file_loads_to_the_defaults_in_code() {
    let source = Source::File(root("config/default.toml"));
    let loaded = Config::load(&[source], &[]).unwrap();
    let default = Config::default();
    assert_eq!(loaded.file_form(), default.file_form());
    assert_eq!((&loaded.plant, &loaded.estimator), (&default.plant, &default.estimator));
    assert_eq!(loaded.plant.sim, SimOptions::cedro2022());
}

#[test]
fn regress_embedded_files_are_the_files_in_the_directory() {
    for entry in std::fs::read_dir(root("config")).unwrap() {
        let path = entry.unwrap().path();
        // Robots have files of another form, see docs/robots.md.
        if path.is_dir() {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let Some(Source::Embedded { text, .. }) = Config::embedded(&name) else {
            panic!("config/{name}.toml is not built in")
        };
        assert_eq!(text, std::fs::read_to_string(&path).unwrap());
        let config = Config::load(&[Source::File(path)], &[]).unwrap();
        assert_eq!(config.warnings(), &[], "{name}");
    }
}

#[test]
fn prop_a_written_configuration_loads_to_itself() {
    let config = load(
        "[plant.setpoint]\nkind = \"random\"\n[estimator]\ntime_constant_s = 33.5\nstep_factor = inf\nfixed = [\"theta_9\"]",
        &["bus.domain=elsewhere", "plant.speed=2.5", "monitor.out_dir=/tmp/a b"],
    )
    .unwrap();
    let again = load(&config.to_toml(), &[]).unwrap();
    assert_eq!(again.file_form(), config.file_form());
    assert_eq!(again.estimator, config.estimator);
    assert_eq!(again.config_hash(), config.config_hash());
    assert_eq!(config.plant.speed, Speed::Factor(2.5));
    assert!(config.estimator.options.parameters[8].fixed);
    // λ = exp(−N Δ/τ)
    assert_eq!(config.estimator.options.forgetting_factor, (-1.9f64 / 33.5).exp());
}

#[test]
fn regress_later_sources_win_and_arguments_win_over_all() {
    let file = |text: &str| Source::Embedded {
        name: "f".to_owned(),
        text: text.to_owned(),
    };
    let sources = [
        file("[estimator]\nblock_len = 100\nforgetting_factor = 0.9\n[plant]\nduration_s = 5"),
        file("estimator.block_len = 200\nestimator.time_constant_s = 19"),
    ];
    let config = Config::load(&sources, &["plant.duration_s = 7".to_owned()]).unwrap();
    assert_eq!(config.estimator.block_len, 200);
    assert_eq!(config.plant.sim.duration_s, 7.0);
    // The later file's time constant replaces the earlier one's factor: exp(−0.2/19).
    assert_eq!(config.estimator.options.forgetting_factor, (-0.2f64 / 19.0).exp());
    let config = Config::load(&sources, &["estimator.forgetting_factor=0.5".to_owned()]).unwrap();
    assert_eq!(config.estimator.options.forgetting_factor, 0.5);
}

#[test]
fn regress_auto_delivery_is_lockstep_at_full_speed_only() {
    let bus = load("", &[]).unwrap().bus;
    assert_eq!(bus.delivery, Delivery::Auto);
    assert!(bus.lockstep(Speed::Max) && !bus.lockstep(Speed::Factor(1.0)));
}

#[test]
fn prop_the_hash_follows_what_determines_estimates_and_nothing_else() {
    let hash = |set: &str| load("", &[set]).unwrap().config_hash();
    let default = Config::default().config_hash();
    for same in [
        "bus.domain=b",
        "plant.seed=5",
        "plant.duration_s=3",
        "monitor.out_dir=x",
        "estimator.block_len=1900",
    ] {
        assert_eq!(hash(same), default, "{same}");
    }
    for other in [
        "estimator.block_len=950",
        "estimator.forgetting_factor=0.93",
        "identifier.input=controller",
        "model.gravity_m_s2=1.62",
        "plant.sample_period_s=0.002",
    ] {
        assert_ne!(hash(other), default, "{other}");
    }
}

#[test]
fn regress_the_paper_file_states_the_paper_presets_of_the_core_types() {
    let config = Config::load(&[Config::embedded("cedro2022").unwrap()], &[]).unwrap();
    assert_eq!(config.plant.sim, SimOptions::cedro2022());
    assert_eq!(config.estimator.options, cedro2022_estimator());
    assert_eq!(
        config.estimator,
        Config::default().estimator,
        "the defaults in code are the paper's, too"
    );
    assert_eq!(config.plant.sim.sample_count(), 170_000);
    assert_eq!(config.plant.sim.sample_count() / config.estimator.block_len as u64, 89);
}

#[test]
fn regress_setpoints_come_from_a_csv_file_beside_the_configuration() {
    let dir = tempfile::tempdir().unwrap();
    let toml = dir.path().join("run.toml");
    std::fs::write(
        &toml,
        "plant.setpoint = { kind = \"csv\", csv = { path = \"moves.csv\", between = \"linear\" } }",
    )
    .unwrap();
    let try_csv = |text: &str| {
        std::fs::write(dir.path().join("moves.csv"), text).unwrap();
        Config::load(&[Source::File(toml.clone())], &[]).map_err(|e| e.to_string())
    };
    let good = try_csv("# recorded\nq2_rad, t_s, q1_rad, note\n0.5, 0, 0.1, a\n-0.5, 2.5, 0.2, b\n").unwrap();
    let thetabus::sim::Setpoint::Table { t_s, values_rad, .. } = &good.plant.sim.setpoint[1] else {
        panic!("not a table")
    };
    assert_eq!(
        (t_s.as_slice(), values_rad.as_slice()),
        (&[0.0, 2.5][..], &[0.5, -0.5][..])
    );
    // The written configuration loads without other files and has the same meaning.
    let written = good.to_toml();
    assert!(!written.contains("moves.csv"), "{written}");
    assert_eq!(load(&written, &[]).unwrap().plant, good.plant);
    for (text, parts) in [
        ("t_s,q1_rad\n0,0\n", &["moves.csv:1", "t_s, q1_rad, q2_rad"][..]),
        ("t_s,q1_rad,q2_rad\n0,0,x\n", &["moves.csv:2", "q2_rad", "\"x\""]),
        ("t_s,q1_rad,q2_rad\n0,0,nan\n", &["moves.csv:2", "finite"]),
        ("t_s,q1_rad,q2_rad\n1,0,0\n1,0,0\n", &["moves.csv:3", "after 1"]),
        ("t_s,q1_rad,q2_rad\n1,0\n", &["moves.csv"]),
        ("t_s,q1_rad,q2_rad\n", &["at least one row"]),
        ("", &["moves.csv"]),
    ] {
        let message = try_csv(text).map(|_| ()).expect_err(text);
        for part in parts {
            assert!(message.contains(part), "{text:?}: expected {part:?} in: {message}");
        }
    }
}
