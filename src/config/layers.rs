//! Layers of settings: built-in defaults, files in order, `--set` arguments.

use super::error::{Origin, Problem};
use super::kind::Key;
use super::kind::{Kind, quoted};
use super::schema::{EXCLUSIVE, ROBOTS, Schema};
use super::words::{cut, describe, is_section, nearest, shorten, unknown};
use crate::pipe::read_text;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::de::{DeArray, DeTable, DeValue};
use toml::{Spanned, Value};

/// Longest text of settings from any source \[bytes\].
pub(super) const MAX_BYTES: u64 = crate::pipe::MAX_SETTINGS_BYTES;

/// More problems than this are only counted: a file of garbage has one in each line.
pub(super) const MAX_PROBLEMS: usize = 100;

/// Longest part of a key shown in a message \[characters\].
const MAX_KEY: usize = 100;

/// For a larger text that is not TOML, only the first error is reported.
const MAX_BYTES_RECOVERED: usize = 1 << 18;

/// A file that is not TOML has a syntax error in each line; a few suffice.
const MAX_SYNTAX_ERRORS: usize = 5;

/// A source of settings.
#[derive(Debug, Clone)]
pub enum Source {
    /// A file on disk; relative paths inside it are relative to its directory.
    File(PathBuf),
    /// The settings shared by all robots of a file with `[[robot]]` entries: everything except
    /// these entries.
    Shared(PathBuf),
    /// A text built into the program.
    Embedded {
        /// Shown in messages.
        name: String,
        /// TOML.
        text: String,
    },
    /// The common sections of a robot's file. `RobotConfig` reads its own sections; what these say
    /// about the common ones is in the two texts.
    #[cfg(feature = "robot")]
    Robot {
        /// The file.
        path: PathBuf,
        /// TOML: what holds unless the file says otherwise.
        defaults: String,
        /// TOML: what holds whatever the file says.
        derived: String,
    },
    /// The configuration in a recording, which may come from anywhere, so it must not make the
    /// program open files. Its paths for results and checkpoints, of another machine, are ignored,
    /// and it contains setpoints as rows.
    Recorded {
        /// Shown in messages.
        name: String,
        /// TOML.
        text: String,
    },
}

/// A checked value and its origin.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub value: Value,
    pub origin: Origin,
    /// Base directory of a relative path.
    pub base: Option<PathBuf>,
    /// True if it comes from a recording.
    pub recorded: bool,
    layer: usize,
}

/// The present values while sources are applied.
#[derive(Debug)]
pub(super) struct Layers {
    /// The keys that there are.
    schema: &'static Schema,
    entries: BTreeMap<String, Entry>,
    /// The valid keys in lists of tables, by a path such as `robot[2].name`, each with its origin.
    inner: BTreeMap<String, (Value, Origin)>,
    layer: usize,
    /// True if the source being read is a recording.
    recorded: bool,
    /// Sections of the source being read that are handled elsewhere.
    elsewhere: Vec<&'static str>,
    /// True if the text being read is a file's own.
    has_lines: bool,
    pub problems: Vec<Problem>,
    /// Problems beyond [`MAX_PROBLEMS`].
    untold: usize,
    /// Setting of the velocity filter in an old recording.
    velocity_samples: Option<u32>,
}

/// A key of old recordings; it gives a time together with their sample period.
const SAMPLES_OF_THE_VELOCITY_FILTER: &str = "identifier.projected.velocity_half_width";

impl Layers {
    /// Without sources, for files of this kind.
    pub fn of(schema: &'static Schema) -> Self {
        Self {
            schema,
            entries: BTreeMap::new(),
            inner: BTreeMap::new(),
            layer: 0,
            recorded: false,
            elsewhere: Vec::new(),
            has_lines: true,
            problems: Vec::new(),
            untold: 0,
            velocity_samples: None,
        }
    }

