//! One HTML page with the table, the figures and the configuration of a run; it loads nothing else.

use super::data::RunData;
use super::fonts::{MEDIUM, REGULAR};
use super::labels::{escape, power_of_ten};
use super::plot::Figure;
use super::summary::{Summary, error, significant};
use super::words::{model_symbol, pretty_unit, symbol, with_powers};
use std::fmt::Write as _;

const STYLE: &str = "
:root{--paper:#f6f6f4;--card:#fff;--ink:#1b1b1b;--soft:#5c5c5c;--line:#dcdcdc;--rule:#b5b5b5;--blue:#0072B2;--warn:#C04A00}
@media screen and (prefers-color-scheme:dark){:root{--paper:#14171a;--card:#1d2125;--ink:#e8e8e6;--soft:#a5abb1;--line:#373d43;--rule:#565d64;--blue:#5ab4e5;--warn:#f0894a}
figure svg{filter:invert(.885) hue-rotate(180deg)}}
@media screen and (max-width:640px){td small{width:auto;max-width:130px}main{padding:20px 12px 40px!important}h1{font-size:22px!important}figure{overflow-x:auto;padding:8px!important}figure svg{min-width:600px}figcaption{position:sticky;left:0}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 Roboto,'Helvetica Neue',Arial,sans-serif}
main{max-width:960px;margin:0 auto;padding:36px 24px 60px}
h1{font-size:28px;font-weight:500;line-height:1.2;margin:0 0 4px}
h2{font-size:19px;font-weight:500;margin:40px 0 12px}
p{margin:0 0 12px}
.soft{color:var(--soft)}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(140px,1fr));gap:12px;margin:24px 0 0}
.facts div{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:12px 14px}
.facts b{display:block;font-size:21px;font-weight:500;line-height:1.25}
.facts span{color:var(--soft);font-size:13px}
.warn{border-left:4px solid var(--warn);background:var(--card);padding:10px 14px;margin:16px 0 0}
.scroll{overflow-x:auto;background:var(--card);border:1px solid var(--line);border-radius:6px}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums lining-nums}
th,td{padding:7px 10px;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
tr:last-child td{border-bottom:0}
th{font-weight:500;color:var(--soft);font-size:13px;border-bottom:1px solid var(--rule)}
th:first-child,td:first-child,th:last-child,td:last-child,#result th:nth-child(6),#result td:nth-child(6){text-align:left}
td:last-child{white-space:normal}#result td:last-child{min-width:132px}
td small{display:block;width:190px;max-width:250px;white-space:normal;color:var(--soft);font-size:12px;line-height:1.35}
nav{display:flex;flex-wrap:wrap;gap:6px 14px;font-size:14px}
a{color:var(--blue)}
figure{margin:0 0 26px;background:var(--card);border:1px solid var(--line);border-radius:6px;padding:14px 16px}
figure svg{display:block;width:100%;height:auto}
figcaption{color:var(--soft);font-size:14px;margin-top:8px}
details{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:10px 14px}
summary{cursor:pointer;font-weight:500}
pre{overflow-x:auto;font:13px/1.45 ui-monospace,'DejaVu Sans Mono',monospace;margin:12px 0 0}
@media print{body{background:#fff}figure,details,.facts div{break-inside:avoid}nav{display:none}}
";

/// The page of a run.
///
/// `beside` are files in the same directory.
pub fn page(run: &RunData, summary: &Summary, figures: &[Figure], beside: &[&str]) -> String {
    let title = format!(
        "{}, robot {}",
        escape(&model_symbol(&summary.model)),
        escape(&summary.robot)
    );
    let mut html = String::with_capacity(1 << 20);
    let _ = write!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><meta name=\"color-scheme\" content=\"light dark\">\
         <title>{title} — thetabus</title><style>{}{STYLE}</style></head>\n<body><main data-figures=\"{}\">\n\
         <p class=\"soft\">Identification of the {title}</p>\n<h1>{}</h1>\n<p class=\"soft\">{}thetabus {}, model {:016x}, configuration {}</p>\n",
        fonts(),
        figures.len(),
        escape(&run.headline().unwrap_or_else(|| "no value may be used".to_owned())),
        made(run),
        env!("CARGO_PKG_VERSION"),
        run.info.model_hash,
        summary.config_hash.as_deref().unwrap_or("unknown"),
    );
    links(&mut html, beside);
    facts(&mut html, summary);
    if !run.loss.is_none() {
        let _ = writeln!(
            html,
            "<p class=\"warn\"><b>The recording is not complete:</b> {}.</p>",
            escape(&run.loss.to_string())
        );
    }
    results(&mut html, summary, &run.notes.meanings);
    changes(&mut html, summary);
    html.push_str("<h2>Figures</h2>\n<nav>");
    for figure in figures {
        let _ = write!(
            html,
            "<a href=\"#{0}\">{1}</a>",
            escape(&figure.name),
            escape(&symbol(&figure.name))
        );
    }
    html.push_str("</nav>\n<p></p>\n");
    for figure in figures {
        let _ = writeln!(
            html,
            "<figure id=\"{}\">{}<figcaption>{}</figcaption></figure>",
            escape(&figure.name),
            figure.svg().trim_end(),
            escape(&figure.caption)
        );
    }
    let _ = write!(
        html,
        "<h2>Configuration</h2>\n<details><summary>The whole configuration of the run, as a file that can be run again</summary><pre>{}</pre></details>\n</main></body></html>\n",
        escape(&run.info.config_toml)
    );
    html
}

/// The embedded fonts, so that the page looks the same everywhere.
fn fonts() -> String {
    [(REGULAR, 400), (MEDIUM, 500)]
        .map(|(font, weight)| {
            format!(
                "@font-face{{font-family:Roboto;font-weight:{weight};src:url(data:font/ttf;base64,{}) format('truetype')}}",
                base64(font)
            )
        })
        .concat()
}

/// Date and place, with a comma after them.
fn made(run: &RunData) -> String {
    let mut text = String::new();
    for (words, what) in [("recorded ", &run.notes.begun), ("reported on ", &run.notes.host)] {
        if !what.is_empty() {
            let _ = write!(text, "{words}{}, ", escape(what));
        }
    }
    text
}

/// Links to the files next to the page.
fn links(html: &mut String, beside: &[&str]) {
    if beside.is_empty() {
        return;
    }
    html.push_str("<nav>");
    for name in beside {
        let _ = write!(html, "<a href=\"{0}\">{0}</a>", escape(name));
    }
    html.push_str("</nav>\n");
}

fn facts(html: &mut String, summary: &Summary) {
    html.push_str("<div class=\"facts\">");
    let mut fact = |value: &str, what: &str| {
        let _ = write!(html, "<div><b>{}</b><span>{what}</span></div>", escape(value));
    };
    fact(&symbol(&summary.state), "state at the end");
    fact(&grouped(summary.blocks), "estimates, one per block");
    fact(&grouped(summary.samples.accepted), "samples accepted");
    fact(&grouped(summary.samples.missing), "missing");
    fact(&grouped(summary.samples.rejected), "rejected");
    if let Some(wall) = summary.wall_s {
        fact(&format!("{wall:.1} s"), "wall time");
    }
    html.push_str("</div>\n");
}

fn results(html: &mut String, summary: &Summary, meanings: &[String]) {
    html.push_str(
        "<h2>Result</h2>\n<div class=\"scroll\"><table id=\"result\"><thead><tr><th>value</th><th>estimate</th><th>standard deviation</th>\
         <th>truth</th><th>error</th><th>unit</th><th>note</th></tr></thead><tbody>\n",
    );
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_string(), |v| minus(&significant(v)));
    let standard_deviation = |value: Option<f64>| value.map_or_else(|| "–".to_string(), two_digits);
    let error =
        |estimate, std, truth| error(estimate, std, truth).map_or_else(|| "–".to_string(), |percent| minus(&percent));
    let mut row = |name: &str, values: [String; 4], unit: &str, note: &str, meaning: &str| {
        let cells = values.map(|value| format!("<td>{value}</td>")).concat();
        let unit = if unit == "1" {
            String::new()
        } else {
            escape(&pretty_unit(unit))
        };
        let meaning = match meaning {
            // the name of a robot's parameter may be sufficient
            "" => String::new(),
            words if words == name => String::new(),
            words => format!("<small>{}</small>", escape(&with_powers(words))),
        };
        let _ = writeln!(
            html,
            "<tr><td>{}{meaning}</td>{cells}<td>{unit}</td><td>{note}</td></tr>",
            escape(&symbol(name))
        );
    };
    for (index, p) in summary.parameters.iter().enumerate() {
        let values = [
            number(p.estimate),
            standard_deviation(p.std),
            number(p.truth),
            error(p.estimate, p.std, p.truth),
        ];
        let meaning = meanings.get(index).map_or("", String::as_str);
        row(&p.name, values, &p.unit, p.note(), meaning);
    }
    for (index, d) in summary.derived.iter().enumerate() {
        let values = [
            number(d.estimate),
            standard_deviation(d.std),
            number(d.truth),
            error(d.estimate, d.std, d.truth),
        ];
        let meaning = meanings
            .get(summary.parameters.len() + index)
            .map_or("", String::as_str);
        row(&d.name, values, &d.unit, "derived", meaning);
    }
    html.push_str("</tbody></table></div>\n");
}

fn changes(html: &mut String, summary: &Summary) {
    if summary.changes.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Changes found</h2>\n<div class=\"scroll\"><table><thead><tr><th>located at</th><th>announced by block</th><th>announced at</th>\
         <th>blocks until within 1 %</th></tr></thead><tbody>\n",
    );
    for c in &summary.changes {
        let settled = c.blocks_to_1_percent.map_or_else(|| "–".to_string(), |n| n.to_string());
        let _ = writeln!(
            html,
            "<tr><td>{:.3} s</td><td>{}</td><td>{:.3} s</td><td>{settled}</td></tr>",
            c.t_s, c.block, c.detected_t_s
        );
    }
    html.push_str("</tbody></table></div>\n");
}

