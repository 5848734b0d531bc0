//! Messages about wrong keys and values: what is wrong, and what was probably intended.

use super::kind::Key;
use super::schema::Schema;
use toml::de::DeValue;

pub(super) use crate::words::cut;

/// True for a section and for the beginning of one.
pub(super) fn is_section(schema: &Schema, path: &str) -> bool {
    schema
        .keys()
        .any(|key| key.section == path || key.section.strip_prefix(path).is_some_and(|rest| rest.starts_with('.')))
}

/// Message about an unknown key.
pub(super) fn unknown(schema: &Schema, path: &str) -> String {
    let known: Vec<String> = schema.keys().map(Key::path).collect();
    let list = schema.list_of(path);
    if is_section(schema, path) {
        let inside = schema.keys().find(|key| key.section == path).map(Key::path);
        return match inside {
            Some(key) => format!("a section, not a key; its keys are {key} and others in {list}"),
            None => format!("a section, not a key; {list} lists its keys"),
        };
    }
    if let Some(what) = schema.retired(path) {
        return what.to_owned();
    }
    let name = path.rsplit('.').next().unwrap_or(path);
    // The right key in the wrong section is the most common mistake, if that section exists.
    let moved = known
        .iter()
        .find(|key| key.rsplit('.').next() == Some(name))
        .map(String::as_str);
    let sections = schema.keys().map(|key| key.section).filter(|name| !name.is_empty());
    let similar = nearest(path, known.iter().map(String::as_str).chain(sections));
    let stated = path.rsplit_once('.').map_or("", |(section, _)| section);
    let likeliest = if is_section(schema, stated) {
        moved.or(similar)
    } else {
        similar.or(moved)
    };
    match likeliest {
        Some(key) => format!("unknown key; did you mean {key}?"),
        None => format!("unknown key; {list} lists all of them"),
    }
}

/// Longest word to compare: a longer one is not a typing error.
const LONGEST: usize = 64;

/// The most similar word, if similar enough to be a typing error.
pub(super) fn nearest<'a>(word: &str, words: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    words
        .filter(|_| word.len() <= LONGEST)
        .map(|candidate| (strsim::osa_distance(word, candidate), candidate))
        .min()
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len() / 5)
        .map(|(_, candidate)| candidate)
}

/// The value as written, and its type.
pub(super) fn describe(value: &DeValue<'_>, text: &str) -> String {
    let what = match value {
        DeValue::String(s) => {
            // Enough for display; a string may be as long as a file.
            let beginning: String = s.chars().take(100).collect();
            return format!("{} (a string)", shorten(&format!("{beginning:?}")));
        }
        DeValue::Integer(_) => "a whole number".to_owned(),
        DeValue::Float(x) if matches!(x.as_str().trim_start_matches(['+', '-']), "inf" | "nan") => {
            "not a finite number".to_owned()
        }
        DeValue::Float(_) => "a number".to_owned(),
        DeValue::Boolean(_) => "a truth value".to_owned(),
        DeValue::Datetime(_) => "a date or time".to_owned(),
        DeValue::Array(items) => format!("a list of {}", items.len()),
        DeValue::Table(_) => return "a section".to_owned(),
    };
    format!("{} ({what})", shorten(text))
}

/// In one line, the first characters.
pub(super) fn shorten(text: &str) -> String {
    const LIMIT: usize = 60;
    // Only words up to the limit can be shown.
    let words = text.split_whitespace().take(LIMIT).map(|word| cut(word, LIMIT + 1));
    cut(&words.collect::<Vec<_>>().join(" "), LIMIT)
}
