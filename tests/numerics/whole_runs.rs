//! Whole runs of the arm in which a value was once usable and wrong, or an alarm or a cause was false,
//! scored as the trials are.

use crate::trials::sources;
use thetabus::config::Config;
use thetabus::messages::Estimate;
use thetabus::studies::trials::{
    Arm, Disturbance, Motion, RandomArmSpec, Trial, TrialResult, TrialSpec, Trouble, rest_instant,
};

/// Seed 25 picks its payload up where a block begins, while both joints rest. That block alone puts
/// θ₂ anywhere, and positions that had been smoothed to agree with it spoke for it: it was usable
/// 20 000 % off, at 300 standard deviations.
#[test]
fn val_a_payload_picked_up_at_rest_leaves_nothing_confidently_wrong() {
    let spec = TrialSpec {
        disturbance: Disturbance::AtRest,
        blocks: 40,
        ..TrialSpec::new(Motion::Rests, 25)
    };
    let mut settings = spec.settings();
    let quiet = Config::load(&sources(), &settings).unwrap().plant.sim;
    let at_s = rest_instant(&quiet, spec.middle_s()).expect("both joints rest");
    settings.push(format!("plant.mass_2.t_s=[0.0, {at_s:?}]"));
    let (result, _) = run(&settings);
    assert_eq!((result.blocks, result.dangerous), (40, 0), "{:?}", result.worst);
    assert_eq!((result.changes, result.detected), (1, 1));
}

/// Half of the payload falls off 0.2 to 0.4 s before a block ends, in smooth motion that hardly
/// shows an inductance. θ₆ then keeps its old value, which the rows since contradict. The open
/// question what had changed widened its covariance for some blocks, and the line that was fitted
/// after that counted as if each of its rows told its end. Both confirmed θ₆: the derived inductance
/// was 40 to 50 % off in 12 blocks of these six runs, at 6 to 10 standard deviations. One block is
/// left, at 6.2: the inductance may become usable again a block before the motion shows it.
#[test]
fn ident_what_a_late_change_has_left_wrong_is_not_confirmed_by_doubt_about_its_cause() {
    let mut dangerous = 0;
    for seed in [9, 18, 25, 26, 34, 37] {
        let spec = TrialSpec {
            arm: Arm::Small,
            disturbance: Disturbance::JumpAtEnd(-50),
            blocks: 60,
            ..TrialSpec::new(Motion::MinimumJerk, seed)
        };
        let (result, _) = run(&spec.settings());
        println!("seed {seed}: {} dangerous, {:?}", result.dangerous, result.worst);
        dangerous += result.dangerous;
        assert_eq!((result.blocks, result.detected), (60, 1), "seed {seed}");
    }
    assert!(dangerous <= 1, "{dangerous} of 360 blocks");
}

/// The payload changes while joint 1 rests. Joint 2 shows it at once, joint 1 only when it moves, in
/// the next block but one. In each of these runs that was announced as a second change.
#[test]
fn prop_a_change_that_shows_late_at_another_joint_is_announced_once() {
    for seed in [107, 113, 119, 122] {
        let spec = TrialSpec {
            blocks: 40,
            ..TrialSpec::new(Motion::MinimumJerk, seed)
        };
        let (result, _) = run(&spec.settings());
        let counts = (result.changes, result.detected, result.false_alarms, result.dangerous);
        assert_eq!(counts, (1, 1, 0, 0), "seed {seed}: {:?}", result.worst);
    }
}

/// A run of the encoder arm: its score, and how many of the last ten estimates may be used.
fn run(settings: &[String]) -> (TrialResult, usize) {
    watched(settings, |_| {})
}

