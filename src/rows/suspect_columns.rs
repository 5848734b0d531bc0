//! Possible errors of a machine that its model leaves out: one column of the rows per error.
//!
//! ```text
//! f_i(θ*) = noise + Σ_s a_s d_is      d_is = ∂f_i/∂a_s, the machine has error s with amplitude a_s
//! ```
//!
//! | error | column, before whitening | amplitude a |
//! |---|---|---|
//! | the recorded input acts later than specified | −s ∫ψ′ u, the first power of the delay (`kernel.rs`) | s |
//! | the drive produces more than specified | −s ∫ψ u | share |
//! | Coulomb friction that the model lacks | s ∫ψ sat(q̇/v₀) | unit of the input |
//! | friction that falls with speed | s ∫ψ sat(q̇/v₀) exp(−(q̇/v_s)²) | unit of the input |
//! | an offset of the input, or a constant force | −s | unit of the input |
//! | a dead band or dead time of the drive; a spring, such as a cable | see `drive_shapes.rs` | unit of the input; per rad or m |
//! | gain or viscous friction by direction, friction by load | see `by_direction.rs` | share; as viscous friction; share |
//! | an inertia without weight, such as a rotor's | see `through_drive.rs` | unit of the input per rad/s² or m/s² |
//! | viscous friction | see `through_drive.rs` | unit of the input per rad/s or m/s |
//! | an encoder off its centre, which reads q + a sin q or q + a cos q | Σ_k ∂f_i/∂q_k sin q_k, or cos q_k | rad |
//! | a resonance between motor and load | s ∫ψ″ u | s² |
//! | an encoder's zero, or gravity's direction: reads q + a | Σ_k ∂f_i/∂q_k | rad |
//! | another scale of an encoder: reads q (1 + a) | Σ_k q_k ∂f_i/∂q_k | share |
//! | a clock that runs fast | none: it is a change of the parameters (`tempo.rs`) | share |
//!
//! There are two columns of friction that falls with speed (R. Stribeck 1902), with v_s of 0.2 and
//! of 0.8 times the root mean square of the velocity in the first block that moves: together they
//! approximate any v_s between. `suspect_effects.rs` says which errors have a column at all.
//!
//! sat is the sign function with a linear middle. For velocities it is three standard deviations of
//! their noise wide, because at rest the sign is that of the noise, and for inputs a fiftieth of
//! u_r, the largest root mean square of a block's input so far (`suspect_sizes.rs`).
//!
//! A flexible joint has u (1 + s²/ω_a²) = (1 + s²/ω_r²)·(the rigid terms), so to first order in
//! 1/ω² its rigid model is off by (1/ω_r² − 1/ω_a²) s² u: the second derivative of the input, for
//! any equation. Its sign depends on the side of the encoder.
//!
//! The estimator widens its published covariance by the remaining uncertainty of the errors that
//! have a prior standard deviation ([`Considered`]), and tests for all of them (`score_test.rs`).

use super::by_direction::ByDirection;
use super::drive_shapes::DriveShapes;
use super::kernel::{Kernels, dot};
use super::suspect::{Considered, Suspect, SuspectKind};
use super::suspect_effects::SuspectEffects;
use super::suspect_places::{
    CLOCK, COSINE, DEAD_BAND, DELAY, FRICTION, GAIN, GAIN_BY_DIRECTION, INERTIA, LOAD_FRICTION, OFFSET, RESONANCE,
    SCALE, SINE, SLOW_FRICTION, SPRING, SuspectPlaces, VISCOUS, VISCOUS_BY_DIRECTION, ZERO, place,
};
use super::suspect_sizes::SuspectSizes;
use super::tempo::tempo;
use super::through_drive::ThroughDrive;
use super::trajectory::Trajectory;
use super::turned::Turned;
use super::whitening::{Direction, Whitening};
use crate::estimator::SuspectRows;
use crate::model::AnyPlant;

/// Velocity, in standard deviations of its noise, below which a joint may be at rest.
const STANDING: f64 = 3.0;
/// v_s of the two columns, as shares of the velocity's root mean square.
const STRIBECK_SPEEDS: [f64; 2] = [0.2, 0.8];

