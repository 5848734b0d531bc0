//! Logs in columns, zero-phase filtering, friction, and samples that cannot be used.

use super::{SIX_AXIS, robot};
use crate::support::TestRng;
#[cfg(feature = "config")]
use thetabus::config::{ConfigError, RobotConfig};
use thetabus::robot::{
    Drives, Engagement, FilteredSample, FrictionTerm, IdentifyOptions, JointFriction, LogColumns, RobotIdentifier,
    RobotModel, RobotSample, SampleFault, WindowOptions, ZeroPhaseLowPass, correlation_time_s, read_log,
};

fn columns() -> LogColumns {
    LogColumns {
        time: 1,
        position: vec![2, 3],
        velocity: vec![4, 5],
        input: vec![6, 7],
    }
}

#[test]
fn regress_logs_with_any_separator_and_with_or_without_names() {
    let drives = Drives {
        gain: vec![2.0, 3.0],
        coupling: Some(vec![vec![1.0, 0.5], vec![0.0, 1.0]]),
    };
    for text in [
        "t,a,b,c,d,e,f\n0,1,2,3,4,5,6\n0.01,1,2,3,4,5,6\n",
        "0;1;2;3;4;5;6;ignored\n\n0.01;1;2;3;4;5;6;7\n",
        "0 1  2 3 4 5 6\n0.01\t1\t2\t3\t4\t5\t6\n",
        "0|1|2|3|4|5|6\n0,01;1,0;2;3;4;5;6\n",
        "0 1.0 2 3 4 5 6\n0.01 | 1 | 2 | 3 | 4 | 5 | 6\n",
    ] {
        let log = read_log(text, &columns(), &drives).unwrap().samples;
        assert_eq!(log.len(), 2);
        assert_eq!((log[1].t_s, log[1].q[1], log[1].dq[0]), (0.01, 2.0, 3.0));
        // τ = C K i: (10 + 0.5 · 18, 18).
        assert_eq!(log[0].tau[..2], [19.0, 18.0]);
    }
}

#[test]
fn regress_a_log_may_lack_velocities() {
    let columns = LogColumns::in_order(2, false);
    let log = read_log("0,1,2,5,6\n0.01,1,2,5,6\n", &columns, &Drives::torque(2))
        .unwrap()
        .samples;
    assert_eq!(
        (log[1].q[..2].to_vec(), log[1].dq, log[1].tau[..2].to_vec()),
        (vec![1.0, 2.0], [0.0; 8], vec![5.0, 6.0])
    );
    assert_eq!(LogColumns::in_order(2, true), self::columns());
}

/// Section `[log]` of a configuration, and the columns of a log with so many.
#[cfg(feature = "config")]
#[test]
fn regress_columns_of_a_robots_log_follow_from_the_section_or_from_their_number() {
    let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/seven_axis.toml"));
    let of = |section: &str, width: usize| -> Result<LogColumns, ConfigError> {
        let text = format!("[model]\nkind = \"robot\"\nurdf = \"six_axis.urdf\"\n[log]\n{section}");
        let config = RobotConfig::parse(&text, path)?;
        Ok(config.columns_of(&format!("names\n{}\n", vec!["0"; width].join(","))))
    };
    let [with, without] = [true, false].map(|has| LogColumns::in_order(6, has));
    let behind = LogColumns {
        input: (8..14).collect(),
        ..without.clone()
    };
    for (section, width, expected) in [
        ("", 19, &with),
        ("", 13, &without),
        ("", 14, &with),
        ("velocity_columns = []", 30, &without),
        ("velocity_columns = [8, 9, 10, 11, 12, 13]", 13, &with),
        ("position_columns = [2, 3, 4, 5, 6, 7]", 13, &with),
        ("input_columns = [8, 9, 10, 11, 12, 13]", 30, &behind),
    ] {
        assert_eq!(of(section, width).as_ref(), Ok(expected), "{section} {width}");
    }
    let error = of("velocity_columns = [1, 2]", 19).unwrap_err().to_string();
    assert!(
        error.contains("velocity_columns: expected 6 columns") && error.contains("leave it out, or empty"),
        "{error}"
    );
}

