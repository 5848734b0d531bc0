//! A result in words: values rounded to their standard deviation, and the headline of a page, a
//! table and a terminal.

/// A change is mentioned in the headline if it exceeds this many standard deviations.
const CLEAR: f64 = 5.0;
/// A derived value may be used if three standard deviations are below this share of it, as for
/// parameters.
pub const DERIVED_USABLE: f64 = 0.05;
/// Significant digits of a value without a standard deviation, and the largest number with one.
const DIGITS: i32 = 7;

/// A value and its standard deviation as text, with the same number of decimals.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Rounded {
    /// The value: `170.04`, `3.42e-6`; `–` if it is not finite.
    pub value: String,
    /// The standard deviation: `0.04`, `0.05e-6`; empty if none is known.
    pub std: String,
}

impl Rounded {
    /// Rounds a value to its standard deviation: one significant digit of it, two if it begins with
    /// 1 or 2. Without one (`NaN`, infinite, 0) the value has five significant digits.
    pub fn new(value: f64, std: f64) -> Self {
        if !value.is_finite() {
            return Self {
                value: "–".into(),
                std: String::new(),
            };
        }
        let magnitude = if value == 0.0 { 0 } else { exponent(value) };
        let known = std.is_finite() && std > 0.0;
        let place = if known { place(std) } else { magnitude - 4 };
        // Far below the value's own digits: 15 digits are unreadable.
        let is_tiny = known && magnitude - place >= DIGITS;
        let place = if is_tiny { magnitude - DIGITS + 1 } else { place };
        let largest = if known { magnitude.max(exponent(std)) } else { magnitude };
        let shift = if (-3..6).contains(&largest) { 0 } else { largest };
        let decimals = (shift - place).clamp(0, 17) as usize;
        let scale = 10f64.powi(shift);
        let power = if shift == 0 { String::new() } else { format!("e{shift}") };
        let text = |number: f64| {
            let rounded = format!("{:.decimals$}", number / scale);
            // Less than half of the last digit is 0, of either sign.
            let is_zero = !rounded.contains(|c: char| ('1'..='9').contains(&c));
            let shown = rounded.strip_prefix('-').filter(|_| is_zero).unwrap_or(&rounded);
            format!("{shown}{power}")
        };
        let std = match (known, is_tiny) {
            (false, _) => String::new(),
            (true, true) => format!("{std:.0e}"),
            (true, false) => text(to_place(std, place)),
        };
        Self {
            value: text(to_place(value, place)),
            std,
        }
    }
}

/// `170.04 ± 0.04`.
impl std::fmt::Display for Rounded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.std.is_empty() {
            true => f.write_str(&self.value),
            false => write!(f, "{} ± {}", self.value, self.std),
        }
    }
}

/// The place of a number's first digit: 2 for 170, −2 for 0.04.
fn exponent(value: f64) -> i32 {
    format!("{:e}", value.abs())
        .split_once('e')
        .and_then(|(_, exponent)| exponent.parse().ok())
        .unwrap_or(0)
}

/// The place to which a standard deviation is rounded.
fn place(std: f64) -> i32 {
    let first = exponent(std);
    let digit = std / 10f64.powi(first);
    if digit < 2.95 { first - 1 } else { first }
}

/// Above the decimals: 1234567 ± 2000 is 1235000.
fn to_place(value: f64, place: i32) -> f64 {
    if place <= 0 {
        return value;
    }
    let unit = 10f64.powi(place);
    (value / unit).round() * unit
}

/// A quantity with its estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known<'a> {
    /// Short name: `theta_1`, `mass_2`.
    pub name: &'a str,
    /// SI unit, `"1"` if there is none.
    pub unit: &'a str,
    /// The estimate.
    pub value: f64,
    /// Its standard deviation, `NaN` if there is none.
    pub std: f64,
    /// Whether it may be used.
    pub usable: bool,
    /// Computed from the parameters; users know it by name.
    pub derived: bool,
    /// Estimate and standard deviation before the last change, if both it and they are known.
    pub before: Option<(f64, f64)>,
}

impl Known<'_> {
    /// `170.04 ± 0.04 kg`.
    pub fn text(&self) -> String {
        with_unit(&Rounded::new(self.value, self.std).to_string(), self.unit)
    }

    /// Relative size of a clear change; `None` if there was none.
    fn changed_by(&self) -> Option<f64> {
        let (before, std) = self.before?;
        let noise = |std: f64| if std.is_finite() { std } else { 0.0 };
        let step = (self.value - before).abs();
        let sigma = noise(self.std).hypot(noise(std));
        let share = step / before.abs().max(self.value.abs());
        (self.usable && share > 1e-3 && step > CLEAR * sigma).then_some(share)
    }
}

/// A number with its unit as in a text.
pub fn with_unit(number: &str, unit: &str) -> String {
    match unit {
        "" | "1" => number.to_owned(),
        unit => format!("{number} {}", pretty_unit(unit)),
    }
}