/// The columns of a block.
#[derive(Debug, Clone)]
pub(super) struct SuspectColumns {
    sizes: SuspectSizes,
    pub places: SuspectPlaces,
    /// Names of the parameters.
    parameters: Vec<String>,
    /// [equation][suspect][row], and whitened; empty if the error does not affect the equation.
    columns: Vec<Vec<Vec<f64>>>,
    white: Vec<Vec<Vec<f64>>>,
    /// The integrands of the friction columns, per equation and sample; empty if there are none.
    frictions: Vec<[Vec<f64>; 2]>,
    /// The integrands of dead bands and springs, per equation.
    drives: Vec<DriveShapes>,
    /// Per equation; empty without Coulomb friction.
    by_direction: Vec<ByDirection>,
    /// Inertias without weight and viscous friction; `None` if the model has parameters for both.
    through_drives: Vec<Option<ThroughDrive>>,
    /// sin q/σ, cos q/σ and 1/σ per joint and sample, σ the standard deviation of the position;
    /// empty if no column needs them.
    turns: Vec<[Vec<f64>; 3]>,
    /// q/σ per joint and sample, for scales, and whether these have columns.
    scaled: Vec<Vec<f64>>,
    has_scale_columns: bool,
    /// Relative changes of the parameters by a clock that runs fast.
    tempo: Option<Vec<f64>>,
    /// Square root of the sum of squares of the velocity filter's weights.
    velocity_gain: f64,
    sample_period_s: f64,
}

impl SuspectColumns {
    /// Workspace for `rows` rows of samples in buffers of `capacity`.
    pub fn new(
        plant: &dyn AnyPlant,
        considered: Considered,
        velocity_weights: &[f64],
        moves: impl Fn(usize, usize) -> bool,
        depends_on_place: impl Fn(usize, usize) -> bool,
        rows: usize,
        capacity: usize,
    ) -> Self {
        let effects = SuspectEffects::of(plant);
        let equations = effects.places.inputs.len();
        let column = |e: usize, suspect: usize| match effects.have_column(e, suspect, &moves, &depends_on_place) {
            true => vec![0.0; rows],
            false => Vec::new(),
        };
        let columns: Vec<Vec<Vec<f64>>> = (0..equations)
            .map(|e| (0..effects.places.count()).map(|s| column(e, s)).collect())
            .collect();
        let jumps = &effects.places.jumps;
        let room = |needed: bool| vec![0.0; if needed { capacity } else { 0 }];
        Self {
            sizes: SuspectSizes::new(considered, equations),
            parameters: plant.parameters().iter().map(|p| p.name.to_string()).collect(),
            white: columns.clone(),
            columns,
            drives: (0..equations)
                .map(|e| DriveShapes {
                    dead_band: room(effects.has_dead_band(e)),
                    spring: room(!effects.has_spring[e]),
                })
                .collect(),
            by_direction: jumps
                .iter()
                .map(|&jumps| ByDirection::new(if jumps { capacity } else { 0 }))
                .collect(),
            frictions: jumps.iter().map(|&jumps| [room(true), room(jumps)]).collect(),
            turns: (0..plant.joints())
                .map(|j| {
                    let turns = effects.turns[j] && effects.places.inputs.contains(&j);
                    [room(turns), room(turns), room(turns)]
                })
                .collect(),
            scaled: vec![vec![0.0; capacity]; plant.joints()],
            has_scale_columns: false,
            tempo: tempo(plant),
            velocity_gain: dot(velocity_weights, velocity_weights).sqrt(),
            places: effects.places,
            through_drives: effects.through_drives,
            sample_period_s: 0.0,
        }
    }

    /// With samples a period \[s\] apart.
    #[must_use]
    pub fn with_period(mut self, sample_period_s: f64) -> Self {
        self.sample_period_s = sample_period_s;
        self
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        self.sizes.reset();
        self.through_drives.iter_mut().flatten().for_each(ThroughDrive::reset);
    }

