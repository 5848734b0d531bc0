//! Commanded positions φ_z of (13), which excite the plant.
//!
//! Stepping kinds hold their value from one sample to the next; smooth kinds are evaluated at any
//! instant of the integrator. Holding a smooth reference over 1 ms would put a staircase into the
//! voltage, which no later filter can remove.

use super::error::{SimError, finite, in_range, not_negative, positive};
use super::moves::{Moves, MovesSource};
use super::noise::Noise;
use super::schedule::Interpolation;
use std::f64::consts::TAU;

/// One sine of a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Frequency \[Hz\], > 0.
    pub frequency_hz: f64,
    /// Amplitude \[rad\].
    pub amplitude_rad: f64,
    /// Phase at t = 0 \[rad\].
    pub phase_rad: f64,
}

/// Commanded position of one joint over time.
#[derive(Debug, Clone, PartialEq)]
pub enum Setpoint {
    /// A cycle of levels, each held for the same time.
    Steps {
        /// Levels \[rad\], at least one.
        levels_rad: Vec<f64>,
        /// Time on each level \[s\], at least one sample period; rounded to whole samples.
        dwell_s: f64,
        /// Position within the cycle at the start of the run \[s\], ≥ 0; rounded to whole samples.
        shift_s: f64,
    },
    /// Between offset + amplitude and offset − amplitude, starting with the former.
    Square {
        /// Amplitude \[rad\].
        amplitude_rad: f64,
        /// Mean \[rad\].
        offset_rad: f64,
        /// Period \[s\], at least two sample periods; half of it rounded to whole samples.
        period_s: f64,
        /// Position within the period at the start of the run \[s\], ≥ 0; rounded to whole samples.
        shift_s: f64,
    },
    /// Sum of given sines.
    Sines {
        /// Mean \[rad\].
        offset_rad: f64,
        /// The sines, at least one.
        tones: Vec<Tone>,
    },
    /// Sum of sines drawn from the seed: one in each of `count` equal parts of the logarithmic
    /// frequency range, phases uniform, amplitudes falling as 1/frequency (equal velocities) and
    /// scaled so that their sum is `amplitude_rad`.
    RandomSines {
        /// Number of sines, 1 to 64.
        count: usize,
        /// Lowest frequency \[Hz\], > 0.
        min_frequency_hz: f64,
        /// Highest frequency \[Hz\], ≥ the lowest.
        max_frequency_hz: f64,
        /// Bound of the sum's magnitude \[rad\], ≥ 0.
        amplitude_rad: f64,
    },
    /// Levels and dwell times drawn from the seed, both uniform.
    Random {
        /// Lowest level \[rad\].
        min_rad: f64,
        /// Highest level \[rad\].
        max_rad: f64,
        /// Shortest dwell \[s\], at least one sample period; rounded to whole samples.
        min_dwell_s: f64,
        /// Longest dwell \[s\].
        max_dwell_s: f64,
    },
    /// A sine whose frequency rises exponentially over `sweep_s`, then again from the start.
    Chirp {
        /// Amplitude \[rad\].
        amplitude_rad: f64,
        /// Mean \[rad\].
        offset_rad: f64,
        /// First frequency \[Hz\], > 0.
        start_frequency_hz: f64,
        /// Last frequency \[Hz\], > 0.
        end_frequency_hz: f64,
        /// Length of a sweep \[s\], > 0.
        sweep_s: f64,
    },
    /// Moves from point to point with rests between them, drawn from the seed.
    Moves(Moves),
    /// Values at given times; the first value before the first time, the last one after the last.
    Table {
        /// Times \[s\], increasing, at least one.
        t_s: Vec<f64>,
        /// Values \[rad\], as many.
        values_rad: Vec<f64>,
        /// Interpolation between them; steps take effect at the first sample at or after their
        /// time.
        interpolation: Interpolation,
    },
}

impl Setpoint {
    /// One position throughout.
    pub fn constant(level_rad: f64) -> Self {
        Self::Steps {
            levels_rad: vec![level_rad],
            dwell_s: 1.0,
            shift_s: 0.0,
        }
    }

    /// True for the kinds that jump at sample instants and hold in between.
    pub fn has_steps(&self) -> bool {
        match self {
            Self::Steps { .. } | Self::Square { .. } | Self::Random { .. } => true,
            Self::Table { interpolation, .. } => *interpolation == Interpolation::Step,
            Self::Sines { .. } | Self::RandomSines { .. } | Self::Chirp { .. } | Self::Moves(_) => false,
        }
    }

