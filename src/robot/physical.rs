//! The physically possible rigid body nearest to an estimate.
//!
//! ```text
//! J(π) = [½ tr(I) 1 − I, h; hᵀ, m] ≻ 0                         a mass density has this π      (1)
//! min ½ (π − π̂)ᵀ Λ (π − π̂) + γ [tr(J₀⁻¹ J) − ln det J]              with decreasing γ        (2)
//! ```
//!
//! (2) is convex in π. J₀ is a ball of the estimated mass at the estimated position. Damped Newton
//! steps follow decreasing γ; coordinates that are positive by construction, such as log-Cholesky,
//! converge slowly along the boundary of the cone. Sources: P. Wensing, S. Kim, J.-J. Slotine, IEEE
//! RA-L 3 (2018); T. Lee, P. Wensing, F. Park, IEEE T-RO 36 (2020).

use super::error::{LoadError, is_load};
use super::spatial::{BODY_PARAMETERS, BodyParameters};
use crate::model::{ball_inertia, load_at_flange};
use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector3};

/// Largest distance of the ball from the flange \[m\].
const FARTHEST: f64 = 0.5;
/// γ at the start and at the end, in nats of a likelihood.
const WEIGHTS: (f64, f64) = (1e4, 0.1);
/// Largest total number of Newton steps.
const STEPS: usize = 80;

type Square = SMatrix<f64, BODY_PARAMETERS, BODY_PARAMETERS>;
type Column = SVector<f64, BODY_PARAMETERS>;

/// (1).
pub fn pseudo_inertia(body: &BodyParameters) -> Matrix4<f64> {
    let (inertia, h) = (body.inertia(), body.first_moment());
    let sigma = Matrix3::identity() * (0.5 * inertia.trace()) - inertia;
    let mut j = Matrix4::zeros();
    j.fixed_view_mut::<3, 3>(0, 0).copy_from(&sigma); // (1)
    j.fixed_view_mut::<3, 1>(0, 3).copy_from(&h);
    j.fixed_view_mut::<1, 3>(3, 0).copy_from(&h.transpose());
    j[(3, 3)] = body.mass();
    j
}

/// True if a body can exist: (1).
pub fn is_physical(body: &BodyParameters) -> bool {
    pseudo_inertia(body).cholesky().is_some()
}

/// ln det J of (1); `None` if the body cannot exist.
pub fn log_determinant(pseudo_inertia: Matrix4<f64>) -> Option<f64> {
    let factor = pseudo_inertia.cholesky()?;
    Some(factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum())
}

/// J of (1) for a body that has 1 of one parameter and 0 of the others.
pub fn directions() -> [Matrix4<f64>; BODY_PARAMETERS] {
    std::array::from_fn(|i| {
        let mut unit = BodyParameters::default();
        unit.0[i] = 1.0;
        pseudo_inertia(&unit)
    })
}

/// The first of 1, ½, ¼, … of a Newton step that lowers the cost from `now` by a tenth of what its
/// decrement promises; `None` if none does. `at` gives the place after a part of the step, `cost`
/// `None` for impossible bodies.
pub fn shortened<X>(now: f64, decrement: f64, at: impl Fn(f64) -> X, cost: impl Fn(&X) -> Option<f64>) -> Option<X> {
    let mut part = 1.0;
    while part > 1e-9 {
        let next = at(part);
        if cost(&next).is_some_and(|next| next <= now - 0.1 * part * decrement) {
            return Some(next);
        }
        part *= 0.5;
    }
    None
}