    /// Chooses whether there are columns of scales.
    pub fn enable_scale_columns(&mut self, enabled: bool) {
        let scales = (0..self.places.inputs.len()).map(|of| place(of, SCALE));
        for white in self.white.iter_mut().filter(|_| self.has_scale_columns && !enabled) {
            scales.clone().for_each(|scale| white[scale].fill(0.0));
        }
        self.has_scale_columns = enabled;
    }

    /// Describes an error; indices beyond the last are the drifts of the parameters.
    pub fn describe<'a>(&'a self, suspect: usize, input_unit: &'a str) -> Option<Suspect<'a>> {
        use SuspectKind as Kind;
        if let Some(drifting) = suspect.checked_sub(self.count()) {
            return self.parameters.get(drifting).map(|name| Suspect {
                kind: SuspectKind::Drift,
                parameter: Some(name),
                joint: None,
                unit: "1/s",
                smallest: 0.0,
                largest: f64::INFINITY,
            });
        }
        let (kind, joint) = (self.places.kind(suspect), self.places.joint(suspect));
        let (unit, largest) = match kind {
            Kind::InputDelay => ("s", 0.1),
            Kind::Gain | Kind::GainByDirection | Kind::LoadFriction | Kind::Scale | Kind::Clock => ("1", 1.0),
            Kind::Coulomb | Kind::Stribeck | Kind::Offset | Kind::DeadBand => {
                (input_unit, joint.map_or(0.0, |joint| self.sizes.inputs[joint]))
            }
            Kind::Spring | Kind::Inertia | Kind::Viscous | Kind::ViscousByDirection => ("", f64::INFINITY),
            Kind::Eccentricity => ("rad", 0.1),
            Kind::Resonance => ("s^2", f64::INFINITY),
            Kind::Zero => ("rad", 0.5),
            Kind::Drift => ("1/s", f64::INFINITY),
        };
        Some(Suspect {
            kind,
            parameter: None,
            joint,
            unit,
            // beyond one radian per sample, errors of quadrature look the same
            smallest: match kind {
                SuspectKind::Resonance => self.sample_period_s.powi(2),
                _ => 0.0,
            },
            largest,
        })
    }

    /// Prepares the first `len` samples of a block; `q_std` are the standard deviations of the
    /// positions, `input_noise` that of the noise of a joint's input.
    pub fn sense(&mut self, len: usize, signals: &Trajectory, q_std: &[Vec<f64>], input_noise: impl Fn(usize) -> f64) {
        for joint in 0..self.turns.len() {
            let (u, q) = (&signals.u[joint][..len], &signals.q[joint][..len]);
            self.sizes.sense_joint(joint, u, q, input_noise(joint));
            if self.has_scale_columns {
                let positions = signals.q[joint][..len].iter().zip(&q_std[joint]);
                let scaled = self.scaled[joint].iter_mut().zip(positions);
                scaled.for_each(|(scaled, (q, std))| *scaled = q / std);
            }
            let [sines, cosines, units] = &mut self.turns[joint];
            let mut turned = Turned::default();
            let positions = signals.q[joint][..len].iter().zip(&q_std[joint]);
            for (((sine, cosine), unit), (q, std)) in sines.iter_mut().zip(cosines).zip(units).zip(positions) {
                *unit = 1.0 / std;
                let (sin, cos) = turned.to(*q);
                (*sine, *cosine) = (sin * *unit, cos * *unit);
            }
        }
        for (e, &joint) in self.places.inputs.iter().enumerate() {
            let (dq, q_std) = (&signals.dq[joint][..len], &q_std[joint][..len]);
            self.drives[e].sense_spring(&signals.q[joint][..len]);
            let standing = STANDING * self.velocity_gain;
            self.by_direction[e].sense(&signals.u[joint][..len], dq, (q_std, standing));
            let speed = self.sizes.sense_speed(e, dq, q_std, self.velocity_gain);
            let q = &signals.q[joint][..len];
            self.sizes.sense_travel(e, q, q_std, self.sample_period_s);
            for (friction, share) in self.frictions[e].iter_mut().zip(STRIBECK_SPEEDS) {
                for (friction, (dq, q_std)) in friction.iter_mut().zip(dq.iter().zip(q_std)) {
                    *friction = (dq / (standing * q_std)).clamp(-1.0, 1.0);
                }
                if self.places.jumps[e] && speed == 0.0 {
                    friction.fill(0.0);
                } else if self.places.jumps[e] {
                    for (friction, dq) in friction.iter_mut().zip(dq) {
                        *friction *= (-(dq / (share * speed)).powi(2)).exp();
                    }
                }
            }
        }
    }