    /// Checks every value against its domain; `sample_period_s` is the run's Δ.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self, sample_period_s: f64) -> Result<(), SimError> {
        let at_least = |field, value: f64, periods: f64| in_range(field, value, periods * sample_period_s, 1e9);
        match self {
            Self::Steps {
                levels_rad,
                dwell_s,
                shift_s,
            } => {
                if levels_rad.is_empty() {
                    return Err(SimError::new("setpoint.levels_rad", "at least one level", "none"));
                }
                levels_rad
                    .iter()
                    .try_for_each(|&level| finite("setpoint.levels_rad", level))?;
                at_least("setpoint.dwell_s", *dwell_s, 1.0)?;
                in_range("setpoint.shift_s", *shift_s, 0.0, 1e9)
            }
            Self::Square {
                amplitude_rad,
                offset_rad,
                period_s,
                shift_s,
            } => {
                finite("setpoint.amplitude_rad", *amplitude_rad)?;
                finite("setpoint.offset_rad", *offset_rad)?;
                at_least("setpoint.period_s", *period_s, 2.0)?;
                in_range("setpoint.shift_s", *shift_s, 0.0, 1e9)
            }
            Self::Sines { offset_rad, tones } => {
                finite("setpoint.offset_rad", *offset_rad)?;
                if tones.is_empty() {
                    return Err(SimError::new("setpoint.tones", "at least one sine", "none"));
                }
                tones.iter().try_for_each(|tone| {
                    positive("setpoint.tones.frequency_hz", tone.frequency_hz)?;
                    finite("setpoint.tones.amplitude_rad", tone.amplitude_rad)?;
                    finite("setpoint.tones.phase_rad", tone.phase_rad)
                })
            }
            Self::RandomSines {
                count,
                min_frequency_hz,
                max_frequency_hz,
                amplitude_rad,
            } => {
                if !(1..=64).contains(count) {
                    return Err(SimError::new("setpoint.count", "1 to 64", count));
                }
                positive("setpoint.min_frequency_hz", *min_frequency_hz)?;
                in_range("setpoint.max_frequency_hz", *max_frequency_hz, *min_frequency_hz, 1e6)?;
                not_negative("setpoint.amplitude_rad", *amplitude_rad)
            }
            Self::Random {
                min_rad,
                max_rad,
                min_dwell_s,
                max_dwell_s,
            } => {
                finite("setpoint.min_rad", *min_rad)?;
                finite("setpoint.max_rad", *max_rad)?;
                in_range("setpoint.max_rad", *max_rad, *min_rad, f64::MAX)?;
                at_least("setpoint.min_dwell_s", *min_dwell_s, 1.0)?;
                in_range("setpoint.max_dwell_s", *max_dwell_s, *min_dwell_s, 1e9)
            }
            Self::Chirp {
                amplitude_rad,
                offset_rad,
                start_frequency_hz,
                end_frequency_hz,
                sweep_s,
            } => {
                finite("setpoint.amplitude_rad", *amplitude_rad)?;
                finite("setpoint.offset_rad", *offset_rad)?;
                positive("setpoint.start_frequency_hz", *start_frequency_hz)?;
                positive("setpoint.end_frequency_hz", *end_frequency_hz)?;
                positive("setpoint.sweep_s", *sweep_s)
            }
            Self::Moves(moves) => moves.validate(sample_period_s),
            Self::Table { t_s, values_rad, .. } => validate_table(t_s, values_rad),
        }
    }
}

fn validate_table(t_s: &[f64], values_rad: &[f64]) -> Result<(), SimError> {
    if t_s.is_empty() || t_s.len() != values_rad.len() {
        let got = format!("{} times and {} values", t_s.len(), values_rad.len());
        return Err(SimError::new(
            "setpoint.table",
            "as many times as values, at least one",
            got,
        ));
    }
    t_s.iter().try_for_each(|&t| finite("setpoint.table.t_s", t))?;
    values_rad
        .iter()
        .try_for_each(|&value| finite("setpoint.table.values_rad", value))?;
    match t_s.windows(2).find(|pair| pair[1] <= pair[0]) {
        Some(pair) => {
            let got = format!("{} s after {} s", pair[1], pair[0]);
            Err(SimError::new("setpoint.table.t_s", "rising times", got))
        }
        None => Ok(()),
    }
}

