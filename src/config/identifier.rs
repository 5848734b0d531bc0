//! Section `[identifier]` and its subsections: how samples become rows.

use super::check::Check;
use super::schema::{Automatic, FileForm, InputKind, RealOr, RowsKind};
use super::sections::IdentifierConfig;
use crate::model::{MAX_JOINTS, PdController};
use crate::node::model::SharedModel;
use crate::rows::{
    Considered, InputSource, ProjectedError, ProjectedOptions, RowForm, SensorNoise, auto_window_first,
    auto_window_lengths,
};

/// A list with one number per joint of the model, or one for all. A longer one is accepted, so that
/// an arm's files work for a single axis.
fn per_joint(key: &str, list: &[f64], otherwise: f64, joints: usize, check: &mut Check<'_>) -> [f64; MAX_JOINTS] {
    if (2..joints).contains(&list.len()) {
        let message = format!("expected one number, or {joints}, one per joint, got {}", list.len());
        check.wrong(key, message);
    }
    std::array::from_fn(|joint| match list {
        [one] => *one,
        list => list.get(joint).copied().unwrap_or(otherwise),
    })
}

/// A gain for each joint of the model, 0 for further ones: a missing gain would give inputs of 0 V.
/// A longer list is accepted, so that an arm's files work for a single axis.
fn gains(name: &str, list: &[f64], joints: usize, check: &mut Check<'_>) -> Option<[f64; MAX_JOINTS]> {
    let Some(own) = list.get(..joints) else {
        let message = format!(
            "expected {joints} numbers, one per joint of the model, got {}",
            list.len()
        );
        check.wrong(&format!("identifier.{name}"), message);
        return None;
    };
    let mut gains = [0.0; MAX_JOINTS];
    gains[..joints].copy_from_slice(own);
    Some(gains)
}

/// The considered errors.
fn considered(form: &FileForm) -> Considered {
    let section = &form.considered;
    Considered {
        input_delay_s: section.input_delay_s,
        gain: section.gain,
        coulomb: section.coulomb,
        stribeck: section.stribeck,
        offset: section.offset,
        dead_band: section.dead_band,
        spring: section.spring,
        gain_by_direction: section.gain_by_direction,
        viscous_by_direction: section.viscous_by_direction,
        load_friction: section.load_friction,
        inertia: section.inertia,
        viscous: section.viscous,
        friction_in_back_emf: section.friction_in_back_emf,
        resonance_hz: section.resonance_hz,
        drift_per_s: section.drift_per_s,
        zero_rad: section.zero_rad,
        eccentricity_rad: section.eccentricity_rad,
    }
}

/// Samples on either side of the velocity filter. Its duration matters: with the same number of
/// samples at a lower rate, it would smooth away the fastest motion. The polynomial of order 5
/// needs 3 at any rate.
fn velocity_half_width(half_width_s: f64, sample_period_s: f64, check: &mut Check<'_>) -> Option<usize> {
    let periods = (half_width_s / sample_period_s).round();
    if periods > 100.0 {
        let message = format!("expected at most 100 sample periods, got {half_width_s} s, which are {periods}");
        check.wrong("identifier.projected.velocity_half_width_s", message);
        return None;
    }
    Some((periods as usize).max(3))
}

/// Decides whether the noise is learnt; if the key is not stated, this depends on which levels are
/// set. A written configuration contains the decision, so it is the same when read again.
pub(super) fn decide_on_noise(form: &mut FileForm, check: &mut Check<'_>) {
    if form.identifier.rows == RowsKind::Pointwise {
        return;
    }
    let section = &mut form.projected;
    let positions = section.position_resolution.is_some() || section.position_noise.is_some();
    let inputs = section.input_noise.is_some() || section.input_resolution.is_some();
    let learn = *section.learn_noise.get_or_insert(!positions && !inputs);
    if learn || (positions && inputs) {
        return;
    }
    let projected = |name: &str| format!("identifier.projected.{name}");
    let (set, missing) = match (positions, inputs) {
        (true, _) => (
            ["position_resolution", "position_noise"],
            "input_noise or input_resolution",
        ),
        (_, true) => (
            ["input_noise", "input_resolution"],
            "position_resolution or position_noise",
        ),
        _ => (["learn_noise"; 2], "the levels of positions and inputs"),
    };
    let [first, second] = set.map(projected);
    let key = check.culprit(&[first.as_str(), second.as_str()]).to_owned();
    let message = format!(
        "expected {missing} as well, got none of them: state 0 for signals that are exact, or learn_noise = true to have all noise taken from the \
         signals"
    );
    check.wrong(&key, message);
}

