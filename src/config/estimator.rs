//! Section `[estimator]`: the recursion's options, checked against the model.

use super::check::Check;
use super::schema::{BoundsKind, Estimator, FileForm, OutliersKind, RelationsKind, RowsKind};
use super::sections::EstimatorConfig;
use crate::estimator::{ChangeDetection, EstimatorError, EstimatorOptions, Outliers, forgetting_factor};
use crate::messages::nanoseconds;
use crate::node::model::SharedModel;

pub(super) fn estimator(form: &FileForm, model: &SharedModel, check: &mut Check<'_>) -> Option<EstimatorConfig> {
    let section = &form.estimator;
    let before = check.problems.len();
    let parameters = model.parameters();
    let structure = model.structure();
    let (params, equations) = (parameters.len(), structure.equations.len());
    let mut listed = |name: &str, list: &[f64], len: usize, what: &str, otherwise: &dyn Fn(usize) -> f64| -> Vec<f64> {
        if !list.is_empty() && list.len() != len {
            let message = format!(
                "expected {len} numbers, one per {what} of the model, or none, got {}",
                list.len()
            );
            check.wrong(&format!("estimator.{name}"), message);
        }
        if list.is_empty() {
            (0..len).map(otherwise).collect()
        } else {
            list.to_vec()
        }
    };
    let theta_start = listed("theta_start", &section.theta_start, params, "parameter", &|i| {
        parameters[i].start
    });
    let magnitude = |i: usize| theta_start.get(i).map_or(0.0, |v: &f64| v.abs());
    let start_std = listed("start_std", &section.start_std, params, "parameter", &magnitude);
    let random_walk = listed("random_walk", &section.random_walk, params, "parameter", &|_| 0.0);
    let noise_std = listed("noise_std", &section.noise_std, equations, "equation", &|_| 1.0);
    // a plant of any size may have a floor in a file that knows nothing of it
    let floors = match section.noise_floor.as_slice() {
        [one] => vec![*one; equations],
        floors => floors.to_vec(),
    };
    let noise_floor = listed("noise_floor", &floors, equations, "equation", &|_| 0.0);
    let (lower, upper) = match section.bounds {
        BoundsKind::Model => (
            parameters.iter().map(|p| p.lower).collect(),
            parameters.iter().map(|p| p.upper).collect(),
        ),
        BoundsKind::Listed => (
            listed("lower", &section.lower, params, "parameter", &|_| f64::NEG_INFINITY),
            listed("upper", &section.upper, params, "parameter", &|_| f64::INFINITY),
        ),
        BoundsKind::None => (vec![f64::NEG_INFINITY; params], vec![f64::INFINITY; params]),
    };
    let names: Vec<&str> = parameters.iter().map(|parameter| &*parameter.name).collect();
    for name in section.fixed.iter().filter(|name| !names.contains(&name.as_str())) {
        check.wrong(
            "estimator.fixed",
            format!("expected names out of {}, got \"{name}\"", names.join(", ")),
        );
    }
    let fixed = names
        .iter()
        .map(|name| section.fixed.iter().any(|fixed| fixed == name))
        .collect();
    let forgetting_factor = match (section.forgetting_factor, section.time_constant_s) {
        (Some(factor), _) => factor,
        (None, Some(time_constant_s)) => {
            match forgetting_factor(time_constant_s, section.block_len as usize, form.plant.sample_period_s) {
                Ok(factor) => factor,
                Err(error) => {
                    check.wrong("estimator.time_constant_s", format!("{error}"));
                    f64::NAN
                }
            }
        }
        (None, None) => {
            check.wrong(
                "estimator.forgetting_factor",
                "expected this or estimator.time_constant_s, got neither",
            );
            f64::NAN
        }
    };
    if check.problems.len() > before {
        return None;
    }
    let options = EstimatorOptions {
        theta_start,
        start_std,
        lower,
        upper,
        relations: match section.relations {
            RelationsKind::Model => model.definition().relations.clone(),
            RelationsKind::None => Vec::new(),
        },
        fixed,
        forgetting: section.forgetting,
        bound: section.bound,
        forgetting_factor,
        information_floor: section.information_floor,
        max_iterations: section.max_iterations as usize,
        step_factor: section.step_factor,
        noise_std,
        noise_floor,
        noise_floor_relative: section.noise_floor_relative,
        random_walk,
        // as all considered errors, for projected rows
        drift_per_s: match form.identifier.rows {
            RowsKind::Projected => form.considered.drift_per_s,
            RowsKind::Pointwise => 0.0,
        },
        outliers: match section.outliers {
            OutliersKind::Huber => Outliers::Huber(section.huber_limit),
            OutliersKind::Gate => Outliers::Gate(section.gate_limit),
            OutliersKind::Keep => Outliers::Keep,
        },
        change_detection: section.change_detection.then(|| ChangeDetection {
            false_alarm_rate: section.false_alarm_rate,
            // Rows state their span in nanoseconds.
            margin: nanoseconds(section.change_margin_s),
        }),
    };
    if let Err(error) = options.validate(&structure) {
        let (key, message) = estimator_problem(&error, &names, section);
        let key = match key.as_str() {
            "estimator.theta_start" => check.culprit(&["estimator.theta_start", "estimator.lower", "estimator.upper"]),
            "estimator.forgetting_factor" => {
                check.culprit(&["estimator.forgetting_factor", "estimator.bound", "estimator.forgetting"])
            }
            key => key,
        };
        check.wrong(key, message);
        return None;
    }
    Some(EstimatorConfig {
        block_len: section.block_len as usize,
        options,
    })
}

/// Key and message for what the estimator refuses.
fn estimator_problem(error: &EstimatorError, names: &[&str], section: &Estimator) -> (String, String) {
    let name = |index: usize| names.get(index).copied().unwrap_or("?");
    let (option, message) = match error {
        EstimatorError::Length { option, expected, got } => (*option, format!("expected {expected} values, got {got}")),
        EstimatorError::Entry {
            option,
            index,
            expected,
            got,
        } => (*option, format!("expected {expected} for {}, got {got}", name(*index))),
        EstimatorError::Value { option, expected, got } => {
            let option = match *option {
                "forgetting_factor" if section.time_constant_s.is_some() => "time_constant_s",
                "outliers.huber" => "huber_limit",
                "outliers.gate" => "gate_limit",
                option => option,
            };
            let got = if option == "time_constant_s" {
                format!("λ = {got}")
            } else {
                got.to_string()
            };
            (option, format!("expected {expected}, got {got}"))
        }
        EstimatorError::StartOutsideBounds {
            index,
            start,
            lower,
            upper,
        } => (
            "theta_start",
            format!(
                "expected {lower} to {upper} for the start of {}, got {start}",
                name(*index)
            ),
        ),
        EstimatorError::Relation { .. } => ("relations", error.to_string()),
        EstimatorError::Structure { .. } | EstimatorError::UnknownName { .. } => ("forgetting", error.to_string()),
    };
    (format!("estimator.{option}"), message)
}
