//! Why the estimates of a robot may not be used, as far as its data tell.

use super::doubt::RobotDoubt;
use super::drive_gain_room::WrongGain;
use super::identify::RobotIdentifier;
use super::impossible_room::Impossible;
use super::left_out_room::LeftOutCause;
use super::other_travel::OtherTravel;
use super::unmodelled::Unmodelled;
use super::urdf_prior::UrdfContradiction;
use super::velocity_ratio::WrongVelocities;

/// Standard deviation of a delay below which a lag of velocities does no harm \[s\].
const LEAST_DELAY_S: f64 = 1e-4;

impl RobotIdentifier {
    /// The first joint whose measured velocities are not the rate of change of its positions.
    pub fn wrong_velocities(&self) -> Option<WrongVelocities> {
        // those formed from the positions cannot lag
        let considered_s = match self.learner.options.formed_over_s {
            Some(_) => f64::INFINITY,
            None => self.learner.options.delay_s.max(LEAST_DELAY_S),
        };
        self.signals.wrong_velocities(considered_s)
    }

    /// The first joint whose torque is clipped while it moves, with the limit \[N m or N\].
    pub fn clipped(&self) -> Option<(usize, f64)> {
        (0..self.model().robot().len()).find_map(|joint| Some((joint, self.rows.clipped(joint)?.0)))
    }

    /// The joint whose torque the model explains least over the last blocks, with the explained
    /// share of its power, if that was below [`LEAST_EXPLAINED`](super::LEAST_EXPLAINED) and has
    /// hardly risen since.
    pub fn unexplained(&self) -> Option<(usize, f64)> {
        let lacking = |joint: &usize| self.recent_rows.lacking[*joint];
        let shares = (0..self.model().robot().len()).filter(lacking);
        let shares = shares.map(|joint| (joint, self.figures.explained[joint]));
        shares.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Why nothing may be used: a drive or an encoder has changed, or might have. `None` if there
    /// is no such doubt.
    pub fn doubt(&self) -> Option<RobotDoubt> {
        let inquired = || self.watch.as_ref()?.doubt();
        self.signals.jump().or_else(inquired)
    }

    /// A gravity or a zero that contradicts the URDF, if the moments show one: no moment may then
    /// be used.
    pub fn contradiction(&self) -> Option<UrdfContradiction> {
        self.checks.contradiction()
    }

    /// A joint whose torque contradicts those of the others: its gain is wrong, and nothing may be
    /// used.
    pub fn wrong_gain(&self) -> Option<WrongGain> {
        self.checks.wrong_gain()
    }

    /// The first impossible estimate: the model does not describe the machine.
    pub fn impossible(&self) -> Option<Impossible> {
        self.checks.impossible()
    }

    /// The missing term that makes estimates wrong, if the residuals show one: the model then does
    /// not describe the machine. Zeros so wrong that they contradict the URDF are reported only by
    /// [`contradiction`](Self::contradiction), because a slope does not give their size.
    pub fn left_out_cause(&self) -> Option<LeftOutCause> {
        let found = self.allowances.left_out_cause()?;
        let is_contradiction = found.what.is_considered() && self.contradiction().is_some();
        (!is_contradiction).then_some(found)
    }

    /// Reversals that take far longer than in the model, if the term that was `found` resembles
    /// them: then they are likelier than the term.
    pub fn other_travel(&self, found: &LeftOutCause) -> Option<OtherTravel> {
        OtherTravel::of(self).filter(|_| found.what.is_one_of_many())
    }

    /// True if a wrong gain is likelier than the term that the model leaves out: zeros, tilts,
    /// springs and delays imitate it.
    pub fn is_gain_likelier(&self) -> bool {
        let is_vague = |what: Unmodelled| what.is_considered() || what.is_one_of_many();
        self.wrong_gain().is_some() && self.left_out_cause().is_some_and(|cause| is_vague(cause.what))
    }

    /// True if a wrong sign is likelier than a term left out of the model. Springs and delays
    /// resemble it, and missing Coulomb friction also makes inertias negative.
    pub fn is_sign_likelier(&self) -> bool {
        let is_vague = |cause: LeftOutCause| cause.what.is_one_of_many();
        matches!(self.impossible(), Some(Impossible::Inertia(_))) && self.left_out_cause().is_none_or(is_vague)
    }
}
