//! Finds by evaluation which terms a plant's equations have: friction with a jump, a constant, a
//! spring, an inertia.

use super::passes::{Terms, terms};
use crate::model::{AnyPlant, MAX_JOINTS};

/// Parameters that are all different from 0.
fn some_theta(plant: &dyn AnyPlant) -> Vec<f64> {
    let start = plant.parameters().iter().map(|p| p.start);
    start.map(|start| if start != 0.0 { start } else { 1.0 }).collect()
}

/// True if an equation jumps when a joint begins to move: the model has Coulomb friction or
/// something similar, however small beside its other terms. Otherwise a column would treat that
/// friction as an error. `standstill.rs` asks for less and for more: for jumps large enough to
/// spoil a row at rest, but also for those of terms that are differentiated.
pub(super) fn has_jump(plant: &dyn AnyPlant, equation: usize, joint: usize) -> bool {
    let theta = some_theta(plant);
    let at = |speed: f64| {
        let mut dq = [0.0; MAX_JOINTS];
        dq[joint] = speed;
        terms(plant, equation, &[0.3; MAX_JOINTS], &dq, &theta)[0]
    };
    let step = |speed: f64| (at(speed) - at(-speed)).abs();
    // a continuous term shrinks with the speed
    step(1e-9) > 1e-3 * step(1e-3)
}

/// True if an equation has the [`term`].
pub(super) fn has_term(plant: &dyn AnyPlant, equation: usize, d: usize, shape: impl Fn(&[f64], &[f64]) -> f64) -> bool {
    term(plant, equation, d, shape).is_some()
}

/// The parameter k of an equation that is the factor of this function of the positions and
/// velocities, and the constant c: ∂g_d/∂θ_k is c times the function for any motion, and ∂g_r/∂θ_k
/// = 0 for r ≠ d.
pub(super) fn term(
    plant: &dyn AnyPlant,
    equation: usize,
    d: usize,
    shape: impl Fn(&[f64], &[f64]) -> f64,
) -> Option<(usize, f64)> {
    let start = some_theta(plant);
    let positions = |state: f64| std::array::from_fn::<f64, MAX_JOINTS, _>(|j| (state * (1.0 + j as f64)).sin());
    let velocities = |state: f64| std::array::from_fn::<f64, MAX_JOINTS, _>(|j| (1.7 * state * (1.0 + j as f64)).cos());
    let at = |state: f64, theta: &[f64]| terms(plant, equation, &positions(state), &velocities(state), theta);
    plant.equations()[equation].parameters.clone().find_map(|k| {
        let mut moved = start.clone();
        moved[k] += 1e-3 * start[k].abs();
        // ∂g/∂θ_k divided by the function
        let factor = |state: f64| -> Terms {
            let (from, to) = (at(state, &start), at(state, &moved));
            let divisor = (moved[k] - start[k]) * shape(&positions(state), &velocities(state));
            std::array::from_fn(|r| (to[r] - from[r]) / divisor)
        };
        let first = factor(0.3)[d];
        let is_same = |state: f64| {
            let mut rest = factor(state);
            rest[d] -= first;
            rest.iter().all(|g| g.abs() < 1e-6 * first.abs())
        };
        let is_term = first != 0.0 && [0.3, 1.1, 2.9].into_iter().all(is_same);
        is_term.then_some((k, first))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{DriveInput, Manipulator, Motion, ServoAxis};

    /// Otherwise a column would treat a term of the model as an error.
    #[test]
    fn val_a_model_that_has_a_term_is_told_from_one_that_lacks_it() {
        let arm = Manipulator::default();
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, 35.0).unwrap();
        for equation in 0..2 {
            assert!(!has_term(&arm, equation, 0, |_, _| 1.0) && !has_jump(&arm, equation, equation));
        }
        // the axis has an offset and Coulomb friction, and no spring
        assert!(has_term(&axis, 0, 0, |_, _| 1.0) && has_jump(&axis, 0, 0));
        assert!(!has_term(&axis, 0, 0, |q, _| q[0]));
        // θ₈ is the back EMF of joint 2, whose equation is multiplied by 12
        let (parameter, factor) = term(&arm, 1, 0, |_, dq| dq[1]).unwrap();
        assert!(parameter == 7 && (factor - 12.0).abs() < 1e-6, "{parameter} {factor}");
    }
}
