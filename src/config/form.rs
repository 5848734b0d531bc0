//! The form of a file: a structure with a field for each key, with stated values applied, and as
//! text.

use super::error::{Origin, Problem};
use super::kind::{Kind, Section};
use super::layers::Layers;
use super::schema::EXCLUSIVE;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Write as _;
use toml::{Table, Value};

/// Defaults with the stated values applied; values of sections that the form lacks are left out.
pub(super) fn merged<F: Default + Serialize + DeserializeOwned>(layers: &Layers) -> Result<F, Vec<Problem>> {
    let broken = |e: &dyn std::fmt::Display| vec![Problem::new(Origin::Default, "", format!("{e}"))];
    let mut table = Table::try_from(F::default()).map_err(|e| broken(&e))?;
    for group in EXCLUSIVE {
        if group.iter().any(|key| layers.entries().contains_key(*key)) {
            for (section, name) in group.iter().filter_map(|key| key.rsplit_once('.')) {
                section_of(&mut table, section).map(|section| section.remove(name));
            }
        }
    }
    for (path, entry) in layers.entries() {
        let Some((section, name)) = path.rsplit_once('.') else {
            continue;
        };
        section_of(&mut table, section).map(|section| section.insert(name.to_owned(), entry.value.clone()));
    }
    F::deserialize(Value::Table(table)).map_err(|e| broken(&e))
}

/// A section of a form as a table.
pub(super) fn section_of<'a>(table: &'a mut Table, section: &str) -> Option<&'a mut Table> {
    table.get_mut(section).and_then(Value::as_table_mut)
}

/// A form as a file that loads to the same form.
pub(super) fn render(sections: &[Section], form: &impl Serialize) -> String {
    text_of(sections, form, None)
}

/// The same with the type, range, unit and meaning of every key, after the first lines.
pub(super) fn reference(begin: &str, sections: &[Section], form: &impl Serialize) -> String {
    text_of(sections, form, Some(begin))
}

/// With comments, if there are first lines.
fn text_of(sections: &[Section], form: &impl Serialize, begin: Option<&str>) -> String {
    // Serialising plain structures of numbers, words and lists cannot fail.
    let values = Table::try_from(form).unwrap_or_default();
    let comments = begin.is_some();
    let mut text = begin.unwrap_or_default().to_owned();
    for section in sections {
        if comments {
            text.push('\n');
            comment(&mut text, &format!("{}.", section.meaning));
        }
        let _ = writeln!(text, "[{}]", section.name);
        for key in section.keys {
            let value = values.get(section.name).and_then(|section| section.get(key.name));
            if comments {
                let default = if value.is_none() { "; not set by default" } else { "" };
                text.push('\n');
                comment(&mut text, &format!("{}.", key.meaning));
                comment(&mut text, &format!("Takes {}{default}.", key.kind.expected(key.unit)));
                if let Kind::Tables(inner) = key.kind {
                    for key in inner {
                        let need = if key.optional { "" } else { "; needed" };
                        let line = format!(
                            "{}: {}. Takes {}{need}.",
                            key.name,
                            key.meaning,
                            key.kind.expected(key.unit)
                        );
                        comment(&mut text, &line);
                    }
                }
            }
            match value {
                Some(value) => _ = writeln!(text, "{} = {}", key.name, literal(value)),
                None if comments => _ = writeln!(text, "#{} =", key.name),
                None => {}
            }
        }
        if !comments {
            text.push('\n');
        }
    }
    text
}

/// A value in short form: `1e-9`, not `0.000000001`.
pub(super) fn literal(value: &Value) -> String {
    match value {
        Value::Float(x) => format!("{x:?}"),
        Value::Table(table) => {
            let entries = table.iter().map(|(name, value)| format!("{name} = {}", literal(value)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
        Value::Array(items) => format!("[{}]", items.iter().map(literal).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// A sentence as comment lines of readable length.
fn comment(text: &mut String, sentence: &str) {
    const WIDTH: usize = 110;
    let mut width = WIDTH;
    for word in sentence.split(' ') {
        if width + 1 + word.chars().count() > WIDTH {
            text.push_str(if text.ends_with('\n') { "#" } else { "\n#" });
            width = 1;
        }
        text.push(' ');
        text.push_str(word);
        width += 1 + word.chars().count();
    }
    text.push('\n');
}
