//! What is wrong or suspicious in a file or an argument, and the messages about it.

use super::load;
use crate::support::{edited, edits};
use proptest::prelude::*;
use thetabus::config::{Config, Source, keys};

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
    (
        "[robot]\nname = \"a\"",
        &["test.toml:1: robot", "bus.robot", "entries [[robot]], in two brackets"],
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
        "[plant]\nduration_s = 1e10",
        &["plant.duration_s: expected 1 to 1e9 sample periods, 0.001 to 1000000 s, got 10000000000"],
    ),
    (
        "[plant]\nduration_s = 1e-4",
        &["plant.duration_s: expected 1 to 1e9 sample periods, 0.001 to 1000000 s, got 0.0001"],
    ),
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
fn regress_a_recording_of_a_shortened_run_is_no_reason_to_warn() {
    let text = "[plant]\nduration_s = 20\n[plant.mass_2]\nt_s = [0, 45]\nmass_kg = [150, 170]\n".to_owned();
    let name = "test.toml".to_owned();
    let warns = |source: Source| {
        let config = Config::load(&[source], &[]).unwrap();
        let mut warnings = config.warnings().iter();
        warnings.any(|warning| warning.message.contains("behind the end of the run"))
    };
    assert!(warns(Source::Embedded {
        name: name.clone(),
        text: text.clone()
    }));
    assert!(!warns(Source::Recorded { name, text }));
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
        let text = edited(include_str!("../../../config/default.toml"), &edits);
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
    let message = load(include_str!("../../../docs/method.md"), &[])
        .map(|_| ())
        .unwrap_err();
    assert_eq!(message.lines().count(), 6, "{message}");
    assert!(message.contains("is this a TOML file?"), "{message}");
}