/// The same; every estimate goes to `watch`, too.
fn watched(settings: &[String], mut watch: impl FnMut(&Estimate)) -> (TrialResult, usize) {
    let config = Config::load(&sources(), settings).unwrap();
    let mut node = config.identifier().unwrap();
    let parameters = &config.model.definition().parameters;
    let names: Vec<String> = parameters.iter().map(|p| p.name.to_string()).collect();
    let trial = Trial {
        sim: &config.plant.sim,
        block_len: 1900,
        names: &names,
        known: config.known,
    };
    let mut usable = Vec::new();
    let mut cause = None;
    let result = trial.run(|sample, estimates| {
        node.on_sample(sample, &mut |estimate| {
            usable.push(estimate.use_ok != 0);
            watch(estimate);
            estimates.push(*estimate);
        });
        if !estimates.is_empty() {
            let status = node.status();
            let named = Some(status.error.words()).filter(|words| words.contains("would explain"));
            cause = named.map(str::to_owned).or(cause.take());
        }
    });
    let mut result = result.unwrap();
    result.named_cause = cause;
    let last = usable.iter().rev().take(10).filter(|&&use_ok| use_ok);
    (result, last.count())
}

/// Friction behind an inductance makes θ₃ larger, and the relation θ₁/θ₃ = θ₂/θ₄ then moves θ₂. If
/// standard deviations did not allow for friction as the cause, four blocks would be dangerous.
#[test]
fn fault_a_relation_passes_no_friction_on_as_sure() {
    let spec = RandomArmSpec {
        trouble: Trouble::Viscous,
        blocks: 12,
        seed: 11,
    };
    let (result, _) = run(&spec.trial().settings());
    assert_eq!((result.blocks, result.dangerous), (12, 0), "{:?}", result.worst);
    assert!(result.use_ok > 2, "{} of 12 blocks usable", result.use_ok);
}

/// One block of smooth motion through 13 bits hardly determines the θ of its own weights. If the
/// first blocks were learnt from only once, theta_5 would end more than 80 bounds off in three of
/// these twelve runs, and nine of the 216 quiet blocks would raise an alarm.
#[test]
fn ident_the_first_blocks_through_13_bits_leave_no_error_behind() {
    let (mut alarms, mut quiet, mut far) = (0, 0, 0);
    for motion in [Motion::MinimumJerk, Motion::Trapezoidal] {
        for seed in 0..6 {
            let spec = TrialSpec {
                bits: 13,
                period_us: 500,
                blocks: 20,
                ..TrialSpec::new(motion, seed)
            };
            let (result, _) = run(&spec.settings());
            let score = &result.parameters[4];
            let ratio = (score.squared_ratio / f64::from(score.marks.max(1))).sqrt();
            println!(
                "{} {seed}: {ratio:.1} bounds, {} alarms",
                motion.name(),
                result.false_alarms
            );
            assert_eq!(result.dangerous, 0, "{} {seed}", motion.name());
            assert!(score.marks > 0);
            far += u32::from(ratio > 10.0);
            alarms += result.false_alarms;
            quiet += result.quiet;
        }
    }
    // after a false alarm, the estimate of a run begins anew; one may have one
    assert!(far <= 1, "{far} of 12 runs");
    assert!(alarms * 40 <= quiet, "{alarms} alarms in {quiet} blocks");
}

/// In these runs, the worst of 24, θ₅ was off by 8 to 14 bounds for good if the first blocks were
/// learnt as one in a single pass. It is now off by 2.0 to 3.4.
#[test]
fn ident_passes_over_the_first_blocks_settle_on_one_theta() {
    for seed in [3, 10, 16, 23] {
        let spec = TrialSpec {
            bits: 13,
            blocks: 20,
            ..TrialSpec::new(Motion::Trapezoidal, seed)
        };
        let (result, _) = run(&spec.settings());
        let score = &result.parameters[4];
        let ratio = (score.squared_ratio / f64::from(score.marks)).sqrt();
        println!("{seed}: {ratio:.1} bounds");
        assert!(score.marks > 0 && ratio < 5.0, "{seed}: {ratio} bounds");
        assert_eq!(result.dangerous, 0, "{seed}: {:?}", result.worst);
    }
}

