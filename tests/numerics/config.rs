//! Configuration files: which ones load, which ones do not, and the messages about them.

use crate::support::{edited, edits};
use proptest::prelude::*;
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

/// Each case: a file, and what its message must contain.
const WRONG: &[(&str, &[&str])] = &[
    (
        "[estimator]\nblock_len = \"abc\"",
        &[
            "test.toml:2",
            "estimator.block_len",
            "whole number from 1 to",
            "[samples]",
            "\"abc\" (a string)",
        ],
    ),
    (
        "[estimator]\n\n\nblock_len = 0",
        &["test.toml:4", "block_len", "from 1 to", "got 0"],
    ),
    ("[estimator]\nblock_len = -5", &["got -5"]),
    ("[estimator]\nblock_len = 1.5", &["got 1.5"]),
    (
        "[estimator]\nblock_len = 99999999999999999999999",
        &["block_len", "got 99999999999999999999999"],
    ),
    (
        "[estimator]\nforgetting_factor = nan",
        &["forgetting_factor", "above 0 up to 1", "nan (not a finite number)"],
    ),
    (
        "[estimator]\ninformation_floor = inf",
        &["information_floor", "inf (not a finite number)"],
    ),
    (
        "[estimator]\ninformation_floor = 1e999",
        &["information_floor", "got 1e999"],
    ),
    ("[estimator]\nforgetting_factor = 1.01", &["up to 1", "got 1.01"]),
    (
        "[estimator]\nforgetting_factor = 0.3",
        &["forgetting_factor", "0.5", "polynomial", "got 0.3"],
    ),
    (
        "[estimator]\nforgetting_factor = 0.9\ntime_constant_s = 19",
        &["either this or", "both", "test.toml:"],
    ),
    ("[estimator]\ntime_constant_s = 1e-9", &["time_constant_s"]),
    (
        "[estimator]\nblok_len = 5",
        &[
            "test.toml:2",
            "blok_len",
            "unknown key",
            "did you mean estimator.block_len?",
        ],
    ),
    (
        "[plant]\nblock_len = 5",
        &["plant.block_len", "did you mean estimator.block_len?"],
    ),
    ("[plnt]\nseed = 5", &["plnt", "did you mean plant?"]),
    (
        "colour = 5",
        &["test.toml:1", "colour", "unknown key", "config/default.toml"],
    ),
    ("estimator = 5", &["estimator", "a section [estimator]", "got 5"]),
    ("[estimator.block_len]\na = 1", &["estimator.block_len", "a section"]),
    ("[[estimator]]\nblock_len = 1", &["estimator", "a section [estimator]"]),
    (
        "[estimator]\nforgetting = \"bouned\"",
        &["one of \"exponential\"", "did you mean \"bounded\"?"],
    ),
    ("[estimator]\nforgetting = 3", &["one of", "3 (a whole number)"]),
    (
        "[estimator]\ntheta_start = [1, 2, 3]",
        &["theta_start", "expected 9 numbers", "got 3"],
    ),
    (
        "[estimator]\ntheta_start = [1, 2, 3, 4, 5, 6, 7, 8, nan]",
        &["theta_start", "a list of"],
    ),
    (
        "[estimator]\nfixed = [\"theta_10\"]",
        &["fixed", "theta_1, theta_2", "\"theta_10\""],
    ),
    (
        "[estimator]\nbounds = \"listed\"\nlower = [1,1,1,1,1,1,1,1,1]",
        &[
            "test.toml:3",
            "estimator.lower",
            "expected 1 to inf for the start of theta_1",
        ],
    ),
    (
        "[bus]\ndomain = \"No Spaces\"",
        &["bus.domain", "a-z 0-9 _ -", "\"No Spaces\""],
    ),
    ("[bus]\nrobot = \"../../etc\"", &["bus.robot"]),
    ("[bus]\nlockstep_consumers = true", &["true (a truth value)"]),
    ("[bus]\ndelivery = 2026-01-01", &["a date or time"]),
    ("[plant]\nspeed = \"fast\"", &["\"max\" or a number", "\"fast\""]),
    ("[plant]\nspeed = 0", &["plant.speed", "got 0"]),
    (
        "[plant]\ninitial_q_rad = [0]",
        &["a list of 2 numbers", "one per joint", "a list of 1"],
    ),
    (
        "[plant]\nsample_period_s = 0.00012345678912",
        &["sample_period_s", "nanoseconds"],
    ),
    ("[plant]\nduration_s = 0.0001", &["plant.duration_s", "0.0001"]),
    (
        "[plant.arm]\nmass_1_kg = -1",
        &["plant.arm.mass_1_kg", "above 0", "[kg]", "-1"],
    ),
    (
        "[plant.mass_2]\nt_s = [0, 1, 2]",
        &["plant.mass_2.t_s", "3 times and 2 masses"],
    ),
    ("[plant.mass_2]\nt_s = [1, 2]", &["plant.mass_2.t_s", "at 0 s"]),
    ("[plant.mass_2]\nt_s = [0, 0]", &["plant.mass_2.t_s", "rising"]),
    (
        "[plant.setpoint.steps]\ndwell_s = [1e-9, 1]",
        &["plant.setpoint.steps.dwell_s", "joint 1"],
    ),
    (
        "[plant.setpoint.steps]\nlevels_rad = [[1], []]",
        &["levels_rad", "for each of the 2 joints"],
    ),
    (
        "[plant.setpoint]\nkind = \"csv\"",
        &["plant.setpoint.csv.path", "not set"],
    ),
    (
        "[plant.setpoint]\nkind = \"csv\"\n[plant.setpoint.csv]\npath = \"no/such.csv\"",
        &["no/such.csv", "cannot be read"],
    ),
    (
        "[plant.setpoint]\nkind = \"sines\"\n[plant.setpoint.sines]\nphase_rad = [[1], [1]]",
        &["phase_rad", "frequency_hz"],
    ),
    (
        "[model.known]\nlength_1_m = 0.5",
        &["model.known", "not set", "winding_resistance_ohm"],
    ),
    (
        "[identifier]\nrows = \"projected\"\n[identifier.projected]\nwindow_s = 10.0",
        &["test.toml:4", "8 to 2000 sample periods", "got 10 s, which are 10000"],
    ),
    (
        "[identifier]\nrows = \"projected\"\n[identifier.projected]\nvelocity_half_width = 10",
        &["test.toml:4", "velocity_half_width_s", "0.01 for 10 samples at 1 ms"],
    ),
    (
        "[identifier]\nrows = \"projected\"\n[identifier.projected]\nvelocity_half_width_s = 0.2",
        &["test.toml:4", "at most 100 sample periods", "got 0.2 s, which are 200"],
    ),
    (
        "[identifier]\nrows = \"projected\"\n[identifier.projected]\ninput_noise = [0.1]",
        &[
            "test.toml:4",
            "position_resolution or position_noise as well",
            "learn_noise = true",
        ],
    ),
    (
        "[identifier]\nrows = \"projected\"\n[identifier.projected]\nlearn_noise = false",
        &[
            "test.toml:4",
            "identifier.projected.learn_noise",
            "levels of positions and inputs",
        ],
    ),
    (
        "[model]\ncoulomb_friction = true",
        &[
            "test.toml:2",
            "model.coulomb_friction",
            "identifier.rows = \"pointwise\"",
        ],
    ),
    (
        "[model]\nkind = \"servo_axis\"\n[log]\nq = [\"q_m\"]\nposition_unit = \"rad\"",
        &["test.toml:5", "log.position_unit", "\"mm\"", "moves along a line"],
    ),
    (
        "[log]\nq = [\"a\", \"b\"]\nposition_unit = \"m\"",
        &["test.toml:3", "log.position_unit", "\"deg\"", "turns"],
    ),
    (
        "[estimator]\nblock_len = 5\nblock_len = 6",
        &["test.toml:3", "duplicate key"],
    ),
    ("[estimator]\nblock_len = ", &["test.toml:2", "not valid TOML"]),
    ("[estimator\nblock_len = 1", &["test.toml:1", "not valid TOML"]),
];

