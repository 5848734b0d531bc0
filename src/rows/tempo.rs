//! A clock that runs fast is equivalent to a change of the parameters.
//!
//! ```text
//! s^d g_d(q, s q̇; θ) = g_d(q, q̇; θ s^r)        for every s, at every state, for every term d
//! d g_d + Σ_j q̇_j ∂g_d/∂q̇_j = Σ_i r_i θ_i ∂g_d/∂θ_i                            its slope at s = 1
//! ```
//!
//! If time stamps run faster by the share a, every parameter appears as θ_i (1 + a)^r_i: a back
//! EMF, in V s/rad, has r = 1, an inertia 2. The r are found by least squares over random states
//! and parameters; a plant whose terms have a fixed time scale has none.

use super::passes::{Terms, terms};
use super::probes::probes;
use crate::model::AnyPlant;
use nalgebra::{DMatrix, DVector};

/// Relative step of the differences, whose error is its square.
const STEP: f64 = 1e-4;
/// Largest relative residual: about a hundred times the error of the differences.
const EQUAL: f64 = 1e-5;

/// r of each parameter; `None` if no change of the parameters is equivalent to one of the clock.
pub(super) fn tempo(plant: &dyn AnyPlant) -> Option<Vec<f64>> {
    let count = plant.parameters().len();
    let (mut columns, mut sides) = (Vec::new(), Vec::new());
    for probe in probes(plant) {
        for (e, equation) in plant.equations().iter().enumerate() {
            let at_speed = |s: f64| terms(plant, e, &probe.q, &probe.dq.map(|dq| dq * s), &probe.theta);
            let with_parameter = |i: usize, factor: f64| {
                let mut theta = probe.theta.clone();
                theta[i] *= factor;
                terms(plant, e, &probe.q, &probe.dq, &theta)
            };
            let slope =
                |more: Terms, less: Terms| -> Terms { std::array::from_fn(|d| (more[d] - less[d]) / (2.0 * STEP)) };
            let unchanged = at_speed(1.0);
            let faster = slope(at_speed(1.0 + STEP), at_speed(1.0 - STEP));
            let grown: Vec<Terms> = (0..count)
                .map(|i| slope(with_parameter(i, 1.0 + STEP), with_parameter(i, 1.0 - STEP)))
                .collect();
            for d in 0..=equation.order {
                let side = faster[d] + d as f64 * unchanged[d];
                let size = grown.iter().map(|g| g[d].abs()).sum::<f64>() + side.abs();
                if size > 0.0 {
                    columns.extend(grown.iter().map(|g| g[d] / size));
                    sides.push(side / size);
                }
            }
        }
    }
    let (matrix, side) = (
        DMatrix::from_row_slice(sides.len(), count, &columns),
        DVector::from_vec(sides),
    );
    let r = matrix.clone().svd(true, true).solve(&side, STEP * STEP).ok()?;
    let fits = (&matrix * &r - side).iter().all(|left| left.abs() < EQUAL);
    let mut r: Vec<f64> = r.iter().copied().collect();
    if let Some(delay) = plant.input_delay() {
        r[delay] = 1.0;
    }
    fits.then_some(r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{DriveInput, Manipulator, Motion, ServoAxis};

    /// Powers of the second in the parameters' units, without that of gravity, which does not
    /// change.
    #[test]
    fn val_parameters_change_with_the_second_of_their_units() {
        let close = |found: Option<Vec<f64>>, expected: &[f64]| {
            let found = found.expect("a change of the parameters");
            assert!(
                found.iter().zip(expected).all(|(r, e)| (r - e).abs() < 1e-4),
                "{found:?}"
            );
        };
        close(
            tempo(&Manipulator::default()),
            &[3.0, 3.0, 2.0, 2.0, 1.0, 1.0, 0.0, 1.0, 2.0],
        );
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, 35.0).unwrap();
        close(tempo(&axis), &[2.0, 1.0, 0.0, 0.0]);
    }
}