    /// Prepares the columns of what drives pass on or lose, for the same samples, at θ.
    pub fn sense_drives(&mut self, len: usize, signals: &Trajectory, plant: &dyn AnyPlant, theta: &[f64]) {
        for (e, &joint) in self.places.inputs.iter().enumerate() {
            let back_emf = self.through_drives[e].as_mut().and_then(|own| {
                own.sense(plant, theta, &signals.q, len);
                own.back_emf()
            });
            let back_emf = back_emf.map_or(0.0, |own| own.per_speed(theta));
            let (u, dq) = (&signals.u[joint][..len], &signals.dq[joint][..len]);
            self.drives[e].sense_dead_band(u, dq, back_emf, self.sizes.inputs[joint]);
        }
    }

    /// Projects the columns that depend on the input and on the sign of the velocity, for one row.
    /// `moments` are ∫ψ^(r) u with the input's scale.
    pub fn project(&mut self, e: usize, row: usize, centre: usize, scale: f64, kernels: &Kernels, moments: [f64; 3]) {
        let (own, columns) = (place(e, 0), &mut self.columns[e]);
        let mut put = |suspect: usize, value: f64| {
            if let Some(entry) = columns[suspect].get_mut(row) {
                *entry = value;
            }
        };
        put(DELAY, -moments[1]);
        put(own + GAIN, -moments[0]);
        put(own + RESONANCE, moments[2]);
        put(own + OFFSET, -scale); // ∫ψ = 1
        let [friction, slow_friction] = &self.frictions[e];
        let DriveShapes { dead_band, spring } = &self.drives[e];
        let shapes = [
            (FRICTION, friction),
            (SLOW_FRICTION, slow_friction),
            (DEAD_BAND, dead_band),
            (SPRING, spring),
            (GAIN_BY_DIRECTION, &self.by_direction[e].inputs),
            (VISCOUS_BY_DIRECTION, &self.by_direction[e].speeds),
            (LOAD_FRICTION, &self.by_direction[e].loads),
        ];
        for (place, shape) in shapes {
            if let Some(shape) = shape.get(centre - kernels.half..=centre + kernels.half) {
                put(own + place, scale * dot(&kernels.position[0], shape));
            }
        }
    }

    /// The column of a resonance.
    pub fn resonance(&mut self, e: usize) -> &mut [f64] {
        &mut self.columns[e][place(e, RESONANCE)]
    }

    /// Projects the columns of an inertia and of viscous friction for one row.
    pub fn project_through_drive(
        &mut self,
        e: usize,
        row: usize,
        signals: &Trajectory,
        centre: usize,
        scale: f64,
        kernels: &Kernels,
    ) {
        let Some(own) = &self.through_drives[e] else { return };
        let columns = &mut self.columns[e][place(e, 0)..];
        if let Some(inertia) = columns[INERTIA].get_mut(row) {
            *inertia = own.inertia(&signals.q, centre, scale, kernels);
        }
        if let Some(friction) = columns[VISCOUS].get_mut(row) {
            *friction = own.friction(&signals.q, centre, scale, kernels);
        }
    }

