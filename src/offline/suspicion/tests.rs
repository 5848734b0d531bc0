//! Each likely mistake and its detection.

use super::*;

const RAD: PositionUnit = PositionUnit::Radians;
const DEG: PositionUnit = PositionUnit::Degrees;
const TURN: PositionUnit = PositionUnit::Turns;
const M: PositionUnit = PositionUnit::Metres;
const MM: PositionUnit = PositionUnit::Millimetres;

fn profile(signal: Signal, min: f64, max: f64, largest_step: f64) -> LogProfile {
    LogProfile {
        columns: vec![ColumnProfile {
            name: "x".to_owned(),
            signal,
            count: 100,
            min,
            max,
            largest_step,
            last: Some(max),
        }],
        ..LogProfile::default()
    }
}

#[test]
fn regress_each_likely_mistake_is_named_with_the_key_that_mends_it_and_a_good_log_is_not() {
    let q = Signal::Position(0);
    // (what, turns, unit, column, its range in SI units, largest step, words)
    let cases = [
        ("an arm in rad", true, RAD, q, [-3.0, 3.0], 0.01, ""),
        ("two turns", true, RAD, q, [0.0, 12.5], 0.01, ""),
        ("an arm in degrees as rad", true, RAD, q, [-90.0, 90.0], 1.0, "\"deg\""),
        (
            "small motion in degrees as rad",
            true,
            RAD,
            q,
            [0.0, 20.0],
            0.1,
            "\"deg\"",
        ),
        ("rad as deg", true, DEG, q, [-0.02, 0.03], 1e-4, "\"rad\""),
        ("degrees as deg", true, DEG, q, [-1.5, 1.5], 1e-2, ""),
        ("degrees as turns", true, TURN, q, [0.0, 500.0], 1.0, "\"deg\""),
        ("an axis in m", false, M, q, [-0.1, 0.1], 0.001, ""),
        ("an axis of 300 mm as m", false, M, q, [0.0, 300.0], 1.0, "\"mm\""),
        ("mm as mm", false, MM, q, [0.0, 0.3], 0.001, ""),
        ("m as mm", false, MM, q, [0.0, 3e-4], 1e-6, "\"m\""),
        ("a wrapped encoder", true, RAD, q, [-3.1, 3.1], 6.2, "unwrapped"),
        (
            "the same in degrees as rad",
            true,
            RAD,
            q,
            [-179.0, 179.0],
            358.0,
            "unwrapped",
        ),
        (
            "a machine that was off",
            false,
            M,
            q,
            [0.2, 0.2],
            0.0,
            "was the machine on",
        ),
        (
            "no input",
            false,
            M,
            Signal::Input(0),
            [0.0, 0.0],
            0.0,
            "was the machine on",
        ),
        (
            "a setpoint that rests",
            false,
            M,
            Signal::Setpoint(0),
            [0.0, 0.0],
            0.0,
            "",
        ),
    ];
    for (what, turns, position_unit, signal, [min, max], step, words) in cases {
        let configured = Configured {
            turns: &[turns],
            position_unit,
            input_sign: 1.0,
        };
        let found = judge_profile(&profile(signal, min, max, step), &configured, &[]);
        let told: Vec<String> = found.iter().map(ToString::to_string).collect();
        match words {
            "" => assert!(told.is_empty(), "{what}: {told:?}"),
            words => assert!(told.len() == 1 && told[0].contains(words), "{what}: {told:?}"),
        }
    }
}

/// Beside a joint that turns, a unit of angle is not that of the slide, and the reverse.
#[test]
fn regress_a_slide_beside_a_hinge_is_judged_in_m() {
    for (position_unit, signal, range, words) in [
        (DEG, Signal::Position(1), [0.0, 0.3], ""),
        (DEG, Signal::Position(1), [0.0, 300.0], "\"mm\""),
        (DEG, Signal::Position(0), [0.0, 0.01], "\"rad\""),
        (MM, Signal::Position(0), [0.0, 3.0], ""),
        (MM, Signal::Position(0), [0.0, 180.0], "\"deg\""),
    ] {
        let configured = Configured {
            turns: &[true, false],
            position_unit,
            input_sign: 1.0,
        };
        let found = judge_profile(&profile(signal, range[0], range[1], 1e-3), &configured, &[]);
        let told: Vec<String> = found.iter().map(ToString::to_string).collect();
        match words {
            "" => assert!(told.is_empty(), "{position_unit:?} {range:?}: {told:?}"),
            words => assert!(
                told.len() == 1 && told[0].contains(words),
                "{position_unit:?} {range:?}: {told:?}"
            ),
        }
    }
}

