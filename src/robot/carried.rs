//! The payload in the form that robot controllers use.

use super::identify::RobotIdentifier;
use super::physical::{controller_std, controller_values, information, project};
use super::spatial::{BODY_PARAMETERS, BodyParameters};

/// Name, unit and meaning of a payload's derived values, in the order of [`controller_values`].
pub const PAYLOAD_VALUES: [(&str, &str, &str); BODY_PARAMETERS] = [
    ("payload_mass", "kg", "mass of the payload"),
    (
        "payload_com_x",
        "m",
        "centre of mass of the payload in the flange's frame, x",
    ),
    (
        "payload_com_y",
        "m",
        "centre of mass of the payload in the flange's frame, y",
    ),
    (
        "payload_com_z",
        "m",
        "centre of mass of the payload in the flange's frame, z",
    ),
    (
        "payload_inertia_xx",
        "kg m^2",
        "inertia of the payload about its centre of mass, xx",
    ),
    (
        "payload_inertia_xy",
        "kg m^2",
        "inertia of the payload about its centre of mass, xy",
    ),
    (
        "payload_inertia_yy",
        "kg m^2",
        "inertia of the payload about its centre of mass, yy",
    ),
    (
        "payload_inertia_xz",
        "kg m^2",
        "inertia of the payload about its centre of mass, xz",
    ),
    (
        "payload_inertia_yz",
        "kg m^2",
        "inertia of the payload about its centre of mass, yz",
    ),
    (
        "payload_inertia_zz",
        "kg m^2",
        "inertia of the payload about its centre of mass, zz",
    ),
];

/// A payload in the form that robot controllers use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarriedPayload {
    /// Ten parameters at the flange, physically possible.
    pub body: BodyParameters,
    /// See [`controller_values`].
    pub values: [f64; BODY_PARAMETERS],
    /// Their standard deviations.
    pub std: [f64; BODY_PARAMETERS],
}

impl RobotIdentifier {
    /// The nearest physically possible payload. `None` if nothing is carried, or while no such body
    /// is near, as in the first moments.
    pub fn carried(&self) -> Option<CarriedPayload> {
        let payload = self.learner.flange.carried()?;
        let first = payload.first;
        let mut covariance = [0.0; BODY_PARAMETERS * BODY_PARAMETERS];
        let mut estimate = BodyParameters::default();
        for p in 0..BODY_PARAMETERS {
            estimate.0[p] = self.theta()[first + p];
            for q in 0..BODY_PARAMETERS {
                covariance[p * BODY_PARAMETERS + q] = self.covariance(first + p, first + q);
            }
            // A fixed parameter is known.
            let least = (1e-6 * payload.prior[p]).powi(2);
            covariance[p * (BODY_PARAMETERS + 1)] += least;
        }
        let body = project(&estimate, &information(&covariance)?)?;
        let values = controller_values(&body);
        let mut std = controller_std(&body, &covariance);
        // Gains scale mass and inertia, and leave the centre of mass where it is.
        let own = |p: usize| !(1..4).contains(&p) && !self.is_fixed(first + p);
        for p in (0..BODY_PARAMETERS).filter(|p| own(*p)) {
            std[p] = std[p].hypot(self.learner.options.gain_std * values[p]);
        }
        Some(CarriedPayload { body, values, std })
    }
}