#[test]
fn fault_a_wrong_file_is_told_with_place_key_expected_and_got() {
    for (text, parts) in WRONG {
        let message = load(text, &[]).map(|_| ()).expect_err(text);
        for part in *parts {
            assert!(message.contains(part), "{text:?}: expected {part:?} in: {message}");
        }
        assert!(message.starts_with("test.toml"), "{text:?}: no place in: {message}");
    }
}

#[test]
fn fault_a_wrong_argument_is_quoted() {
    for (set, parts) in [
        (
            "estimator.block_len=abc",
            &["--set estimator.block_len=abc", "whole number", "\"abc\" (a string)"][..],
        ),
        ("estimator.block_len", &["section.key=value", "no \"=\""]),
        ("estimator.blok_len=5", &["did you mean estimator.block_len?"]),
        ("block_len=5", &["did you mean estimator.block_len?"]),
        (
            "identifier.considred.offset=1",
            &["did you mean identifier.considered.offset?"],
        ),
        (
            "estimator=5",
            &["a section, not a key; its keys are estimator.block_len"],
        ),
        (
            "plant.initial_q_rad=[0, ",
            &["which is not TOML", "a list of 2 numbers"],
        ),
        ("=", &["no key before"]),
        ("estimator.block_len=", &["block_len"]),
        ("plant.duration_s=1 2", &["\"1 2\""]),
    ] {
        let message = load("", &[set]).map(|_| ()).expect_err(set);
        for part in parts {
            assert!(message.contains(part), "{set}: expected {part:?} in: {message}");
        }
    }
    // A shell takes quotes away, so lists of words need none, and a single one no brackets.
    for set in ["[theta_1, theta_3]", "[\"theta_1\", theta_3]", "theta_1,theta_3"] {
        let config = load("", &[&format!("estimator.fixed={set}")]).expect(set);
        let fixed: Vec<bool> = config.estimator.options.parameters.iter().map(|p| p.fixed).collect();
        assert_eq!(fixed[..4], [true, false, true, false], "{set}");
    }
    // Names need no quotes even where they look like something else.
    assert_eq!(
        load("", &["bus.domain=1234", "bus.robot=true"]).unwrap().bus.domain,
        "1234"
    );
}

