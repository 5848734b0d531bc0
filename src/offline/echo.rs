//! Inputs that are no inputs: the column repeats the position or the velocity of its own joint, in
//! this unit or in another that is usual.
//!
//! ```text
//! min_c Σ (u_k − c x_k)² < ε² Σ (u_k − mean u)²,  x: q or q̇,  |c| within 1 % of a usual factor      (1)
//! ```
//!
//! A spring gives an input in proportion to q, and a motor without load one in proportion to q̇, so
//! (1) needs the factor as well: that of a machine is any number. The input of a model may be a
//! velocity; only those of drives are judged.

use std::f64::consts::PI;
use std::fmt;

/// ε of (1): as for the torques of a robot.
const NEARLY: f64 = 0.03;
/// Largest relative difference of c from a usual factor.
const SAME: f64 = 0.01;
/// Usual factors, of angles, lengths and their rates per SI unit: the unit itself, degrees, turns,
/// turns per minute; centimetres, millimetres and micrometres; metres and millimetres per minute.
const FACTORS: [f64; 9] = [1.0, 180.0 / PI, 0.5 / PI, 30.0 / PI, 1e2, 1e3, 1e6, 60.0, 60e3];

/// The signal that a column of inputs repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputEcho {
    /// q.
    Position,
    /// q̇.
    Velocity,
}

impl fmt::Display for InputEcho {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
        })
    }
}

/// The sums of (1) for one joint.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct EchoSums {
    n: f64,
    u: f64,
    uu: f64,
    /// Σ u x and Σ x², of q and of q̇.
    ux: [f64; 2],
    xx: [f64; 2],
}

impl EchoSums {
    /// Adds position, velocity and input of the same instant.
    pub(super) fn add(&mut self, [q, dq]: [f64; 2], u: f64) {
        (self.n, self.u, self.uu) = (self.n + 1.0, self.u + u, self.uu + u * u);
        for (i, x) in [q, dq].into_iter().enumerate() {
            self.ux[i] += u * x;
            self.xx[i] += x * x;
        }
    }

    /// (1) for inputs of this unit \[SI units\].
    pub(super) fn of(&self, input_unit: f64) -> Option<InputEcho> {
        let echoes = [InputEcho::Position, InputEcho::Velocity];
        let spread = self.uu - self.u * self.u / self.n;
        let is = |i: usize| {
            let factor = (self.ux[i] / self.xx[i] / input_unit).abs();
            let usual = FACTORS.iter().any(|known| (factor / known - 1.0).abs() < SAME);
            usual && self.uu - self.ux[i] * self.ux[i] / self.xx[i] < NEARLY * NEARLY * spread // (1)
        };
        (0..2).find(|i| is(*i)).map(|i| echoes[i])
    }
}

#[cfg(test)]
mod tests {
    use super::super::InputSign;
    use super::*;
    use crate::config::Config;
    use crate::messages::Sample;
    use crate::sim::MachineSimulator;

    /// What the input repeats over 15 s of a simulated axis, if `input` makes it from position,
    /// velocity and the true input.
    fn echo(sets: &[&str], input_unit: f64, input: fn(f64, f64, f64) -> f64) -> Option<InputEcho> {
        let source = Config::embedded("servo_axis").expect("built in");
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        let config = Config::load(&[source], &sets).expect("valid");
        let mut found = InputSign::new(1);
        let simulator = MachineSimulator::new(&config.plant.sim).expect("valid");
        let mut before = None;
        for (k, s) in simulator.take(15_000).enumerate() {
            let mut sample = Sample::new(1, k as u64, k as u64 * 1_000_000, 1, 0, &s);
            let q = sample.q[0];
            let dq = (q - before.replace(q).unwrap_or(q)) * 1e3;
            sample.input[0] = input_unit * input(q, dq, sample.input[0]);
            found.take(&sample);
        }
        found.echo(0, input_unit)
    }

    const ENCODER: &str = "plant.sensors.encoder_bits=20";
    /// Hardly a mass and no friction but the viscous one: input and velocity are nearly in
    /// proportion.
    const LIGHT: [&str; 4] = [
        "plant.servo_axis.mass=[0.5]",
        "plant.servo_axis.coulomb_friction=0.0",
        "plant.servo_axis.offset=0.0",
        "plant.servo_axis.proportional_gain=1000.0",
    ];

    #[test]
    fn regress_an_input_that_repeats_position_or_velocity_is_named_in_every_usual_unit() {
        for unit in [1.0, -1.0, 0.001] {
            assert_eq!(echo(&[], unit, |q, _, _| q), Some(InputEcho::Position));
            assert_eq!(echo(&[], unit, |_, dq, _| dq), Some(InputEcho::Velocity));
            assert_eq!(echo(&[ENCODER], unit, |q, _, _| q * 1e3), Some(InputEcho::Position));
            assert_eq!(
                echo(&[ENCODER], unit, |_, dq, _| dq * 30.0 / PI),
                Some(InputEcho::Velocity)
            );
        }
    }

    #[test]
    fn val_no_simulated_axis_is_suspected_whatever_its_gains() {
        for sets in [
            &[][..],
            &["plant.sensors.input_noise_v=0.0"],
            &["plant.setpoint.kind=random"],
            &["plant.servo_axis.proportional_gain=4000.0"],
            &["plant.servo_axis.gain=350.0"],
            &["plant.servo_axis.viscous_friction=2000.0"],
            &["plant.servo_axis.coulomb_friction=0.0"],
            &LIGHT,
        ] {
            assert_eq!(echo(sets, 1.0, |_, _, u| u), None, "{sets:?}");
        }
        // A spring, and a motor without load: in proportion, but by any factor.
        assert_eq!(echo(&[], 1.0, |q, _, _| 37.0 * q), None);
        assert_eq!(echo(&[], 1.0, |_, dq, _| 5.79 * dq), None);
    }

    #[test]
    fn fault_an_axis_that_rests_repeats_nothing() {
        assert_eq!(echo(&[], 1.0, |_, _, _| 0.0), None);
        assert_eq!(echo(&[], 1.0, |_, _, _| 1.0), None);
        assert_eq!(echo(&[], 1.0, |_, _, _| f64::NAN), None);
    }
}
