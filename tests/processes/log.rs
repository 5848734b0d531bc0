//! `thetabus identify LOG.csv`: the user's own data off line.

use crate::support::{Program, Site, column, eventually, text};
use nix::sys::signal::Signal;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use thetabus::config::{Config, Source};
use thetabus::sim::MachineSimulator;

const SERVO_AXIS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml");
const NAMES: [&str; 4] = ["mass", "viscous_friction", "coulomb_friction", "offset"];

#[test]
fn e2e_a_log_with_other_columns_units_and_bad_rows_is_identified_and_its_bad_rows_are_told() {
    let site = Site::new();
    let config = Config::load(&[Source::File(SERVO_AXIS.into())], &[]).expect("the file in config/");
    let simulator = MachineSimulator::new(&config.plant.sim).expect("valid");
    let mut log = "u [mV],note,time,x [mm]\n".to_owned();
    for (k, sample) in simulator.take(20_000).enumerate() {
        let (t_ms, x_mm, u_mv) = (k, sample.q[0] * 1e3, sample.input[0] * 1e3);
        match k {
            5_000 => log.push_str("a,row,of,words\n"),
            6_000 => _ = writeln!(log, "NaN,ok,{t_ms},{x_mm}"),
            7_000 => _ = writeln!(log, "{u_mv},ragged"),
            8_000 => _ = writeln!(log, "{u_mv},late,{},{x_mm}", t_ms - 500),
            _ => _ = writeln!(log, "{u_mv},ok,{t_ms},{x_mm}"),
        }
    }
    // The file system was full.
    log.truncate(log.len() - 7);
    let path = site.dir.path().join("log.csv");
    fs::write(&path, log).expect("written");
    let out = site.out();
    let args = [
        "identify",
        path.to_str().expect("UTF-8"),
        "--config",
        SERVO_AXIS,
        "--out",
        out.to_str().expect("UTF-8"),
        "--set",
        "log.time=time",
        "--set",
        "log.time_unit=ms",
        "--set",
        "log.q=[\"x [mm]\"]",
        "--set",
        "log.position_unit=mm",
        "--set",
        "log.input=[\"u [mV]\"]",
        "--set",
        "log.input_unit=0.001",
        "--set",
        "log.setpoint=[]",
    ];
    let mut identify = site.start(Program::Thetabus, &args);
    // Finished, with rows refused.
    identify.expect_code(3);
    let said = identify.stdout();
    for part in ["20000 rows", "not finite", "out of order", "(the first in line 5002)"] {
        assert!(said.contains(part), "{part:?} is not in\n{said}");
    }
    let csv = out.join("estimates.csv");
    let truth = config.plant.sim.true_parameters(0.0);
    for (name, truth) in NAMES.iter().zip(truth) {
        let (theta, std) = (column(&csv, name), column(&csv, &format!("{name}_std")));
        let (theta, std) = (theta[theta.len() - 1], std[std.len() - 1]);
        // As on the bus: seven standard deviations allow for stiction, which the model leaves out.
        assert!((theta - truth).abs() < 7.0 * std, "{name}: {theta} +- {std}");
        assert!(std < 0.02 * truth.abs(), "{name}: {theta} +- {std}");
    }
}

#[test]
fn e2e_a_log_that_does_not_fit_its_configuration_is_refused_with_what_was_expected() {
    let site = Site::new();
    let path = site.dir.path().join("log.csv");
    fs::write(&path, "t_s,position,voltage_v\n0,0,0\n").expect("written");
    let mut identify = site.start(
        Program::Thetabus,
        &["identify", path.to_str().expect("UTF-8"), "--config", SERVO_AXIS],
    );
    identify.expect_code(2);
    identify.expect_stderr(&["log.csv", "log.q", "\"q_m\"", "\"position\""]);
    // Which of two columns of one name was meant is unknown.
    for header in ["t_s,q_m,q_ref_m,voltage_v,q_m", "t_s,q_m,q_ref_m,voltage_v,q_ref_m"] {
        let log = servo_log(&site, "twice.csv", header, |t, q, u| format!("{t},{q},{q},{u},0"));
        let log = log.to_str().expect("UTF-8");
        let mut identify = site.start(Program::Thetabus, &["identify", log, "--config", SERVO_AXIS]);
        identify.expect_code(2);
        identify.expect_stderr(&["twice, as columns "]);
    }
    let other = servo_log(&site, "other.csv", "t_s,q_m,q_ref_m,voltage_v,a,a", |t, q, u| {
        format!("{t},{q},{q},{u},0,0")
    });
    let other = other.to_str().expect("UTF-8");
    let mut identify = site.start(Program::Thetabus, &["identify", other, "--config", SERVO_AXIS]);
    identify.expect_code(0);
}

