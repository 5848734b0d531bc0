//! From the form of the file to the core types, with the checks that concern several keys, and the defaults the other way.

use super::catalog::{self, Catalog};
use super::check::{Check, chosen};
use super::controller;
use super::error::{Origin, Problem};
use super::layers::Layers;
use super::memory;
use super::plant;
use super::schema::{self, FileForm, RealOrWord};
use super::sections::{
    BusConfig, CheckpointConfig, Config, Delivery, EstimatorConfig, IdentifierConfig, LogColumns, MonitorConfig,
    PlantConfig, RealtimeConfig, RealtimeSettings, Speed, SupervisionConfig,
};
use crate::estimator::{
    Bound, ChangeDetection, EstimatorError, EstimatorOptions, Forgetting, Outliers, forgetting_factor,
};
use crate::model::{MAX_JOINTS, PdController};
use crate::node::model::SharedModel;
use crate::rows::{
    Considered, InputSource, InputTiming, ProjectedError, ProjectedOptions, RowForm, SensorNoise, auto_window_first,
    auto_window_lengths,
};
use crate::sim::Machine;
use std::path::PathBuf;

/// Builds and checks; on failure everything that is wrong.
pub(super) fn config(mut form: FileForm, catalog: &Catalog, layers: &Layers) -> Result<Config, Vec<Problem>> {
    let mut check = Check {
        layers,
        problems: Vec::new(),
        warnings: Vec::new(),
    };
    prefer(catalog, &mut form, &check);
    plant::inline_setpoints(&mut form, &mut check);
    decide_on_noise(&mut form, &mut check);
    let own = catalog.is_own(&form.model.kind);
    let model = catalog.build(&form, &mut check);
    // what is wrong with them has been told with the model
    let known = model.as_ref().and_then(|_| catalog::known(&form, &mut check)).flatten();
    let plant = plant::plant(&form, model.as_ref(), &mut check);
    let identifier = identifier(&form, model.as_ref(), &mut check);
    let log = log(&form, model.as_ref(), &mut check);
    let estimator = model.as_ref().and_then(|model| estimator(&form, model, &mut check));
    let bus = BusConfig {
        robot: form.bus.robot.clone(),
        domain: form.bus.domain.clone(),
        delivery: match form.bus.delivery.as_str() {
            "realtime" => Delivery::Realtime,
            "lockstep" => Delivery::Lockstep,
            _ => Delivery::Auto,
        },
        lockstep_consumers: form.bus.lockstep_consumers as usize,
        lockstep_limit_s: form.bus.lockstep_limit_s,
        sample_buffer: form.bus.sample_buffer as usize,
        max_sample_subscribers: form.bus.max_sample_subscribers as usize,
        max_estimate_subscribers: form.bus.max_estimate_subscribers as usize,
        max_programs: form.bus.max_programs as usize,
    };
    let monitor = MonitorConfig {
        out_dir: form.monitor.out_dir.as_ref().map(PathBuf::from),
        record_file_bytes: form.monitor.record_file_mib.saturating_mul(1 << 20),
        record_files: form.monitor.record_files as usize,
        record_joint_states: form.monitor.record_joint_states,
    };
    let checkpoint = CheckpointConfig {
        dir: form.checkpoint.dir.as_ref().map(PathBuf::from),
        period_s: form.checkpoint.period_s,
    };
    let supervision = SupervisionConfig {
        restarts: form.supervision.restarts,
        backoff_s: form.supervision.backoff_s,
        backoff_limit_s: form.supervision.backoff_limit_s,
        healthy_s: form.supervision.healthy_s,
    };
    let controller = match (&model, &estimator) {
        (Some(model), Some(estimator)) => controller::controller(&form, model, estimator, &mut check),
        _ => None,
    };
    match (plant, model, identifier, estimator, controller) {
        (Some(plant), Some(model), Some(identifier), Some(estimator), Some(controller))
            if check.problems.is_empty() =>
        {
            check.suspicious(&form, own, &bus, &plant, &estimator);
            let warnings = check.warnings;
            let recorded = memory::recorded(layers);
            Ok(Config {
                bus,
                plant,
                model,
                identifier,
                estimator,
                controller,
                monitor,
                checkpoint,
                supervision,
                realtime: realtime(&form),
                log,
                file: form,
                warnings,
                recorded,
                known: known.filter(|_| !own),
                catalog: catalog.clone(),
            })
        }
        _ => Err(check.problems),
    }
}