#[test]
fn regress_an_input_against_the_models_direction_is_named_where_the_data_are_sure() {
    let profile = profile(Signal::Input(0), -1.0, 1.0, 0.1);
    for (input_sign, correlation, named) in [
        (1.0, Some(0.9), false),
        (1.0, Some(-0.9), true),
        (-1.0, Some(-0.9), false),
        (-1.0, Some(0.9), true),
        (1.0, Some(-0.2), false),
        (1.0, None, false),
        (0.0, Some(-1.0), false),
    ] {
        let configured = Configured {
            turns: &[false],
            position_unit: M,
            input_sign,
        };
        let found = judge_profile(&profile, &configured, &[correlation]);
        assert_eq!(!found.is_empty(), named, "{input_sign} {correlation:?}: {found:?}");
    }
}

#[test]
fn regress_times_separators_and_fields_are_told_by_their_looks() {
    let field = |text: &str| judge_field("clock", text).map(|s| s.to_string());
    for (text, words) in [
        ("2026-11-21T08:15:30.123Z", "in column \"clock\" is a date"),
        ("2026-11-21 08:15:30", "date"),
        ("21.11.2026 08:15", "date"),
        ("08:15:30.5", "date"),
        ("2026-11-21Z", "date"),
        ("0,125", "decimal point"),
        ("-3,5", "decimal point"),
        ("0,5;1,25;3", "semicolons"),
        ("1\t2", "tabs"),
        ("0.002 s", "\"0.002 s\" in column \"clock\" is no number"),
        ("1.5e-3 m", "no number"),
        ("\u{1b}[31m", "\"\\u{1b}[31m\""),
        ("", "no number"),
    ] {
        let told = field(text).unwrap_or_default();
        assert!(told.contains(words), "{text}: {told}");
    }
    for text in ["1.5", "NaN", "-1.5e-3"] {
        assert_eq!(field(text), None, "{text}");
    }
    for (line, words) in [
        ("t;q;u", "semicolons"),
        ("t\tq\tu", "tabs"),
        ("t,q,u", ""),
        ("t,q;r,u", ""),
        ("0.0, 1.5,-2e3", "no header"),
        ("0,q,1", ""),
    ] {
        let told = judge_header(line).map(|s| s.to_string()).unwrap_or_default();
        assert!(
            told.contains(words) && told.is_empty() == words.is_empty(),
            "{line}: {told}"
        );
    }
    for (got_s, expected_s, unit_s, words) in [
        (1.0, 1e-3, 1.0, "\"ms\""),
        (1000.0, 1e-3, 1.0, "\"us\""),
        (1e6, 1e-3, 1.0, "\"ns\""),
        (1e-6, 1e-3, 1e-3, "\"s\""),
        (0.002, 0.001, 1.0, "plant.sample_period_s = 0.002"),
        (0.5, 0.001, 1.0, ""),
    ] {
        let told = judge_period(got_s, expected_s, unit_s)
            .map(|s| s.to_string())
            .unwrap_or_default();
        assert!(
            told.contains(words) && told.is_empty() == words.is_empty(),
            "{got_s}: {told}"
        );
    }
}

#[test]
fn regress_an_estimate_at_its_bound_is_named() {
    let inf = f64::INFINITY;
    let parameters = [
        ("mass", 50.0, [0.0, inf], [2e-22, 1e-9]),
        ("rotor of a small motor", 50.0, [0.0, inf], [2e-4, 2.5e-7]),
        ("friction", 100.0, [0.0, inf], [3.0, 1.0]),
        ("offset", 0.0, [-inf, inf], [0.0, 0.1]),
        ("never moved", 0.0, [0.0, inf], [0.0, 0.1]),
    ];
    let found = judge_bounds(parameters.into_iter());
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].to_string().contains("mass rests at its bound 0"),
        "{}",
        found[0]
    );
}

#[test]
fn regress_an_input_that_is_another_signal_or_in_milli_units_is_named() {
    let echo = Some(InputEcho::Velocity);
    for (range, unit, echo, words) in [
        ([-10.1, 10.127], "V", None, ""),
        ([-1200.0, 800.0], "V", None, ""),
        (
            [-10_100.0, 127.0],
            "V",
            None,
            "reaches -10100 V, more than a drive has: if it is in mV, set log.input_unit = 0.001",
        ),
        ([-1.0, 4000.0], "A", None, "reaches 4000 A"),
        ([-9e5, 9e5], "N", None, ""),
        (
            [-1.0, 1.0],
            "N m",
            echo,
            "\"x\" is read as input, but repeats the velocity of its joint: log.input must",
        ),
        ([-5e3, 5e3], "V", echo, "repeats the velocity"),
        ([-1.0, 1.0], "m/s", echo, ""),
    ] {
        let profile = profile(Signal::Input(0), range[0], range[1], 0.1);
        let found = judge_inputs(&profile, unit, &[echo]);
        let told = found.first().map(ToString::to_string).unwrap_or_default();
        assert!(found.len() < 2 && told.contains(words), "{range:?} {unit}: {told}");
        assert_eq!(told.is_empty(), words.is_empty(), "{range:?} {unit}: {told}");
    }
}