/// Samples of the simulated servo axis as a log; `row` writes t \[s\], q \[m\] and u \[V\].
fn servo_log(site: &Site, name: &str, header: &str, row: fn(f64, f64, f64) -> String) -> PathBuf {
    let config = Config::load(&[Source::File(SERVO_AXIS.into())], &[]).expect("the file in config/");
    let simulator = MachineSimulator::new(&config.plant.sim).expect("valid");
    let mut log = format!("{header}\n");
    for (k, sample) in simulator.take(6_000).enumerate() {
        log.push_str(&row(k as f64 * 1e-3, sample.q[0], sample.input[0]));
        log.push('\n');
    }
    let path = site.dir.path().join(name);
    fs::write(&path, log).expect("written");
    path
}

#[test]
fn e2e_what_was_read_of_a_log_is_printed_and_the_likely_mistake_is_named() {
    let site = Site::new();
    let good = "t_s,q_m,q_ref_m,voltage_v";
    // (what, header, rows, further arguments, exit code, what is said)
    type Row = fn(f64, f64, f64) -> String;
    let cases: [(&str, &str, Row, &[&str], i32, &[&str]); 12] = [
        (
            "good",
            good,
            |t, q, u| format!("{t},{q},{q},{u}"),
            &[],
            0,
            &[
                "6000 rows over 5.999 s, 1000 Hz: 1 ms apart",
                "column \"q_m\" read as position of joint 1: ",
                "column \"voltage_v\" read as input of joint 1: ",
            ],
        ),
        (
            "millimetres",
            good,
            |t, q, u| format!("{t},{},0,{u}", 1e3 * q),
            &[],
            0,
            &["log.position_unit = \"mm\""],
        ),
        (
            "sign",
            good,
            |t, q, u| format!("{t},{q},{q},{}", -u),
            &[],
            0,
            &[
                "column \"voltage_v\" drives the machine backwards",
                "log.input_unit to its negative",
                "mass rests at its bound 0",
            ],
        ),
        (
            "mended",
            good,
            |t, q, u| format!("{t},{q},{q},{}", -u),
            &["--set", "log.input_unit=-1"],
            0,
            &["6000 rows"],
        ),
        (
            "milliseconds",
            good,
            |t, q, u| format!("{},{q},{q},{u}", 1e3 * t),
            &[],
            2,
            &["1 s apart", "log.time_unit = \"ms\""],
        ),
        (
            "dates",
            good,
            |t, q, u| format!("2026-11-21T08:15:{t:06.3}Z,{q},{q},{u}"),
            &[],
            2,
            &["date or time of day"],
        ),
        (
            "semicolons",
            "t_s;q_m;q_ref_m;voltage_v",
            |t, q, u| format!("{t};{q};{q};{u}"),
            &[],
            2,
            &["separated by semicolons"],
        ),
        (
            "units in the fields",
            good,
            |t, q, u| format!("{t},{q} m,{q},{u}"),
            &[],
            2,
            &[" m\" in column \"q_m\" is no number"],
        ),
        (
            "no header",
            "0,0.1,0.1,2.5",
            |t, q, u| format!("{t},{q},{q},{u}"),
            &[],
            2,
            &["the file has no header"],
        ),
        (
            "too short",
            good,
            |t, q, u| {
                if t < 1.0 {
                    format!("{t},{q},{q},{u}")
                } else {
                    String::new()
                }
            },
            &[],
            2,
            &["no estimate: expected a whole block of 1900 samples", "got 1000"],
        ),
        (
            "checkpoint",
            good,
            |t, q, u| format!("{t},{q},{q},{u}"),
            &["--set", "checkpoint.dir=kept"],
            0,
            &["kept\", but identify writes no checkpoint"],
        ),
        (
            "one time far ahead",
            good,
            |t, q, u| {
                let t = if t == 3.0 { 4e8 } else { t };
                format!("{t},{q},{q},{u}")
            },
            &[],
            3,
            &["1 out of order (the first in line 3002)"],
        ),
    ];
    for (what, header, row, further, code, parts) in cases {
        // a log is one by what it holds, whatever its name
        let ending = if what == "good" { "txt" } else { "csv" };
        let path = servo_log(&site, &format!("{what}.{ending}").replace(' ', "_"), header, row);
        let args = ["identify", path.to_str().expect("UTF-8"), "--config", SERVO_AXIS];
        let mut identify = site.start(Program::Thetabus, &[&args[..], further].concat());
        identify.expect_code(code);
        let said = identify.said();
        for part in parts {
            assert!(said.contains(part), "{what}: {part:?} is not in\n{said}");
        }
        if ["good", "mended", "one time far ahead"].contains(&what) {
            assert!(
                !said.contains("drives the machine") && !said.contains("rests at its bound"),
                "{what}:\n{said}"
            );
        }
    }
}