/// In g it would have a length of 1, and multiplied twice one of 96.
#[cfg(feature = "config")]
#[test]
fn fault_a_gravity_that_is_none_is_refused() {
    let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/seven_axis.toml"));
    let of = |gravity: &str| {
        let text = format!("[model]\nkind = \"robot\"\nurdf = \"six_axis.urdf\"\ngravity_m_per_s2 = {gravity}\n");
        RobotConfig::parse(&text, path).map(|config| config.model.robot().gravity.norm())
    };
    for (gravity, size) in [
        ("[0.0, 0.0, -9.81]", 9.81),
        ("[0.0, 0.0, 0.0]", 0.0),
        ("[-1.62, 0.0, 0.0]", 1.62),
    ] {
        assert_eq!(of(gravity), Ok(size));
    }
    for (gravity, words) in [
        ("[0.0, 0.0, -1.0]", "got [0.0, 0.0, -1.0] of length 1.000"),
        ("[0.0, 0.0, -96.2]", "of length 96.200"),
        ("[0.0, 0.0, nan]", "expected a list of 3 numbers of any size [m/s²]"),
        ("[0.0, -9.81]", "got [0.0, -9.81] (a list of 2)"),
    ] {
        let error = of(gravity).unwrap_err().to_string();
        assert!(
            error.contains("model.gravity_m_per_s2") && error.contains(words),
            "{error}"
        );
    }
}

