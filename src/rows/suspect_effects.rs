//! Which possible errors of a machine have a column in which equation, by the terms of its model.
//!
//! Friction that falls with speed, a dead band and what differs by direction have columns only if
//! the model has Coulomb friction, or they would hardly differ from it. A dead time has one if the
//! model has back EMF and an inductance. A spring has one at any joint whose model has none,
//! because a weight and an inertia look like it.

use super::present_terms::{has_jump, has_term};
use super::suspect_places::{
    CLOCK, COSINE, DEAD_BAND, INERTIA, OFFSET, SCALE, SINE, SPRING, SuspectPlaces, VISCOUS, WITH_COULOMB, ZERO,
};
use super::through_drive::ThroughDrive;
use crate::model::AnyPlant;

/// What the equations of a plant have of the terms that decide this, one entry per equation.
pub(super) struct SuspectEffects {
    pub places: SuspectPlaces,
    /// Inertias without weight and viscous friction; `None` if the model has parameters for both.
    pub through_drives: Vec<Option<ThroughDrive>>,
    pub has_spring: Vec<bool>,
    has_constant: Vec<bool>,
    has_input_delay: bool,
    /// True if a joint turns, joint by joint: its encoder may be off its centre or its zero.
    pub turns: Vec<bool>,
}

impl SuspectEffects {
    /// Of a plant.
    pub fn of(plant: &dyn AnyPlant) -> Self {
        let equations = plant.equations();
        let inputs: Vec<usize> = equations.iter().map(|e| e.input).collect();
        let all = || 0..equations.len();
        Self {
            through_drives: all().map(|e| ThroughDrive::new(plant, e)).collect(),
            has_spring: all().map(|e| has_term(plant, e, 0, |q, _| q[inputs[e]])).collect(),
            has_constant: all().map(|e| has_term(plant, e, 0, |_, _| 1.0)).collect(),
            has_input_delay: plant.input_delay().is_some(),
            turns: (0..plant.joints()).map(|joint| plant.turns(joint)).collect(),
            places: SuspectPlaces {
                jumps: all().map(|e| has_jump(plant, e, inputs[e])).collect(),
                inputs,
            },
        }
    }

    /// True if a dead band or dead time has a column in an equation.
    pub fn has_dead_band(&self, e: usize) -> bool {
        self.places.jumps[e] || self.passes(e, ThroughDrive::has_back_emf)
    }

    fn passes(&self, e: usize, is_of: fn(&ThroughDrive) -> bool) -> bool {
        self.through_drives[e].as_ref().is_some_and(is_of)
    }

    /// True if an error has a column in equation `e`. `moves(e, joint)` is true if the equation
    /// contains the joint's motion, `depends_on_place(e, joint)` if it depends on its position.
    pub fn have_column(
        &self,
        e: usize,
        suspect: usize,
        moves: impl Fn(usize, usize) -> bool,
        depends_on_place: impl Fn(usize, usize) -> bool,
    ) -> bool {
        let Some((of, index)) = SuspectPlaces::within(suspect) else {
            return !self.has_input_delay;
        };
        let inputs = &self.places.inputs;
        // one encoder per joint, whatever its number of equations
        let is_first = !inputs[..of].contains(&inputs[of]);
        match index {
            OFFSET => of == e && !self.has_constant[e],
            SPRING => of == e && !self.has_spring[e],
            INERTIA => of == e && self.passes(e, ThroughDrive::has_inertia),
            VISCOUS => of == e && self.passes(e, ThroughDrive::has_friction),
            DEAD_BAND => of == e && self.has_dead_band(e),
            _ if WITH_COULOMB.contains(&index) => of == e && self.places.jumps[e],
            CLOCK => false,
            SCALE => moves(e, inputs[of]) && is_first,
            SINE | COSINE => self.turns[inputs[of]] && moves(e, inputs[of]) && is_first,
            // otherwise the column is only rounding, which would count as evidence
            ZERO => self.turns[inputs[of]] && depends_on_place(e, inputs[of]) && is_first,
            _ => of == e,
        }
    }
}
