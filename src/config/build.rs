//! Converts the form of the file to the core types, with the checks that involve several keys, and
//! the defaults in the other direction.

use super::catalog::{self, Catalog};
use super::check::Check;
use super::controller;
use super::error::Problem;
use super::estimator;
use super::identifier;
use super::layers::Layers;
use super::log;
use super::memory;
use super::plant;
use super::schema::{FileForm, MachineKind, Realtime};
use super::sections::{
    BusConfig, CheckpointConfig, Config, MonitorConfig, RealtimeConfig, RealtimeSettings, SupervisionConfig,
};
use super::setpoint;
use super::timing;
use std::path::PathBuf;

/// Builds and checks; on failure returns all problems.
pub(super) fn config(mut form: FileForm, catalog: &Catalog, layers: &Layers) -> Result<Config, Vec<Problem>> {
    let mut check = Check {
        layers,
        problems: Vec::new(),
        warnings: Vec::new(),
    };
    prefer(catalog, &mut form, &check);
    setpoint::inline_setpoints(&mut form, &mut check);
    identifier::decide_on_noise(&mut form, &mut check);
    timing::decide_on_timing(&mut form, &mut check);
    let own = catalog.is_own(&form.model.kind);
    let model = catalog.build(&form, &mut check);
    // their problems have been reported with the model
    let known = model.as_ref().and_then(|_| catalog::known(&form, &mut check)).flatten();
    let plant = plant::plant(&form, model.as_ref(), &mut check);
    let identifier = identifier::identifier(&form, model.as_ref(), &mut check);
    let log = log::log(&form, model.as_ref(), &mut check);
    let estimator = model
        .as_ref()
        .and_then(|model| estimator::estimator(&form, model, &mut check));
    let bus = BusConfig {
        robot: form.bus.robot.clone(),
        domain: form.bus.domain.clone(),
        delivery: form.bus.delivery,
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

/// If no model is stated, a program with its own models uses the first of them; if no machine is
/// stated, it simulates the model's equations.
fn prefer(catalog: &Catalog, form: &mut FileForm, check: &Check<'_>) {
    if let Some(name) = catalog.preferred().filter(|_| !check.stated("model.kind")) {
        form.model.kind = name.to_owned();
    }
    if catalog.is_own(&form.model.kind) && !check.stated("plant.machine") {
        form.plant.machine = MachineKind::Model;
    }
}

fn realtime(form: &FileForm) -> RealtimeConfig {
    let settings = |section: &Realtime| RealtimeSettings {
        scheduler_priority: u8::try_from(section.scheduler_priority)
            .ok()
            .filter(|priority| *priority > 0),
        cpu_affinity: section.cpu_affinity.iter().map(|&cpu| cpu as usize).collect(),
        lock_memory: section.lock_memory,
    };
    RealtimeConfig {
        plant: settings(&form.realtime_plant),
        identifier: settings(&form.realtime_identifier),
        monitor: settings(&form.realtime_monitor),
    }
}