    /// Columns of eccentricities and zeros for one row: `c(joint)` holds −∂f/∂q times the standard
    /// deviations of some positions, and the buffer position of the first.
    pub fn turn<'a>(&mut self, e: usize, row: usize, c: impl Fn(usize) -> (&'a [f64], usize)) {
        for (of, &joint) in self.places.inputs.iter().enumerate() {
            let (c, first) = c(joint);
            if let (true, Some(entry), Some(scaled)) = (
                self.has_scale_columns,
                self.columns[e][place(of, SCALE)].get_mut(row),
                self.scaled[joint].get(first..first + c.len()),
            ) {
                *entry = -dot(c, scaled);
            }
            let turns = self.turns[joint]
                .each_ref()
                .map(|turn| turn.get(first..first + c.len()));
            let [Some(sines), Some(cosines), Some(units)] = turns else {
                continue;
            };
            let columns = &mut self.columns[e][place(of, 0)..];
            for (at, turns) in [(SINE, sines), (COSINE, cosines), (ZERO, units)] {
                if let Some(entry) = columns[at].get_mut(row) {
                    *entry = -dot(c, turns);
                }
            }
        }
    }

    /// Whitens the columns of an equation.
    pub fn whiten(&mut self, e: usize, rows: usize, whitening: &mut Whitening) {
        let (columns, enabled) = (self.white[e].iter_mut().zip(&self.columns[e]), self.has_scale_columns);
        let wanted = |place: &usize| enabled || SuspectPlaces::within(*place).is_none_or(|(_, index)| index != SCALE);
        let columns = columns
            .enumerate()
            .filter(|(place, (_, raw))| !raw.is_empty() && wanted(place));
        let columns = columns.map(|(_, (white, raw))| {
            white[..rows].copy_from_slice(&raw[..rows]);
            &mut white[..rows]
        });
        whitening.apply_all(Direction::Backward, columns);
    }
}

impl SuspectRows for SuspectColumns {
    fn count(&self) -> usize {
        self.places.count()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, columns: &mut [f64]) {
        for (d, column) in columns.iter_mut().zip(&self.white[equation]) {
            *d = column.get(index).copied().unwrap_or(0.0);
        }
    }

    fn std(&self, suspect: usize) -> f64 {
        self.sizes.std(&self.places, &self.through_drives, suspect)
    }

    /// Viscous friction adds to a parameter of back EMF.
    fn inseparable_std(&self, parameter: usize) -> f64 {
        self.sizes
            .inseparable_std(&self.places, &self.through_drives, parameter)
    }

    /// A supply sags, a belt slips, a bus becomes slower.
    fn is_sudden(&self, suspect: usize) -> bool {
        matches!(
            self.places.kind(suspect),
            SuspectKind::InputDelay
                | SuspectKind::Gain
                | SuspectKind::Coulomb
                | SuspectKind::Offset
                | SuspectKind::Zero
                | SuspectKind::Scale
                | SuspectKind::Clock
        )
    }

    /// A scale, and a gain without a prior: parameters are in the units that the drive reports.
    fn is_imitated(&self, suspect: usize) -> bool {
        let kind = self.places.kind(suspect);
        kind == SuspectKind::Scale || kind == SuspectKind::Gain && self.sizes.considered.gain == 0.0
    }

    /// Viscous friction behind an inductance: θ₃ is then off θ₁ θ₄/θ₂.
    fn contradicts_relations(&self, suspect: usize) -> bool {
        self.places.kind(suspect) == SuspectKind::Viscous
    }

    fn is_named(&self, suspect: usize) -> bool {
        self.places.is_named(suspect)
    }

    fn lags_as(&self, suspect: usize) -> Option<usize> {
        self.places.lags_as(suspect)
    }

    fn imitation(&self, suspect: usize) -> Option<&[f64]> {
        self.tempo.as_deref().filter(|_| suspect == 1 + CLOCK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Manipulator;

    #[test]
    fn prop_a_zero_that_nothing_depends_on_has_no_column() {
        let considered = Considered {
            eccentricity_rad: 0.0,
            ..Considered::default()
        };
        // the arm's first joint turns about the vertical, so gravity does not depend on its
        // position
        let depends = |_: usize, joint: usize| joint == 1;
        let suspects = SuspectColumns::new(&Manipulator::default(), considered, &[1.0], |_, _| true, depends, 3, 3);
        for equation in 0..2 {
            let column = |of: usize| &suspects.columns[equation][place(of, ZERO)];
            assert!(column(0).is_empty() && !column(1).is_empty());
        }
    }
}
