//! Elements of a URDF with their place in the text, and typed reading of their attributes.

use super::error::{FILE, UrdfError};
use nalgebra::Vector3;
use roxmltree::{Document, Node, ParsingOptions};

/// Largest text to read: a description with its tags, without meshes.
pub(super) const MAX_BYTES: usize = 16 << 20;
/// Largest number of elements, without attributes; a large humanoid has about ten thousand.
const MAX_NODES: u32 = 1_000_000;
/// What to do with a file of macros.
pub(super) const EXPAND: &str = "expand macros with `xacro robot.urdf.xacro > robot.urdf`";

/// Parses a text.
///
/// # Errors
/// The text is too long, or not XML.
pub(super) fn parse(text: &str) -> Result<Document<'_>, UrdfError> {
    if text.len() > MAX_BYTES {
        return Err(UrdfError::new(
            None,
            FILE,
            format!("at most {MAX_BYTES} bytes"),
            format!("{} bytes", text.len()),
        ));
    }
    let options = ParsingOptions {
        nodes_limit: MAX_NODES,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options).map_err(|e| {
        let line = Some(e.pos().row as usize);
        UrdfError::new(line, FILE, "well-formed XML", format!("an error: {e}"))
    })
}

/// Line numbers of byte offsets.
#[derive(Debug)]
pub(super) struct Lines {
    starts: Vec<usize>,
}

impl Lines {
    pub fn new(text: &str) -> Self {
        let newlines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        Self {
            starts: std::iter::once(0).chain(newlines.map(|(i, _)| i + 1)).collect(),
        }
    }

    fn of(&self, offset: usize) -> usize {
        self.starts.partition_point(|start| *start <= offset)
    }
}

/// One element with its place.
#[derive(Clone, Copy)]
pub(super) struct Element<'a> {
    node: Node<'a, 'a>,
    lines: &'a Lines,
    /// The `<link>` or `<joint>` that the element is part of.
    owner: Option<Node<'a, 'a>>,
}

impl<'a> Element<'a> {
    pub fn root(document: &'a Document<'a>, lines: &'a Lines) -> Self {
        Self {
            node: document.root_element(),
            lines,
            owner: None,
        }
    }

    pub fn tag(&self) -> &'a str {
        self.node.tag_name().name()
    }

    pub fn has_namespace(&self) -> bool {
        self.node.tag_name().namespace().is_some()
    }

    pub fn line(&self) -> usize {
        self.lines.of(self.node.range().start)
    }

    /// `<joint name="elbow">`, or `<axis> of <joint name="elbow">`.
    pub fn label(&self) -> String {
        let own = named(self.node);
        match self.owner {
            Some(owner) => format!("{own} of {}", named(owner)),
            None => own,
        }
    }

    pub fn error(&self, expected: impl Into<String>, got: impl Into<String>) -> UrdfError {
        UrdfError::new(self.line(), self.label(), expected, got)
    }

    /// Child elements, in the order of the file.
    pub fn children(&self) -> impl Iterator<Item = Element<'a>> + use<'a> {
        let (lines, owner) = (self.lines, self.owner);
        // Below the root, an element belongs to the link or joint that contains it.
        let below = (self.node.parent_element().is_some()).then_some(owner.unwrap_or(self.node));
        let elements = self.node.children().filter(Node::is_element);
        elements.map(move |node| Element {
            node,
            lines,
            owner: below,
        })
    }

    /// The only child element of this tag, or `None`.
    ///
    /// # Errors
    /// If there are several.
    pub fn child(&self, tag: &str) -> Result<Option<Element<'a>>, UrdfError> {
        let mut found = self.children().filter(|child| child.tag() == tag);
        let first = found.next();
        match found.next() {
            Some(second) => Err(second.error(format!("one <{tag}>"), "a second one")),
            None => Ok(first),
        }
    }

    /// The child element of this tag, which is required.
    pub fn required_child(&self, tag: &str) -> Result<Element<'a>, UrdfError> {
        self.child(tag)?
            .ok_or_else(|| self.error(format!("a <{tag}> element"), "none"))
    }

    /// An attribute's text.
    pub fn text(&self, name: &str) -> Option<&'a str> {
        self.node.attribute(name).map(str::trim)
    }

    /// A required attribute, which must not be empty.
    pub fn required_text(&self, name: &str) -> Result<&'a str, UrdfError> {
        match self.text(name) {
            Some(text) if !text.is_empty() => Ok(text),
            Some(_) => Err(self.error(format!("{name}=\"…\" with a value"), "an empty one")),
            None => Err(self.error(format!("the attribute {name}"), "none")),
        }
    }

    /// A finite number, or `None` without the attribute.
    pub fn number(&self, name: &str) -> Result<Option<f64>, UrdfError> {
        self.text(name).map(|text| self.parse(name, text)).transpose()
    }

    /// A required finite number.
    pub fn required_number(&self, name: &str) -> Result<f64, UrdfError> {
        self.parse(name, self.required_text(name)?)
    }

    /// Three finite numbers separated by white space, or `None` without the attribute.
    pub fn vector(&self, name: &str) -> Result<Option<Vector3<f64>>, UrdfError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        let values: Vec<f64> = text
            .split_whitespace()
            .map(|word| self.parse(name, word))
            .collect::<Result<_, _>>()?;
        match values[..] {
            [x, y, z] => Ok(Some(Vector3::new(x, y, z))),
            _ => Err(self.error(
                format!("{name} with three numbers"),
                format!("{} in \"{}\"", values.len(), shortened(text)),
            )),
        }
    }

    fn parse(&self, name: &str, text: &str) -> Result<f64, UrdfError> {
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            // What a macro would have replaced.
            _ if text.contains("${") || text.contains("$(") => Err(self.error(
                format!("{name} with finite numbers; {EXPAND}"),
                format!("\"{}\"", shortened(text)),
            )),
            _ => Err(self.error(
                format!("{name} with finite numbers"),
                format!("\"{}\"", shortened(text)),
            )),
        }
    }
}

fn named(node: Node<'_, '_>) -> String {
    let tag = node.tag_name().name();
    match node.attribute("name") {
        Some(name) => format!("<{tag} name=\"{}\">", shortened(name)),
        None => format!("<{tag}>"),
    }
}

/// A text shortened for one line of an error message.
pub(super) fn shortened(text: &str) -> String {
    const MOST: usize = 60;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    crate::words::cut(&line, MOST)
}