#[test]
fn fault_a_signal_before_the_end_of_a_log_is_told_and_no_success() {
    let site = Site::new();
    // a second of work: the signal comes some milliseconds after the beginning
    let mut log = "t_s,q_m,q_ref_m,voltage_v\n".to_owned();
    for k in 0..1_000_000 {
        let (t_s, u) = (f64::from(k) * 1e-3, (f64::from(k) * 2.5e-3).sin());
        let _ = writeln!(log, "{t_s},{},0,{u:.3}", 0.05 * u);
    }
    let path = site.dir.path().join("log.csv");
    fs::write(&path, log).expect("written");
    let out = site.out();
    let args = ["identify", text(&path), "--config", SERVO_AXIS, "--out", text(&out)];
    let mut identify = site.start(Program::Thetabus, &args);
    eventually("it has begun", || out.join("estimates.csv").exists().then_some(()));
    identify.signal(Signal::SIGINT);
    identify.expect_code(3);
    identify.expect_stderr(&["stopped by a signal", "log.csv is not in the result"]);
    assert!(out.join("summary.json").exists());
}

#[test]
fn val_the_emps_recording_identified_on_the_command_line_gives_the_published_parameters() {
    // Stands beside the project, since it came without a licence.
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let data = std::env::var_os("THETABUS_DATA_DIR").map_or(beside, PathBuf::from);
    let path = data.join("emps.csv");
    if !path.exists() {
        let required = std::env::var("THETABUS_REQUIRE_PEERS").as_deref() == Ok("1");
        assert!(!required, "{} is missing", path.display());
        eprintln!("skipped: {} is missing", path.display());
        return;
    }
    let site = Site::new();
    let out = site.out();
    let args = [
        "identify",
        path.to_str().expect("UTF-8"),
        "--config",
        SERVO_AXIS,
        "--out",
        out.to_str().expect("UTF-8"),
    ];
    site.start(Program::Thetabus, &args).expect_code(0);
    // Janot, Gautier, Brunot 2019; what one on-line pass has to reach of it, in per cent.
    let published = [(95.1089, 0.2), (203.5034, 0.5), (20.3935, 0.5), (-3.1648, 2.0)];
    for (name, (value, percent)) in NAMES.iter().zip(published) {
        let (theta, std) = (
            column(&out.join("estimates.csv"), name),
            column(&out.join("estimates.csv"), &format!("{name}_std")),
        );
        let (theta, std) = (theta[theta.len() - 1], std[std.len() - 1]);
        assert!((theta / value - 1.0).abs() < percent / 100.0, "{name}: {theta}");
        assert!((theta - value).abs() < 2.0 * std, "{name}: {theta} +- {std}");
    }
}

#[test]
fn val_the_log_that_is_shipped_gives_the_machine_that_it_is_of() {
    let site = Site::new();
    let log = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/data/servo_axis.csv");
    let out = site.out();
    let out = out.to_str().expect("UTF-8");
    let args = ["identify", log, "--config", SERVO_AXIS, "--out", out];
    // Its rate is not the configuration's, and the error says what to write.
    let mut refused = site.start(Program::Thetabus, &args);
    refused.expect_code(2);
    refused.expect_stderr(&["set plant.sample_period_s = 0.002"]);
    let period = ["--set", "plant.sample_period_s=0.002"];
    site.start(Program::Thetabus, &[&args[..], &period].concat())
        .expect_code(0);
    let config = Config::load(&[Source::File(SERVO_AXIS.into())], &[]).expect("the file in config/");
    let truth = config.plant.sim.true_values(&NAMES, 0.0);
    let csv = site.out().join("estimates.csv");
    for (name, truth) in NAMES.iter().zip(truth) {
        let last = |column_name: &str| *column(&csv, column_name).last().expect("a block");
        let (value, std) = (last(name), last(&format!("{name}_std")));
        // Four values that are to be within 4 standard deviations: one log in 4000 would not be.
        assert!(
            (value - truth).abs() < 4.0 * std && std < 0.05 * truth.abs(),
            "{name}: {value} ± {std}, {truth}"
        );
    }
}
