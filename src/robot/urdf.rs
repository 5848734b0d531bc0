//! A URDF as links and joints, each checked separately: names, numbers, axes, masses, inertias.
//!
//! Properties of the whole are checked in [`selection`](super::selection) (loops, tips) and
//! [`tree`](super::tree) (bodies without mass). Meshes, transmissions and simulator extensions are
//! irrelevant to rigid-body dynamics and are ignored. Format: the `urdf` package of ROS.

use super::error::UrdfError;
use super::spatial::{BodyParameters, Placement};
use super::xml::{self, EXPAND, Element, Lines};
use nalgebra::{Matrix3, Vector3};
use std::collections::HashMap;

/// Largest number of links in a file.
pub const MAX_LINKS: usize = 4096;
/// Largest difference of an axis from length 1 that counts as rounding.
const AXIS_TOLERANCE: f64 = 1e-3;

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// About its axis, within limits \[rad\].
    Revolute,
    /// About its axis, without limits \[rad\].
    Continuous,
    /// Along its axis \[m\].
    Prismatic,
    /// Fixed.
    Fixed,
    /// In a plane; not supported.
    Planar,
    /// Freely; not supported.
    Floating,
}

impl JointKind {
    const NAMES: [(&'static str, Self); 6] = [
        ("revolute", Self::Revolute),
        ("continuous", Self::Continuous),
        ("prismatic", Self::Prismatic),
        ("fixed", Self::Fixed),
        ("planar", Self::Planar),
        ("floating", Self::Floating),
    ];

    /// The URDF's word for it.
    pub fn name(self) -> &'static str {
        let (name, _) = Self::NAMES
            .iter()
            .find(|(_, kind)| *kind == self)
            .unwrap_or(&Self::NAMES[0]);
        name
    }

    /// True for a revolute or continuous joint.
    pub fn turns(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous)
    }
}

/// Limits of a joint; `None` for what the URDF does not state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// Lowest position \[rad or m\].
    pub lower: Option<f64>,
    /// Highest position \[rad or m\].
    pub upper: Option<f64>,
    /// Largest speed \[rad/s or m/s\].
    pub velocity: Option<f64>,
    /// Largest torque or force \[N m or N\].
    pub effort: Option<f64>,
}

/// A link: a rigid body, or a frame without mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Its name.
    pub name: String,
    /// Line of its element.
    pub line: usize,
    /// Its mass and inertia in its own frame; `None` for a frame without mass.
    pub body: Option<BodyParameters>,
}

/// A joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Line of its element.
    pub line: usize,
    /// How it moves.
    pub kind: JointKind,
    /// Index of the link before it.
    pub parent: usize,
    /// Index of the link after it.
    pub child: usize,
    /// Placement of the child link at position 0, in the parent link.
    pub origin: Placement,
    /// Unit axis in the child link.
    pub axis: Vector3<f64>,
    /// Limits.
    pub limits: Limits,
    /// Name of the joint that this one mimics.
    pub mimic: Option<String>,
}

impl Joint {
    /// An error about this joint.
    pub(super) fn error(&self, expected: &str, got: String) -> UrdfError {
        UrdfError::new(self.line, format!("<joint name=\"{}\">", self.name), expected, got)
    }
}

/// Links and joints of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Urdf {
    /// Name of the robot.
    pub name: String,
    /// Links in the order of the file.
    pub links: Vec<Link>,
    /// Joints in the order of the file.
    pub joints: Vec<Joint>,
}

impl Urdf {
    /// Reads a text.
    ///
    /// # Errors
    /// The first element that is wrong.
    pub fn parse(text: &str) -> Result<Self, UrdfError> {
        let document = xml::parse(text)?;
        let lines = Lines::new(text);
        let root = Element::root(&document, &lines);
        if root.tag() != "robot" {
            return Err(root.error(
                "a URDF with the element <robot> at its top",
                format!("<{}>", root.tag()),
            ));
        }
        let mut links: Vec<Link> = Vec::new();
        let mut index = HashMap::new();
        for element in root.children() {
            if element.has_namespace() {
                return Err(element.error(
                    format!("plain URDF; {EXPAND}"),
                    format!("an element with a namespace, {}", element.label()),
                ));
            }
            if element.tag() != "link" {
                continue;
            }
            let link = read_link(&element)?;
            if index.insert(link.name.clone(), links.len()).is_some() {
                return Err(element.error("each link's name once", "a second link of this name"));
            }
            if links.len() == MAX_LINKS {
                return Err(element.error(format!("at most {MAX_LINKS} links"), "more"));
            }
            links.push(link);
        }
        if links.is_empty() {
            return Err(root.error("at least one <link>", "none"));
        }
        let mut joints: Vec<Joint> = Vec::new();
        let mut names = HashMap::new();
        for element in root.children().filter(|element| element.tag() == "joint") {
            let joint = read_joint(&element, &index)?;
            if let Some(first) = names.insert(joint.name.clone(), joint.line) {
                return Err(element.error(
                    "each joint's name once",
                    format!("a second joint of this name, the first is in line {first}"),
                ));
            }
            joints.push(joint);
        }
        Ok(Self {
            name: root.text("name").unwrap_or_default().to_owned(),
            links,
            joints,
        })
    }
}

fn read_link(element: &Element<'_>) -> Result<Link, UrdfError> {
    Ok(Link {
        name: element.required_text("name")?.to_owned(),
        line: element.line(),
        body: element.child("inertial")?.map(|e| read_inertial(&e)).transpose()?,
    })
}