/// Through 13 bits, the acceleration of joints that creep is mostly noise. If that noise counted as
/// information, 53 of these 360 blocks would be dangerous.
#[test]
fn ident_noise_in_the_regressors_of_creeping_joints_is_not_taken_for_knowledge() {
    let (mut dangerous, mut blocks) = (0u64, 0u64);
    for seed in 0..3 {
        let spec = TrialSpec {
            bits: 13,
            period_us: 500,
            blocks: 120,
            ..TrialSpec::new(Motion::Creeping, seed)
        };
        let (result, _) = run(&spec.settings());
        println!("{seed}: {} of {} dangerous", result.dangerous, result.blocks);
        (dangerous, blocks) = (dangerous + result.dangerous, blocks + result.blocks);
    }
    // the payload of one run changes in the last milliseconds of a block, which cannot see it
    assert!(dangerous <= 2, "{dangerous} of {blocks}");
}

/// With a constant torque to estimate, and a joint that stays within 0.5 rad, hardly anything tells
/// the weight from the torque: θ₇ and θ₉ are open along θ₇θ₉ = const. Without the coordinates of
/// `estimator/curvature.rs`, θ₉ is 15 % off at 12 standard deviations in some of these runs,
/// and others never become usable (docs/method.md, section 8).
#[test]
fn ident_a_curve_that_the_data_leave_open_is_not_taken_for_known() {
    for seed in [2, 3, 5, 6] {
        let arm = TrialSpec::new(Motion::Steps, seed).settings();
        let (start, own) = (
            "0.010869565, 0.0104348, 0.01739132, 0.652175, 9.2",
            "0.0652175, 0.104348, 57.5, 0.4",
        );
        let more = [
            "plant.mass_2.t_s=[0.0]".to_owned(),
            "plant.mass_2.mass_kg=[150.0]".to_owned(),
            "plant.setpoint.random.min_rad=[-0.8, -0.5]".to_owned(),
            "plant.setpoint.random.max_rad=[0.8, 0.5]".to_owned(),
            "model.offset=true".to_owned(),
            format!("estimator.theta_start=[{start}, 0.0, {own}, 0.0]"),
        ];
        let settings: Vec<String> = arm.into_iter().chain(more).collect();
        let (result, _) = run(&settings);
        println!(
            "{seed}: {} of {} dangerous, {} usable",
            result.dangerous, result.blocks, result.usable
        );
        assert_eq!(result.dangerous, 0, "seed {seed}");
        // a right model is usable in at least 70 % of what the Cramér-Rao bound puts below 1 %; a
        // run that never becomes usable has 0 %
        assert!(result.knowable_usable * 10 >= result.knowable * 7, "seed {seed}");
    }
}

/// An offset of the recorded voltage at joint 2 and none at joint 1: both are known to millivolts.
/// Measured by itself, an offset near zero would never be known, and the state would be
/// `poorly_excited` for good.
#[test]
fn ident_an_offset_near_zero_is_known_and_usable() {
    for seed in [0, 1] {
        let spec = TrialSpec {
            disturbance: Disturbance::InputOffsetModelled {
                joint: 2,
                millivolts: 50,
            },
            blocks: 40,
            ..TrialSpec::new(Motion::Steps, seed)
        };
        let (result, _) = run(&spec.settings());
        assert_eq!(result.dangerous, 0, "seed {seed}: {:?}", result.worst);
        let open = result.states.iter().find(|(state, _)| *state == "poorly_excited");
        let open = open.map_or(0, |(_, blocks)| *blocks);
        assert!(
            open * 4 <= result.blocks,
            "seed {seed}: {open} of {} blocks",
            result.blocks
        );
        assert!(result.usable * 10 >= result.excited * 9, "seed {seed}");
    }
}