#[test]
fn fault_all_problems_are_told_at_once() {
    let text =
        "colour = 1\n[bus]\nrobot = \"\"\n[plant]\nseed = -1\nduration_s = \"long\"\n[model.known]\nlength_1_m = 1";
    let message = load(text, &["estimator.block_len=0"]).map(|_| ()).unwrap_err();
    assert_eq!(message.lines().count(), 6, "{message}");
}

#[test]
fn fault_files_that_are_none_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    std::fs::write(path("latin1.toml"), b"# ok\n# Gr\xfc\xdfe\n").unwrap();
    std::fs::write(path("huge.toml"), vec![b'#'; (4 << 20) + 1]).unwrap();
    for (name, part) in [
        ("missing.toml", "cannot be opened"),
        ("latin1.toml", "UTF-8 text, got other bytes in line 2"),
        ("huge.toml", "at most 4194304 bytes"),
        ("", "cannot be read"),
    ] {
        let message = Config::load(&[Source::File(path(name))], &[])
            .map(|_| ())
            .unwrap_err()
            .to_string();
        assert!(message.contains(part) && message.contains(name), "{name}: {message}");
    }
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

#[test]
fn fault_a_recordings_configuration_opens_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let secret = dir.path().join("secret");
    std::fs::write(&secret, "root:$6$hidden\n").unwrap();
    let recorded = |text: &str, sets: &[String]| {
        let text = text.to_owned();
        let source = Source::Recorded {
            name: "the recording".to_owned(),
            text,
        };
        Config::load(&[source], sets).map_err(|e| e.to_string())
    };
    let path = secret.display();
    let csv = format!("[plant.setpoint]\nkind = \"csv\"\n[plant.setpoint.csv]\npath = \"{path}\"");
    let error = recorded(&csv, &[]).unwrap_err();
    assert!(
        error.contains("plant.setpoint.csv.path") && error.contains("opens no file"),
        "{error}"
    );
    assert!(!error.contains("hidden"), "{error}");
    // Whoever reads the recording may name one.
    let moves = dir.path().join("moves.csv");
    std::fs::write(&moves, "t_s,q1_rad,q2_rad\n0,0.1,0.2\n").unwrap();
    let set = format!("plant.setpoint.csv.path={}", moves.display());
    let config = recorded(&csv, &[set]).unwrap();
    assert!(config.to_toml().contains("0.0 0.1 0.2"), "{}", config.to_toml());
    // Setpoints in the recording itself; where results went does not count.
    let whole = format!(
        "{}\n[checkpoint]\ndir = \"{path}\"",
        config.to_toml().replace("[checkpoint]\n", "")
    );
    let again = recorded(&whole.replace("period_s = 10.0\n\n", ""), &[]);
    let again = again.unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(again.plant, config.plant);
    assert_eq!((again.checkpoint.dir, again.monitor.out_dir), (None, None));
}