/// The result in a sentence: the largest change if there was one, otherwise the best-known value;
/// `None` if none is usable.
///
/// Derived values come first: a mass is more meaningful than a sum of products.
pub fn headline(known: &[Known<'_>], change_t_s: Option<f64>) -> Option<String> {
    let change = change_t_s.and_then(|t_s| {
        let most = |derived: bool| {
            let changed = known.iter().filter(|k| k.derived == derived);
            changed
                .filter_map(|k| Some((k, k.changed_by()?)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
        };
        most(true).or_else(|| most(false)).map(|(k, _)| (k, t_s))
    });
    if let Some((k, t_s)) = change {
        let (before, std) = k.before.unwrap_or_default();
        let before = with_unit(&Rounded::new(before, std).value, k.unit);
        return Some(format!("{}: {}, changed from {before} at {t_s:.2} s", k.name, k.text()));
    }
    let best = |derived: bool| {
        let usable = known.iter().filter(|k| k.usable && k.derived == derived);
        usable.min_by(|a, b| relative(a).total_cmp(&relative(b)))
    };
    best(true)
        .or_else(|| best(false))
        .map(|k| format!("{}: {}", k.name, k.text()))
}

fn relative(known: &Known<'_>) -> f64 {
    known.std / known.value.abs()
}

/// Name as in a text: `θ₁`, `viscous friction`.
pub fn symbol(name: &str) -> String {
    let subscript = |digits: &str| -> Option<String> {
        let digit = |c: char| c.to_digit(10).and_then(|d| char::from_u32(0x2080 + d));
        digits.chars().map(digit).collect()
    };
    match name.rsplit_once('_') {
        Some(("theta", digits)) if !digits.is_empty() => {
            subscript(digits).map_or_else(|| name.to_string(), |digits| format!("θ{digits}"))
        }
        _ => name.replace('_', " "),
    }
}

/// Name of a model as in a text: without the digest that a robot's has behind it, `_5998eabc`.
pub(super) fn model_symbol(name: &str) -> String {
    let is_digest = |end: &str| end.len() == 8 && end.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    match name.rsplit_once('_') {
        Some((own, end)) if is_digest(end) && !own.is_empty() => symbol(own),
        _ => symbol(name),
    }
}

/// Unit as in a text: a real exponent and a middle dot.
pub fn pretty_unit(unit: &str) -> String {
    with_powers(unit).replace(' ', "\u{b7}")
}

/// A text with real exponents.
pub(super) fn with_powers(text: &str) -> String {
    text.replace("^2", "²").replace("^3", "³")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_values_are_rounded_to_their_standard_deviation() {
        for (value, std, text) in [
            (170.0412, 0.0387, "170.04 ± 0.04"),
            (170.0412, 0.0187, "170.041 ± 0.019"),
            (150.1234, f64::NAN, "150.12"),
            (0.0, 0.3, "0.0 ± 0.3"),
            (-0.26, 0.004, "-0.260 ± 0.004"),
            (-0.0012, 0.05, "0.00 ± 0.05"),
            (-2.0, 37.0, "0 ± 40"),
            (-0.0, f64::NAN, "0.0000"),
            (3.4218e-6, 4.6e-8, "3.42e-6 ± 0.05e-6"),
            (1_234_567.0, 2345.0, "1.2346e6 ± 0.0023e6"),
            (12345.0, 340.0, "12300 ± 300"),
            (0.027_314_5, 3e-12, "0.02731450 ± 3e-12"),
            (f64::NAN, 1.0, "–"),
            (5.0, f64::INFINITY, "5.0000"),
            (2.0, 37.0, "0 ± 40"),
            (9.99, 0.0996, "9.99 ± 0.10"),
        ] {
            assert_eq!(Rounded::new(value, std).to_string(), text);
        }
    }

    #[test]
    fn regress_a_digest_is_no_part_of_a_models_name() {
        for (name, text) in [
            ("six_axis_5998eabc", "six axis"),
            ("servo_axis", "servo axis"),
            ("arm_of_facade", "arm of facade"),
            ("_5998eabc", " 5998eabc"),
        ] {
            assert_eq!(model_symbol(name), text);
        }
    }

    fn known(name: &str, value: f64, before: f64, derived: bool) -> Known<'_> {
        Known {
            name,
            unit: if derived { "kg" } else { "1" },
            value,
            std: 0.04,
            usable: true,
            derived,
            before: Some((before, 0.09)),
        }
    }

    #[test]
    fn regress_the_headline_says_what_changed_from_what_and_when() {
        let all = [
            known("theta_2", 30.0, 10.0, false),
            known("mass_1", 40.0, 40.05, true),
            known("mass_2", 170.0412, 150.1123, true),
        ];
        assert_eq!(
            headline(&all, Some(44.99)).as_deref(),
            Some("mass_2: 170.04 ± 0.04 kg, changed from 150.11 kg at 44.99 s")
        );
        assert_eq!(headline(&all, None).as_deref(), Some("mass_2: 170.04 ± 0.04 kg"));
        assert_eq!(
            headline(&all[..2], Some(1.0)).as_deref(),
            Some("theta_2: 30.00 ± 0.04, changed from 10.00 at 1.00 s")
        );
    }

    #[test]
    fn prop_what_may_not_be_used_is_in_no_headline() {
        let mut one = known("mass_2", 170.0, 150.0, true);
        one.usable = false;
        assert_eq!(headline(&[one], Some(1.0)), None);
        assert_eq!(headline(&[], None), None);
    }
}
