//! Finds probable mistakes in a log as configured: the usual mistakes in logs and configurations.
//!
//! Nothing here changes a number or refuses a log. Each finding is reported with the key that would
//! correct it, and the user decides. Hardly any real machine exceeds the limits, but the mistakes
//! nearly always do: joints that turn three times, axes longer than ten metres.

use super::echo::InputEcho;
use super::profile::{ColumnProfile, LogProfile, Signal, short};
use crate::config::PositionUnit;
use std::fmt;

/// Joints seldom turn further \[rad\]; angles in degrees span more.
const LARGEST_SPAN_RAD: f64 = 6.0 * std::f64::consts::PI;
/// Axes are seldom longer \[m\]; lengths in millimetres span more.
const LARGEST_SPAN_M: f64 = 10.0;
/// Joints seldom turn less \[rad\]: 3.4°, which is 3.4 rad read as degrees.
const SMALLEST_SPAN_RAD: f64 = 0.06;
/// Axes seldom move less \[m\]: this is 1 m read as millimetres.
const SMALLEST_SPAN_M: f64 = 0.001;
/// Significant partial correlation of input and acceleration: noise alone gives ±0.14 for 50
/// samples.
const SURE_CORRELATION: f64 = 0.5;
/// Spread of the steps, relative to the period, that exceeds rounding and scheduling of time
/// stamps.
const LARGEST_SPREAD: f64 = 0.1;
/// Drives seldom have more volts or amperes: low voltage ends at 1500 V (IEC 60038). A command of
/// 10 V in millivolts exceeds it.
const LARGEST_OF_A_DRIVE: f64 = 1500.0;
/// Steps between rows of this share of a turn are wraps, not motion.
const WRAP: std::ops::Range<f64> = 0.9..1.1;

/// The relevant configuration.
#[derive(Debug, Clone)]
pub struct Configured<'a> {
    /// True if a joint turns, joint by joint; otherwise it moves along a line.
    pub turns: &'a [bool],
    /// Unit of the position columns, for the joints that it suits.
    pub position_unit: PositionUnit,
    /// Sign of the acceleration due to a positive input in the model, 1 or −1; 0 if unknown.
    pub input_sign: f64,
}

impl Configured<'_> {
    /// Whether a joint turns, and the unit of its position.
    fn joint(&self, joint: usize) -> (bool, PositionUnit) {
        let turns = self.turns.get(joint).copied().unwrap_or(false);
        (turns, self.position_unit.of_joint(self.turns, joint))
    }
}