#[test]
fn fault_garbage_is_told_in_few_words_and_little_time() {
    let many: String = (0..80_000).map(|k| format!("key_{k} = {k}\n")).collect();
    let name = "x".repeat(1 << 20);
    let cases = [
        ("80 000 unknown keys", many),
        ("a key of 1 MB", format!("{name} = 1\n")),
        ("a name of 1 MB", format!("[log]\nq = [\"{name}\"]\ntime = \"{name}\"")),
        ("a robot of 1 MB", format!("[bus]\nrobot = \"{name}\"")),
        ("deep lists", format!("x = {}", "[".repeat(1 << 20))),
        ("deep keys", format!("{} = 1", vec!["a"; 1 << 19].join("."))),
        ("many tables", "[[plant.faults]]\n".repeat(60_000)),
        ("syntax errors", "= = =\n".repeat(500_000)),
        ("more than is read", "#\n".repeat(3 << 20)),
        (
            "rows of garbage",
            format!("plant.setpoint = {{ kind = \"csv\", csv.rows = \"{name}\" }}"),
        ),
    ];
    for (what, text) in cases {
        let start = std::time::Instant::now();
        let error = load(&text, &[]).unwrap_err();
        assert!(error.len() < 50_000, "{what}: {} bytes", error.len());
        let longest = error.lines().map(str::len).max();
        assert!(longest < Some(1000), "{what}: a line of {longest:?} bytes");
        // A tenth of it is enough on an idle machine; a quadratic search takes minutes.
        assert!(start.elapsed().as_secs() < 10, "{what}: {:?}", start.elapsed());
    }
    let error = load("", &[&format!("{name}=1")]).unwrap_err();
    assert!(error.len() < 1000, "{} bytes", error.len());
}

#[test]
fn regress_legal_but_suspicious_settings_warn() {
    for (sets, part) in [
        (&["plant.duration_s=1"][..], "before the first block is full"),
        (&["plant.mass_2.t_s=[0, 200]"], "behind the end of the run"),
        (&["bus.delivery=realtime"], "loses samples"),
        (&["estimator.forgetting_factor=1"], "averages"),
        (&["estimator.change_detection=true"], "single step"),
        (
            &["plant.setpoint.chirp.sweep_s=[9, 9]"],
            "no effect unless plant.setpoint.kind is \"chirp\"; it is \"steps\"",
        ),
        (
            &["estimator.step_factor=3", "estimator.max_iterations=9"],
            "limits nothing",
        ),
        (&["plant.sensors.encoder_bits=16"], "sensors give no derivatives"),
        (&["estimator.huber_limit=2"], "no effect unless estimator.outliers"),
        (
            &[
                "identifier.rows=projected",
                "identifier.projected.window_s=0.012",
                "identifier.projected.stride_s=0.004",
            ],
            "is 12 samples long",
        ),
        (
            &["identifier.derivative_gain_v_s_per_rad=[1,1]"],
            "no effect unless identifier.input",
        ),
    ] {
        let config = load("", sets).unwrap();
        let warnings: Vec<String> = config.warnings().iter().map(ToString::to_string).collect();
        assert!(
            warnings.iter().any(|w| w.contains(part) && w.contains("--set")),
            "{sets:?}: {warnings:?}"
        );
    }
    assert_eq!(load("", &[]).unwrap().warnings(), &[]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000, failure_persistence: None, ..ProptestConfig::default() })]

    /// The reference file with bytes changed: an error or a configuration, never a panic.
    #[test]
    fn fault_corrupt_files_never_panic(edits in edits()) {
        let text = edited(include_str!("../../config/default.toml"), &edits);
        if let Err(message) = load(&text, &[]) {
            prop_assert!(message.starts_with("test.toml"), "{}", message);
        }
    }

    /// Any value for any key, as an argument.
    #[test]
    fn fault_strange_arguments_never_panic(key in any::<prop::sample::Index>(), value in "\\PC{0,24}|-?[0-9.e_xinfa]{1,12}|\\[[-0-9., \\[\\]]{0,30}\\]") {
        let keys: Vec<_> = keys().collect();
        let argument = format!("{}={value}", keys[key.index(keys.len())].path());
        if let Err(message) = load("", &[&argument]) {
            prop_assert!(!message.is_empty());
        }
    }
}