#[test]
fn regress_a_wrong_log_is_refused_by_line_and_column() {
    let torque = Drives::torque(2);
    for (text, message) in [
        (
            "0,1,2,3,4,5,6\n0.01,1,2,3,x,5,6\n",
            "line 2: column 5: expected a finite number, got \"x\"",
        ),
        ("0,1,2,3,4,5,6\n0.01,1,2,3,nan,5,6\n", "got \"nan\""),
        (
            "0,1,2,3,4,5,6\n0.01,1,2,3,4,5\n",
            "line 2: expected at least 7 columns, got 6",
        ),
        (
            "0,1,2,3,4,5,6\n0,1,2,3,4,5,6\n",
            "line 2: expected a time after 0 s, got 0 s",
        ),
    ] {
        let error = read_log(text, &columns(), &torque).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    let zero = LogColumns { time: 0, ..columns() };
    assert!(
        read_log("", &zero, &torque)
            .unwrap_err()
            .to_string()
            .contains("numbers from 1")
    );
    let short = LogColumns {
        velocity: vec![4],
        ..columns()
    };
    assert!(
        read_log("", &short, &torque)
            .unwrap_err()
            .to_string()
            .contains("velocity columns")
    );
    assert!(
        read_log("", &columns(), &Drives::torque(3))
            .unwrap_err()
            .to_string()
            .contains("expected 2 finite numbers")
    );
}

/// As in the logs of other machines (`src/offline/log`).
#[test]
fn fault_a_row_that_is_no_sample_is_skipped_and_counted() {
    let row = |t: &str| format!("{t},1,2,3,4,5,6\n");
    let sound: String = (0..8).map(|k| row(&format!("0.0{k}"))).collect();
    let bad = [
        (
            "0.1,1,2,nan,4,5,6\n",
            [0, 1, 0],
            "line 9: column 4: expected a finite number, got \"nan\"",
        ),
        (
            "0.1,1,,3,4,5,6\n",
            [0, 1, 0],
            "line 9: column 3: expected a finite number, got \"\"",
        ),
        (
            "0.1,1,2,3,4,5,-inf\n",
            [0, 1, 0],
            "column 7: expected a finite number, got \"-inf\"",
        ),
        (
            "0.1,1,2,3,4,five,6\n",
            [1, 0, 0],
            "column 6: expected a finite number, got \"five\"",
        ),
        ("0.1,1,2,3\n", [1, 0, 0], "line 9: expected at least 7 columns, got 4"),
        (
            "0.07,1,2,3,4,5,6\n",
            [0, 0, 1],
            "line 9: expected a time after 0.07 s, got 0.07 s",
        ),
        (
            "0.01,1,2,3,4,5,6\n",
            [0, 0, 1],
            "line 9: expected a time after 0.07 s, got 0.01 s",
        ),
    ];
    for (bad, counts, words) in bad {
        let text = format!("{sound}{bad}{}", row("0.2"));
        let log = read_log(&text, &columns(), &Drives::torque(2)).unwrap();
        let skipped = &log.skipped;
        assert_eq!((log.samples.len(), skipped.rows), (9, 10), "{bad}");
        assert_eq!(
            [skipped.unreadable, skipped.not_finite, skipped.not_later],
            counts,
            "{bad}"
        );
        let said = skipped.to_string();
        assert!(
            said.starts_with("1 of 10 rows are skipped, 1 ") && said.contains(words),
            "{said}"
        );
    }
    // the file ends in the middle of a row; and most of it is no log
    let log = read_log(&format!("{sound}0.1,1,2"), &columns(), &Drives::torque(2)).unwrap();
    assert_eq!((log.samples.len(), log.skipped.count()), (8, 1));
    let error = read_log(&format!("{}0.1,1\n0.2,1\n", row("0")), &columns(), &Drives::torque(2)).unwrap_err();
    assert_eq!(error.line, Some(2));
    assert!(error.to_string().ends_with("2 of 3 rows are no samples"), "{error}");
}

/// The theorem: forwards and backwards an order-N Butterworth has |H|² = 1/(1 +
/// (tan(πf/2)/tan(πf_c/2))^2N) and no phase.
#[test]
fn prop_the_zero_phase_low_pass_has_the_gain_of_butterworth_twice() {
    for order in [1, 2, 5] {
        let filter = ZeroPhaseLowPass::new(order, 0.15).unwrap();
        for f in [0.02_f64, 0.1, 0.15, 0.25] {
            let tan = |f: f64| (std::f64::consts::FRAC_PI_2 * f).tan();
            let gain = 1.0 / (1.0 + (tan(f) / tan(0.15)).powi(2 * order as i32));
            let wave = |k: usize| (std::f64::consts::PI * f * k as f64).sin();
            let filtered = filter.apply(&(0..4000).map(wave).collect::<Vec<_>>());
            for k in 1500..2500 {
                assert!((filtered[k] - gain * wave(k)).abs() < 1e-6, "order {order}, {f}, {k}");
            }
        }
        let line: Vec<f64> = (0..300).map(|k| 2.0 - 0.5 * f64::from(k)).collect();
        // A line is continued as a line, and passes up to rounding and the start of each section.
        for (filtered, value) in filter.apply(&line).iter().zip(&line).skip(100).take(100) {
            assert!((filtered - value).abs() < 1e-6, "{filtered} {value}");
        }
        assert_eq!(filter.apply(&[3.0]), [3.0]);
        assert!(filter.apply(&[]).is_empty());
    }
    assert!(ZeroPhaseLowPass::new(0, 0.1).is_none() && ZeroPhaseLowPass::new(5, 1.0).is_none());
}

/// The slope of the engagement is that of a difference of two ways δ. Central differences with a
/// step of 1e-4 in ln δ leave 1e-8 of third derivatives of order 1.
#[test]
fn val_the_slope_of_the_engagement_is_its_derivative_by_the_way_of_a_reversal() {
    let of = |presliding: f64| {
        let friction = JointFriction {
            presliding,
            ..JointFriction::default()
        };
        let mut engaged = Engagement::default();
        (0..300)
            .map(|k| {
                engaged = friction.engagement(2e-5 * (0.05 * f64::from(k)).sin(), engaged);
                engaged
            })
            .collect::<Vec<_>>()
    };
    let (h, delta) = (1e-4_f64, 2e-4);
    let (less, exact, more) = (of(delta * (-h).exp()), of(delta), of(delta * h.exp()));
    for k in 0..300 {
        let slope = (more[k].z - less[k].z) / (2.0 * h);
        assert!((exact[k].slope - slope).abs() < 1e-7, "{k}: {} {slope}", exact[k].slope);
    }
    let largest = exact.iter().map(|e| e.slope.abs()).fold(0.0, f64::max);
    assert!(largest > 0.3, "the motion reverses: {largest}");
}

#[test]
fn prop_engagement_follows_motion_and_stays_at_rest() {
    let friction = JointFriction::default();
    let mut engaged = Engagement::default();
    for _ in 0..1000 {
        engaged = friction.engagement(1e-5, engaged);
    }
    assert!(engaged.z > 0.999 && engaged.z <= 1.0);
    assert_eq!(friction.engagement(0.0, engaged), engaged);
    // One step or many: the way counts.
    let halves = friction.engagement(-5e-5, friction.engagement(-5e-5, engaged));
    let whole = friction.engagement(-1e-4, engaged);
    assert!((whole.z - halves.z).abs() < 1e-12 && (whole.slope - halves.slope).abs() < 1e-12);
    assert_eq!(friction.engagement(-1.0, engaged).z, -1.0);
    for wrong in [
        JointFriction {
            presliding: 0.0,
            ..JointFriction::default()
        },
        JointFriction {
            rest_speed: f64::NAN,
            ..JointFriction::default()
        },
        JointFriction {
            stribeck_speed: -1.0,
            ..JointFriction::default()
        },
        JointFriction {
            terms: vec![FrictionTerm::Viscous; 2],
            ..JointFriction::default()
        },
    ] {
        assert!(wrong.validate().is_err());
    }
}

fn identifier() -> RobotIdentifier {
    let model = RobotModel::new(robot(SIX_AXIS), true, vec![JointFriction::default(); 6]).unwrap();
    RobotIdentifier::new(model, IdentifyOptions::default()).unwrap()
}

#[test]
fn fault_samples_that_cannot_be_used_change_nothing() {
    let mut identifier = identifier();
    let at = |t_s: f64| RobotSample {
        t_s,
        ..RobotSample::default()
    };
    assert_eq!(identifier.push(&at(1.0)), Ok(false));
    let mut broken = at(1.01);
    broken.tau[3] = f64::NAN;
    assert_eq!(identifier.push(&broken), Err(SampleFault::NotFinite));
    assert_eq!(identifier.push(&at(f64::INFINITY)), Err(SampleFault::NotFinite));
    assert_eq!(identifier.push(&at(1.0)), Err(SampleFault::NotLater));
    assert_eq!(identifier.push(&at(1.01)), Ok(false));
    // Rest, pauses and nothing at all: estimates stay finite.
    for k in 0..2000 {
        identifier.push(&at(2.0 + 0.01 * f64::from(k))).unwrap();
    }
    identifier.push(&at(500.0)).unwrap();
    identifier.end_of_recording();
    identifier.widen_friction();
    identifier.push(&at(0.0)).unwrap();
    assert!(!identifier.end_of_recording());
    assert!((0..identifier.theta().len()).all(|i| identifier.theta()[i].is_finite() && identifier.theta_std(i) > 0.0));
}

#[test]
fn regress_options_out_of_range_are_refused_in_words() {
    let model = RobotModel::new(robot(SIX_AXIS), true, vec![JointFriction::default(); 6]).unwrap();
    let windows = |length_s: f64, stride_s: f64| IdentifyOptions {
        windows: WindowOptions {
            length_s,
            stride_s,
            ..WindowOptions::default()
        },
        ..IdentifyOptions::default()
    };
    for (options, message) in [
        (windows(0.0, 0.1), "window length: expected a time above 0"),
        (windows(1.0, 0.01), "window stride: expected at least"),
        (windows(f64::NAN, 0.1), "window length"),
        (
            IdentifyOptions {
                block_s: -1.0,
                ..IdentifyOptions::default()
            },
            "block length",
        ),
        (
            IdentifyOptions {
                friction_walk: f64::NAN,
                ..IdentifyOptions::default()
            },
            "friction walk",
        ),
        (
            IdentifyOptions {
                payload_friction: -0.1,
                ..IdentifyOptions::default()
            },
            "payload friction",
        ),
    ] {
        let error = RobotIdentifier::new(model.clone(), options).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
    }
    let error = RobotModel::new(robot(SIX_AXIS), true, vec![JointFriction::default(); 5]).unwrap_err();
    assert!(error.to_string().contains("each of 6 joints, got 5"), "{error}");
}

/// The autocorrelation of a cosine is a cosine: it falls to 1/e after acos(1/e)/2π = 0.190 of its
/// period. Noise forgets itself at once.
#[test]
fn val_a_misfit_is_correlated_for_a_fifth_of_its_period() {
    let model = RobotModel::new(robot(SIX_AXIS), true, vec![JointFriction::default(); 6]).unwrap();
    let theta = vec![0.0; model.parameters().len()];
    let mut rng = TestRng(7);
    let log: Vec<FilteredSample> = (0..10_000)
        .map(|k| {
            let t_s = 0.01 * f64::from(k);
            let mut sample = FilteredSample {
                t_s,
                ..FilteredSample::default()
            };
            sample.tau[0] = (std::f64::consts::TAU * t_s / 2.0).cos();
            sample.tau[1] = rng.between(-1.0, 1.0);
            sample
        })
        .collect();
    // Two samples for the grid and the finite log.
    let slow = correlation_time_s(&model, &theta, &log, 0).unwrap();
    assert!((slow - 0.190 * 2.0).abs() < 0.02, "{slow}");
    assert!((correlation_time_s(&model, &theta, &log, 1).unwrap() - 0.01).abs() < 1e-9);
    assert_eq!(correlation_time_s(&model, &theta, &log, 2), None);
}