/// If the noise of the relation between the ratios of a winding were charged to viscous friction,
/// which is considered and absent here, θ₅ would have seven times its Cramér–Rao bound. The root
/// mean square over four seeds has a standard deviation of 35 % of its expectation, which is 1
/// bound, so a limit of 2 is three standard deviations away.
#[test]
fn ident_friction_that_is_only_considered_costs_no_accuracy() {
    let (mut squares, mut marks) = (0.0, 0);
    for seed in 0..4 {
        let spec = TrialSpec {
            blocks: 40,
            ..TrialSpec::new(Motion::Multisine, seed)
        };
        let (result, _) = run(&spec.settings());
        assert_eq!(result.dangerous, 0, "seed {seed}");
        squares += result.parameters[4].squared_ratio;
        marks += result.parameters[4].marks;
    }
    let ratio = (squares / f64::from(marks)).sqrt();
    println!("theta_5: {ratio:.2} bounds");
    assert!(marks > 0 && ratio < 2.0, "{ratio}");
}

/// If a joint never moves, its parameters stay unknown, and those of the other joint are usable.
#[test]
fn ident_a_joint_that_never_moves_keeps_only_its_own_parameters_from_use() {
    for (still, own) in [(0, 0..5), (1, 5..9)] {
        let mut settings = TrialSpec::new(Motion::Steps, 1).settings();
        let (mut low, mut high) = ([-1.0, -0.8], [1.0, 0.8]);
        (low[still], high[still]) = (0.0, 0.0);
        settings.push(format!("plant.setpoint.random.min_rad={low:?}"));
        settings.push(format!("plant.setpoint.random.max_rad={high:?}"));
        let (mut used, mut of_the_other) = (false, false);
        let (result, last) = watched(&settings, |estimate| {
            let usable = |i: usize| estimate.is_usable(i);
            used |= own.clone().any(usable);
            of_the_other |= (0..9).filter(|i| !own.contains(i)).any(usable);
        });
        assert_eq!((result.dangerous, last), (0, 10), "joint {}", still + 1);
        assert!(!used && of_the_other, "joint {}", still + 1);
    }
}

/// The noise of the input is in the residual and in the column of a resonance. Without
/// `column_noise.rs` each of these runs ends with a resonance that the arm does not have.
#[test]
fn ident_a_right_model_lacks_no_resonance() {
    for seed in 0..4 {
        let spec = TrialSpec {
            arm: Arm::Small,
            ..TrialSpec::new(Motion::MinimumJerk, seed)
        };
        let (result, last) = run(&spec.settings());
        let named = result.named_cause.unwrap_or_default();
        assert!(last == 10 && !named.contains("resonance"), "seed {seed}: {named}");
    }
}

/// Slow motion holds the rounding error of a position for many samples, and a payload that is picked
/// up meanwhile looks like an offset. Without the rules for both, each of these 8 runs ends with a cause
/// that the arm does not have. 3 of the 16 runs of `docs/trials.md` still do, and these 8 are among them.
#[test]
fn ident_slow_motion_of_a_right_model_is_seldom_said_to_lack_a_term() {
    let mut named = Vec::new();
    for motion in [Motion::Creeping, Motion::Tiny] {
        for seed in 0..4 {
            let (result, _) = run(&TrialSpec::new(motion, seed).settings());
            let last = result.named_cause;
            named.extend(last.filter(|words| !words.starts_with("changed parameters or ")));
        }
    }
    assert!(named.len() <= 3, "{named:?}");
}

/// Friction of 1.2 % of the voltage, which is R b/kₘ more back EMF. No motion tells them apart, so
/// without `identifier.considered.friction_in_back_emf` most blocks are dangerous.
#[test]
fn ident_friction_that_a_back_emf_contains_is_allowed_for() {
    let dangerous = |more: &[&str]| {
        let spec = TrialSpec {
            arm: Arm::Small,
            blocks: 20,
            ..TrialSpec::new(Motion::MinimumJerk, 1)
        };
        let mut settings = spec.settings();
        settings.push("plant.unmodelled.viscous_friction_n_m_s_per_rad=[0.6, 0.6]".to_owned());
        settings.extend(more.iter().map(|setting| (*setting).to_owned()));
        run(&settings).0.dangerous
    };
    assert_eq!(dangerous(&[]), 0);
    assert!(dangerous(&["identifier.considered.friction_in_back_emf=0.0"]) > 5);
}