/// Two significant digits, with a power of ten if that is shorter.
fn two_digits(value: f64) -> String {
    let text = format!("{value:.1e}");
    match text
        .split_once('e')
        .and_then(|(m, e)| Some((m, e.parse::<i32>().ok()?)))
    {
        Some((_, exponent @ -2..=2)) => {
            let decimals = (1 - exponent).max(0) as usize;
            format!("{value:.decimals$}")
        }
        Some((mantissa, exponent)) => format!("{mantissa}\u{b7}{}", power_of_ten(exponent)),
        None => text,
    }
}

fn minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

/// Digits in groups of three.
fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push('\u{a0}');
        }
        out.push(digit);
    }
    out
}

/// RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().fold(0u32, |word, &byte| word << 8 | u32::from(byte)) << (8 * (3 - group.len()));
        for place in 0..4 {
            let sextet = (word >> (18 - 6 * place)) as usize & 63;
            out.push(if place <= group.len() {
                char::from(ALPHABET[sextet])
            } else {
                '='
            });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_base64_vectors_of_the_rfc() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn regress_standard_deviations_have_two_digits() {
        for (value, text) in [
            (3.04e-6, "3.0·10⁻⁶"),
            (0.172, "0.17"),
            (0.012, "0.012"),
            (23.4, "23"),
            (1e5, "1.0·10⁵"),
        ] {
            assert_eq!(two_digits(value), text);
        }
    }

    #[test]
    fn regress_large_counts_are_grouped() {
        assert_eq!(grouped(170_000), "170\u{a0}000");
        assert_eq!(
            (grouped(0), grouped(1_234_567)),
            ("0".into(), "1\u{a0}234\u{a0}567".into())
        );
    }
}
