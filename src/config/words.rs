//! Messages about wrong keys and values: what is wrong, and what was probably intended.

use super::kind::Key;
use super::schema::{ROBOTS, Schema};
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
    if path == ROBOTS {
        return "unknown key; the name of one robot is bus.robot, and many robots are entries [[robot]], in two brackets".to_owned();
    }
    match likeliest(schema, path, &known) {
        Some(key) => format!("unknown key; did you mean {key}?"),
        None => format!("unknown key; {list} lists all of them"),
    }
}

/// The key or section that was probably meant: with a similar name in the same section; with this
/// name in another one, below this one first; or in a section with a similar name.
fn likeliest<'a>(schema: &'a Schema, path: &str, known: &'a [String]) -> Option<&'a str> {
    let (stated, name) = parts(path);
    let sections = schema.keys().map(|key| key.section).filter(|name| !name.is_empty());
    let all: Vec<&str> = known.iter().map(String::as_str).chain(sections).collect();
    let inside = nearest(
        name,
        all.iter().filter(|one| parts(one).0 == stated).map(|one| parts(one).1),
    );
    if let Some(inside) = inside {
        let meant = |one: &&&str| parts(one) == (stated, inside);
        return all.iter().find(meant).copied();
    }
    let below = |one: &&&str| {
        parts(one)
            .0
            .strip_prefix(stated)
            .is_some_and(|rest| rest.starts_with('.'))
    };
    let of_this_name = || known.iter().map(String::as_str).filter(|one| parts(one).1 == name);
    // A name in a section that does not exist may be of anything, unless only the beginning of the
    // section was left out.
    let within = format!(".{path}");
    let may_be_moved = stated.is_empty() || is_section(schema, stated);
    let moved: Vec<&str> = of_this_name()
        .filter(|one| may_be_moved || one.ends_with(&within))
        .collect();
    let moved = moved.iter().find(below).or(moved.first()).copied();
    // A section that does not exist is rather misspelt than meant.
    let section = match is_section(schema, stated) {
        true => None,
        false => nearest(stated, all.iter().map(|one| parts(one).0).filter(|one| !one.is_empty())),
    };
    let respelt = section.and_then(|section| {
        let inside = all.iter().filter(|one| parts(one).0 == section).map(|one| parts(one).1);
        let inside = nearest(name, inside)?;
        all.iter().find(|one| parts(one) == (section, inside)).copied()
    });
    // Without a section any key of a similar name may be meant.
    let anywhere = || {
        let inside = nearest(name, known.iter().map(|one| parts(one).1))?;
        known.iter().map(String::as_str).find(|one| parts(one).1 == inside)
    };
    respelt
        .or(moved)
        .or_else(|| if stated.is_empty() { anywhere() } else { None })
}

/// Number of errors of typing; a unit that was left out, as in `window` for `window_s`, is one.
fn distance(word: &str, candidate: &str) -> usize {
    match candidate.strip_prefix(word).is_some_and(|rest| rest.starts_with('_')) {
        true => 1,
        false => strsim::osa_distance(word, candidate),
    }
}

/// The section, empty at the top, and the name in it.
fn parts(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or(("", path))
}

/// Longest word to compare: a longer one is not a typing error.
const LONGEST: usize = 64;

/// The most similar word, if similar enough to be a typing error: one letter that is wrong,
/// missing, superfluous or swapped with its neighbour in each four, none in a word of two.
pub(super) fn nearest<'a>(word: &str, words: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let most = match word.chars().count() {
        0..3 => 0,
        len => 1.max(len / 4),
    };
    words
        .filter(|_| word.len() <= LONGEST)
        .map(|candidate| (distance(word, candidate), candidate))
        .min()
        .filter(|(distance, candidate)| *distance <= most && *distance < candidate.chars().count())
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

#[cfg(test)]
mod tests {
    use super::super::schema::ORDINARY;
    use super::*;

    #[test]
    fn fault_a_misspelt_key_is_told_the_near_one_of_its_section_and_no_far_one() {
        for (wrong, meant) in [
            ("estimator.blokc_len", Some("estimator.block_len")),
            ("estimator.block_length", Some("estimator.block_len")),
            ("bus.doman", Some("bus.domain")),
            ("identifier.projected.window", Some("identifier.projected.window_s")),
            ("plant.sensor", Some("plant.sensors")),
            ("estimater.block_len", Some("estimator.block_len")),
            ("estimater.blok_len", Some("estimator.block_len")),
            ("identifer.projected.window_s", Some("identifier.projected.window_s")),
            // in another section
            ("identifier.window_s", Some("identifier.projected.window_s")),
            ("identifier.fixed", Some("estimator.fixed")),
            ("block_len", Some("estimator.block_len")),
            ("blok_len", Some("estimator.block_len")),
            ("servo_axis.motion", Some("model.servo_axis.motion")),
            // nothing near
            ("estimator.nmae", None),
            ("model.nmae", None),
            ("nmae", None),
            ("log.x", None),
            ("estimator.colour", None),
        ] {
            let said = unknown(&ORDINARY, wrong);
            let expected = meant.map_or("lists all of them".to_owned(), |key| format!("did you mean {key}?"));
            assert!(said.contains(&expected), "{wrong}: {said}");
        }
    }
}
