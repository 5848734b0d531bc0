//! Errors of a machine that are drawn from what the identifier considers them to be: if its
//! standard deviations are right, 95 % of its intervals hold the truth.

use super::spread::{normal, spread};
use crate::rows::Considered;
use crate::sim::{ArmSimulator, SensorOptions, SimError, SimOptions, Unmodelled};
use std::f64::consts::TAU;

/// Settings of the simulation of an arm for one draw. A delay, friction and 1/(2π f)² of a
/// resonance have one sign on a machine: they are drawn from half of the normal distribution, which
/// has the same second moment. Heating is the drift, of both windings' resistances.
///
/// # Errors
/// The simulation's options are not valid.
pub fn drawn_errors(sim: &SimOptions, considered: &Considered, seed: u64) -> Result<Vec<String>, SimError> {
    let sizes = input_sizes(sim)?;
    let draw = |place: u64| normal(seed, 60 + place);
    let of_either = |value: &dyn Fn(usize) -> f64| [0, 1].map(value);
    let arm = &sim.arm;
    let friction = of_either(&|joint| {
        let volts = considered.coulomb * sizes[joint] * draw(joint as u64).abs();
        volts * arm.torque_constant_n_m_per_a[joint] / arm.winding_resistance_ohm[joint]
    });
    let offset = of_either(&|joint| considered.offset * sizes[joint] * draw(2 + joint as u64));
    let zero = considered.zero_rad * draw(4);
    let [sine, cosine] = [draw(5), draw(6)].map(|n| considered.eccentricity_rad.unwrap_or(0.0) * n);
    let resonance = match considered.resonance_hz {
        rigid if !(rigid > 0.0) => 0.0,
        hertz => (hertz / draw(7).abs().sqrt()).min(1000.0),
    };
    let fault = |signal: &str, joint: usize, offset: f64| {
        format!("{{kind=\"wrong\",signal=\"{signal}\",joint={joint},from_s=0.0,offset={offset:?}}}")
    };
    let faults = [
        fault("input", 1, offset[0]),
        fault("input", 2, offset[1]),
        fault("q", 2, zero),
    ];
    Ok(vec![
        format!("plant.sensors.input_delay_s={:?}", considered.input_delay_s * draw(8).abs()),
        format!("plant.sensors.resonance_hz={resonance:?}"),
        format!("plant.sensors.eccentricity_rad={:?}", sine.hypot(cosine)),
        format!("plant.sensors.eccentricity_phase_rad={:?}", TAU * spread(seed, 51)),
        format!("plant.unmodelled.coulomb_friction_n_m={friction:?}"),
        format!(
            "plant.unmodelled.heating_share={:?}",
            considered.drift_per_s * sim.duration_s * draw(9)
        ),
        format!("plant.unmodelled.heating_s={:?}", sim.duration_s),
        format!("plant.faults=[{}]", faults.join(",")),
        "plant.substeps=10".to_owned(),
    ])
}

/// Root mean square of each voltage of the machine as its equations say.
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
