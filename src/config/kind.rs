//! A key of the configuration and its values: type, range, and how both are shown.

use crate::sim::ARM_JOINTS;
use crate::words::is_name;
use std::fmt;
use toml::Value;
use toml::de::DeValue;

/// One key of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Its section, `plant.arm`; empty at the top of a file.
    pub section: &'static str,
    /// Its name in the section.
    pub name: &'static str,
    /// Its kind of value.
    pub kind: Kind,
    /// SI unit, empty if there is none.
    pub unit: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
    /// It may be left out, which is its default.
    pub optional: bool,
}

impl Key {
    /// Section and name, `plant.arm.length_1_m`.
    pub fn path(&self) -> String {
        match self.section {
            "" => self.name.to_owned(),
            section => format!("{section}.{}", self.name),
        }
    }
}

/// A section of a file.
#[derive(Debug)]
pub(super) struct Section {
    pub name: &'static str,
    pub meaning: &'static str,
    pub keys: &'static [Key],
}

/// An interval of real numbers; infinite ends stand for "no limit".
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The lower end itself is not allowed.
    pub above_low: bool,
    /// The infinities are values like any other.
    pub infinite: bool,
}

impl Interval {
    /// Every finite number.
    pub const ANY: Self = Self::closed(f64::NEG_INFINITY, f64::INFINITY);
    /// Numbers greater than zero.
    pub const POSITIVE: Self = Self::above(0.0, f64::INFINITY);
    /// Zero and above.
    pub const NOT_NEGATIVE: Self = Self::closed(0.0, f64::INFINITY);

    /// Both ends allowed.
    pub const fn closed(low: f64, high: f64) -> Self {
        Self {
            low,
            high,
            above_low: false,
            infinite: false,
        }
    }

    /// The lower end not allowed.
    pub const fn above(low: f64, high: f64) -> Self {
        Self {
            low,
            high,
            above_low: true,
            infinite: false,
        }
    }

    /// The same with `inf` and `-inf` as far as the ends reach.
    pub const fn or_infinite(self) -> Self {
        Self { infinite: true, ..self }
    }

    fn contains(&self, x: f64) -> bool {
        (x.is_finite() || self.infinite && !x.is_nan())
            && if self.above_low { x > self.low } else { x >= self.low }
            && x <= self.high
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            above_low, infinite, ..
        } = *self;
        let [low, high] = [self.low, self.high].map(Short);
        match (self.low.is_finite(), self.high.is_finite()) {
            (false, false) => write!(f, "of any size"),
            (true, false) if above_low => write!(f, "above {low}"),
            (true, false) => write!(f, "of at least {low}"),
            (false, true) => write!(f, "of at most {high}"),
            (true, true) => {
                write!(f, "{} {low} ", if above_low { "above" } else { "from" })?;
                write!(f, "{} {high}", if above_low { "up to" } else { "to" })
            }
        }?;
        if infinite { write!(f, " or infinite") } else { Ok(()) }
    }
}

/// A number in short form: 1e9, not 1000000000.
pub(crate) struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(x) = *self;
        if x == 0.0 || (1e-3..1e6).contains(&x.abs()) {
            write!(f, "{x}")
        } else {
            write!(f, "{x:e}")
        }
    }
}

/// Number of entries of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Len {
    /// One per joint of the arm.
    Joints,
    /// One per parameter of the model, or none for the model's own values.
    Parameters,
    /// One per equation of the model, or none for the default.
    Equations,
    /// One per joint of the model, or none for the default.
    ModelJoints,
    /// One per joint of a robot, whose number its URDF gives.
    RobotJoints,
    /// Any number within these limits.
    From(usize, usize),
}

impl Len {
    fn limits(self) -> (usize, usize) {
        match self {
            Self::Joints => (ARM_JOINTS, ARM_JOINTS),
            Self::Parameters => (0, crate::model::MAX_PARAMS),
            Self::Equations | Self::ModelJoints => (0, crate::model::MAX_JOINTS),
            Self::RobotJoints => (1, crate::model::MAX_JOINTS),
            Self::From(low, high) => (low, high),
        }
    }
}

