//! Section `[estimator]`: the recursion's options, checked against the model.

use super::check::Check;
use super::schema::{BoundsKind, Estimator, FileForm, OutliersKind, RelationsKind, RowsKind};
use super::sections::EstimatorConfig;
use crate::estimator::{
    ChangeDetection, EquationNoise, EstimatorError, EstimatorOptions, Outliers, ParameterPrior, forgetting_factor,
};
use crate::messages::nanoseconds;
use crate::model::Parameter;
use crate::node::model::SharedModel;

pub(super) fn estimator(form: &FileForm, model: &SharedModel, check: &mut Check<'_>) -> Option<EstimatorConfig> {
    let section = &form.estimator;
    let before = check.problems.len();
    let structure = model.structure();
    let names: Vec<&str> = model.parameters().iter().map(|parameter| &*parameter.name).collect();
    // one value applies to a plant of any size, because the file may not know the plant
    let floors = match section.noise_floor.as_slice() {
        [one] => vec![*one; structure.equations.len()],
        floors => floors.to_vec(),
    };
    check_lengths(section, &floors, &names, structure.equations.len(), check);
    check_fixed(section, &names, check);
    let forgetting_factor = factor(form, check);
    if check.problems.len() > before {
        return None;
    }
    let noise = |e: usize| EquationNoise {
        std: listed(&section.noise_std, e, 1.0),
        floor: listed(&floors, e, 0.0),
    };
    let options = EstimatorOptions {
        parameters: priors(section, model.parameters()),
        equations: (0..structure.equations.len()).map(noise).collect(),
        relations: match section.relations {
            RelationsKind::Model => model.definition().relations.clone(),
            RelationsKind::None => Vec::new(),
        },
        forgetting: section.forgetting,
        bound: section.bound,
        forgetting_factor,
        information_floor: section.information_floor,
        max_iterations: section.max_iterations as usize,
        step_factor: section.step_factor,
        noise_floor_relative: section.noise_floor_relative,
        // like all considered errors, only for projected rows
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
            // Rows have their span in nanoseconds.
            margin: nanoseconds(section.change_margin_s),
        }),
    };
    if let Err(error) = options.validate(&structure) {
        refuse(&error, &names, section, check);
        return None;
    }
    Some(EstimatorConfig {
        block_len: section.block_len as usize,
        options,
    })
}

/// Lists have one number per parameter or per equation, or none.
fn check_lengths(section: &Estimator, floors: &[f64], names: &[&str], equations: usize, check: &mut Check<'_>) {
    let (per_parameter, per_equation) = ((names.len(), "parameter"), (equations, "equation"));
    let mut lists = vec![
        ("theta_start", &section.theta_start[..], per_parameter),
        ("start_std", &section.start_std, per_parameter),
        ("random_walk", &section.random_walk, per_parameter),
        ("noise_std", &section.noise_std, per_equation),
        ("noise_floor", floors, per_equation),
    ];
    if section.bounds == BoundsKind::Listed {
        lists.push(("lower", &section.lower, per_parameter));
        lists.push(("upper", &section.upper, per_parameter));
    }
    for (name, list, (len, what)) in lists {
        let got = list.len();
        if got != 0 && got != len {
            let mut message = format!("expected {len} numbers, one per {what} of the model, or none, got {got}");
            if what == "parameter" {
                message += &format!("; the parameters are {}", names.join(", "));
            }
            check.wrong(&format!("estimator.{name}"), message);
        }
    }
}

/// Fixed parameters are some of the model's.
fn check_fixed(section: &Estimator, names: &[&str], check: &mut Check<'_>) {
    for name in section.fixed.iter().filter(|name| !names.contains(&name.as_str())) {
        check.wrong(
            "estimator.fixed",
            format!("expected names out of {}, got \"{name}\"", names.join(", ")),
        );
    }
}

/// The forgetting factor λ, stated or from the time constant; NaN if neither gives one.
fn factor(form: &FileForm, check: &mut Check<'_>) -> f64 {
    let section = &form.estimator;
    match (section.forgetting_factor, section.time_constant_s) {
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
    }
}

/// What is known of each parameter before the first sample.
fn priors(section: &Estimator, parameters: &[Parameter]) -> Vec<ParameterPrior> {
    let prior = |(i, p): (usize, &Parameter)| {
        let start = listed(&section.theta_start, i, p.start);
        let (lower, upper) = match section.bounds {
            BoundsKind::Model => (p.lower, p.upper),
            BoundsKind::Listed => (
                listed(&section.lower, i, f64::NEG_INFINITY),
                listed(&section.upper, i, f64::INFINITY),
            ),
            BoundsKind::None => (f64::NEG_INFINITY, f64::INFINITY),
        };
        let prior = ParameterPrior::new(start)
            .std(listed(&section.start_std, i, start.abs()))
            .within(lower, upper)
            .walking(listed(&section.random_walk, i, 0.0));
        match section.fixed.iter().any(|name| *name == p.name) {
            true => prior.fixed(),
            false => prior,
        }
    };
    parameters.iter().enumerate().map(prior).collect()
}

/// Entry `i` of a list that may be empty.
fn listed(list: &[f64], i: usize, otherwise: f64) -> f64 {
    list.get(i).copied().unwrap_or(otherwise)
}

/// Reports an error of the estimator at the key that was stated, of those that can cause it.
fn refuse(error: &EstimatorError, names: &[&str], section: &Estimator, check: &mut Check<'_>) {
    let (key, message) = estimator_problem(error, names, section);
    let key = match key.as_str() {
        "estimator.theta_start" => check.culprit(&["estimator.theta_start", "estimator.lower", "estimator.upper"]),
        "estimator.forgetting_factor" => {
            check.culprit(&["estimator.forgetting_factor", "estimator.bound", "estimator.forgetting"])
        }
        key => key,
    };
    check.wrong(key, message);
}

/// Key and message for an error of the estimator.
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
