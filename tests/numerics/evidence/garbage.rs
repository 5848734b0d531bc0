//! Machines that show nothing, parameters that are fixed wrong, and signals that are garbage.

use super::{N, arm, nothing_dangerous, servo, simulate, still};
use crate::estimator_study::Gauss;
use crate::support::TestRng;
use thetabus::model::{JointSample, MAX_JOINTS};
use thetabus::sim::{MassSchedule, Setpoint};

#[test]
fn fault_a_machine_that_has_stood_still_since_the_start_is_not_usable() {
    let mut resting = arm(1, 25.0, MassSchedule::constant(150.0), "rest");
    resting.plant.sim.initial_q_rad = [0.3; 2];
    let mut axis = servo(1, 25.0);
    axis.plant.sim.setpoint[0] = Setpoint::constant(0.1);
    axis.plant.sim.initial_q_rad[0] = 0.1;
    // through an encoder that flickers by a count, so that nothing looks frozen
    let mut random = TestRng(9);
    for (name, config) in [("arm at rest", resting), ("axis at rest", axis)] {
        let outcome = simulate(name, &config, |_, s| s.q[0] += 5e-8 * (random.bits() % 2) as f64);
        assert_eq!(outcome.use_ok(), 0, "{name}");
    }
}

#[test]
fn fault_parameters_that_are_fixed_wrong_are_not_usable() {
    for (name, factor) in [("arm", 1.5), ("arm", 1.1), ("axis", 1.5), ("axis", 1.1)] {
        let mut config = match name {
            "arm" => arm(1, 30.0, MassSchedule::constant(150.0), "steps"),
            _ => servo(1, 30.0),
        };
        let truth = config.plant.sim.true_parameters(0.0);
        for every in [1, 2] {
            let options = &mut config.estimator.options;
            for (i, (prior, truth)) in options.parameters.iter_mut().zip(&truth).enumerate() {
                (prior.start, prior.fixed) = (truth * factor, i % every == 0);
            }
            options.relations.clear();
            let outcome = simulate(
                &format!("{name}, every {every}. fixed at {factor} times"),
                &config,
                still,
            );
            assert_eq!(outcome.use_ok(), 0, "{}", outcome.name);
        }
    }
}

type Spoil = Box<dyn FnMut(u64, &mut JointSample)>;

fn garbage(seed: u64) -> Vec<(&'static str, Spoil)> {
    let rng = move |k: u64| Gauss(TestRng(seed * 1000 + k));
    let (mut a, mut b, mut d, mut e, mut f) = (rng(1), rng(2), rng(4), rng(5), rng(6));
    let mut past: Vec<JointSample> = Vec::new();
    let mut past_input: Vec<JointSample> = Vec::new();
    vec![
        (
            "input of the wrong sign",
            Box::new(|_, s| s.input.iter_mut().for_each(|u| *u = -*u)),
        ),
        (
            "white noise everywhere",
            Box::new(move |_, s| {
                for j in 0..MAX_JOINTS {
                    (s.q[j], s.input[j]) = (0.5 * a.next(), 20.0 * a.next());
                }
            }),
        ),
        (
            "white noise for input",
            Box::new(move |_, s| s.input.iter_mut().for_each(|u| *u = 5.0 * b.next())),
        ),
        ("zeros", Box::new(|_, s| *s = JointSample::default())),
        (
            "constants",
            Box::new(|_, s| {
                for j in 0..MAX_JOINTS {
                    (s.q[j], s.input[j]) = (0.3, 5.0);
                }
            }),
        ),
        (
            "plus and minus 1e9",
            Box::new(|k, s| {
                let v = if k / 7 % 2 == 0 { 1e9 } else { -1e9 };
                for j in 0..MAX_JOINTS {
                    (s.q[j], s.input[j]) = (v, -v);
                }
            }),
        ),
        (
            "single bits flipped",
            Box::new(move |_, s| {
                for j in 0..MAX_JOINTS {
                    for value in [&mut s.q[j], &mut s.input[j]] {
                        if d.0.bits() % 1000 == 0 {
                            *value = f64::from_bits(value.to_bits() ^ 1 << (d.0.bits() % 64));
                        }
                    }
                }
            }),
        ),
        (
            "positions 50 ms late",
            Box::new(move |_, s| {
                past.push(*s);
                s.q = past[past.len().saturating_sub(51)].q;
            }),
        ),
        (
            "input 50 ms late",
            Box::new(move |_, s| {
                past_input.push(*s);
                s.input = past_input[past_input.len().saturating_sub(51)].input;
            }),
        ),
        (
            "spikes of 1 % in the input",
            Box::new(move |_, s| {
                for u in &mut s.input {
                    if e.0.bits() % 100 == 0 {
                        *u += 50.0 * e.next();
                    }
                }
            }),
        ),
        (
            "spikes of 1 % in the positions",
            Box::new(move |_, s| {
                for q in &mut s.q {
                    if f.0.bits() % 100 == 0 {
                        *q += 0.05 * f.next();
                    }
                }
            }),
        ),
    ]
}

#[test]
fn fault_garbage_never_reaches_use_ok() {
    for (machine, seed) in [("arm", 1), ("axis", 1), ("arm", 2), ("axis", 2)] {
        for (name, mut spoil) in garbage(seed) {
            let config = match machine {
                "arm" => arm(seed, 40.0, MassSchedule::constant(150.0), "steps"),
                _ => servo(seed, 40.0),
            };
            let outcome = simulate(&format!("{machine}, {name}"), &config, &mut spoil);
            nothing_dangerous(&outcome);
            // What stands out of its neighbours is repaired before it becomes a row, and the rest
            // of the samples is right.
            let repaired = name == "single bits flipped" || name.starts_with("spikes");
            assert!(
                repaired || outcome.use_ok() == 0,
                "{}: {} blocks",
                outcome.name,
                outcome.use_ok()
            );
        }
    }
}

#[test]
fn fault_garbage_after_a_good_start_is_never_usable_and_wrong() {
    for machine in ["arm", "axis"] {
        for (what, mut spoil) in garbage(3) {
            let config = match machine {
                "arm" => arm(3, 50.0, MassSchedule::constant(150.0), "steps"),
                _ => servo(3, 50.0),
            };
            let outcome = simulate(&format!("{machine}, late {what}"), &config, move |k, s| {
                if k >= 25 * N as u64 {
                    spoil(k, s);
                }
            });
            nothing_dangerous(&outcome);
            let late = outcome
                .blocks
                .iter()
                .filter(|(e, _)| e.block > 25 && e.use_ok == 1)
                .count();
            let repaired = what == "single bits flipped" || what.starts_with("spikes");
            // An axis without weight that stands still to the bit is one that rests: nothing is
            // learnt, and what was known stays. Levels of 1e9 that last 7 ms leave no row in use
            // either.
            let rests = machine == "axis" && ["zeros", "constants", "plus and minus 1e9"].contains(&what);
            assert!(repaired || rests || late == 0, "{}: {late} blocks", outcome.name);
        }
    }
}
