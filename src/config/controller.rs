//! Section `[controller]`: converts its keys to the settings of the controller.

use super::check::{Check, joints};
use super::schema::{FileForm, MachineKind};
use super::sections::{ControllerConfig, EstimatorConfig};
use crate::control::AdaptiveOptions;
use crate::model::MAX_JOINTS;
use crate::node::model::SharedModel;

/// Checks against the model; `None` after reporting a problem.
pub(super) fn controller(
    form: &FileForm,
    model: &SharedModel,
    estimator: &EstimatorConfig,
    check: &mut Check<'_>,
) -> Option<ControllerConfig> {
    let section = &form.control;
    let definition = model.definition();
    let mut fits = true;
    for (key, got, wanted, what) in [
        ("theta", section.theta.len(), definition.parameters.len(), "parameter"),
        ("input_limit", section.input_limit.len(), definition.joints, "joint"),
        (
            "derivative_gain",
            section.derivative_gain.len(),
            definition.joints,
            "joint",
        ),
    ] {
        if got != 0 && got != wanted {
            let name = &definition.name;
            let message = format!("expected {wanted} numbers, one per {what} of {name}, or none, got {got}");
            check.wrong(&format!("controller.{key}"), message);
            fits = false;
        }
    }
    let own_loop = match form.plant.machine {
        MachineKind::Arm => joints(&form.controller.derivative_gain_v_s_per_rad).to_vec(),
        MachineKind::ServoAxis | MachineKind::Model => Vec::new(),
    };
    let damping = match section.derivative_gain.is_empty() {
        true => &own_loop,
        false => &section.derivative_gain,
    };
    let each = |list: &[f64], otherwise: f64| -> [f64; MAX_JOINTS] {
        std::array::from_fn(|joint| list.get(joint).copied().unwrap_or(otherwise))
    };
    fits.then(|| ControllerConfig {
        feed_forward: section.feed_forward,
        theta: match section.theta.is_empty() {
            true => estimator.options.theta_start(),
            false => section.theta.clone(),
        },
        options: AdaptiveOptions {
            max_std: section.max_std,
            blend_s: section.blend_s,
            silence_s: section.silence_s,
            derivative_gain: each(damping, 0.0),
            input_limit: each(&section.input_limit, f64::INFINITY),
        },
        deadline_s: section.deadline_s,
    })
}
