//! Settings that are legal but probably not intended.

use super::check::Check;
use super::error::Origin;
use super::schema::{Delivery, FileForm, Need, RealOr, RowsKind};
use super::sections::{BusConfig, EstimatorConfig, PlantConfig, Speed};
use crate::rows::FEWEST_WINDOW_SAMPLES;
use crate::sim::Machine;
use toml::Value;

impl Check<'_> {
    pub(super) fn suspicious(
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
        // Whoever shortens a run by an argument knows what is cut off, and a recording is over.
        let shortened = self.recorded("plant.duration_s")
            || matches!(
                self.layers.origin("plant.duration_s"),
                Origin::Argument(_) | Origin::Option(_)
            );
        if let Some(late) = sim
            .mass_2
            .points
            .iter()
            .find(|point| point.0 >= sim.duration_s && !shortened && !own)
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
        if form.model.kind != sim.model() && self.stated("plant.machine") {
            let message = format!(
                "simulates a machine that the model {} does not describe",
                form.model.kind
            );
            self.warn(self.culprit(&["plant.machine", "model.kind"]), message);
        }
        let blind = sim.machine == Machine::Arm && !sim.sensors.exact_positions();
        if !own && form.identifier.rows == RowsKind::Pointwise && blind {
            let message = "sensors give no derivatives, so rows = \"pointwise\" refuses each sample of the simulator; \"projected\" needs none";
            let keys = [
                "identifier.rows",
                "plant.sensors.encoder_bits",
                "plant.sensors.position_noise_rad",
            ];
            self.warn(self.culprit(&keys), message);
        }
        if let (RowsKind::Projected, RealOr::Real(window_s)) = (form.identifier.rows, &form.projected.window_s) {
            let samples = window_s / form.plant.sample_period_s;
            if samples < FEWEST_WINDOW_SAMPLES - 1e-6 {
                let message = format!(
                    "is {samples:.0} samples long; below {FEWEST_WINDOW_SAMPLES} the terms between samples are \
                     lost, and estimates can be wrong by more than they say: \"auto\" chooses from the signals"
                );
                self.warn("identifier.projected.window_s", message);
            }
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
        if limited && options.parameters.iter().all(|prior| prior.lower < 0.0) {
            let message =
                "limits nothing, because it acts on parameters whose lower bound is not negative: see estimator.bounds";
            self.warn("estimator.step_factor", message);
        }
        self.without_effect(form, own);
    }

    /// Keys with a non-default value that belong to a choice that was not made.
    fn without_effect(&mut self, form: &FileForm, own: bool) {
        let kind = &form.model.kind;
        let [default, form] = [&FileForm::default(), form].map(|form| toml::Table::try_from(form).unwrap_or_default());
        let unused: Vec<(String, String)> = self
            .layers
            .entries()
            .iter()
            // A robot's file implies keys that nobody wrote; they have no line.
            .filter(|(_, entry)| !matches!(entry.origin, Origin::File { line: 0, .. }))
            .filter_map(|(path, entry)| {
                let (section, name) = path.rsplit_once('.')?;
                if default.get(section)?.get(name) == Some(&entry.value) {
                    return None;
                }
                if own && section.split('.').next() == Some("model") && path != "model.kind" {
                    return Some((path.clone(), format!("on {kind}, a model of this program")));
                }
                let Need { key, wanted } = Need::of(section, name)?;
                let got = key
                    .rsplit_once('.')
                    .and_then(|(section, name)| form.get(section)?.get(name))?;
                // as in a file: words in quotes, flags and numbers without
                let wanted = match got {
                    Value::String(_) => format!("{wanted:?}"),
                    _ => wanted.to_owned(),
                };
                let reason = format!("unless {key} is {wanted}; it is {got}");
                (got.to_string() != wanted).then(|| (path.clone(), reason))
            })
            .collect();
        for (path, reason) in unused {
            self.warn_without_effect(&path, &reason);
        }
    }
}