/// A likely mistake.
#[derive(Debug, Clone, PartialEq)]
pub enum Suspicion {
    /// Angles in degrees, read as radians or turns.
    Degrees {
        /// The column.
        column: String,
        /// Its span \[rad\].
        span_rad: f64,
    },
    /// Angles in radians, read as degrees.
    Radians {
        /// The column.
        column: String,
        /// Its span \[rad\].
        span_rad: f64,
    },
    /// Lengths in millimetres or less, read as metres.
    Millimetres {
        /// The column.
        column: String,
        /// Its span \[m\].
        span_m: f64,
    },
    /// Lengths in metres, read as something smaller.
    Metres {
        /// The column.
        column: String,
        /// Its span \[m\].
        span_m: f64,
    },
    /// A column that never changes.
    Constant {
        /// The column.
        column: String,
        /// Its value, in SI units.
        value: f64,
    },
    /// A position wrapped into one turn.
    Wraps {
        /// The column.
        column: String,
    },
    /// The input acts against the direction in the model.
    InputSign {
        /// The column.
        column: String,
        /// Partial correlation of input and acceleration.
        correlation: f64,
    },
    /// The input is another signal.
    InputEcho {
        /// The column.
        column: String,
        /// The signal.
        of: InputEcho,
    },
    /// An input of a thousand times what a drive has.
    Milli {
        /// The column.
        column: String,
        /// Its value that is farthest from 0 \[V or A\].
        largest: f64,
        /// Unit of the input.
        unit: String,
    },
    /// Rows are unevenly spaced.
    Uneven {
        /// Mean distance of rows \[s\].
        mean_s: f64,
        /// Standard deviation \[s\].
        std_s: f64,
    },
    /// Time restarts within the log.
    Restarts {
        /// First line of the later part.
        line: u64,
    },
    /// An estimate at a bound.
    AtBound {
        /// The parameter.
        parameter: String,
        /// The bound.
        bound: f64,
    },
    /// Dates where numbers of seconds were expected.
    Dates {
        /// Name of the column.
        column: String,
        /// An example of such a field.
        field: String,
    },
    /// Something else where numbers were expected.
    NoNumber {
        /// Name of the column.
        column: String,
        /// An example of such a field.
        field: String,
    },
    /// Numbers where the names of the columns were expected.
    NoHeader,
    /// A comma for the decimal point.
    DecimalComma {
        /// An example of such a field.
        field: String,
    },
    /// Another character between the columns.
    Separator {
        /// The character.
        separator: char,
    },
    /// The time column has another unit.
    TimeUnit {
        /// The unit that gives the configured period.
        unit: &'static str,
    },
    /// The configured period differs.
    Period {
        /// The log's \[s\].
        period_s: f64,
    },
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Degrees { column, span_rad } => write!(
                f,
                "column \"{column}\" spans {} rad, {} turns: if it is in degrees, set log.position_unit = \"deg\"; if it is a length, choose a model that moves along a line",
                short(*span_rad),
                short(span_rad / std::f64::consts::TAU)
            ),
            Self::Radians { column, span_rad } => write!(
                f,
                "column \"{column}\" spans {} degrees only: if it is in radians, set log.position_unit = \"rad\"",
                short(span_rad.to_degrees())
            ),
            Self::Millimetres { column, span_m } => write!(
                f,
                "column \"{column}\" spans {} m: if it is in millimetres, set log.position_unit = \"mm\"",
                short(*span_m)
            ),
            Self::Metres { column, span_m } => write!(
                f,
                "column \"{column}\" spans {} mm only: if it is in metres, set log.position_unit = \"m\"",
                short(span_m * 1e3)
            ),
            Self::Constant { column, value } => write!(
                f,
                "column \"{column}\" is {value} in every row: is it the column that was meant, and was the machine on?"
            ),
            Self::Wraps { column } => write!(
                f,
                "column \"{column}\" jumps by a whole turn between rows: the position must go on beyond a turn, unwrapped"
            ),
            Self::InputSign { column, correlation } => write!(
                f,
                "column \"{column}\" drives the machine backwards (its correlation with the acceleration is {correlation:.2}): if its sign is that of another convention, set log.input_unit to its negative"
            ),
            Self::InputEcho { column, of } => write!(
                f,
                "column \"{column}\" is read as input, but repeats the {of} of its joint: log.input must name the voltage, current, force or torque of the drive"
            ),
            Self::Milli { column, largest, unit } => write!(
                f,
                "column \"{column}\" reaches {} {unit}, more than a drive has: if it is in m{unit}, set log.input_unit = 0.001",
                short(*largest)
            ),
            Self::Uneven { mean_s, std_s } => write!(
                f,
                "rows are {mean_s:.6} s apart with a standard deviation of {std_s:.6} s: if the machine was sampled evenly and only the time stamps are uneven, leave log.time out"
            ),
            Self::Restarts { line } => write!(
                f,
                "time goes back in line {line} and goes on from there: two logs in one file, or a clock that was set; cut the log there"
            ),
            Self::AtBound { parameter, bound } => write!(
                f,
                "{parameter} rests at its bound {bound}, so the data ask for a value beyond it: check sign and unit of the input, and the order of the columns"
            ),
            Self::Dates { column, field } => write!(
                f,
                "\"{field}\" in column \"{column}\" is a date or time of day: expected a number, of a time the seconds since any instant"
            ),
            Self::NoNumber { column, field } => {
                write!(
                    f,
                    "\"{field}\" in column \"{column}\" is no number: units belong into [log]"
                )
            }
            Self::NoHeader => f.write_str("the file has no header: its first line must name the columns"),
            Self::DecimalComma { field } => {
                write!(
                    f,
                    "\"{field}\" has a comma for the decimal point: write numbers with points"
                )
            }
            Self::Separator { separator } => {
                let name = match separator {
                    ';' => "semicolons",
                    '\t' => "tabs",
                    _ => "other characters",
                };
                write!(f, "columns are separated by {name}: they must be separated by commas")
            }
            Self::TimeUnit { unit } => write!(f, "if time is in {unit}, set log.time_unit = \"{unit}\""),
            Self::Period { period_s } => {
                // round off the rounding errors of a median of differences
                let period_s = format!("{period_s:.6e}").parse().unwrap_or(*period_s);
                write!(f, "if that is right, set plant.sample_period_s = {period_s}")
            }
        }
    }
}

