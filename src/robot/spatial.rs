//! Spatial vectors, placements and the ten inertial parameters of a rigid body.
//!
//! A motion (ω, v) is taken at the origin of the frame that it is expressed in. With E, r the
//! rotation and origin of a child frame as seen by its parent,
//!
//! ```text
//! ω' = Eᵀ ω,   v' = Eᵀ (v + ω × r)                                  (1) motion in the child's frame
//! (ω, v) × (a, l) = (ω × a, ω × l + v × a)                          (2) rate of change of a moved vector
//! I (ω, v) = (h × v + J ω, m v + ω × h)                             (3) momentum about the origin, and linear
//! u · (I v) = m u_l·v + h·(u_l × ω + v × u_a) + u_aᵀ J ω            (4) the same, linear in m, h, J
//! ```
//!
//! m is the mass \[kg\], h = m c the first moment \[kg m\], J the inertia about the origin \[kg
//! m²\]. Source: R. Featherstone, *Rigid Body Dynamics Algorithms* (2008), chapter 2.

use nalgebra::{Matrix3, Vector3};

/// Parameters of one body, in this order: m, h_x, h_y, h_z, J_xx, J_xy, J_yy, J_xz, J_yz, J_zz.
pub const BODY_PARAMETERS: usize = 10;

/// A spatial motion: angular part \[rad/s\] and linear part \[m/s\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Angular part.
    pub angular: Vector3<f64>,
    /// Linear part at the origin of the frame.
    pub linear: Vector3<f64>,
}

impl Motion {
    /// A motion from both parts.
    pub const fn new(angular: Vector3<f64>, linear: Vector3<f64>) -> Self {
        Self { angular, linear }
    }

    /// (2): this motion's cross product with a motion.
    #[must_use]
    pub fn cross(&self, other: &Self) -> Self {
        Self {
            angular: self.angular.cross(&other.angular), // (2)
            linear: self.angular.cross(&other.linear) + self.linear.cross(&other.angular), // (2)
        }
    }

    /// Scaled by a number.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self::new(self.angular * factor, self.linear * factor)
    }

    /// The sum of two motions.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self::new(self.angular + other.angular, self.linear + other.linear)
    }

    /// (4): writes the coefficients of u · (I v) over the ten parameters; `self` is u.
    pub fn momentum_row(&self, v: &Self, row: &mut [f64; BODY_PARAMETERS]) {
        let (a, w) = (&self.angular, &v.angular);
        let h = self.linear.cross(w) + v.linear.cross(a); // (4)
        *row = [
            self.linear.dot(&v.linear), // (4)
            h.x,
            h.y,
            h.z,
            a.x * w.x, // (4): aᵀ J ω
            a.x * w.y + a.y * w.x,
            a.y * w.y,
            a.x * w.z + a.z * w.x,
            a.y * w.z + a.z * w.y,
            a.z * w.z,
        ];
    }
}

/// Placement of a child frame in its parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// E: columns are the child's axes.
    pub rotation: Matrix3<f64>,
    /// r: the child's origin \[m\].
    pub translation: Vector3<f64>,
}

impl Placement {
    /// The same frame.
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// From a URDF origin: fixed-axis roll, pitch, yaw \[rad\] and a translation \[m\].
    pub fn from_rpy(rpy: Vector3<f64>, translation: Vector3<f64>) -> Self {
        let rotation = nalgebra::Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z).into_inner();
        Self { rotation, translation }
    }

    /// Placement of `child`'s frame, given in this frame, as seen by this frame's parent.
    #[must_use]
    pub fn then(&self, child: &Self) -> Self {
        Self {
            rotation: self.rotation * child.rotation,
            translation: self.translation + self.rotation * child.translation,
        }
    }

    /// Placement of the parent's frame in the child.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self {
            rotation: self.rotation.transpose(),
            translation: -self.rotation.tr_mul(&self.translation),
        }
    }

    /// (1): a motion of the parent's frame in the child's.
    #[must_use]
    pub fn into_child(&self, motion: &Motion) -> Motion {
        Motion {
            angular: self.rotation.tr_mul(&motion.angular), // (1)
            linear: self
                .rotation
                .tr_mul(&(motion.linear + motion.angular.cross(&self.translation))), // (1)
        }
    }
}

/// The ten inertial parameters of a body about the origin of its frame; see [`BODY_PARAMETERS`] for
/// the order.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyParameters(pub [f64; BODY_PARAMETERS]);

impl BodyParameters {
    /// From mass \[kg\], centre of mass \[m\] and inertia about the centre of mass \[kg m²\], both
    /// in the body's frame.
    pub fn new(mass: f64, center: Vector3<f64>, inertia_at_center: Matrix3<f64>) -> Self {
        // Steiner: J = J_c + m (c·c 1 − c cᵀ).
        let j = inertia_at_center + mass * (Matrix3::identity() * center.norm_squared() - center * center.transpose());
        Self::from_parts(mass, mass * center, j)
    }

    /// From mass, first moment and inertia about the origin.
    pub fn from_parts(mass: f64, h: Vector3<f64>, j: Matrix3<f64>) -> Self {
        Self([
            mass,
            h.x,
            h.y,
            h.z,
            j[(0, 0)],
            j[(0, 1)],
            j[(1, 1)],
            j[(0, 2)],
            j[(1, 2)],
            j[(2, 2)],
        ])
    }

    /// m \[kg\].
    pub fn mass(&self) -> f64 {
        self.0[0]
    }

    /// h = m c \[kg m\].
    pub fn first_moment(&self) -> Vector3<f64> {
        Vector3::new(self.0[1], self.0[2], self.0[3])
    }

    /// J about the origin \[kg m²\].
    pub fn inertia(&self) -> Matrix3<f64> {
        let [_, _, _, _, xx, xy, yy, xz, yz, zz] = self.0;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Relative amount by which the largest principal inertia about the centre of mass exceeds the
    /// sum of the two others; negative for a body that can exist.
    pub fn excess(&self) -> f64 {
        let center = self.first_moment() / self.mass();
        let steiner = self.mass() * (Matrix3::identity() * center.norm_squared() - center * center.transpose());
        let principal = (self.inertia() - steiner).symmetric_eigenvalues();
        let largest = principal.max();
        (2.0 * largest - principal.sum()) / largest
    }

    /// The same body in the frame in which `placement` places this body's frame.
    #[must_use]
    pub fn moved(&self, placement: &Placement) -> Self {
        let (e, r, mass) = (&placement.rotation, &placement.translation, self.mass());
        let h = e * self.first_moment(); // about the old origin, in the new axes
        let outer = |a: &Vector3<f64>, b: &Vector3<f64>| Matrix3::identity() * a.dot(b) - a * b.transpose();
        let j = e * self.inertia() * e.transpose() + mass * outer(r, r) + outer(r, &h) + outer(&h, r);
        Self::from_parts(mass, h + mass * r, j)
    }

    /// Two bodies as one; both in the same frame.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }

    /// (3): momentum about the origin and linear momentum of a motion, or moment and force of an
    /// acceleration.
    pub fn apply(&self, motion: &Motion) -> (Vector3<f64>, Vector3<f64>) {
        let (h, w, v) = (self.first_moment(), &motion.angular, &motion.linear);
        (
            h.cross(v) + self.inertia() * w, // (3)
            self.mass() * v + w.cross(&h),   // (3)
        )
    }
}
