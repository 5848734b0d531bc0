//! How large the errors of a machine may be, judged by its signals so far.
//!
//! The standard deviations of friction, dead band, offset and spring are shares of u_r, the largest
//! root mean square of a block's input so far, so one default fits drives of any voltage. The
//! offset is a share of u_r or of 400 standard deviations of the input's noise, whichever is
//! larger: the offset of an amplifier or a sensor does not depend on the motion, and u_r is small
//! in slow motion.

use super::spread::{root_mean_square, standard_deviation};
use super::suspect::{Considered, SuspectKind};
use super::suspect_places::SuspectPlaces;
use super::through_drive::ThroughDrive;
use crate::model::MAX_JOINTS;
use std::f64::consts::TAU;

/// Range of an input in standard deviations of its noise, at least.
const RANGE: f64 = 400.0;
/// Ratio of the velocity's root mean square in a block to that of its noise above which the joint
/// has moved, and above which the velocity of most samples is hardly noise.
const MOVED: f64 = 4.0;
const CLEAR: f64 = 20.0;
/// Time over which a joint's travel tells whether it has moved \[s\]: a coarse encoder that rests
/// makes velocities over a few samples more uncertain than slow motion is.
const TRAVEL_S: f64 = 0.05;

/// Sizes of the signals of a stream, and the errors considered relative to them.
#[derive(Debug, Clone)]
pub(super) struct SuspectSizes {
    pub considered: Considered,
    /// Largest root mean square of each joint's input so far, and of its position about the mean.
    pub inputs: [f64; MAX_JOINTS],
    travels: [f64; MAX_JOINTS],
    /// Standard deviation of the noise of each joint's input.
    input_noises: [f64; MAX_JOINTS],
    /// Of each equation.
    speeds: Vec<Speeds>,
}

/// Root mean squares of the velocity that belongs to an equation; 0 until there is such a block.
#[derive(Debug, Clone, Copy, Default)]
struct Speeds {
    /// In the first block in which the velocity was clear of noise.
    clear: f64,
    /// The largest of the blocks in which the joint moved, without the noise, by its travel.
    fastest: f64,
}

impl Speeds {
    /// That of the first clear block, or by the travel if the encoder is too coarse for one.
    fn typical(&self) -> f64 {
        if self.clear > 0.0 { self.clear } else { self.fastest }
    }

    /// Takes the root mean square of a block, and of the noise in it.
    fn sense(&mut self, own: f64, noise: f64) {
        if own > CLEAR * noise && self.clear == 0.0 {
            self.clear = own;
        }
    }

    /// The same by the travel over a longer time.
    fn sense_travel(&mut self, own: f64, noise: f64) {
        if own > MOVED * noise {
            self.fastest = self.fastest.max((own * own - noise * noise).sqrt());
        }
    }
}

impl SuspectSizes {
    /// Of a stream without samples.
    pub fn new(considered: Considered, equations: usize) -> Self {
        Self {
            considered,
            inputs: [0.0; MAX_JOINTS],
            travels: [0.0; MAX_JOINTS],
            input_noises: [0.0; MAX_JOINTS],
            speeds: vec![Speeds::default(); equations],
        }
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        (self.inputs, self.travels) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        self.speeds.fill(Speeds::default());
    }

    /// Takes the input and the positions of a joint in a block; `input_noise` is the standard
    /// deviation of the input's noise.
    pub fn sense_joint(&mut self, joint: usize, u: &[f64], q: &[f64], input_noise: f64) {
        self.input_noises[joint] = input_noise;
        self.inputs[joint] = self.inputs[joint].max(root_mean_square(u));
        self.travels[joint] = self.travels[joint].max(standard_deviation(q));
    }

    /// Takes the velocity that belongs to an equation in a block; its noise is `velocity_gain`
    /// times that of the positions, whose standard deviations are `q_std`. Returns the velocity's
    /// root mean square in the first block in which it was clear of noise; 0 until then.
    pub fn sense_speed(&mut self, e: usize, dq: &[f64], q_std: &[f64], velocity_gain: f64) -> f64 {
        let speeds = &mut self.speeds[e];
        speeds.sense(root_mean_square(dq), velocity_gain * root_mean_square(q_std));
        speeds.clear
    }

    /// Takes the positions that belong to an equation in a block, and their standard deviations.
    pub fn sense_travel(&mut self, e: usize, q: &[f64], q_std: &[f64], sample_period_s: f64) {
        let lag = ((TRAVEL_S / sample_period_s).round() as usize).max(1);
        let seconds = lag as f64 * sample_period_s;
        if q.len() <= lag {
            return;
        }
        let (mut own, mut noise) = (0.0, 0.0);
        for (pair, std) in q.iter().zip(&q[lag..]).zip(q_std.iter().zip(&q_std[lag..])) {
            own += (pair.1 - pair.0).powi(2);
            noise += std.0.powi(2) + std.1.powi(2);
        }
        let of_speed = |sum: f64| (sum / (q.len() - lag) as f64).sqrt() / seconds;
        self.speeds[e].sense_travel(of_speed(own), of_speed(noise));
    }

