//! Changes at rest, near the end of a block, between two streams, and of the supply.

use super::{Outcome, arm, arm_with, identifier, nothing_dangerous, simulate, steps_with_rest, still};
use crate::support::TestRng;
use thetabus::config::Config;
use thetabus::messages::{Estimate, Sample};
use thetabus::model::JointSample;
use thetabus::node::command::NodeState;
use thetabus::node::identifier::Identifier;
use thetabus::sim::{MachineSimulator, MassSchedule, Setpoint};

#[test]
fn ident_after_a_payload_is_picked_up_at_rest_only_what_the_data_have_shown_since_is_usable() {
    let rest_s = (60.0, 87.0);
    for (seed, then_kg) in [(1, 170.0), (2, 170.0), (3, 153.0), (4, 130.0), (5, 225.0)] {
        let mut config = arm(seed, 60.0, MassSchedule::jump(150.0, 72.0, then_kg), "steps");
        let mut random = TestRng(seed + 100);
        let duration_s = config.plant.sim.duration_s;
        config.plant.sim.setpoint = [1.0, 0.8].map(|reach| steps_with_rest(&mut random, reach, duration_s, rest_s));
        let outcome = simulate(&format!("payload at rest, {then_kg} kg"), &config, still);
        nothing_dangerous(&outcome);
        let at_rest: Vec<_> = outcome
            .blocks
            .iter()
            .filter(|(e, _)| (72.0..rest_s.1).contains(&(e.t_last_ns as f64 * 1e-9)))
            .collect();
        for (e, truth) in &at_rest {
            for i in [1, 3] {
                assert!(!e.is_usable(i), "block {}: nothing showed theta_{}", e.block, i + 1);
            }
            // a block or two after the change what holds the weight is known again, with or without
            // motion
            assert!((e.t_last_ns as f64) < 79e9 || (e.theta[6] / truth[6] - 1.0).abs() < 0.01);
        }
        assert!(at_rest.len() > 6);
        // the motion brings everything back: a joint of sines or steps knows theta_4 to 1 % in a
        // few blocks
        let (last, _) = outcome.blocks.last().expect("blocks");
        assert!(last.is_usable(3) && last.is_usable(1) && last.is_usable(6));
    }
}

#[test]
fn fault_what_changed_between_two_streams_is_not_usable_until_the_second_shows_it() {
    // An arm at rest gives no information about joint 1, whose axis is vertical: nothing in the
    // second stream shows that its winding has become warmer.
    for (seed, warmer, moves) in [(1, 0.02, false), (2, 0.05, false), (3, 0.2, false), (4, 0.05, true)] {
        for restarted in [false, true] {
            let first = arm(seed, 20.0, MassSchedule::constant(150.0), "sines");
            let mut second = arm(seed + 50, 12.0, MassSchedule::constant(150.0), "steps");
            let sim = &mut second.plant.sim;
            sim.arm.winding_resistance_ohm[0] *= 1.0 + warmer;
            if !moves {
                (sim.setpoint, sim.initial_q_rad) = ([0.0, 0.3].map(Setpoint::constant), [0.0, 0.3]);
            }
            let mut outcome = Outcome {
                name: format!("winding warmer by {warmer}, moves {moves}, identifier restarted {restarted}"),
                ..Outcome::default()
            };
            let mut node = identifier(&first);
            let mut learn = |node: &mut Box<dyn Identifier>, stream_id: u64, config: &Config| {
                let sim = &config.plant.sim;
                let samples = MachineSimulator::new(sim).unwrap().take(sim.sample_count() as usize);
                for (seq, sample) in (0u64..).zip(samples) {
                    let sample = Sample::new(stream_id, seq, seq * 1_000_000, 2, sim.signals(), &sample);
                    node.on_sample(&sample, &mut |e: &Estimate| {
                        let truth = sim.true_parameters(e.t_last_ns as f64 * 1e-9);
                        outcome.blocks.push((*e, truth));
                    });
                }
            };
            learn(&mut node, 1, &first);
            if restarted {
                let mut state = NodeState::default();
                node.save(&mut state);
                node = identifier(&first);
                node.load(&state).unwrap();
            }
            learn(&mut node, 2, &second);
            outcome.blocks.drain(..20);
            nothing_dangerous(outcome.tell());
            let (last, _) = outcome.blocks.last().expect("blocks");
            assert_eq!(last.is_usable(3), moves, "{}", outcome.name);
            // the parameters of the weight are seen at rest, too
            assert!(last.is_usable(6), "{}", outcome.name);
        }
    }
}

#[test]
fn fault_a_supply_that_sags_for_both_drives_at_once_makes_nothing_surely_wrong() {
    // No single error explains what both joints see. 3 % of each parameter are 500 of its sigma.
    for motion in ["steps", "sines"] {
        for seed in 0..2 {
            let config = arm(seed, 32.0, MassSchedule::constant(150.0), motion);
            let sagged = |k: u64, s: &mut JointSample| {
                if k >= 30_300 {
                    s.input[0] *= 1.03;
                    s.input[1] *= 1.03;
                }
            };
            let outcome = simulate(&format!("{motion}, supply sags, seed {seed}"), &config, sagged);
            nothing_dangerous(&outcome);
            assert!(outcome.use_ok() > 5, "silence is no honesty");
        }
    }
}

#[test]
fn ident_a_jump_anywhere_in_a_block_is_never_published_as_usable_and_wrong() {
    for motion in ["steps", "sines"] {
        // In 25 ms an arm that holds still sinks by ½ Δq̈ t² = 0.5 mrad, 20 standard deviations of
        // a position, of which three free values of the state at the start of the window take most:
        // 12 standard deviations are left of the 6 that are needed. In 15 ms it would be 6.
        let tenths = (1..=19).map(|tenth| 100 * tenth);
        for (seed, before_ms) in [25u32, 40, 55, 70, 85].into_iter().chain(tenths).enumerate() {
            let at_s = 20.0 * 1.9 - 1e-3 * f64::from(before_ms);
            let config = arm(seed as u64, 26.0, MassSchedule::jump(150.0, at_s, 170.0), motion);
            let outcome = simulate(&format!("{motion}, jump {before_ms} ms before the end"), &config, still);
            nothing_dangerous(&outcome);
            let (last, _) = outcome.blocks.last().expect("blocks");
            // sines hardly show what tells viscous friction at joint 1 from inertia
            let is_seen = last.is_usable(3) || motion == "sines";
            assert!(last.is_usable(6) && is_seen, "{}", outcome.name);
        }
    }
}

/// In a window of 30 ms the arm sinks by no more than its encoder's noise. If the windows at the end
/// were as short as the regular ones, the jumps 30 and 35 ms before it would be confidently missed.
#[test]
fn ident_short_windows_do_not_hide_a_jump_near_the_end_of_a_block() {
    let short = [
        "identifier.projected.window_s=0.03",
        "identifier.projected.stride_s=0.006",
    ];
    for (seed, before_ms) in [30u32, 35, 40, 45, 50, 60, 75].into_iter().enumerate() {
        let at_s = 12.0 * 1.9 - 1e-3 * f64::from(before_ms);
        let mass_2 = MassSchedule::jump(150.0, at_s, 170.0);
        let config = arm_with(&short, seed as u64, 16.0, mass_2, "steps");
        nothing_dangerous(&simulate(
            &format!("jump {before_ms} ms before the end"),
            &config,
            still,
        ));
    }
}
