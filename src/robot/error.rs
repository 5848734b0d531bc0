//! Errors of a robot's description, with the element and its line.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a URDF does not describe a robot that can be identified.
///
/// It is displayed as `arm.urdf:12: <joint name="elbow">: expected …, got …`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UrdfError {
    /// The file, if the text is from one.
    pub file: Option<PathBuf>,
    /// Line of the element, counted from 1, if the error belongs to one.
    pub line: Option<usize>,
    /// The element, such as `<joint name="elbow">`.
    pub element: String,
    /// What was expected there.
    pub expected: String,
    /// What was found instead.
    pub got: String,
}

impl UrdfError {
    /// An error of one element.
    pub(super) fn new(
        line: impl Into<Option<usize>>,
        element: impl Into<String>,
        expected: impl Into<String>,
        got: impl Into<String>,
    ) -> Self {
        Self {
            file: None,
            line: line.into(),
            element: element.into(),
            expected: expected.into(),
            got: got.into(),
        }
    }

    /// The same with the file.
    pub(super) fn in_file(mut self, file: &Path) -> Self {
        self.file = Some(file.to_owned());
        self
    }
}

impl fmt::Display for UrdfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.file, self.line) {
            (Some(file), Some(line)) => write!(f, "{}:{line}: ", file.display())?,
            (Some(file), None) => write!(f, "{}: ", file.display())?,
            (None, Some(line)) => write!(f, "line {line}: ")?,
            (None, None) => {}
        }
        let Self {
            element, expected, got, ..
        } = self;
        write!(f, "{element}: expected {expected}, got {got}")
    }
}

impl std::error::Error for UrdfError {}