    /// Standard deviation of an error's amplitude, 0 if it is only tested for.
    pub fn std(&self, places: &SuspectPlaces, through_drives: &[Option<ThroughDrive>], suspect: usize) -> f64 {
        let of_joint = |sizes: &[f64; MAX_JOINTS]| places.joint(suspect).map_or(0.0, |joint| sizes[joint]);
        let size = of_joint(&self.inputs);
        match places.kind(suspect) {
            // the rows have resolved the default, which depends on the sample period
            SuspectKind::InputDelay => self.considered.input_delay_s.unwrap_or(0.0),
            SuspectKind::Gain => self.considered.gain,
            SuspectKind::Coulomb => self.considered.coulomb * size,
            SuspectKind::Stribeck => self.considered.stribeck * size,
            SuspectKind::Offset => self.considered.offset * size.max(RANGE * of_joint(&self.input_noises)),
            SuspectKind::DeadBand => self.considered.dead_band * size,
            SuspectKind::Spring => match of_joint(&self.travels) {
                0.0 => 0.0,
                travel => self.considered.spring * size / travel,
            },
            SuspectKind::Inertia => {
                let own = SuspectPlaces::within(suspect).and_then(|(e, _)| through_drives[e].as_ref());
                own.map_or(0.0, |own| self.considered.inertia * own.size())
            }
            SuspectKind::Viscous => self.considered.viscous * self.per_speed(suspect, size),
            SuspectKind::GainByDirection => self.considered.gain_by_direction,
            SuspectKind::LoadFriction => self.considered.load_friction,
            SuspectKind::ViscousByDirection => self.considered.viscous_by_direction * self.per_speed(suspect, size),
            SuspectKind::Eccentricity => self.considered.eccentricity_rad,
            SuspectKind::Resonance if self.considered.resonance_hz > 0.0 => {
                (TAU * self.considered.resonance_hz).powi(-2)
            }
            SuspectKind::Zero => self.considered.zero_rad,
            SuspectKind::Resonance | SuspectKind::Scale | SuspectKind::Clock => 0.0,
            SuspectKind::Drift => self.considered.drift_per_s,
        }
    }

    /// The size of a joint's input over the speed of the error's equation; 0 before it moved.
    fn per_speed(&self, suspect: usize, size: f64) -> f64 {
        match SuspectPlaces::within(suspect).map_or(0.0, |(e, _)| self.speeds[e].typical()) {
            0.0 => 0.0,
            speed => size / speed,
        }
    }

    /// Standard deviation that viscous friction adds to a parameter of back EMF, 0 for others.
    pub fn inseparable_std(
        &self,
        places: &SuspectPlaces,
        through_drives: &[Option<ThroughDrive>],
        parameter: usize,
    ) -> f64 {
        let own = through_drives.iter().enumerate().filter_map(|(e, own)| {
            let back_emf = own.as_ref()?.back_emf().filter(|own| own.parameter == parameter)?;
            let of_input = self.considered.friction_in_back_emf * self.inputs[places.inputs[e]];
            let fastest = self.speeds[e].fastest;
            (fastest > 0.0).then(|| (of_input / fastest * back_emf.per_friction).powi(2))
        });
        own.sum::<f64>().sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_joint_has_moved_long_before_each_of_its_velocities_is_clear() {
        let mut speeds = Speeds::default();
        speeds.sense(3.9, 1.0);
        speeds.sense_travel(3.9, 1.0);
        assert_eq!((speeds.fastest, speeds.clear), (0.0, 0.0));
        speeds.sense(5.0, 1.0);
        speeds.sense_travel(5.0, 1.0);
        assert!((speeds.fastest - 24f64.sqrt()).abs() < 1e-12);
        assert_eq!(speeds.clear, 0.0);
        // the first clear one stays
        for own in [21.0, 25.0] {
            speeds.sense(own, 1.0);
            speeds.sense_travel(own, 1.0);
        }
        assert_eq!(speeds.clear, 21.0);
        assert!((speeds.fastest - 624f64.sqrt()).abs() < 1e-12);
    }

    /// An encoder of 13 bits at 2 ms: one move of 0.5 rad/s in a block of rests, where the position
    /// is known to half a count. Velocities over five samples have noise of 0.05 rad/s and more.
    #[test]
    fn val_a_move_between_rests_is_seen_with_a_coarse_encoder() {
        let (period_s, count) = (2e-3, std::f64::consts::TAU / 8192.0);
        let place = |k: usize| 0.5 * period_s * (k.clamp(1000, 1200) as f64 - 1000.0);
        let q: Vec<f64> = (0..1900).map(|k| (place(k) / count).round() * count).collect();
        let mut sizes = SuspectSizes::new(Considered::default(), 1);
        sizes.sense_travel(0, &q, &vec![0.5 * count; 1900], period_s);
        // 0.5 rad/s in 200 of 1875 steps, less at both ends
        let expected = 0.5 * (187.5f64 / 1875.0).sqrt();
        let found = sizes.speeds[0].fastest;
        assert!((found - expected).abs() < 0.05 * expected, "{found} {expected}");
        sizes.reset();
        sizes.sense_travel(0, &vec![0.0; 1900], &vec![0.5 * count; 1900], period_s);
        assert_eq!(sizes.speeds[0].fastest, 0.0);
    }
}
