//! Robots whose measured velocities have errors: noise, a filter, or those of the encoder from which
//! a drive computes them. A filter makes them late, which is named.
//!
//! Taken as exact, velocities with noise of 0.02 rad/s made all of 33 usable blocks of one of these
//! runs dangerous (see `left_out.rs`), and differences of encoders of 13 bits 28 of 31.

use super::left_out::{VelocityErrors, run_with, simulation};
use super::{SIX_AXIS, robot};
use thetabus::robot::{JointFriction, RobotSimOptions};

/// Noise \[rad/s\], time constant of a filter \[s\], whether velocities are differences of the
/// positions, and bits of the encoders.
const ERRORS: [(f64, f64, bool, u32); 6] = [
    (0.0, 0.0, false, 20),
    (0.02, 0.0, false, 20),
    (0.05, 0.0, false, 18),
    (0.0, 0.01, false, 20),
    (0.0, 0.0, true, 13),
    (0.0, 0.003, true, 14),
];

#[test]
fn fault_errors_of_measured_velocities_make_nothing_surely_wrong() {
    let terms = JointFriction::default().terms;
    for (noise, filter_s, differs, bits) in ERRORS {
        let mut usable = 0;
        for (has_rests, seed) in [(false, 1), (false, 2), (true, 1), (true, 3)] {
            let sensors = RobotSimOptions {
                encoder_bits: bits,
                ..simulation(has_rests, seed)
            };
            let errors = VelocityErrors {
                noise,
                filter_s,
                differs,
            };
            let run = run_with(&robot(SIX_AXIS), &terms, 1e-4, sensors, 60, Some(errors));
            println!("rests {has_rests}, seed {seed}, {bits} bits, {errors:?}: {run:?}");
            assert_eq!(run.dangerous, 0);
            if filter_s > 0.0 {
                assert!(run.words.contains("ms later than its positions"), "{}", run.words);
            }
            usable += run.usable;
        }
        if filter_s > 0.0 {
            assert_eq!(usable, 0);
            continue;
        }
        // Half of the blocks after the first ten; raw differences of 13 bits are too coarse for
        // more than a third.
        let least = if differs { 60 } else { 100 };
        assert!(usable >= least, "{usable}");
    }
}