/// Without a word on the model, a program with models of its own means the first of them, and without one on the machine, its equations simulated.
fn prefer(catalog: &Catalog, form: &mut FileForm, check: &Check<'_>) {
    if let Some(name) = catalog.preferred().filter(|_| !check.stated("model.kind")) {
        form.model.kind = name.to_owned();
    }
    if catalog.is_own(&form.model.kind) && !check.stated("plant.machine") {
        form.plant.machine = "model".to_owned();
    }
}

impl Check<'_> {
    fn suspicious(
        &mut self,
        form: &FileForm,
        own: bool,
        bus: &BusConfig,
        plant: &PlantConfig,
        estimator: &EstimatorConfig,
    ) {
        let sim = &plant.sim;
        if sim.sample_count() < estimator.block_len as u64 {
            let message = format!(
                "the run of {} samples ends before the first block is full",
                sim.sample_count()
            );
            self.warn(self.culprit(&["plant.duration_s", "estimator.block_len"]), message);
        }
        // Whoever shortens a run on the command line knows what is cut off.
        let shortened = matches!(self.layers.origin("plant.duration_s"), Origin::Argument(_));
        if let Some(late) = sim
            .mass_2
            .points
            .iter()
            .find(|point| point.0 >= sim.duration_s && !shortened)
        {
            let message = format!(
                "the point at {} s lies behind the end of the run at {} s",
                late.0, sim.duration_s
            );
            self.warn(self.culprit(&["plant.mass_2.t_s", "plant.duration_s"]), message);
        }
        if bus.delivery == Delivery::Realtime && plant.speed == Speed::Max {
            let message =
                "realtime delivery at speed \"max\" loses samples as soon as a consumer is slower than the plant";
            self.warn(self.culprit(&["bus.delivery", "plant.speed"]), message);
        }
        if !own && form.model.kind != sim.model() && self.stated("plant.machine") {
            let message = format!(
                "simulates a machine that the model {} does not describe",
                form.model.kind
            );
            self.warn(self.culprit(&["plant.machine", "model.kind"]), message);
        }
        let blind = sim.machine == Machine::Arm && !sim.sensors.exact_positions();
        if !own && form.identifier.rows == "pointwise" && blind {
            let message = "sensors give no derivatives, so rows = \"pointwise\" refuses each sample of the simulator; \"projected\" needs none";
            let keys = [
                "identifier.rows",
                "plant.sensors.encoder_bits",
                "plant.sensors.position_noise_rad",
            ];
            self.warn(self.culprit(&keys), message);
        }
        let options = &estimator.options;
        let arm = form.model.kind == "manipulator";
        if arm && options.forgetting_factor == 1.0 && sim.mass_2.points.len() > 1 && options.change_detection.is_none()
        {
            let message =
                "1 forgets nothing, so estimates after a change of the plant are averages of before and after";
            self.warn("estimator.forgetting_factor", message);
        }
        if options.change_detection.is_some() && options.max_iterations == 1 {
            let message = "a single step per block leaves an error of linearisation that can look like a change";
            self.warn(
                self.culprit(&["estimator.change_detection", "estimator.max_iterations"]),
                message,
            );
        }
        let limited = options.step_factor.is_finite() && options.max_iterations > 1;
        if limited && options.lower.iter().all(|lower| *lower < 0.0) {
            let message =
                "limits nothing, because it acts on parameters whose lower bound is not negative: see estimator.bounds";
            self.warn("estimator.step_factor", message);
        }
        self.without_effect(form, own);
    }

    /// Keys that were set to something of their own but belong to a choice that was not made.
    fn without_effect(&mut self, form: &FileForm, own: bool) {
        let default = toml::Table::try_from(FileForm::default()).unwrap_or_default();
        let unused: Vec<(String, String)> = self
            .layers
            .entries()
            .iter()
            .filter_map(|(path, entry)| {
                let (section, name) = path.rsplit_once('.')?;
                if default.get(section)?.get(name) == Some(&entry.value) {
                    return None;
                }
                if own && section.split('.').next() == Some("model") && path != "model.kind" {
                    let message = format!("has no effect on {}, a model of this program", form.model.kind);
                    return Some((path.clone(), message));
                }
                let need = match (section, name) {
                    ("identifier", "proportional_gain_v_per_rad" | "derivative_gain_v_s_per_rad") => {
                        ("identifier.input", form.identifier.input.as_str(), "controller")
                    }
                    ("identifier.projected" | "identifier.considered", _) => {
                        ("identifier.rows", form.identifier.rows.as_str(), "projected")
                    }
                    ("plant.servo_axis", _) => ("plant.machine", form.plant.machine.as_str(), "servo_axis"),
                    ("plant.model", _) => ("plant.machine", form.plant.machine.as_str(), "model"),
                    ("plant.arm" | "plant.mass_2", _) => ("plant.machine", form.plant.machine.as_str(), "arm"),
                    ("model", "coulomb_friction" | "offset") => ("model.kind", form.model.kind.as_str(), "manipulator"),
                    ("model.servo_axis", _) => ("model.kind", form.model.kind.as_str(), "servo_axis"),
                    ("estimator", "lower" | "upper") => ("estimator.bounds", form.estimator.bounds.as_str(), "listed"),
                    ("estimator", "huber_limit") => ("estimator.outliers", form.estimator.outliers.as_str(), "huber"),
                    ("estimator", "false_alarm_rate" | "change_margin_s") if !form.estimator.change_detection => {
                        ("estimator.change_detection", "false", "true")
                    }
                    ("estimator", "gate_limit") => ("estimator.outliers", form.estimator.outliers.as_str(), "gate"),
                    _ => {
                        let kind = section.strip_prefix("plant.setpoint.")?;
                        ("plant.setpoint.kind", form.setpoint.kind.as_str(), kind)
                    }
                };
                let (key, got, wanted) = need;
                (got != wanted).then(|| {
                    (
                        path.clone(),
                        format!("has no effect unless {key} is \"{wanted}\"; it is \"{got}\""),
                    )
                })
            })
            .collect();
        unused.into_iter().for_each(|(path, message)| self.warn(&path, message));
    }
}

