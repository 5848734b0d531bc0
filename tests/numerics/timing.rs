//! The input between samples, as the identifier assumes it and as the simulated controller produces
//! it.

use thetabus::config::{Config, Source};
use thetabus::rows::{InputTiming, RowForm};
use thetabus::sim::ControllerKind;

const ANALOG: &str = "plant.controller.kind=analog";
const SAMPLED: &str = "plant.controller.kind=sampled";
const HELD: &str = "identifier.projected.timing=held";
const CONTINUOUS: &str = "identifier.projected.timing=continuous";
const PROJECTED: &str = "identifier.rows=projected";

fn load(sources: &[Source], sets: &[&str]) -> Result<Config, String> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    Config::load(sources, &sets).map_err(|e| e.to_string())
}

fn text(config: &Config) -> Source {
    Source::Embedded {
        name: "written".to_owned(),
        text: config.to_toml(),
    }
}

fn recorded(config: &str) -> Source {
    Source::Recorded {
        name: "the recording".to_owned(),
        text: config.to_owned(),
    }
}

fn timing(config: &Config) -> InputTiming {
    match config.identifier.rows {
        RowForm::Projected(rows) => rows.timing,
        RowForm::Pointwise => panic!("projected rows were asked for"),
    }
}

#[test]
fn fault_a_controller_and_a_timing_that_contradict_each_other_are_refused() {
    let encoder_only = || Config::embedded("encoder_only").unwrap();
    let message = load(&[encoder_only()], &[ANALOG]).unwrap_err();
    for part in [
        "built-in encoder_only.toml:50: identifier.projected.timing: expected \"continuous\"",
        "plant.controller.kind = \"analog\" (--set plant.controller.kind=analog), got \"held\"",
        "set identifier.projected.timing = \"continuous\", or plant.controller.kind = \"sampled\"",
        "beside a real machine leave plant.controller.kind out",
    ] {
        assert!(message.contains(part), "expected {part:?} in: {message}");
    }
    let message = load(&[encoder_only()], &[CONTINUOUS]).unwrap_err();
    assert!(
        message.contains("expected \"held\"") && message.contains("got \"continuous\""),
        "{message}"
    );
    assert!(load(&[], &[PROJECTED, ANALOG, HELD]).is_err());
    // what agrees
    let config = load(&[encoder_only()], &[ANALOG, CONTINUOUS]).unwrap();
    assert_eq!(timing(&config), InputTiming::Continuous);
    assert_eq!(config.plant.sim.controller.kind, ControllerKind::Analog);
    // rows that have no windows, and a machine with another controller
    assert!(load(&[], &[ANALOG, HELD]).is_ok());
    assert!(load(&[encoder_only()], &[CONTINUOUS, "plant.machine=model"]).is_ok());
    // a file as the axis of the examples, under a sampled controller
    let axis = Config::embedded("servo_axis").unwrap();
    assert!(load(&[axis], &[SAMPLED]).is_err());
}

#[test]
fn regress_the_timing_follows_a_stated_controller_and_no_other() {
    for (sets, expected) in [
        (&[PROJECTED, ANALOG][..], InputTiming::Continuous),
        (&[PROJECTED, SAMPLED], InputTiming::Held),
        // with a real machine no controller is configured
        (&[PROJECTED], InputTiming::Held),
        (&[PROJECTED, HELD], InputTiming::Held),
        (&[PROJECTED, CONTINUOUS], InputTiming::Continuous),
    ] {
        let config = load(&[], sets).unwrap();
        assert_eq!(timing(&config), expected, "{sets:?}");
        // the written configuration states no more than the original, and may be changed during the
        // run
        let again = load(&[text(&config)], &[]).unwrap();
        assert_eq!(again.to_toml(), config.to_toml(), "{sets:?}");
        assert_eq!(again.plant, config.plant, "{sets:?}");
        assert!(config.with_number("estimator.block_len", 950.0).is_ok(), "{sets:?}");
    }
}

#[test]
fn regress_recordings_of_before_are_read_whatever_was_simulated_then() {
    // they state every key
    let written = load(&[], &[PROJECTED, HELD]).unwrap().to_toml();
    let before = written.replace("[plant.controller]\n", "[plant.controller]\nkind = \"analog\"\n");
    assert!(before.contains("kind = \"analog\""));
    let config = load(&[recorded(&before)], &[]).unwrap();
    assert_eq!(timing(&config), InputTiming::Held);
    assert_eq!(load(&[text(&config)], &[]).unwrap().to_toml(), config.to_toml());
    // a request for rows other than the recorded ones is reported
    let pointwise = before.replace("rows = \"projected\"", "rows = \"pointwise\"");
    assert!(load(&[recorded(&pointwise)], &[]).is_ok());
    assert!(load(&[recorded(&pointwise)], &[PROJECTED]).is_err());
    assert!(load(&[recorded(&pointwise)], &[PROJECTED, CONTINUOUS]).is_ok());
}