#[test]
fn fault_a_file_that_is_no_toml_is_told_in_a_few_lines() {
    let message = load(include_str!("../../docs/method.md"), &[]).map(|_| ()).unwrap_err();
    assert_eq!(message.lines().count(), 6, "{message}");
    assert!(message.contains("is this a TOML file?"), "{message}");
}

#[test]
fn e2e_faults_are_tables_of_their_own_and_survive_a_round_trip() {
    use thetabus::sim::{Fault, FaultKind, FaultSignal};
    let text = "
        [plant]
        duration_s = 10
        [[plant.faults]]
        kind = \"stuck\"
        signal = \"q\"
        joint = 2
        from_s = 3
        to_s = 4.5
        [[plant.faults]]
        kind = \"intermittent\"
        from_s = 5
        share = 0.25
    ";
    let config = load(text, &[]).unwrap();
    let expected = [
        Fault {
            kind: FaultKind::Stuck,
            signal: FaultSignal::Q,
            joint: Some(1),
            from_s: 3.0,
            to_s: 4.5,
        },
        Fault {
            kind: FaultKind::Intermittent {
                share: 0.25,
                period_s: 0.0,
            },
            signal: FaultSignal::Sample,
            joint: None,
            from_s: 5.0,
            to_s: f64::INFINITY,
        },
    ];
    assert_eq!(config.plant.sim.faults, expected);
    assert_eq!(load(&config.to_toml(), &[]).unwrap().plant, config.plant);
    let inline = r#"plant.faults=[{kind="off", signal="input", from_s=1}]"#;
    assert_eq!(
        load("", &[inline]).unwrap().plant.sim.faults[0].signal,
        FaultSignal::Input
    );
    // Faults of the signals are not part of the hash of the estimation.
    assert_eq!(config.config_hash(), load("", &[]).unwrap().config_hash());
}

#[test]
fn fault_a_fault_that_is_wrong_itself_is_named_with_its_table_and_key() {
    let cases = [
        (
            "kind = \"of\"\nfrom_s = 1",
            ["test.toml:2: plant.faults[1].kind", "\"off\""],
        ),
        ("kind = \"off\"", ["test.toml:1: plant.faults[1]", "from_s"]),
        (
            "kind = \"off\"\nfrom_s = -1",
            ["test.toml:3: plant.faults[1].from_s", "-1"],
        ),
        (
            "kind = \"off\"\nfrom_s = 1\nuntil_s = 2",
            ["test.toml:4: plant.faults[1].until_s", "unknown key"],
        ),
        (
            "kind = \"off\"\nfrom_s = 2\nto_s = 1",
            ["test.toml:1: plant.faults: table 1, to_s", "after from_s"],
        ),
        ("kind = \"delayed\"\nfrom_s = 2", ["table 1, delay_s", "got 0"]),
        ("kind = \"wrong\"\nfrom_s = 2", ["table 1, signal", "single signal"]),
        (
            "kind = \"off\"\nsignal = \"q\"\njoint = 3\nfrom_s = 2",
            ["table 1, joint: expected a joint of the machine", "got 3"],
        ),
    ];
    for (table, parts) in cases {
        let error = load(&format!("[[plant.faults]]\n{table}\n"), &[]).unwrap_err();
        for part in parts {
            assert!(error.contains(part), "{part:?} is not in {error}");
        }
    }
    let error = load("[plant]\nfaults = [3]", &[]).unwrap_err();
    assert!(error.contains("plant.faults[1]: expected a table, got"), "{error}");
    let warned = load(
        "[plant.sensors]\nencoder_bits = 16\n[[plant.faults]]\nkind = \"off\"\nsignal = \"ddq\"\nfrom_s = 0",
        &[],
    );
    assert!(warned.unwrap().warnings()[0].message.contains("has no effect"));
}

/// A plant with only the required methods.
#[derive(Clone)]
struct Own {
    name: &'static str,
    parameters: Vec<Parameter>,
    equations: Vec<Equation>,
}

impl Plant for Own {
    fn name(&self) -> &str {
        self.name
    }
    fn joints(&self) -> usize {
        1
    }
    fn input_unit(&self) -> &str {
        "N m"
    }
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }
    fn equations(&self) -> &[Equation] {
        &self.equations
    }
    fn terms<D: Scalar>(&self, _equation: usize, _q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1];
        g[1] = theta[0] * dq[0];
    }
}

