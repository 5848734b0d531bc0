//! An error of a machine drawn from the identifier's prior: if its standard deviations are right,
//! at least 95 % of its intervals contain the truth.

use super::spread::{normal, spread};
use crate::rows::Considered;
use crate::sim::{ArmSimulator, SensorOptions, SimError, SimOptions, Unmodelled};
use std::f64::consts::TAU;

/// Settings of the simulation of an arm with one error, of a kind that the seed chooses. A delay,
/// friction, the inertia of a rotor and 1/(2π f)² of a resonance have one sign on a machine: they
/// are drawn from half of the normal distribution, which has the same second moment. Heating is the
/// drift, of both windings' resistances.
///
/// # Errors
/// If the simulation's options are invalid.
pub fn drawn_errors(sim: &SimOptions, considered: &Considered, seed: u64) -> Result<Vec<String>, SimError> {
    let sizes = input_sizes(sim)?;
    let draw = |place: u64| normal(seed, 60 + place);
    let fault = |signal: &str, joint: usize, offset: f64| {
        format!("{{kind=\"wrong\",signal=\"{signal}\",joint={joint},from_s=0.0,offset={offset:?}}}")
    };
    Ok(match seed % 8 {
        0 => vec![format!(
            "plant.sensors.input_delay_s={:?}",
            considered.input_delay_std_s(sim.sample_period_s) * draw(0).abs()
        )],
        1 => {
            let arm = &sim.arm;
            let friction = [0, 1].map(|joint| {
                let volts = considered.coulomb * sizes[joint] * draw(joint as u64).abs();
                volts * arm.torque_constant_n_m_per_a[joint] / arm.winding_resistance_ohm[joint]
            });
            vec![
                format!("plant.unmodelled.coulomb_friction_n_m={friction:?}"),
                "plant.substeps=10".to_owned(),
            ]
        }
        2 => {
            let offset = [0, 1].map(|joint| considered.offset * sizes[joint] * draw(joint as u64));
            let faults = [fault("input", 1, offset[0]), fault("input", 2, offset[1])];
            vec![format!("plant.faults=[{}]", faults.join(","))]
        }
        3 => vec![format!(
            "plant.faults=[{}]",
            fault("q", 2, considered.zero_rad * draw(0))
        )],
        4 => {
            let size = considered.eccentricity_rad;
            vec![
                format!("plant.sensors.eccentricity_rad={:?}", size * draw(0).hypot(draw(1))),
                format!("plant.sensors.eccentricity_phase_rad={:?}", TAU * spread(seed, 51)),
            ]
        }
        5 => {
            let hertz = considered.resonance_hz / draw(0).abs().sqrt();
            vec![format!("plant.sensors.resonance_hz={:?}", hertz.min(1000.0))]
        }
        6 => {
            let (arm, mass_kg) = (&sim.arm, sim.mass_2.mass_kg(0.0));
            let own = mass_kg * arm.length_2_m.powi(2) / 3.0;
            let rotor = [0.0, considered.inertia * own * draw(0).abs()];
            vec![format!("plant.unmodelled.rotor_inertia_kg_m2={rotor:?}")]
        }
        _ => {
            let share = considered.drift_per_s * sim.duration_s * draw(0);
            vec![
                format!("plant.unmodelled.heating_share={share:?}"),
                format!("plant.unmodelled.heating_s={:?}", sim.duration_s),
            ]
        }
    })
}

/// Root mean square of each voltage of the machine without the error.
fn input_sizes(sim: &SimOptions) -> Result<[f64; 2], SimError> {
    let exact = SimOptions {
        sensors: SensorOptions::exact(),
        unmodelled: Unmodelled::none(),
        faults: Vec::new(),
        ..sim.clone()
    };
    let mut sums = [0.0; 2];
    let count = sim.sample_count();
    for sample in ArmSimulator::new(&exact)?.take(count as usize) {
        for (sum, u) in sums.iter_mut().zip(sample.input) {
            *sum += u * u;
        }
    }
    Ok(sums.map(|sum| (sum / count.max(1) as f64).sqrt()))
}