/// The setpoints of one joint of a run, as in its simulator.
#[derive(Debug, Clone)]
pub struct SetpointPath {
    source: SetpointSource,
    begun: Option<u64>,
}

impl SetpointPath {
    /// A valid setpoint of joint `joint`, counted from 0, in a run with this sample period \[s\]
    /// and seed.
    pub fn new(setpoint: &Setpoint, joint: usize, sample_period_s: f64, seed: u64) -> Self {
        let noise = Noise::new(seed, Noise::setpoint_stream(joint));
        Self {
            source: SetpointSource::new(setpoint, sample_period_s, noise),
            begun: None,
        }
    }

    /// The setpoint at sample `k` and a fraction, 0 to 1, of a period. Samples must not go back.
    pub fn value(&mut self, k: u64, fraction: f64) -> f64 {
        let from = self.begun.map_or(0, |begun| begun + 1);
        (from..=k).for_each(|k| self.source.begin_sample(k));
        self.begun = Some(k.max(self.begun.unwrap_or(0)));
        self.source.value(fraction)
    }
}

/// A running [`Setpoint`]: call [`begin_sample`](Self::begin_sample) for k = 0, 1, 2 …, then
/// [`value`](Self::value) within that sample.
#[derive(Debug, Clone)]
pub(super) struct SetpointSource {
    kind: Source,
    sample_period_s: f64,
    /// Present sample.
    k: u64,
    /// Level held during this sample, for kinds that step.
    held: f64,
}

#[derive(Debug, Clone)]
enum Source {
    Steps {
        levels: Vec<f64>,
        dwell: u64,
        shift: u64,
    },
    Sines {
        offset: f64,
        tones: Vec<Tone>,
    },
    Random {
        min: f64,
        max: f64,
        min_dwell_s: f64,
        max_dwell_s: f64,
        noise: Box<Noise>,
        until: u64,
    },
    Chirp {
        amplitude: f64,
        offset: f64,
        start: f64,
        ratio: f64,
        sweep: f64,
    },
    Moves(Box<MovesSource>),
    Held {
        t_s: Vec<f64>,
        values: Vec<f64>,
        next: usize,
    },
    Line {
        t_s: Vec<f64>,
        values: Vec<f64>,
        next: usize,
    },
}

impl SetpointSource {
    /// A source for a validated setpoint.
    pub fn new(setpoint: &Setpoint, sample_period_s: f64, mut noise: Noise) -> Self {
        let samples = |seconds: f64| (seconds / sample_period_s).round().max(0.0) as u64;
        let kind = match setpoint.clone() {
            Setpoint::Steps {
                levels_rad,
                dwell_s,
                shift_s,
            } => Source::Steps {
                levels: levels_rad,
                dwell: samples(dwell_s).max(1),
                shift: samples(shift_s),
            },
            Setpoint::Square {
                amplitude_rad,
                offset_rad,
                period_s,
                shift_s,
            } => Source::Steps {
                levels: vec![offset_rad + amplitude_rad, offset_rad - amplitude_rad],
                dwell: samples(period_s / 2.0).max(1),
                shift: samples(shift_s),
            },
            Setpoint::Sines { offset_rad, tones } => Source::Sines {
                offset: offset_rad,
                tones,
            },
            Setpoint::RandomSines {
                count,
                min_frequency_hz,
                max_frequency_hz,
                amplitude_rad,
            } => {
                let range = [min_frequency_hz, max_frequency_hz];
                Source::Sines {
                    offset: 0.0,
                    tones: random_tones(count, range, amplitude_rad, &mut noise),
                }
            }
            Setpoint::Random {
                min_rad,
                max_rad,
                min_dwell_s,
                max_dwell_s,
            } => Source::Random {
                min: min_rad,
                max: max_rad,
                min_dwell_s,
                max_dwell_s,
                noise: Box::new(noise),
                until: 0,
            },
            Setpoint::Chirp {
                amplitude_rad,
                offset_rad,
                start_frequency_hz,
                end_frequency_hz,
                sweep_s,
            } => Source::Chirp {
                amplitude: amplitude_rad,
                offset: offset_rad,
                start: start_frequency_hz,
                ratio: (end_frequency_hz / start_frequency_hz).ln(),
                sweep: sweep_s,
            },
            Setpoint::Moves(moves) => Source::Moves(Box::new(MovesSource::new(moves, noise))),
            Setpoint::Table {
                t_s,
                values_rad,
                interpolation: Interpolation::Step,
            } => Source::Held {
                t_s,
                values: values_rad,
                next: 0,
            },
            Setpoint::Table {
                t_s,
                values_rad,
                interpolation: Interpolation::Linear,
            } => Source::Line {
                t_s,
                values: values_rad,
                next: 0,
            },
        };
        Self {
            kind,
            sample_period_s,
            k: 0,
            held: 0.0,
        }
    }

