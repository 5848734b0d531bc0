//! The servo axis with its friction.

use super::*;

/// An axis that is pushed by its offset alone.
fn pushed(offset: f64) -> (SimOptions, ServoAxisOptions) {
    let axis = ServoAxisOptions {
        offset,
        proportional_gain: 0.0,
        derivative_gain: 0.0,
        position_resolution: 0.0,
        ..ServoAxisOptions::emps()
    };
    let options = SimOptions {
        machine: Machine::ServoAxis(axis.clone()),
        ..SimOptions::cedro2022()
    };
    (options, axis)
}

#[test]
fn val_an_axis_under_a_constant_force_follows_the_closed_form() {
    let (options, axis) = pushed(-50.0);
    let end_speed = (50.0 - axis.coulomb_friction) / axis.viscous_friction;
    let rate = axis.viscous_friction / axis.mass.mass_kg(0.0);
    for (k, sample) in MachineSimulator::new(&options).unwrap().take(3000).enumerate() {
        let t = k as f64 * 1e-3;
        let decay = (-rate * t).exp_m1();
        // Runge-Kutta steps of 0.25 ms: (rate h)^5/120 a step, below 1e-17; what is left is
        // rounding of 12 000 sums.
        assert!((sample.dq[0] + end_speed * decay).abs() < 1e-12, "{t}");
        assert!((sample.q[0] - end_speed * (t + decay / rate)).abs() < 1e-12, "{t}");
    }
}

#[test]
fn val_an_axis_sticks_until_friction_is_overcome() {
    let (options, _) = pushed(-20.0);
    assert!(
        MachineSimulator::new(&options)
            .unwrap()
            .take(1000)
            .all(|s| s.q[0] == 0.0 && s.dq[0] == 0.0)
    );
}

#[test]
fn prop_a_moving_axis_obeys_its_model_at_every_sample_and_turns_at_full_stops() {
    let axis = ServoAxisOptions {
        position_resolution: 0.0,
        ..ServoAxisOptions::emps()
    };
    let tones = |amplitude_rad, frequency_hz| Tone {
        amplitude_rad,
        frequency_hz,
        phase_rad: 0.3,
    };
    let sines = Setpoint::Sines {
        offset_rad: 0.0,
        tones: vec![tones(0.05, 0.4), tones(0.008, 1.7)],
    };
    for kind in [ControllerKind::Analog, ControllerKind::Sampled] {
        let mut options = SimOptions {
            machine: Machine::ServoAxis(axis.clone()),
            setpoint: [sines.clone(), sines.clone()],
            ..SimOptions::cedro2022()
        };
        options.controller.kind = kind;
        let plant = AutoDiff(ServoAxis::new(Motion::Linear, DriveInput::Voltage, axis.gain).unwrap());
        let theta = axis.true_theta(0.0);
        let (mut moving, mut stuck) = (0, 0);
        for sample in MachineSimulator::new(&options).unwrap().take(20_000) {
            if sample.dq[0] == 0.0 {
                stuck += 1;
                continue;
            }
            moving += 1;
            let residual = plant.row(0, &plant.features(&sample), &theta, &mut [0.0; 4]);
            // Forces of up to 350 N, each rounded to 1e-16 of it.
            assert!(residual.abs() < 1e-11, "{residual}");
        }
        assert!(moving > 19_000 && stuck > 0, "{moving} moving, {stuck} stuck");
    }
}