/// A list with one number per joint, or one for all.
fn per_joint(list: &[f64], otherwise: f64) -> [f64; MAX_JOINTS] {
    std::array::from_fn(|joint| match list {
        [one] => *one,
        list => list.get(joint).copied().unwrap_or(otherwise),
    })
}

/// What the model does not say. Positions along a line have no period of one turn.
fn considered(form: &FileForm, linear: bool) -> Considered {
    let section = &form.considered;
    let all = Considered {
        input_delay_s: section.input_delay_s,
        gain: section.gain,
        coulomb: section.coulomb,
        resonance_hz: section.resonance_hz,
        drift_per_s: section.drift_per_s,
        zero_rad: section.zero_rad,
        eccentricity_rad: Some(section.eccentricity_rad),
    };
    if linear { all.without_turns() } else { all }
}

/// Samples on either side of the velocity filter. Its time is what matters: a filter of as many samples at a lower rate smooths away the fastest
/// motion. The polynomial of order 5 needs 3, however slow the samples are.
fn velocity_half_width(half_width_s: f64, sample_period_s: f64, check: &mut Check<'_>) -> Option<usize> {
    let periods = (half_width_s / sample_period_s).round();
    if periods > 100.0 {
        let message = format!("expected at most 100 sample periods, got {half_width_s} s, which are {periods}");
        check.wrong("identifier.projected.velocity_half_width_s", message);
        return None;
    }
    Some((periods as usize).max(3))
}