    /// The stated values, by full key.
    pub fn entries(&self) -> &BTreeMap<String, Entry> {
        &self.entries
    }

    /// A valid value in a list of tables and its origin, by a path such as `robot[2].name`; also if
    /// another table of the list is wrong.
    pub fn inner(&self, path: &str) -> Option<(&Value, &Origin)> {
        self.inner.get(path).map(|(value, origin)| (value, origin))
    }

    /// Origin of a key: where it was stated, or the built-in default.
    pub fn origin(&self, key: &str) -> Origin {
        self.entries
            .get(key)
            .map_or(Origin::Default, |entry| entry.origin.clone())
    }

    /// Origin of a key, if it was stated in a recording.
    pub fn recorded_origin(&self, key: &str) -> Option<Origin> {
        let entry = self.entries.get(key).filter(|entry| entry.recorded)?;
        Some(entry.origin.clone())
    }

    /// Applies one source on top.
    pub fn source(&mut self, source: &Source) {
        match source {
            Source::Embedded { name, text } => self.text(name, text, None),
            Source::Recorded { name, text } => {
                self.recorded = true;
                self.text(name, text, None);
                self.translate_velocity_filter();
                self.recorded = false;
            }
            Source::File(path) => self.file(path),
            Source::Shared(path) => {
                self.elsewhere = vec![ROBOTS];
                self.file(path);
                self.elsewhere.clear();
            }
            #[cfg(feature = "robot")]
            Source::Robot {
                path,
                defaults,
                derived,
            } => {
                let name = path.display().to_string();
                self.generated(&name, defaults);
                self.elsewhere = super::schema::own_sections_of_robots().collect();
                self.file(path);
                self.elsewhere.clear();
                self.generated(&name, derived);
            }
        }
    }

    /// Applies a text that follows from the file of this name, so that its lines say nothing.
    #[cfg(feature = "robot")]
    fn generated(&mut self, name: &str, text: &str) {
        self.has_lines = false;
        self.text(name, text, None);
        self.has_lines = true;
    }

    fn file(&mut self, path: &Path) {
        let name = path.display().to_string();
        match read_text(path, MAX_BYTES) {
            Ok(text) => self.text(&name, &text, path.parent()),
            Err(problem) => {
                let origin = Origin::File { name, line: 0 };
                self.problems.push(Problem::new(origin, "", problem.to_string()));
            }
        }
    }

    /// Replaces the number of samples in an old recording by the corresponding time.
    fn translate_velocity_filter(&mut self) {
        const KEY: &str = "identifier.projected.velocity_half_width_s";
        let period = self.entries.get("plant.sample_period_s").cloned();
        let (Some(samples), Some(period)) = (self.velocity_samples.take(), period) else {
            return;
        };
        if let Some(period_s) = period.value.as_float() {
            let value = Value::Float(f64::from(samples) * period_s);
            self.entries.insert(KEY.to_owned(), Entry { value, ..period });
        }
    }

    /// Applies `section.key=value` arguments on top; later ones win.
    pub fn arguments(&mut self, arguments: &[String]) {
        self.lay(
            arguments
                .iter()
                .map(|argument| (argument, Origin::Argument(cut(argument, 2 * MAX_KEY)))),
        );
    }

    /// The same for options that stand for a key; each has the option as typed before it.
    pub fn options(&mut self, options: &[(String, String)]) {
        let origin = |typed: &str| Origin::Option(cut(typed, 2 * MAX_KEY));
        self.lay(options.iter().map(|(typed, argument)| (argument, origin(typed))));
    }