impl Len {
    /// "a list of 2 numbers above 0 \[m\], one per joint", around the description of the items.
    fn of(self, items: &str) -> String {
        match self {
            Self::Joints => format!("a list of {} {items}, one per joint", ARM_JOINTS),
            Self::Parameters => format!("a list of {items}, one per parameter, or none"),
            Self::Equations => format!("a list of {items}, one per equation, or none"),
            Self::ModelJoints => format!("a list of {items}, one per joint, or none"),
            Self::RobotJoints => format!("a list of {items}, one per joint of the robot"),
            Self::From(low, high) if low == high => format!("a list of {low} {items}"),
            Self::From(low, high) => format!("a list of {low} to {high} {items}"),
        }
    }
}

/// What a key may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// `true` or `false`.
    Flag,
    /// A short name that can be part of file and service names.
    Name,
    /// Text, for a path.
    Path,
    /// Text, for the rows of a table of setpoints.
    Rows,
    /// Text, for a name in a file of the user's.
    Label,
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A whole number within these limits.
    Whole(u64, u64),
    /// A finite number.
    Real(Interval),
    /// A finite number or one word.
    RealOr(Interval, &'static str),
    /// A list of finite numbers.
    Reals(Len, Interval),
    /// A list of whole numbers within these limits.
    Wholes(Len, u64, u64),
    /// A list of short names.
    Words,
    /// A list of some of these words.
    Choices(&'static [&'static str]),
    /// One list of finite numbers for each joint.
    RealsPerJoint(Len, Interval),
    /// A row of finite numbers for each joint of a robot, with a number for each.
    Matrix(Interval),
    /// Any number of tables with these keys, `[[section.key]]`; keys without a default are required
    /// in each.
    Tables(&'static [Key]),
}

impl Kind {
    /// True for keys whose value is text, so that an unquoted `--set` argument is taken literally.
    pub(super) fn is_text(&self) -> bool {
        matches!(
            self,
            Self::Name | Self::Path | Self::Rows | Self::Label | Self::Choice(_)
        )
    }

    /// True for keys whose value is a list of texts.
    pub(super) fn is_list_of_text(&self) -> bool {
        matches!(self, Self::Words | Self::Choices(_))
    }

    /// "a whole number from 1 to 10 \[samples\]".
    pub fn expected(&self, unit: &str) -> String {
        let unit = match unit {
            "" => String::new(),
            unit => format!(" [{unit}]"),
        };
        match self {
            Self::Flag => "true or false".to_owned(),
            Self::Name => "a name of 1 to 32 characters a-z 0-9 _ -".to_owned(),
            Self::Path => "a path as a string".to_owned(),
            Self::Rows => format!(
                "lines of t_s q1_rad q2_rad, separated by spaces, as a string of at most {MAX_ROWS_BYTES} bytes"
            ),
            Self::Label => format!("a name as a string of at most {MAX_LABEL_BYTES} bytes"),
            Self::Choice([word]) => format!("\"{word}\""),
            Self::Choice(words) => format!("one of {}", quoted(words)),
            Self::Whole(low, high) => format!("a whole number {}{unit}", whole_range(*low, *high)),
            Self::Real(interval) => format!("a number {interval}{unit}"),
            Self::RealOr(interval, word) => format!("\"{word}\" or a number {interval}{unit}"),
            Self::Reals(len, interval) => len.of(&format!("numbers {interval}{unit}")),
            Self::Wholes(len, low, high) => len.of(&format!("whole numbers {}{unit}", whole_range(*low, *high))),
            Self::Words => format!("a list of names as strings of at most {MAX_LABEL_BYTES} bytes"),
            Self::Choices(words) => format!("a list of words among {}", quoted(words)),
            Self::Matrix(interval) => {
                let row = Len::RobotJoints.of(&format!("numbers {interval}{unit}"));
                format!("for each joint of the robot {row}")
            }
            Self::RealsPerJoint(len, interval) => {
                format!(
                    "for each of the {} joints {}",
                    ARM_JOINTS,
                    len.of(&format!("numbers {interval}{unit}"))
                )
            }
            Self::Tables(_) => "a list of tables".to_owned(),
        }
    }