/// Suspicions about the values of a log; `correlations` are those of each joint's input with its
/// acceleration, if known.
pub fn judge_profile(
    profile: &LogProfile,
    configured: &Configured<'_>,
    correlations: &[Option<f64>],
) -> Vec<Suspicion> {
    let mut found = Vec::new();
    for column in profile.columns.iter().filter(|c| c.count > 1) {
        let name = column.name.clone();
        let moves = column.max > column.min;
        match column.signal {
            Signal::Position(_) | Signal::Input(_) if !moves => found.push(Suspicion::Constant {
                column: name,
                value: column.min,
            }),
            Signal::Position(joint) => found.extend(judge_position(column, joint, configured)),
            Signal::Input(joint) => {
                let r = correlations.get(joint).copied().flatten();
                let against = r.filter(|r| r * configured.input_sign < -SURE_CORRELATION);
                found.extend(against.map(|correlation| Suspicion::InputSign {
                    column: name,
                    correlation,
                }));
            }
            Signal::Setpoint(_) => {}
        }
    }
    let steps = &profile.steps;
    if steps.count > 1 && steps.std_s() > LARGEST_SPREAD * steps.mean_s {
        found.push(Suspicion::Uneven {
            mean_s: steps.mean_s,
            std_s: steps.std_s(),
        });
    }
    found.extend(profile.restart_line.map(|line| Suspicion::Restarts { line }));
    found
}

/// Inputs, in this unit, that are another signal or have another unit, by what each joint's
/// repeats; only the units of drives are judged, because the input of a model may be a velocity.
pub fn judge_inputs(profile: &LogProfile, unit: &str, echoes: &[Option<InputEcho>]) -> Vec<Suspicion> {
    let judge = |column: &ColumnProfile| {
        let Signal::Input(joint) = column.signal else {
            return None;
        };
        let name = column.name.clone();
        let largest = if -column.min > column.max {
            column.min
        } else {
            column.max
        };
        let echo = echoes.get(joint).copied().flatten();
        match unit {
            "V" | "A" | "N" | "N m" if echo.is_some() => echo.map(|of| Suspicion::InputEcho { column: name, of }),
            "V" | "A" if largest.abs() > LARGEST_OF_A_DRIVE && column.count > 1 => Some(Suspicion::Milli {
                column: name,
                largest,
                unit: unit.to_owned(),
            }),
            _ => None,
        }
    };
    profile.columns.iter().filter_map(judge).collect()
}

fn judge_position(column: &ColumnProfile, joint: usize, configured: &Configured<'_>) -> Option<Suspicion> {
    let name = column.name.clone();
    let span = column.max - column.min;
    let one_turn = column.largest_step / std::f64::consts::TAU;
    match configured.joint(joint) {
        // In degrees a wrap is a step of 360.
        (true, _) if WRAP.contains(&one_turn) || WRAP.contains(&one_turn.to_radians()) => {
            Some(Suspicion::Wraps { column: name })
        }
        (true, unit) if unit != PositionUnit::Degrees && span > LARGEST_SPAN_RAD => Some(Suspicion::Degrees {
            column: name,
            span_rad: span,
        }),
        (true, PositionUnit::Degrees) if span < SMALLEST_SPAN_RAD => Some(Suspicion::Radians {
            column: name,
            span_rad: span,
        }),
        (false, PositionUnit::Metres) if span > LARGEST_SPAN_M => Some(Suspicion::Millimetres {
            column: name,
            span_m: span,
        }),
        (false, PositionUnit::Millimetres | PositionUnit::Micrometres) if span < SMALLEST_SPAN_M => {
            Some(Suspicion::Metres {
                column: name,
                span_m: span,
            })
        }
        _ => None,
    }
}