    fn lay<'a>(&mut self, arguments: impl Iterator<Item = (&'a String, Origin)>) {
        self.layer += 1;
        for (argument, origin) in arguments {
            let taken = self.argument(argument, origin);
            self.problems.extend(taken.err());
        }
    }

    fn argument(&mut self, argument: &str, origin: Origin) -> Result<(), Problem> {
        let expected = "section.key=value, for example estimator.block_len=950";
        let Some((path, text)) = argument.split_once('=') else {
            return Err(Problem::expected(origin, "", expected, "no \"=\""));
        };
        let (path, text) = (path.trim(), text.trim());
        if path.is_empty() {
            return Err(Problem::expected(origin, "", expected, "no key before \"=\""));
        }
        let Some(key) = self.schema.key(path) else {
            return Err(Problem::new(origin, &cut(path, MAX_KEY), unknown(self.schema, path)));
        };
        // A bare word is a string, so that no quotes need escaping in a shell.
        let bare = DeValue::String(text.into());
        let with_quotes = if key.kind.is_list_of_text() {
            quoted_items(text)
        } else {
            None
        };
        let toml = with_quotes.as_deref().unwrap_or(text);
        let parsed = match DeValue::parse(toml) {
            Ok(value) if !key.kind.is_text() || value.get_ref().is_str() => value.into_inner(),
            Err(error) if text.starts_with(['[', '{', '"', '\'']) => {
                let got = format!("{}, which is not TOML: {}", shorten(text), error.message());
                return Err(Problem::expected(origin, path, key.kind.expected(key.unit), got));
            }
            _ => bare,
        };
        self.put(key, path, (&parsed, text), origin, None);
        Ok(())
    }

    /// Applies a text on top, with its name for messages and the base directory of its paths.
    pub fn text(&mut self, name: &str, text: &str, base: Option<&Path>) {
        self.layer += 1;
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let file = File {
            name,
            text,
            base,
            line_ends: self.has_lines.then(|| ends.map(|(at, _)| at).collect()),
        };
        if text.len() as u64 > MAX_BYTES {
            let message = too_large();
            self.problems.push(Problem::new(file.whole(), "", message));
            return;
        }
        if text.len() > MAX_BYTES_RECOVERED
            && let Err(error) = DeTable::parse(text)
        {
            let at = error.span().unwrap_or(0..0);
            let message = format!("not valid TOML: {}; is this a TOML file?", error.message());
            self.problems.push(Problem::new(file.origin(at.start), "", message));
            return;
        }
        let (table, errors) = DeTable::parse_recoverable(text);
        for error in errors.iter().take(MAX_SYNTAX_ERRORS) {
            let at = error.span().unwrap_or(0..0);
            let near = match file.slice(&at) {
                "" => String::new(),
                near => format!(", at {}", shorten(near)),
            };
            let message = format!("not valid TOML: {}{near}", error.message());
            self.problems.push(Problem::new(file.origin(at.start), "", message));
        }
        if let Some(more) = errors.len().checked_sub(MAX_SYNTAX_ERRORS).filter(|more| *more > 0) {
            self.problems.push(Problem::new(
                file.whole(),
                "",
                format!("and {more} more; is this a TOML file?"),
            ));
        }
        // A parser's guesses after a syntax error would only mislead.
        if errors.is_empty() {
            self.table(&file, "", table.get_ref());
        }
        if self.untold > 0 {
            let message = format!("and {} more problems", self.untold);
            self.problems.push(Problem::new(file.whole(), "", message));
            self.untold = 0;
        }
    }

    /// True if a further problem is only counted.
    fn enough(&mut self) -> bool {
        let enough = self.problems.len() >= MAX_PROBLEMS;
        self.untold += usize::from(enough);
        enough
    }

    fn table(&mut self, file: &File<'_>, prefix: &str, table: &DeTable<'_>) {
        for (name, value) in table.iter() {
            let path = if prefix.is_empty() {
                name.get_ref().to_string()
            } else {
                format!("{prefix}.{}", name.get_ref())
            };
            let got = file.slice(&value.span());
            let origin = || file.origin(name.span().start);
            if self.elsewhere.contains(&path.as_str()) {
                continue;
            }
            if self.recorded && path == SAMPLES_OF_THE_VELOCITY_FILTER {
                self.velocity_samples = value.get_ref().as_integer().and_then(|n| n.as_str().parse().ok());
            } else if let Some(key) = self.schema.key(&path) {
                self.put(key, &path, (value.get_ref(), got), origin(), Some(file));
            } else if !is_section(self.schema, &path) {
                if !self.enough() {
                    let told = cut(&path, MAX_KEY);
                    self.problems
                        .push(Problem::new(origin(), &told, unknown(self.schema, &path)));
                }
            } else if let Some(inner) = value.get_ref().as_table() {
                self.table(file, &path, inner);
            } else {
                let expected = format!("a section [{path}]");
                let got = describe(value.get_ref(), got);
                self.problems.push(Problem::expected(origin(), &path, expected, got));
            }
        }
    }

    /// Takes a value with its text; of a `file`, or else of an argument.
    fn put(
        &mut self,
        key: &Key,
        path: &str,
        (value, text): (&DeValue<'_>, &str),
        origin: Origin,
        file: Option<&File<'_>>,
    ) {
        let checked = match (key.kind, value.as_array()) {
            (Kind::Tables(inner), Some(items)) => match self.tables(inner, path, items, &origin, file) {
                Some(tables) => Some(tables),
                None => return,
            },
            _ => key.kind.check(value),
        };
        let Some(checked) = checked else {
            let expected = key.kind.expected(key.unit);
            let got = describe(value, text);
            let got = match meant(key.kind, value) {
                Some(word) => format!("{got}; did you mean \"{word}\"?"),
                None => got,
            };
            self.problems.push(Problem::expected(origin, path, expected, got));
            return;
        };
        for group in EXCLUSIVE.iter().filter(|group| group.contains(&path)) {
            for other in group.iter().filter(|other| **other != path) {
                match self.entries.get(*other) {
                    // Stated in one source they contradict each other; a later source overrides.
                    Some(entry) if entry.layer == self.layer => self.problems.push(Problem::expected(
                        origin.clone(),
                        path,
                        format!("either this or {other}"),
                        format!("both ({other} is set at {})", entry.origin),
                    )),
                    _ => _ = self.entries.remove(*other),
                }
            }
        }
        // The reader of a recording decides where results and checkpoints go.
        if self.recorded && key.kind == Kind::Path && path != "plant.setpoint.csv.path" {
            return;
        }
        let entry = Entry {
            recorded: self.recorded,
            value: checked,
            origin,
            base: file.and_then(|file| file.base).map(Path::to_path_buf),
            layer: self.layer,
        };
        self.entries.insert(path.to_owned(), entry);
    }
}