/// Λ of (2) from a covariance of the ten, row-major; `None` if this is not a covariance.
pub fn information(covariance: &[f64; BODY_PARAMETERS * BODY_PARAMETERS]) -> Option<BodyInformation> {
    let matrix = Square::from_row_slice(covariance);
    // Scaled, because parameters range from kg to g m².
    let scale = matrix.diagonal().map(|x| x.sqrt());
    if !scale.iter().all(|x| *x > 0.0 && x.is_finite()) {
        return None;
    }
    let scaled = Square::from_fn(|i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let inverse = scaled.cholesky()?.inverse();
    Some(BodyInformation(Square::from_fn(|i, j| {
        inverse[(i, j)] / (scale[i] * scale[j])
    })))
}

/// Λ of the ten parameters of a body.
#[derive(Debug, Clone, Copy)]
pub struct BodyInformation(Square);

/// (2): the body nearest to an estimate whose mass is positive; `None` if no such body is near.
pub fn project(estimate: &BodyParameters, information: &BodyInformation) -> Option<BodyParameters> {
    let mass = estimate.mass();
    if !(mass > 0.0 && estimate.0.iter().all(|x| x.is_finite())) {
        return None;
    }
    let ball = ball(mass, estimate.first_moment() / mass);
    let inverse_of_ball = pseudo_inertia(&ball).try_inverse()?;
    let directions = directions();
    let slope = Column::from_fn(|i, _| (inverse_of_ball * directions[i]).trace());
    let wanted = Column::from(estimate.0);
    let cost = |x: &Column, gamma: f64| -> Option<f64> {
        let logarithm = log_determinant(pseudo_inertia(&BodyParameters((*x).into())))?;
        let off = x - wanted;
        Some(0.5 * off.dot(&(information.0 * off)) + gamma * (slope.dot(x) - logarithm)) // (2)
    };
    let mut x = Column::from(ball.0);
    let mut gamma = WEIGHTS.0;
    for _ in 0..STEPS {
        let inverse = pseudo_inertia(&BodyParameters(x.into())).try_inverse()?;
        let turned = directions.map(|direction| inverse * direction);
        let gradient = information.0 * (x - wanted) + gamma * (slope - Column::from_fn(|i, _| turned[i].trace()));
        let hessian = information.0 + Square::from_fn(|i, j| gamma * (turned[i] * turned[j]).trace());
        // Scaled to a unit diagonal, because parameters have very different sizes.
        let scale = hessian.diagonal().map(|d| 1.0 / d.sqrt());
        let scaled = Square::from_fn(|i, j| hessian[(i, j)] * scale[i] * scale[j]);
        let right = Column::from_fn(|i, _| -gradient[i] * scale[i]);
        let step = scaled.cholesky()?.solve(&right);
        let decrement = right.dot(&step);
        let step = Column::from_fn(|i, _| step[i] * scale[i]);
        let mut is_minimum = decrement < 1e-6;
        if !is_minimum {
            let now = cost(&x, gamma)?;
            let next = shortened(now, decrement, |part| x + step * part, |x| cost(x, gamma));
            is_minimum = next.is_none();
            x = next.unwrap_or(x);
        }
        if is_minimum {
            if gamma <= WEIGHTS.1 {
                break;
            }
            gamma = (0.1 * gamma).max(WEIGHTS.1);
        }
    }
    let body = BodyParameters(x.into());
    is_physical(&body).then_some(body)
}

/// A declared load: mass \[kg\], centre of mass in the flange's frame \[m\], inertia about the
/// centre of mass in the axes of the flange, xx, xy, yy, xz, yz, zz \[kg m²\]; without an inertia,
/// that of an aluminium ball.
///
/// # Errors
/// If no body can have these values.
pub fn declared_load(mass_kg: f64, center_m: [f64; 3], inertia: Option<[f64; 6]>) -> Result<BodyParameters, LoadError> {
    if !is_load(mass_kg, Some(center_m)) {
        return Err(LoadError::Mass { mass_kg, center_m });
    }
    let body = BodyParameters(load_at_flange(mass_kg, center_m, inertia));
    match is_physical(&body) {
        true => Ok(body),
        false => Err(LoadError::Inertia(inertia.unwrap_or_default())),
    }
}

fn ball(mass: f64, center: Vector3<f64>) -> BodyParameters {
    let distance = center.norm();
    let center = if distance > FARTHEST {
        center * (FARTHEST / distance)
    } else {
        center
    };
    BodyParameters::new(mass, center, Matrix3::identity() * ball_inertia(mass))
}

/// The values that robot controllers use: mass \[kg\], centre of mass in the flange's frame \[m\],
/// inertia about the centre of mass in the axes of the flange, xx, xy, yy, xz, yz, zz \[kg m²\].
pub fn controller_values(body: &BodyParameters) -> [f64; BODY_PARAMETERS] {
    let (mass, h) = (body.mass(), body.first_moment());
    let c = h / mass;
    let j = body.inertia() - mass * (Matrix3::identity() * c.norm_squared() - c * c.transpose());
    [
        mass,
        c.x,
        c.y,
        c.z,
        j[(0, 0)],
        j[(0, 1)],
        j[(1, 1)],
        j[(0, 2)],
        j[(1, 2)],
        j[(2, 2)],
    ]
}

/// Standard deviations of [`controller_values`] at a body whose parameters have this covariance,
/// row-major, to first order.
pub fn controller_std(
    body: &BodyParameters,
    covariance: &[f64; BODY_PARAMETERS * BODY_PARAMETERS],
) -> [f64; BODY_PARAMETERS] {
    // Central differences; the values are polynomials over m.
    let slopes: [[f64; BODY_PARAMETERS]; BODY_PARAMETERS] = std::array::from_fn(|p| {
        let h = 1e-5 * body.mass().max(1e-6);
        let at = |step: f64| {
            let mut moved = *body;
            moved.0[p] += step;
            controller_values(&moved)
        };
        let (up, down) = (at(h), at(-h));
        std::array::from_fn(|k| (up[k] - down[k]) / (2.0 * h))
    });
    std::array::from_fn(|k| {
        let mut variance = 0.0;
        for p in 0..BODY_PARAMETERS {
            for q in 0..BODY_PARAMETERS {
                variance += slopes[p][k] * covariance[p * BODY_PARAMETERS + q] * slopes[q][k];
            }
        }
        variance.max(0.0).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_declared_load_has_the_parameters_of_its_body() {
        let (mass, center, inertia) = (2.5, [0.03, 0.15, -0.16], [0.02, 0.001, 0.03, -0.002, 0.003, 0.025]);
        let [xx, xy, yy, xz, yz, zz] = inertia;
        let about_center = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let body = BodyParameters::new(mass, center.into(), about_center);
        let declared = declared_load(mass, center, Some(inertia)).unwrap();
        let values = controller_values(&declared);
        for k in 0..BODY_PARAMETERS {
            assert!((declared.0[k] - body.0[k]).abs() < 1e-15, "{k}");
        }
        // The values for robot controllers are those declared.
        for (value, stated) in values.iter().zip([mass].iter().chain(&center).chain(&inertia)) {
            assert!((value - stated).abs() < 1e-15);
        }
        assert!(declared_load(mass, center, Some([1.0, 0.0, 0.1, 0.0, 0.0, 0.1])).is_err());
        assert!(declared_load(0.0, center, None).is_err());
    }

    #[test]
    fn prop_what_is_projected_is_physical_and_what_is_physical_stays() {
        let true_body = BodyParameters::new(
            2.8,
            Vector3::new(0.03, 0.15, -0.16),
            Matrix3::from_diagonal(&Vector3::new(0.02, 0.03, 0.025)),
        );
        let mut covariance = [0.0; 100];
        for (i, std) in [0.03, 0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02]
            .iter()
            .enumerate()
        {
            covariance[i * 11] = std * std;
        }
        let lambda = information(&covariance).unwrap();
        let near = project(&true_body, &lambda).unwrap();
        for i in 0..10 {
            let off = (near.0[i] - true_body.0[i]).abs();
            assert!(off < covariance[i * 11].sqrt(), "{i}: {off}");
        }
        // Inertias as estimated without excitation: negative, or in violation of the triangle
        // inequality.
        for inertia in [[-0.1, 0.05, 0.2], [0.5, 0.01, 0.01], [0.0, 0.0, 0.0]] {
            let mut body = true_body;
            (body.0[4], body.0[6], body.0[9]) = (inertia[0], inertia[1], inertia[2]);
            assert!(!is_physical(&body));
            let body = project(&body, &lambda).unwrap();
            assert!(is_physical(&body));
            assert!((body.mass() - 2.8).abs() < 0.2, "{}", body.mass());
        }
        let mut none = true_body;
        none.0[0] = -1.0;
        assert!(project(&none, &lambda).is_none());
    }

    #[test]
    fn val_controllers_get_the_inertia_about_the_centre_of_mass() {
        let inertia = Matrix3::new(0.02, 0.001, -0.002, 0.001, 0.03, 0.003, -0.002, 0.003, 0.025);
        let body = BodyParameters::new(2.0, Vector3::new(0.1, -0.2, 0.3), inertia);
        let values = controller_values(&body);
        let expected = [2.0, 0.1, -0.2, 0.3, 0.02, 0.001, 0.03, -0.002, 0.003, 0.025];
        for (value, expected) in values.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-12);
        }
        // With the mass known to 1 % and h exact, c = h/m is known to 1 %.
        let mut covariance = [0.0; 100];
        covariance[0] = 4e-4;
        let std = controller_std(&body, &covariance);
        assert!((std[0] - 0.02).abs() < 1e-6 && (std[2] - 0.002).abs() < 1e-6);
    }
}