/// Estimates at a bound: name, start, lower and upper bound, estimate and its standard deviation.
pub fn judge_bounds<'a>(parameters: impl Iterator<Item = (&'a str, f64, [f64; 2], [f64; 2])>) -> Vec<Suspicion> {
    let held = |(name, start, bounds, [estimate, std]): (&str, f64, [f64; 2], [f64; 2])| {
        // Closer than data would bring it: a thousandth of the distance moved. A small value that
        // is known to be above 0 is not at its bound.
        let at = bounds.into_iter().find(|bound| {
            let distance = (estimate - bound).abs();
            bound.is_finite() && start != *bound && distance <= 1e-3 * (start - bound).abs() && distance <= 3.0 * std
        });
        at.map(|bound| Suspicion::AtBound {
            parameter: name.to_owned(),
            bound,
        })
    };
    parameters.filter_map(held).collect()
}

/// The likely mistake in a header without the expected columns.
pub fn judge_header(line: &str) -> Option<Suspicion> {
    let count = |c: char| line.matches(c).count();
    let separator = [';', '\t'].into_iter().find(|c| count(*c) > count(','));
    let mut names = line.split(',').map(str::trim);
    let numbers = names.all(|name| name.parse::<f64>().is_ok());
    separator
        .map(|separator| Suspicion::Separator { separator })
        .or(numbers.then_some(Suspicion::NoHeader))
}

/// The likely mistake in a field that should be a number.
pub fn judge_field(column: &str, field: &str) -> Option<Suspicion> {
    let digits = |text: &str, n: usize| text.len() >= n && text.bytes().take(n).all(|b| b.is_ascii_digit());
    let shown = || crate::words::cut(field, 40);
    // 2026-11-21…, 21.11.2026…, 11/21/2026, 08:15:30; but 1.5e-3 m is a number with its unit
    let parts: Vec<&str> = field.splitn(4, ['-', '/', ':', '.']).collect();
    let whole = |part: &&str| (1..=4).contains(&part.len()) && part.bytes().all(|b| b.is_ascii_digit());
    let date = parts.len() >= 3 && parts[..2].iter().all(whole) && digits(parts[2], 1);
    if date {
        return Some(Suspicion::Dates {
            column: column.to_owned(),
            field: shown(),
        });
    }
    if let Some(separator) = [';', '\t'].into_iter().find(|c| field.contains(*c)) {
        return Some(Suspicion::Separator { separator });
    }
    let comma = field.split_once(',');
    let decimal = comma.is_some_and(|(a, b)| digits(a.trim_start_matches(['-', '+']), 1) && digits(b, 1));
    if decimal {
        return Some(Suspicion::DecimalComma { field: shown() });
    }
    field.parse::<f64>().is_err().then(|| Suspicion::NoNumber {
        column: column.to_owned(),
        field: shown(),
    })
}

/// Why rows may be `got_s` apart, by a time column with this unit, although `expected_s` is
/// configured.
pub fn judge_period(got_s: f64, expected_s: f64, unit_s: f64) -> Option<Suspicion> {
    let units = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
    let fits = |seconds: f64| (got_s / unit_s * seconds / expected_s - 1.0).abs() < 0.2;
    if let Some((unit, _)) = units.into_iter().find(|(_, seconds)| fits(*seconds)) {
        return Some(Suspicion::TimeUnit { unit });
    }
    (0.05..20.0)
        .contains(&(got_s / expected_s))
        .then_some(Suspicion::Period { period_s: got_s })
}

#[cfg(test)]
mod tests;