impl Layers {
    /// A list of tables; `None` after reporting their problems.
    fn tables(
        &mut self,
        keys: &[Key],
        path: &str,
        items: &DeArray<'_>,
        origin: &Origin,
        file: Option<&File<'_>>,
    ) -> Option<Value> {
        let at = |span: std::ops::Range<usize>| file.map_or_else(|| origin.clone(), |file| file.origin(span.start));
        let text = |value: &Spanned<DeValue<'_>>| match file {
            Some(file) => file.slice(&value.span()).to_owned(),
            None => plain(value.get_ref()),
        };
        let before = self.problems.len();
        let mut tables = Vec::new();
        for (index, item) in items.iter().enumerate() {
            if self.problems.len() > before && self.enough() {
                continue;
            }
            let path = format!("{path}[{}]", index + 1);
            let Some(table) = item.get_ref().as_table() else {
                let got = describe(item.get_ref(), &text(item));
                self.problems
                    .push(Problem::expected(at(item.span()), &path, "a table", got));
                continue;
            };
            let mut checked = toml::Table::new();
            for (name, value) in table.iter() {
                let (name, origin) = (name.get_ref(), at(name.span()));
                let path = format!("{path}.{name}");
                let Some(key) = keys.iter().find(|key| key.name == name) else {
                    let known = quoted(&keys.iter().map(|key| key.name).collect::<Vec<_>>());
                    if !self.enough() {
                        let hint = nearest(name, keys.iter().map(|key| key.name));
                        let hint = hint.map(|name| format!("; did you mean {name}?")).unwrap_or_default();
                        let message = format!("unknown key; expected {known}{hint}");
                        self.problems.push(Problem::new(origin, &cut(&path, MAX_KEY), message));
                    }
                    continue;
                };
                match key.kind.check(value.get_ref()) {
                    Some(value) => {
                        checked.insert(name.to_string(), value.clone());
                        self.inner.insert(path, (value, origin));
                    }
                    None => {
                        let got = describe(value.get_ref(), &text(value));
                        let problem = Problem::expected(origin, &path, key.kind.expected(key.unit), got);
                        self.problems.push(problem);
                    }
                }
            }
            for key in keys.iter().filter(|key| !key.optional && !table.contains_key(key.name)) {
                let expected = format!("{} = {}", key.name, key.kind.expected(key.unit));
                self.problems
                    .push(Problem::expected(at(item.span()), &path, expected, "none"));
            }
            tables.push(Value::Table(checked));
        }
        (self.problems.len() == before).then_some(Value::Array(tables))
    }
}