#[test]
fn prop_a_users_own_plant_is_a_model_beside_those_of_the_library() {
    let pendulum = Own {
        name: "pendulum",
        parameters: vec![
            Parameter::positive("inertia", "kg m^2", "about the axis", 1.5),
            Parameter::new("bias", "N m", "constant torque", -0.5),
        ],
        equations: vec![Equation::new("axis", 0, 1.0, 1, 0..2)],
    };
    let load = |own: &Own, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        let basis = Config::embedded("own_plant").unwrap();
        let catalog = Catalog::default().with(own.clone());
        Config::load_for(&catalog, &[basis], &sets).map_err(|e| e.to_string())
    };
    let config = load(&pendulum, &[]).unwrap();
    let options = &config.estimator.options;
    assert_eq!(config.model.definition(), &PlantDefinition::of(&pendulum));
    assert_eq!(
        options.parameters,
        [ParameterPrior::positive(1.5), ParameterPrior::new(-0.5)]
    );
    assert!(config.warnings().is_empty(), "{:?}", config.warnings());
    // its own equations are what is simulated, and the configuration that is written out says so
    assert_eq!(config.plant.sim.model(), "pendulum");
    assert_eq!(config.plant.sim.true_parameters(0.0), [1.875, -0.625]);
    let written = Catalog::default().with(pendulum.clone());
    let source = Source::Embedded {
        name: "written".to_owned(),
        text: config.to_toml(),
    };
    let again = Config::load_for(&written, &[source], &[]).unwrap();
    assert_eq!((&again.model, &again.plant), (&config.model, &config.plant));
    assert_eq!(again.config_hash(), config.config_hash());

    let config = load(
        &pendulum,
        &["estimator.theta_start=[2.0,0.1]", "estimator.fixed=[\"bias\"]"],
    )
    .unwrap();
    let of_each = config.estimator.options.parameters.iter();
    assert!(of_each.map(|p| (p.start, p.fixed)).eq([(2.0, false), (0.1, true)]));
    // models of the library remain available
    let servo = load(&pendulum, &["model.kind=servo_axis", "plant.machine=servo_axis"]).unwrap();
    assert_eq!(servo.model.name(), "servo_axis");
    let ignored = load(&pendulum, &["model.gravity_m_s2=1.6"]).unwrap();
    assert!(ignored.warnings()[0].message.contains("no effect on pendulum"));
    let message = load(&pendulum, &["model.kind=pendulun"]).unwrap_err();
    assert!(message.contains("did you mean \"pendulum\"?"), "{message}");

    let message = load(&pendulum, &["estimator.theta_start=[1.0]"]).unwrap_err();
    assert!(message.contains("expected 2 numbers"), "{message}");
    let message = load(&pendulum, &["plant.model.theta=[1.0]"]).unwrap_err();
    assert!(
        message.contains("expected 2 numbers, one per parameter of pendulum"),
        "{message}"
    );
    let message = load(&pendulum, &["plant.model.change_s=3"]).unwrap_err();
    assert!(message.contains("theta_after"), "{message}");
    let mut broken = pendulum.clone();
    broken.equations[0].parameters = 0..3;
    let message = load(&broken, &[]).unwrap_err();
    assert!(
        message.contains("equation axis") && message.contains("0..2, got 0..3"),
        "{message}"
    );
    let mut broken = pendulum.clone();
    broken.parameters[1].name = "inertia".into();
    let message = load(&broken, &[]).unwrap_err();
    assert!(message.contains("two parameters are called inertia"), "{message}");
    for (name, problem) in [
        ("manipulator", "another model has this name"),
        ("My Arm", "a-z 0-9 _ -"),
    ] {
        let message = load(
            &Own {
                name,
                ..pendulum.clone()
            },
            &[],
        )
        .unwrap_err();
        assert!(message.contains(problem), "{message}");
    }
}

