//! Time stamps with all digits: 1795305600.123456789 s has more than an `f64` can hold.

/// A time stamp in the unit of its column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stamp {
    whole: i64,
    rest: f64,
}

impl Stamp {
    /// Parses a number; `None` if it is not one.
    pub(super) fn parse(text: &str) -> Option<Self> {
        // A plain decimal is split at its point, so that nothing is rounded before the first time
        // stamp is subtracted.
        let (integer, fraction) = text.split_once('.').unwrap_or((text, ""));
        let exact = integer.len() <= 19 && fraction.bytes().all(|b| b.is_ascii_digit());
        if let Some(whole) = integer.parse().ok().filter(|_| exact) {
            let rest: f64 = format!("0.{fraction}0").parse().ok()?;
            let rest = if integer.starts_with('-') { -rest } else { rest };
            return Some(Self { whole, rest });
        }
        let rest: f64 = text.parse().ok()?;
        Some(Self { whole: 0, rest })
    }

    /// A computed time.
    pub(super) fn of(value: f64) -> Self {
        Self { whole: 0, rest: value }
    }

    /// Time from another stamp to this one, in their unit; not finite if this one is not.
    pub(super) fn since(&self, first: &Self) -> f64 {
        let whole = i128::from(self.whole) - i128::from(first.whole);
        whole as f64 + (self.rest - first.rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_differences_of_long_time_stamps_have_all_their_digits() {
        for (from, to, difference) in [
            ("1795305600.123456789", "1795305600.124456790", 0.001_000_001),
            ("1795305600123456789", "1795305600123456790", 1.0),
            ("-0.5", "0.25", 0.75),
            ("-1.25", "-1.0", 0.25),
            ("1e3", "1001", 1.0),
            ("+3.", "4", 1.0),
        ] {
            let [from, to] = [from, to].map(|text| Stamp::parse(text).unwrap());
            assert!((to.since(&from) - difference).abs() < 1e-15, "{}", to.since(&from));
        }
        for text in ["", ".", "abc", "1.2.3", "1,5", "2026-11-21", "0x10"] {
            assert_eq!(Stamp::parse(text), None, "{text}");
        }
        for text in ["NaN", "inf", "-inf", "1e999"] {
            let stamp = Stamp::parse(text).unwrap();
            assert!(!stamp.since(&Stamp::of(0.0)).is_finite(), "{text}");
        }
    }
}
