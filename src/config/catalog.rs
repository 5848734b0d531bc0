//! The models that `model.kind` may name: those of this library and those of a user's program.

use super::check::{Check, joints};
use super::schema::{FileForm, RowsKind};
use crate::model::{
    Delayed, ExtendedDerived, ExtendedManipulator, ExtraTerms, KnownConstants, Manipulator, ManipulatorDerived, Plant,
    ServoAxis, usual_delay_limit_s,
};
use crate::node::model::{PlantModel, SharedModel};

/// Builds a model from the keys of a configuration; `None` after reporting a problem.
type Build = fn(&FileForm, &mut Check<'_>) -> Option<SharedModel>;

/// The models of this library, by the name in `model.kind`. A new built-in model is one line here.
const BUILT_IN: &[(&str, Build)] = &[("manipulator", manipulator), ("servo_axis", servo_axis)];

/// The models that `model.kind` may name: those of this library and a program's own.
///
/// ```
/// # use thetabus::model::{Equation, Parameter, Plant, Scalar};
/// # #[derive(Clone)]
/// # struct Flywheel;
/// # impl Plant for Flywheel {
/// #     fn name(&self) -> &str { "flywheel" }
/// #     fn joints(&self) -> usize { 1 }
/// #     fn input_unit(&self) -> &str { "N m" }
/// #     fn parameters(&self) -> &[Parameter] {
/// #    const P: &[Parameter] = &[Parameter::positive("inertia", "kg m^2", "about the axis", 1.0)];
/// #    P
/// #     }
/// #     fn equations(&self) -> &[Equation] {
/// #    const E: &[Equation] = &[Equation::new("axis", 0, 1.0, 1, 0..1)];
/// #    E
/// #     }
/// #     fn terms<D: Scalar>(&self, _: usize, _q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
/// #    g[1] = theta[0] * dq[0];
/// #     }
/// # }
/// use thetabus::config::Catalog;
///
/// let catalog = Catalog::default().with(Flywheel);
/// assert_eq!(catalog.names().collect::<Vec<_>>(), ["manipulator", "servo_axis", "flywheel"]);
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Catalog {
    own: Vec<SharedModel>,
}

impl Catalog {
    /// Adds a model under the name of the plant. The first one added is the default if `model.kind`
    /// is not stated.
    ///
    /// An invalid definition or a duplicate name is reported when a configuration is loaded.
    #[must_use]
    pub fn with(self, plant: impl Plant + Clone + Send + Sync + 'static) -> Self {
        self.with_model(SharedModel::new(PlantModel::new(plant)))
    }

    /// Adds a model.
    #[must_use]
    pub fn with_model(mut self, model: SharedModel) -> Self {
        self.own.push(model);
        self
    }

    /// Adds a model, replacing one of the same name: as with keys, the last file wins.
    #[cfg(feature = "service")]
    #[must_use]
    pub(crate) fn with_latest(mut self, model: SharedModel) -> Self {
        self.own.retain(|own| own.name() != model.name());
        self.with_model(model)
    }

    /// All names, with those of this library first.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let own = self.own.iter().map(|model| model.name());
        BUILT_IN.iter().map(|(name, _)| *name).chain(own)
    }

    /// The default model if `model.kind` is not stated; `None` for this library's default.
    pub fn preferred(&self) -> Option<&str> {
        self.own.first().map(|model| model.name())
    }

    /// True if the name is that of a program's model.
    pub fn is_own(&self, name: &str) -> bool {
        self.own.iter().any(|model| model.name() == name)
    }

    /// The model named in a configuration.
    pub(super) fn build(&self, form: &FileForm, check: &mut Check<'_>) -> Option<SharedModel> {
        let kind = form.model.kind.as_str();
        self.validate(check)?;
        if let Some(own) = self.own.iter().find(|model| model.name() == kind) {
            return Some(own.clone());
        }
        if let Some((_, build)) = BUILT_IN.iter().find(|(name, _)| *name == kind) {
            return build(form, check);
        }
        let names: Vec<&str> = self.names().collect();
        let hint = super::words::nearest(kind, names.iter().copied()).map(|name| format!("; did you mean \"{name}\"?"));
        let hint = match kind {
            // known to every program, but not available here
            "robot" => "; a robot from its URDF is a file of its own, see config/robots/six_axis.toml".to_owned(),
            _ => hint.unwrap_or_default(),
        };
        let expected = super::kind::quoted(&names);
        check.wrong(
            "model.kind",
            format!("expected one of {expected}, got \"{kind}\"{hint}"),
        );
        None
    }

    /// Reports errors of a program's own models.
    fn validate(&self, check: &mut Check<'_>) -> Option<()> {
        let before = check.problems.len();
        for (index, model) in self.own.iter().enumerate() {
            let definition = model.definition();
            let name = &definition.name;
            if let Err(error) = definition.validate() {
                check.wrong("model", format!("the plant {name} of this program: {error}"));
            }
            if !crate::words::is_name(name) {
                let message = "expected a name of 1 to 32 characters a-z 0-9 _ -";
                check.wrong("model", format!("the plant {name:?} of this program: {message}"));
            }
            if self.names().take(BUILT_IN.len() + index).any(|other| other == name) {
                let message = "another model has this name; give it one of its own";
                check.wrong("model", format!("the plant {name} of this program: {message}"));
            }
        }
        (check.problems.len() == before).then_some(())
    }
}