#[test]
fn regress_noise_is_learnt_if_nobody_states_any_and_the_decision_is_written_out() {
    use thetabus::rows::ProjectedOptions;
    let rows = |config: &Config| -> ProjectedOptions {
        match config.identifier.rows {
            RowForm::Projected(rows) => rows,
            RowForm::Pointwise => panic!("projected rows were asked for"),
        }
    };
    let projected = "identifier.rows=projected";
    let learnt = load("", &[projected]).unwrap();
    assert!(rows(&learnt).learn_noise);
    let stated = [
        projected,
        "identifier.projected.position_noise=[1e-4]",
        "identifier.projected.input_resolution=[0.2]",
    ];
    let told = load("", &stated).unwrap();
    let noise = rows(&told).noise;
    assert!(!rows(&told).learn_noise);
    assert_eq!((noise.position_noise[1], noise.input_resolution[1]), (1e-4, 0.2));
    assert_eq!((noise.position_resolution[1], noise.input_noise[1]), (0.0, 0.0));
    for config in [&learnt, &told] {
        let again = load(&config.to_toml(), &[]).unwrap();
        assert_eq!(rows(&again), rows(config));
        assert_eq!(again.config_hash(), config.config_hash());
    }
    // a single floor is that of every equation
    let floor = load("", &[projected, "estimator.noise_floor=[0.5]"]).unwrap();
    let half = EquationNoise { std: 1.0, floor: 0.5 };
    assert_eq!(floor.estimator.options.equations, [half, half]);
    // settings besides own_plant.toml take effect
    let own = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        Config::load(&[Config::embedded("own_plant").unwrap()], &sets).unwrap()
    };
    assert!(rows(&own(&[])).learn_noise);
    assert!(!rows(&own(&stated[1..])).learn_noise);
}

#[test]
fn regress_the_velocity_filter_has_a_time_and_recordings_of_before_keep_theirs() {
    let samples = |config: &Config| match config.identifier.rows {
        RowForm::Projected(rows) => rows.velocity_half_width,
        RowForm::Pointwise => 0,
    };
    for (period_s, expected) in [(0.5e-3, 16), (1e-3, 8), (2e-3, 4), (0.01, 3)] {
        let period = format!("plant.sample_period_s={period_s:?}");
        let window = "identifier.projected.window_s=0.1";
        let config = load("", &["identifier.rows=projected", &period, window]).unwrap();
        assert_eq!(samples(&config), expected, "{period_s}");
    }
    let text = load("", &["identifier.rows=projected", "plant.sample_period_s=0.002"])
        .unwrap()
        .to_toml()
        .replace("velocity_half_width_s = 0.008", "velocity_half_width = 12");
    assert!(text.contains("velocity_half_width = 12"));
    let recorded = Source::Recorded {
        name: "the recording's configuration".to_owned(),
        text,
    };
    let config = Config::load(&[recorded], &[]).unwrap();
    assert_eq!(samples(&config), 12);
    assert_eq!(config.file_form().projected.velocity_half_width_s, 0.024);
}

#[test]
fn regress_terms_of_the_arm_are_switched_on_by_configuration() {
    let rows = "identifier.rows=projected";
    let names = |sets: &[&str]| {
        let config = load("", sets).unwrap();
        let names: Vec<_> = config.model.parameters().iter().map(|p| p.name.to_string()).collect();
        (names, config.model.definition().hash(), config.config_hash())
    };
    let (plain, plain_model, plain_config) = names(&[rows]);
    let (friction, friction_model, friction_config) = names(&[rows, "model.coulomb_friction=true"]);
    assert_eq!(plain.len(), 9);
    assert_eq!(friction[5..7], ["coulomb_friction_1", "coulomb_inductance_1"]);
    assert_eq!(friction[11..], ["coulomb_friction_2", "coulomb_inductance_2"]);
    assert_ne!(plain_model, friction_model);
    assert_ne!(plain_config, friction_config);
    let delay = "identifier.projected.estimate_input_delay=true";
    let (all, ..) = names(&[rows, "model.coulomb_friction=true", "model.offset=true", delay]);
    assert_eq!(
        (all.len(), all[7].as_str(), all[15].as_str()),
        (16, "offset_1", "input_delay")
    );
    // an offset has a derivative, which is 0
    assert_eq!(names(&["model.offset=true"]).0.len(), 11);
    let servo = load("", &["model.kind=servo_axis", "model.offset=true"]).unwrap();
    let warning = &servo.warnings()[0];
    assert_eq!(warning.key, "model.offset");
    assert!(
        warning
            .message
            .contains("no effect unless model.kind is \"manipulator\""),
        "{warning}"
    );
}