/// A list whose bare words are put in quotes, because a shell has removed those; the brackets of a
/// list may be left out. `None` if there is nothing to quote.
fn quoted_items(text: &str) -> Option<String> {
    let in_brackets = text.strip_prefix('[').and_then(|text| text.strip_suffix(']'));
    let inside = in_brackets.unwrap_or(text);
    if inside.starts_with(['[', '{']) || in_brackets.is_none() && inside.is_empty() {
        return None;
    }
    let is_bare = |item: &str| !item.is_empty() && !item.contains(['"', '\'', '[', ']', '\\']);
    let quote = |item: &str| match is_bare(item.trim()) {
        true => format!("\"{}\"", item.trim()),
        false => item.to_owned(),
    };
    Some(format!(
        "[{}]",
        inside.split(',').map(quote).collect::<Vec<_>>().join(",")
    ))
}

/// The word of a choice that was probably meant.
fn meant(kind: Kind, value: &DeValue<'_>) -> Option<&'static str> {
    let (Kind::Choice(words) | Kind::Choices(words)) = kind else {
        return None;
    };
    let wrong = match value.as_array() {
        Some(items) => {
            let mut given = items.iter().filter_map(|item| item.get_ref().as_str());
            given.find(|word| !words.contains(word))
        }
        None => value.as_str(),
    };
    // The right word in another form than a list.
    let wrong = wrong.filter(|wrong| !words.contains(wrong));
    nearest(wrong?, words.iter().copied())
}

/// A number as it was written.
fn plain(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Integer(n) => n.as_str().to_owned(),
        DeValue::Float(x) => x.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        _ => String::new(),
    }
}

struct File<'a> {
    name: &'a str,
    text: &'a str,
    base: Option<&'a Path>,
    /// Where its lines end; `None` if they say nothing.
    line_ends: Option<Vec<usize>>,
}

impl File<'_> {
    fn origin(&self, offset: usize) -> Origin {
        let line = |ends: &Vec<usize>| 1 + ends.partition_point(|end| *end < offset);
        Origin::File {
            name: self.name.to_owned(),
            line: self.line_ends.as_ref().map_or(0, line),
        }
    }

    fn whole(&self) -> Origin {
        Origin::File {
            name: self.name.to_owned(),
            line: 0,
        }
    }

    fn slice(&self, span: &std::ops::Range<usize>) -> &str {
        self.text.get(span.clone()).unwrap_or("")
    }
}

fn too_large() -> String {
    format!("expected a configuration of at most {MAX_BYTES} bytes, got a larger one")
}
