//! Integrands of the columns of a drive's dead band, or dead time, and of a spring.
//!
//! ```text
//! dead band  sat(u/u₀)      dead time of a drive with back EMF e q̇  sat((u − e q̇)/u₀)      spring  q
//! u₀ = u_r/50,   sat: the sign function with a linear middle
//! ```
//!
//! The dead time of an amplifier takes a constant voltage with the sign of the current. As long as
//! the voltage across the inductance is small, the current has the sign of u − e q̇.

/// u₀, as a share of the input's size u_r.
const DEAD: f64 = 0.02;

/// The integrands of one equation, per sample; empty if no column needs them.
#[derive(Debug, Clone)]
pub(super) struct DriveShapes {
    pub dead_band: Vec<f64>,
    pub spring: Vec<f64>,
}

impl DriveShapes {
    /// Prepares the integrand of a spring.
    pub fn sense_spring(&mut self, q: &[f64]) {
        let shape = self.spring.iter_mut().zip(q);
        shape.for_each(|(shape, q)| *shape = *q);
    }

    /// Prepares the integrand of a dead band, or of a dead time if the drive has back EMF \[input
    /// per rad/s or m/s\], for inputs of this size.
    pub fn sense_dead_band(&mut self, u: &[f64], dq: &[f64], back_emf: f64, size: f64) {
        let dead = (DEAD * size).max(f64::MIN_POSITIVE);
        let shape = self.dead_band.iter_mut().zip(u.iter().zip(dq));
        shape.for_each(|(shape, (u, dq))| *shape = ((u - back_emf * dq) / dead).clamp(-1.0, 1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_dead_time_has_the_sign_of_the_current() {
        let mut shapes = DriveShapes {
            dead_band: vec![0.0; 3],
            spring: Vec::new(),
        };
        let (u, dq) = ([4.0, -4.0, 0.1], [2.0, -1.0, 0.0]);
        shapes.sense_dead_band(&u, &dq, 0.0, 10.0);
        assert_eq!(shapes.dead_band, [1.0, -1.0, 0.5]);
        // at 2 rad/s the back EMF of 6 V exceeds the 4 V, so the current is negative
        shapes.sense_dead_band(&u, &dq, 3.0, 10.0);
        assert_eq!(shapes.dead_band, [-1.0, -1.0, 0.5]);
        shapes.sense_spring(&[1.0; 3]);
        assert!(shapes.spring.is_empty());
    }
}