/// Mass, centre and inertia: all of them finite, mass and inertia positive.
fn read_inertial(element: &Element<'_>) -> Result<BodyParameters, UrdfError> {
    let advice = "; remove the <inertial> if this link is only a frame";
    let mass_element = element.required_child("mass")?;
    let mass = mass_element.required_number("value")?;
    if !(mass > 0.0) {
        return Err(mass_element.error(format!("a mass above 0 kg{advice}"), format!("{mass}")));
    }
    let origin = read_origin(element)?;
    let inertia = element.required_child("inertia")?;
    let mut j = Matrix3::zeros();
    for (name, row, column) in [
        ("ixx", 0, 0),
        ("ixy", 0, 1),
        ("ixz", 0, 2),
        ("iyy", 1, 1),
        ("iyz", 1, 2),
        ("izz", 2, 2),
    ] {
        let value = inertia.required_number(name)?;
        j[(row, column)] = value;
        j[(column, row)] = value;
    }
    if !is_positive_definite(&j) {
        return Err(inertia.error(
            format!("a positive definite inertia [kg m²]{advice}"),
            format!("one with a principal inertia of 0 or below, trace {:.3e}", j.trace()),
        ));
    }
    // The rotation of an inertial origin also applies to the axes of the inertia.
    let at_center = BodyParameters::new(mass, Vector3::zeros(), j);
    let body = at_center.moved(&origin);
    if body.0.iter().all(|x| x.is_finite()) {
        Ok(body)
    } else {
        Err(element.error("numbers of a size that a machine has", "products that are not finite"))
    }
}

/// Uses leading minors, because an eigenvalue iteration may not end for numbers near the largest
/// double.
fn is_positive_definite(j: &Matrix3<f64>) -> bool {
    let scaled = j / j.amax();
    let minor2 = scaled[(0, 0)] * scaled[(1, 1)] - scaled[(0, 1)] * scaled[(1, 0)];
    scaled[(0, 0)] > 0.0 && minor2 > 0.0 && scaled.determinant() > 0.0
}

fn read_origin(element: &Element<'_>) -> Result<Placement, UrdfError> {
    let Some(origin) = element.child("origin")? else {
        return Ok(Placement::identity());
    };
    let xyz = origin.vector("xyz")?.unwrap_or_default();
    let rpy = origin.vector("rpy")?.unwrap_or_default();
    if xyz.amax() > MAX_LENGTH_M {
        return Err(origin.error(
            format!("lengths up to {MAX_LENGTH_M} m"),
            format!("{:.3e} m", xyz.amax()),
        ));
    }
    Ok(Placement::from_rpy(rpy, xyz))
}

/// Longest distance between two frames \[m\]: larger ones are millimetres instead of metres, or
/// noise.
const MAX_LENGTH_M: f64 = 1000.0;

fn read_joint(element: &Element<'_>, links: &HashMap<String, usize>) -> Result<Joint, UrdfError> {
    let name = element.required_text("name")?.to_owned();
    let word = element.required_text("type")?;
    let Some(&(_, kind)) = JointKind::NAMES.iter().find(|(name, _)| *name == word) else {
        let known: Vec<&str> = JointKind::NAMES.iter().map(|(name, _)| *name).collect();
        return Err(element.error(
            format!("a type among {}", known.join(", ")),
            format!("\"{}\"", xml::shortened(word)),
        ));
    };
    let link = |tag: &str| -> Result<usize, UrdfError> {
        let end = element.required_child(tag)?;
        let name = end.required_text("link")?;
        links.get(name).copied().ok_or_else(|| {
            end.error(
                "the name of a link of this file",
                format!("\"{}\"", xml::shortened(name)),
            )
        })
    };
    let (parent, child) = (link("parent")?, link("child")?);
    if parent == child {
        return Err(element.error("a parent link other than the child", "the same link for both"));
    }
    Ok(Joint {
        name,
        line: element.line(),
        kind,
        parent,
        child,
        origin: read_origin(element)?,
        axis: read_axis(element)?,
        limits: read_limits(element)?,
        mimic: match element.child("mimic")? {
            Some(mimic) => Some(mimic.required_text("joint")?.to_owned()),
            None => None,
        },
    })
}

/// The axis in the joint's frame, (1, 0, 0) if the file states none.
fn read_axis(element: &Element<'_>) -> Result<Vector3<f64>, UrdfError> {
    let Some(axis) = element.child("axis")? else {
        return Ok(Vector3::x());
    };
    let xyz = axis.vector("xyz")?.unwrap_or_else(Vector3::x);
    let length = xyz.norm();
    if !((length - 1.0).abs() <= AXIS_TOLERANCE) {
        return Err(axis.error("a unit vector in xyz", format!("a vector of length {length}")));
    }
    Ok(xyz / length)
}

fn read_limits(element: &Element<'_>) -> Result<Limits, UrdfError> {
    let Some(limit) = element.child("limit")? else {
        return Ok(Limits::default());
    };
    let limits = Limits {
        lower: limit.number("lower")?,
        upper: limit.number("upper")?,
        velocity: limit.number("velocity")?,
        effort: limit.number("effort")?,
    };
    if let (Some(lower), Some(upper)) = (limits.lower, limits.upper)
        && lower > upper
    {
        return Err(limit.error("lower ≤ upper", format!("lower = {lower}, upper = {upper}")));
    }
    Ok(limits)
}
