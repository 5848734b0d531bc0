//! Integrands of the columns of a drive's dead band, or dead time, and of a spring.
//!
//! ```text
//! dead band  sat(u/u₀)      dead time of a drive with back EMF e q̇  sat((u − e q̇)/u₀)      spring  q
//! u₀ = u_r/50,   sat: the sign function with a linear middle
//! ```
//!
//! The dead time of an amplifier takes a voltage with the sign of the current, which is that of
//! u − e q̇ unless the inductance counts.

/// u₀, as a share of the input's size u_r.
const DEAD: f64 = 0.02;

/// The integrands of one equation, per sample; empty if no column needs them.
#[derive(Debug, Clone)]
pub(super) struct DriveShapes {
    pub dead_band: Vec<f64>,
    pub spring: Vec<f64>,
}

impl DriveShapes {
    /// Prepares the integrands for inputs of this size.
    pub fn sense(&mut self, u: &[f64], q: &[f64], size: f64) {
        let shape = self.dead_band.iter_mut().zip(u);
        shape.for_each(|(shape, u)| *shape = sat(*u, size));
        let spring = self.spring.iter_mut().zip(q);
        spring.for_each(|(spring, q)| *spring = *q);
    }

    /// The same for the dead time of a drive with this back EMF \[input per rad/s or m/s\].
    pub fn sense_dead_time(&mut self, u: &[f64], dq: &[f64], back_emf: f64, size: f64) {
        let shape = self.dead_band.iter_mut().zip(u.iter().zip(dq));
        shape.for_each(|(shape, (u, dq))| *shape = sat(u - back_emf * dq, size));
    }
}

fn sat(u: f64, size: f64) -> f64 {
    (u / (DEAD * size).max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0)
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
        shapes.sense(&[4.0, -4.0, 0.1], &[0.0; 3], 10.0);
        assert_eq!(shapes.dead_band, [1.0, -1.0, 0.5]);
        // 4 V at 2 rad/s with 3 V s/rad drive no current forwards
        shapes.sense_dead_time(&[4.0, -4.0, 0.1], &[2.0, -1.0, 0.0], 3.0, 10.0);
        assert_eq!(shapes.dead_band, [-1.0, -1.0, 0.5]);
        assert!(shapes.spring.is_empty());
    }
}