/// Says whether the noise is learnt, which the levels that are set decide if the key does not. In a configuration that is written out the
/// decision stands, so that it is the same wherever it is read again.
fn decide_on_noise(form: &mut FileForm, check: &mut Check<'_>) {
    if form.identifier.rows != "projected" {
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

/// The projected rows' options; `None` with a problem where they do not go together.
fn projected(form: &FileForm, linear: bool, check: &mut Check<'_>) -> Option<ProjectedOptions> {
    let section = &form.projected;
    let per_joint = |list: &Option<Vec<f64>>| per_joint(list.as_deref().unwrap_or(&[]), 0.0);
    let options = ProjectedOptions {
        sample_period_s: form.plant.sample_period_s,
        window_s: match section.window_s {
            RealOrWord::Real(window_s) => window_s,
            RealOrWord::Word(_) => auto_window_first(form.plant.sample_period_s),
        },
        stride_s: section.stride_s,
        velocity_half_width: velocity_half_width(section.velocity_half_width_s, form.plant.sample_period_s, check)?,
        timing: chosen(&InputTiming::NAMES, &section.timing),
        input_delay_s: section.input_delay_s,
        noise: SensorNoise {
            position_resolution: per_joint(&section.position_resolution),
            position_noise: per_joint(&section.position_noise),
            input_noise: per_joint(&section.input_noise),
            input_resolution: per_joint(&section.input_resolution),
        },
        learn_noise: section.learn_noise.unwrap_or(true),
        considered: considered(form, linear),
    };
    let checked = match section.window_s {
        RealOrWord::Real(_) => options,
        // what is checked of the shortest one holds for all
        RealOrWord::Word(_) => {
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
        let got = match field.ends_with("_s") {
            true if expected.contains("sample period") => {
                let periods = (got / form.plant.sample_period_s).round();
                format!("{got} s, which are {periods}")
            }
            true => format!("{got} s"),
            false => got.to_string(),
        };
        check.wrong(&key, format!("expected {expected}, got {got}"));
        return None;
    }
    let limit = section.input_delay_limit_s;
    if section.estimate_input_delay && section.input_delay_s.abs() > limit {
        let message = format!("expected at least the magnitude of input_delay_s, got {limit}");
        check.wrong("identifier.projected.input_delay_limit_s", message);
        return None;
    }
    Some(options)
}

fn realtime(form: &FileForm) -> RealtimeConfig {
    let settings = |priority: u64, cpus: &[u64], lock_memory| RealtimeSettings {
        scheduler_priority: u8::try_from(priority).ok().filter(|priority| *priority > 0),
        cpu_affinity: cpus.iter().map(|&cpu| cpu as usize).collect(),
        lock_memory,
    };
    RealtimeConfig {
        plant: settings(
            form.realtime_plant.scheduler_priority,
            &form.realtime_plant.cpu_affinity,
            form.realtime_plant.lock_memory,
        ),
        identifier: settings(
            form.realtime_identifier.scheduler_priority,
            &form.realtime_identifier.cpu_affinity,
            form.realtime_identifier.lock_memory,
        ),
        monitor: settings(
            form.realtime_monitor.scheduler_priority,
            &form.realtime_monitor.cpu_affinity,
            form.realtime_monitor.lock_memory,
        ),
    }
}

fn log(form: &FileForm, model: Option<&SharedModel>, check: &mut Check<'_>) -> LogColumns {
    let section = &form.log;
    // Metres taken for radians would be used as they are, and nothing in the result would show it.
    if let Some(model) = model.filter(|_| !section.q.is_empty()) {
        let linear = model.definition().position_unit == "m";
        let is_length = matches!(section.position_unit.as_str(), "m" | "mm" | "um");
        if linear != is_length {
            let (axis, units) = match linear {
                true => ("moves along a line", "\"m\", \"mm\" or \"um\""),
                false => ("turns", "\"rad\", \"deg\" or \"turn\""),
            };
            let message = format!(
                "expected {units}, since the model {axis}, got \"{}\"",
                section.position_unit
            );
            check.wrong(check.culprit(&["log.position_unit", "log.q"]), message);
        }
    }
    if section.input_unit == 0.0 {
        check.wrong("log.input_unit", "expected a number that is not 0, got 0");
    }
    LogColumns {
        time: section.time.clone(),
        time_unit_s: match section.time_unit.as_str() {
            "ms" => 1e-3,
            "us" => 1e-6,
            "ns" => 1e-9,
            _ => 1.0,
        },
        positions: section.q.clone(),
        position_unit: match section.position_unit.as_str() {
            "deg" => std::f64::consts::TAU / 360.0,
            "turn" => std::f64::consts::TAU,
            "mm" => 1e-3,
            "um" => 1e-6,
            _ => 1.0,
        },
        inputs: section.input.clone(),
        input_unit: section.input_unit,
        setpoints: section.setpoint.clone(),
    }
}

fn identifier(form: &FileForm, model: Option<&SharedModel>, check: &mut Check<'_>) -> Option<IdentifierConfig> {
    let linear = model.is_some_and(|model| model.definition().position_unit == "m");
    let rows = match form.identifier.rows.as_str() {
        "projected" if form.identifier.input == "controller" => {
            let message = "expected \"measured\" with projected rows, which have no velocity to put into a controller, got \"controller\"";
            check.wrong(check.culprit(&["identifier.input", "identifier.rows"]), message);
            return None;
        }
        "projected" => RowForm::Projected(projected(form, linear, check)?),
        _ => RowForm::Pointwise,
    };
    let input = match form.identifier.input.as_str() {
        "controller" => {
            let kp = &form.identifier.proportional_gain_v_per_rad;
            let kd = &form.identifier.derivative_gain_v_s_per_rad;
            let mut controllers = [PdController {
                proportional_gain_v_per_rad: 0.0,
                derivative_gain_v_s_per_rad: 0.0,
            }; MAX_JOINTS];
            for ((controller, kp), kd) in controllers.iter_mut().zip(kp).zip(kd) {
                *controller = PdController {
                    proportional_gain_v_per_rad: *kp,
                    derivative_gain_v_s_per_rad: *kd,
                };
            }
            InputSource::Controller(controllers)
        }
        _ => InputSource::Measured,
    };
    Some(IdentifierConfig {
        rows,
        auto_window: matches!(form.projected.window_s, RealOrWord::Word(_)),
        input,
        input_limit: per_joint(&form.identifier.input_limit, f64::INFINITY),
        frozen_after_s: form.identifier.frozen_after_s,
    })
}

fn estimator(form: &FileForm, model: &SharedModel, check: &mut Check<'_>) -> Option<EstimatorConfig> {
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
    let (lower, upper) = match section.bounds.as_str() {
        "model" => (
            parameters.iter().map(|p| p.lower).collect(),
            parameters.iter().map(|p| p.upper).collect(),
        ),
        "listed" => (
            listed("lower", &section.lower, params, "parameter", &|_| f64::NEG_INFINITY),
            listed("upper", &section.upper, params, "parameter", &|_| f64::INFINITY),
        ),
        _ => (vec![f64::NEG_INFINITY; params], vec![f64::INFINITY; params]),
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
        relations: match section.relations.as_str() {
            "model" => model.definition().relations.clone(),
            _ => Vec::new(),
        },
        fixed,
        // The schema lets only known names through.
        forgetting: section.forgetting.parse().unwrap_or(Forgetting::Exponential),
        bound: section.bound.parse().unwrap_or(Bound::Polynomial),
        forgetting_factor,
        information_floor: section.information_floor,
        max_iterations: section.max_iterations as usize,
        step_factor: section.step_factor,
        noise_std,
        noise_floor,
        noise_floor_relative: section.noise_floor_relative,
        random_walk,
        // as all considered errors, for projected rows
        drift_per_s: match form.identifier.rows.as_str() {
            "projected" => form.considered.drift_per_s,
            _ => 0.0,
        },
        outliers: match section.outliers.as_str() {
            "huber" => Outliers::Huber(section.huber_limit),
            "gate" => Outliers::Gate(section.gate_limit),
            _ => Outliers::Keep,
        },
        change_detection: section.change_detection.then(|| ChangeDetection {
            false_alarm_rate: section.false_alarm_rate,
            // Rows state their span in nanoseconds.
            margin: (section.change_margin_s * 1e9).round() as u64,
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
fn estimator_problem(error: &EstimatorError, names: &[&str], section: &schema::Estimator) -> (String, String) {
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
        other => ("forgetting", other.to_string()),
    };
    (format!("estimator.{option}"), message)
}
