//! Numbers and words in figures.

/// About `count` round numbers from `from` to `to`.
pub(super) fn ticks(from: f64, to: f64, count: usize) -> Vec<f64> {
    let span = to - from;
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let rough = span / count.max(2) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|&step| step >= rough * 0.999)
        .unwrap_or(10.0 * power);
    let first = (from / step - 1e-9).ceil() as i64;
    let last = (to / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The numbers at ticks, in a unit: with as many decimals as their distance needs, and with a true
/// minus sign.
pub(super) fn numbers(ticks: &[f64], unit: f64) -> Vec<String> {
    let step = match ticks {
        [first, second, ..] => (second - first) / unit,
        _ => 1.0,
    };
    let decimals = (-step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
    let text = |tick: &f64| {
        // Remove binary rounding and negative zero.
        let value = (tick / step / unit).round() * step;
        format!("{:.decimals$}", if value == 0.0 { 0.0 } else { value }).replace('-', "\u{2212}")
    };
    ticks.iter().map(text).collect()
}

pub(super) fn power_of_ten(exponent: i32) -> String {
    let digits: String = exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + digit as u32 - '0' as u32).unwrap_or(digit),
        })
        .collect();
    format!("10{digits}")
}

/// Text for SVG and HTML.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

/// Six significant digits without trailing zeros.
pub(super) fn short(value: f64) -> String {
    let text = format!("{value:.5e}");
    text.parse::<f64>().map_or(text, |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_ticks_are_round_and_within_the_axis() {
        assert_eq!(
            ticks(0.0, 89.0, 9),
            [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0]
        );
        assert_eq!(ticks(-0.25, 0.25, 5), [-0.2, -0.1, 0.0, 0.1, 0.2]);
        assert_eq!(ticks(1.0, 1.0, 5), Vec::<f64>::new());
        assert_eq!(ticks(0.0, f64::NAN, 5), Vec::<f64>::new());
    }

    #[test]
    fn regress_numbers_of_an_axis() {
        assert_eq!(numbers(&[0.1 + 0.2, 0.35, 0.4], 1.0), ["0.30", "0.35", "0.40"]);
        assert_eq!(numbers(&[-20.0, -0.0, 20.0], 1.0), ["\u{2212}20", "0", "20"]);
        assert_eq!(numbers(&[0.0, 0.002, 0.004], 1e-3), ["0", "2", "4"]);
        assert_eq!(numbers(&[2e5], 1e3), ["200"]);
        assert_eq!(power_of_ten(-12), "10⁻¹²");
    }
}