    /// The value in the form of the file structures, or `None` if it does not fit.
    pub(super) fn check(&self, value: &DeValue<'_>) -> Option<Value> {
        match self {
            Self::Flag => value.as_bool().map(Value::Boolean),
            Self::Name => value.as_str().filter(|s| is_name(s)).map(Value::from),
            Self::Path => value.as_str().filter(|s| is_text(s, MAX_PATH_BYTES)).map(Value::from),
            Self::Rows => value.as_str().filter(|s| is_text(s, MAX_ROWS_BYTES)).map(Value::from),
            Self::Label => value.as_str().filter(|s| is_text(s, MAX_LABEL_BYTES)).map(Value::from),
            Self::Choice(words) => value.as_str().filter(|s| words.contains(s)).map(Value::from),
            Self::Whole(low, high) => whole_within(value, *low, *high),
            Self::Wholes(len, low, high) => list(value, *len, |v| whole_within(v, *low, *high)),
            Self::Real(interval) => number(value, interval),
            Self::RealOr(interval, word) => match value.as_str() {
                Some(s) => (s == *word).then(|| Value::from(s)),
                None => number(value, interval),
            },
            Self::Reals(len, interval) => list(value, *len, |v| number(v, interval)),
            Self::Words => list(value, Len::Parameters, |v| {
                v.as_str().filter(|s| is_text(s, MAX_LABEL_BYTES)).map(Value::from)
            }),
            Self::Choices(words) => list(value, Len::From(0, words.len()), |v| {
                v.as_str().filter(|s| words.contains(s)).map(Value::from)
            }),
            Self::Matrix(interval) => list(value, Len::RobotJoints, |row| {
                list(row, Len::RobotJoints, |v| number(v, interval))
            }),
            Self::RealsPerJoint(len, interval) => {
                list(value, Len::Joints, |inner| list(inner, *len, |v| number(v, interval)))
            }
            // Checked key by key when read, so that a message can name the key.
            Self::Tables(_) => None,
        }
    }
}

/// "from 1 to 10", or "of at least 1" if the largest one is that of TOML.
fn whole_range(low: u64, high: u64) -> String {
    match high == i64::MAX as u64 {
        true => format!("of at least {low}"),
        false => format!("from {low} to {high}"),
    }
}

/// Longest name of a column or a parameter.
const MAX_LABEL_BYTES: usize = 256;
/// Longest path: PATH_MAX of Linux.
const MAX_PATH_BYTES: usize = 4096;
/// Longest table of setpoints; with it a configuration stays below the size limit for reading.
pub(super) const MAX_ROWS_BYTES: usize = 3 << 20;

fn is_text(s: &str, longest: usize) -> bool {
    !s.is_empty() && s.len() <= longest && !s.contains('\0')
}

/// "a", "b" or "c".
pub(super) fn quoted(words: &[&str]) -> String {
    let mut text = String::new();
    for (i, word) in words.iter().enumerate() {
        text.push_str(match i {
            0 => "",
            i if i + 1 == words.len() => " or ",
            _ => ", ",
        });
        text.push_str(&format!("\"{word}\""));
    }
    text
}

fn whole(value: &DeValue<'_>) -> Option<i64> {
    let n = value.as_integer()?;
    i64::from_str_radix(n.as_str(), n.radix()).ok()
}

fn whole_within(value: &DeValue<'_>, low: u64, high: u64) -> Option<Value> {
    let n = whole(value)?;
    (u64::try_from(n).is_ok_and(|n| (low..=high).contains(&n))).then_some(Value::Integer(n))
}

/// Whole numbers are accepted as numbers: `duration_s = 170`.
fn number(value: &DeValue<'_>, interval: &Interval) -> Option<Value> {
    let x = match value {
        DeValue::Integer(_) => whole(value)? as f64,
        DeValue::Float(x) => x.as_str().parse().ok()?,
        _ => return None,
    };
    interval.contains(x).then_some(Value::Float(x))
}

fn list(value: &DeValue<'_>, len: Len, item: impl Fn(&DeValue<'_>) -> Option<Value>) -> Option<Value> {
    let items = value.as_array()?;
    let (low, high) = len.limits();
    if !(low..=high).contains(&items.len()) {
        return None;
    }
    items
        .iter()
        .map(|v| item(v.get_ref()))
        .collect::<Option<Vec<_>>>()
        .map(Value::Array)
}