/// Motor constants of the arm: all of them or none.
pub(super) fn known(form: &FileForm, check: &mut Check<'_>) -> Option<Option<KnownConstants>> {
    let known = &form.known;
    match (
        known.length_1_m,
        &known.winding_resistance_ohm,
        &known.torque_constant_n_m_per_a,
    ) {
        (None, None, None) => Some(None),
        (Some(length_1_m), Some(resistance), Some(constant)) => Some(Some(KnownConstants {
            length_1_m,
            winding_resistance_ohm: joints(resistance),
            torque_constant_n_m_per_a: joints(constant),
        })),
        (length, resistance, constant) => {
            let set = [length.is_some(), resistance.is_some(), constant.is_some()];
            let keys = ["length_1_m", "winding_resistance_ohm", "torque_constant_n_m_per_a"]
                .map(|k| format!("model.known.{k}"));
            let those = |wanted: bool| -> Vec<&str> {
                let pairs = keys.iter().zip(set).filter(|(_, set)| *set == wanted);
                pairs.map(|(key, _)| key.as_str()).collect()
            };
            let (given, missing) = (those(true), those(false));
            let verb = if missing.len() == 1 { "is" } else { "are" };
            let message = format!(
                "expected all of [model.known] or none, but {} {verb} not set",
                missing.join(" and ")
            );
            check.wrong(given.first().copied().unwrap_or("model.known"), message);
            None
        }
    }
}

fn manipulator(form: &FileForm, check: &mut Check<'_>) -> Option<SharedModel> {
    let Some(plant) = Manipulator::new(form.model.gravity_m_s2) else {
        let message = format!("expected 0 or above, got {}", form.model.gravity_m_s2);
        check.wrong("model.gravity_m_s2", message);
        return None;
    };
    let derived = match known(form, check)?.map(ManipulatorDerived::new).transpose() {
        Ok(derived) => derived,
        Err(error) => {
            check.wrong("model.known.length_1_m", error.to_string());
            return None;
        }
    };
    let terms = ExtraTerms {
        coulomb_friction: form.model.coulomb_friction,
        offset: form.model.offset,
    };
    if terms.coulomb_friction && form.identifier.rows == RowsKind::Pointwise {
        let message = "expected false with identifier.rows = \"pointwise\", which needs the derivative of friction that jumps, got true; \
                       identifier.rows = \"projected\" needs none";
        check.wrong(check.culprit(&["model.coulomb_friction", "identifier.rows"]), message);
        return None;
    }
    let extended = ExtendedManipulator::new(plant, terms);
    let derived = derived.map(|derived| ExtendedDerived::new(derived, ExtendedManipulator::places(terms)));
    Some(match delay(form) {
        // the paper's arm has hand-written derivatives, which are faster than the automatic ones
        None if terms.is_none() => shared(PlantModel::new(plant).with_pointwise(plant), derived),
        None => shared(PlantModel::new(extended), derived),
        Some((start_s, limit_s)) => shared(PlantModel::new(Delayed::new(extended, start_s, limit_s)), derived),
    })
}

fn servo_axis(form: &FileForm, check: &mut Check<'_>) -> Option<SharedModel> {
    let section = &form.servo_axis;
    let Some(plant) = ServoAxis::new(section.motion, section.input, section.gain) else {
        let message = format!("expected a number that is not 0, got {}", section.gain);
        check.wrong("model.servo_axis.gain", message);
        return None;
    };
    Some(match delay(form) {
        None => SharedModel::new(PlantModel::new(plant)),
        Some((start_s, limit_s)) => SharedModel::new(PlantModel::new(Delayed::new(plant, start_s, limit_s))),
    })
}

/// A model with the values derived from its known constants.
fn shared<P, M>(model: PlantModel<P, M>, derived: Option<ExtendedDerived>) -> SharedModel
where
    PlantModel<P, M>: crate::node::model::Model + 'static,
{
    match derived {
        Some(derived) => SharedModel::new(model.deriving(derived)),
        None => SharedModel::new(model),
    }
}

/// Start and limit of a delay to be identified \[s\].
fn delay(form: &FileForm) -> Option<(f64, f64)> {
    let section = &form.projected;
    let wanted = form.identifier.rows == RowsKind::Projected && section.estimate_input_delay;
    let start_s = section.input_delay_s;
    let usual_s = || usual_delay_limit_s(start_s, form.plant.sample_period_s);
    wanted.then(|| (start_s, section.input_delay_limit_s.unwrap_or_else(usual_s)))
}