/// In slow motion a small arm's inertia and an estimated delay look alike, and the rows are not linear
/// in the delay. With `input_delay_limit_s = 5e-3` two of these runs have 14 dangerous blocks.
#[test]
fn ident_a_delay_that_slow_motion_hardly_shows_is_not_taken_for_known() {
    for seed in 0..6 {
        let spec = TrialSpec {
            arm: Arm::Small,
            disturbance: Disturbance::DelayEstimated(150),
            blocks: 40,
            ..TrialSpec::new(Motion::MinimumJerk, seed)
        };
        let mut settings = spec.settings();
        settings.push("plant.setpoint.moves.min_move_s=[1.2, 1.2]".to_owned());
        settings.push("plant.setpoint.moves.max_move_s=[3.0, 3.0]".to_owned());
        let (result, last) = run(&settings);
        assert!(last == 10 && result.dangerous == 0, "seed {seed}: {:?}", result.worst);
    }
}

/// Each parameter of an equation follows the gain of its drive, without a residual: without the
/// cause_search the estimate would be wrong by as much, at hundreds of standard deviations. A payload
/// moves some of them only.
#[test]
fn prop_a_drive_or_sensor_that_changes_is_not_taken_for_the_plant() {
    for motion in [Motion::Steps, Motion::MinimumJerk] {
        for disturbance in Disturbance::SENSOR.into_iter().chain(Disturbance::OTHER) {
            let spec = TrialSpec {
                disturbance,
                blocks: 40,
                ..TrialSpec::new(motion, 2)
            };
            let (result, _) = run(&spec.settings());
            let name = format!("{} {}", motion.name(), disturbance.name());
            // a slip of 3 mrad may be too small to show at once: 7 of 640 blocks in docs/trials.md
            let slips = if name.contains("zero_2_later_3mrad") { 3 } else { 0 };
            assert!(result.dangerous <= slips, "{name}: {:?}", result.worst);
        }
    }
    // a payload that is picked up later does not clear up what a drive has done before
    let spec = TrialSpec {
        disturbance: Disturbance::SENSOR[1],
        blocks: 40,
        ..TrialSpec::new(Motion::MinimumJerk, 2)
    };
    let mut settings = spec.settings();
    settings.push("plant.mass_2.t_s=[0.0, 60.0]".to_owned());
    settings.push("plant.mass_2.mass_kg=[150.0, 170.0]".to_owned());
    let (result, used) = run(&settings);
    assert_eq!((result.dangerous, used), (0, 0), "{:?}", result.worst);
    for percent in [-50, 13] {
        let spec = TrialSpec {
            disturbance: Disturbance::Jump(percent),
            blocks: 40,
            ..TrialSpec::new(Motion::MinimumJerk, 1)
        };
        let (result, used) = run(&spec.settings());
        assert_eq!((result.dangerous, result.detected, used), (0, 1, 10), "{percent} %");
    }
}

/// An offset of the drive explains a payload of 1 % as well as the payload does, for as long as the
/// arm moves like this. σ then covers both, and the estimate stays in use.
#[test]
fn ident_a_small_payload_that_an_offset_would_explain_does_not_silence_the_service() {
    for motion in [Motion::MinimumJerk, Motion::Trapezoidal] {
        let mut settings = TrialSpec::new(motion, 2).settings();
        settings.push("plant.mass_2.mass_kg=[150.0, 151.5]".to_owned());
        let (result, used) = run(&settings);
        assert_eq!(
            (result.dangerous, used),
            (0, 10),
            "{}: {:?}",
            motion.name(),
            result.worst
        );
    }
}