/// The options of projected rows; `None` with a problem if they contradict each other.
fn projected(form: &FileForm, joints: usize, check: &mut Check<'_>) -> Option<ProjectedOptions> {
    let section = &form.projected;
    let mut level = |name: &str, list: &Option<Vec<f64>>| {
        let key = format!("identifier.projected.{name}");
        per_joint(&key, list.as_deref().unwrap_or(&[]), 0.0, joints, check)
    };
    let noise = SensorNoise {
        position_resolution: level("position_resolution", &section.position_resolution),
        position_noise: level("position_noise", &section.position_noise),
        input_noise: level("input_noise", &section.input_noise),
        input_resolution: level("input_resolution", &section.input_resolution),
    };
    let options = ProjectedOptions {
        sample_period_s: form.plant.sample_period_s,
        window_s: match section.window_s {
            RealOr::Real(window_s) => window_s,
            RealOr::Word(Automatic::Auto) => auto_window_first(form.plant.sample_period_s),
        },
        stride_s: section.stride_s,
        velocity_half_width: velocity_half_width(section.velocity_half_width_s, form.plant.sample_period_s, check)?,
        timing: section.timing,
        input_delay_s: section.input_delay_s,
        noise,
        learn_noise: section.learn_noise.unwrap_or(true),
        considered: considered(form),
    };
    let checked = match section.window_s {
        RealOr::Real(_) => options,
        // a check of the shortest one covers all
        RealOr::Word(Automatic::Auto) => {
            let shortest = auto_window_lengths(form.plant.sample_period_s).last();
            options.with_window(shortest.unwrap_or(options.window_s))
        }
    };
    if let Err(ProjectedError::Value { field, expected, got }) = checked.validate() {
        let key = match field {
            "sample_period_s" => "plant.sample_period_s".to_owned(),
            field if field.starts_with("considered.") => format!("identifier.{field}"),
            field => format!("identifier.projected.{field}"),
        };
        let got = match field {
            // the ranges of these are in sample periods
            "window_s" | "stride_s" => {
                let periods = (got / form.plant.sample_period_s).round();
                format!("{got} s, which are {periods}")
            }
            field if field.ends_with("_s") => format!("{got} s"),
            _ => got.to_string(),
        };
        let message = format!("expected {expected}, got {got}");
        match check.culprit(&[&key, "plant.sample_period_s"]) {
            stated if stated == key => check.wrong(&key, message),
            // the default does not suit this period
            period => check.wrong(period, format!("{key} must be stated, too: {message}")),
        }
        return None;
    }
    let too_small = |limit: &f64| section.input_delay_s.abs() > *limit;
    if section.estimate_input_delay
        && let Some(limit) = section.input_delay_limit_s.filter(too_small)
    {
        let message = format!("expected at least the magnitude of input_delay_s, got {limit}");
        check.wrong("identifier.projected.input_delay_limit_s", message);
        return None;
    }
    Some(options)
}

pub(super) fn identifier(
    form: &FileForm,
    model: Option<&SharedModel>,
    check: &mut Check<'_>,
) -> Option<IdentifierConfig> {
    let joints = model.map_or(0, |model| model.definition().joints);
    let rows = match form.identifier.rows {
        RowsKind::Projected if form.identifier.input == InputKind::Controller => {
            let message = "expected \"measured\" with projected rows, which have no velocity to put into a controller, got \"controller\"";
            check.wrong(check.culprit(&["identifier.input", "identifier.rows"]), message);
            return None;
        }
        RowsKind::Projected => RowForm::Projected(projected(form, joints, check)?),
        RowsKind::Pointwise => RowForm::Pointwise,
    };
    let input = match form.identifier.input {
        InputKind::Controller => {
            let section = &form.identifier;
            let mut gains = |name: &str, list: &[f64]| gains(name, list, joints, check);
            let kp = gains("proportional_gain_v_per_rad", &section.proportional_gain_v_per_rad);
            let kd = gains("derivative_gain_v_s_per_rad", &section.derivative_gain_v_s_per_rad);
            let (kp, kd) = (kp?, kd?);
            InputSource::Controller(std::array::from_fn(|joint| PdController {
                proportional_gain_v_per_rad: kp[joint],
                derivative_gain_v_s_per_rad: kd[joint],
            }))
        }
        InputKind::Measured => InputSource::Measured,
    };
    Some(IdentifierConfig {
        rows,
        auto_window: matches!(form.projected.window_s, RealOr::Word(Automatic::Auto)),
        input,
        input_limit: per_joint(
            "identifier.input_limit",
            &form.identifier.input_limit,
            f64::INFINITY,
            joints,
            check,
        ),
        frozen_after_s: form.identifier.frozen_after_s,
    })
}