    /// Moves on to sample `k`; samples are visited in order, starting with 0.
    pub fn begin_sample(&mut self, k: u64) {
        self.k = k;
        match &mut self.kind {
            Source::Steps { levels, dwell, shift } => {
                self.held = levels[((k + *shift) / *dwell % levels.len() as u64) as usize];
            }
            Source::Random {
                min,
                max,
                min_dwell_s,
                max_dwell_s,
                noise,
                until,
            } => {
                if k >= *until {
                    self.held = noise.between(*min, *max);
                    let dwell_s = noise.between(*min_dwell_s, *max_dwell_s);
                    *until = k + ((dwell_s / self.sample_period_s).round() as u64).max(1);
                }
            }
            Source::Held { t_s, values, next } => {
                // A time counts as reached from 1 ns before it, so that k Δ rounded down still
                // belongs to it.
                let t = k as f64 * self.sample_period_s + 1e-9;
                while *next < t_s.len() && t_s[*next] <= t {
                    *next += 1;
                }
                self.held = values[next.saturating_sub(1)];
            }
            Source::Moves(moves) => moves.begin_sample(k, self.sample_period_s),
            Source::Sines { .. } | Source::Chirp { .. } | Source::Line { .. } => {}
        }
    }

    /// Commanded position \[rad\] at `fraction` ∈ [0, 1] of the way from this sample to the next.
    ///
    /// At 1 a stepping kind still has the value before the next sample's step.
    pub fn value(&mut self, fraction: f64) -> f64 {
        let t = (self.k as f64 + fraction) * self.sample_period_s;
        match &mut self.kind {
            Source::Steps { .. } | Source::Random { .. } | Source::Held { .. } => self.held,
            Source::Moves(moves) => moves.value(self.k, fraction),
            Source::Sines { offset, tones } => tones.iter().fold(*offset, |sum, tone| {
                sum + tone.amplitude_rad * (TAU * tone.frequency_hz * t + tone.phase_rad).sin()
            }),
            Source::Chirp {
                amplitude,
                offset,
                start,
                ratio,
                sweep,
            } => {
                // Phase ∫ f dt with f = start·exp(ratio·s/sweep), s the time into the sweep.
                let s = t % *sweep;
                let turns = if ratio.abs() < 1e-9 {
                    *start * s
                } else {
                    *start * *sweep / *ratio * (*ratio * s / *sweep).exp_m1()
                };
                *offset + *amplitude * (TAU * turns).sin()
            }
            Source::Line { t_s, values, next } => {
                while *next < t_s.len() && t_s[*next] <= t {
                    *next += 1;
                }
                while *next > 0 && t_s[*next - 1] > t {
                    *next -= 1;
                }
                match (*next).checked_sub(1) {
                    None => values[0],
                    Some(last) if last + 1 == t_s.len() => values[last],
                    Some(last) => {
                        let share = (t - t_s[last]) / (t_s[last + 1] - t_s[last]);
                        values[last] + share * (values[last + 1] - values[last])
                    }
                }
            }
        }
    }
}

/// The sines of [`Setpoint::RandomSines`], with frequencies in this range \[Hz\].
fn random_tones(count: usize, [min_hz, max_hz]: [f64; 2], amplitude_rad: f64, noise: &mut Noise) -> Vec<Tone> {
    let part_width = (max_hz / min_hz).ln() / count as f64;
    let mut tones: Vec<Tone> = (0..count)
        .map(|part| {
            let frequency_hz = min_hz * (part_width * (part as f64 + noise.uniform())).exp();
            Tone {
                frequency_hz,
                amplitude_rad: 1.0 / frequency_hz,
                phase_rad: TAU * noise.uniform(),
            }
        })
        .collect();
    let sum: f64 = tones.iter().map(|tone| tone.amplitude_rad).sum();
    tones
        .iter_mut()
        .for_each(|tone| tone.amplitude_rad *= amplitude_rad / sum);
    tones
}
