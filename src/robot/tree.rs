//! Converts links and joints to the tree of moving bodies: fixed links are merged into the body
//! that carries them. `selection.rs` finds the joints that move.

use super::error::{FILE, UrdfError};
use super::selection::{Selected, Selection};
use super::spatial::{BodyParameters, Placement};
use super::urdf::{Joint, JointKind, Limits, Urdf};
use super::xml;
use nalgebra::Vector3;
use std::path::Path;

/// Acceleration of gravity in the base's frame, unless specified otherwise \[m/s²\].
const STANDARD_GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// Relative excess of a principal inertia that may be rounding in the file.
const ROUNDED: f64 = 0.02;

/// Distance from a joint to the next, or to a centre of mass, beyond which the file is hardly in
/// metres \[m\].
const LONGEST_M: f64 = 20.0;

/// Limits of a turning joint that are hardly in radians \[rad\]; larger ones stand for none.
const DEGREES: std::ops::Range<f64> = 30.0..800.0;

/// A moving joint, with the body after it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotJoint {
    /// Name in the URDF.
    pub name: String,
    /// True if it is revolute \[rad\], false if it is prismatic \[m\].
    pub turns: bool,
    /// Index of its parent joint; `None` at the base. Always below the joint's own index.
    pub parent: Option<usize>,
    /// Placement of the joint's frame at position 0, in the frame of its parent joint.
    pub placement: Placement,
    /// Unit axis in the joint's own frame.
    pub axis: Vector3<f64>,
    /// Limits of the URDF.
    pub limits: Limits,
}

/// A link of the URDF as part of a moving body.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotLink {
    /// Name in the URDF.
    pub name: String,
    /// Index of the joint whose body it is part of.
    pub joint: usize,
    /// Its frame in that of the body.
    pub placement: Placement,
    /// Its own parameters in the body's frame; `None` for a frame without mass.
    pub body: Option<BodyParameters>,
    /// True if there is a joint held at 0 between it and the moving joint.
    pub is_held: bool,
}

/// A robot of 1 to [`MAX_JOINTS`](crate::model::MAX_JOINTS) moving joints, with the body after
/// each.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name in the URDF.
    pub name: String,
    /// The joints, proximal before distal.
    pub joints: Vec<RobotJoint>,
    /// The body after each joint by the URDF, in the joint's frame.
    pub bodies: Vec<BodyParameters>,
    /// Acceleration of gravity in the base's frame \[m/s²\].
    pub gravity: Vector3<f64>,
    /// Placement of the flange in the frame of the last joint's body: the tip, or the last link
    /// fixed to it.
    pub flange: Placement,
    /// Movable joints that are held at 0 because they are outside the selection.
    pub held: Vec<String>,
    /// The links of the bodies, in the order of the tree.
    pub links: Vec<RobotLink>,
}

impl Robot {
    /// Reads a robot from a file.
    ///
    /// # Errors
    /// If the file cannot be read; otherwise see [`from_urdf`](Self::from_urdf).
    pub fn from_file(path: &Path, selection: &Selection) -> Result<Self, UrdfError> {
        let unreadable = |got: String| UrdfError::new(None, FILE, "a URDF that can be read", got).in_file(path);
        let found = std::fs::metadata(path).map_err(|e| unreadable(e.to_string()))?;
        // Opening a named pipe would wait for a writer, and a device may never end.
        if !found.is_file() {
            return Err(unreadable("something that is no regular file".to_owned()));
        }
        let size = found.len();
        if size > xml::MAX_BYTES as u64 {
            return Err(unreadable(format!("{size} bytes, more than {}", xml::MAX_BYTES)));
        }
        let text = std::fs::read_to_string(path).map_err(|e| unreadable(e.to_string()))?;
        Self::from_urdf(&text, selection).map_err(|e| e.in_file(path))
    }

    /// Reads a robot from the text of a URDF.
    ///
    /// # Errors
    /// The first error, with its element and line: see [`Urdf::parse`]; a mimic, planar or floating
    /// joint; a closed loop; several tips without a selection; no moving joint or more than
    /// [`MAX_JOINTS`](crate::model::MAX_JOINTS); a moving body without mass; a name that the file
    /// does not contain.
    pub fn from_urdf(text: &str, selection: &Selection) -> Result<Self, UrdfError> {
        let urdf = Urdf::parse(text)?;
        Self::assemble(&urdf, &selection.of(&urdf)?)
    }

    /// Puts the bodies behind the moving joints together.
    fn assemble(urdf: &Urdf, selected: &Selected) -> Result<Self, UrdfError> {
        let Urdf { name, links, joints } = urdf;
        let Selected { order, moving, tip } = selected;
        // For each link, the moving joint before it and its placement in that joint's frame. The
        // base's body does not move.
        let mut place: Vec<(Option<usize>, Placement)> = vec![(None, Placement::identity()); links.len()];
        let mut found: Vec<Option<RobotJoint>> = vec![None; moving.len()];
        let mut bodies = vec![BodyParameters::default(); moving.len()];
        let (mut held, mut parts) = (Vec::new(), Vec::new());
        let mut behind_held = vec![false; links.len()];
        for &index in order {
            let joint = &joints[index];
            let (body, parent) = place[joint.parent];
            let placement = parent.then(&joint.origin);
            let own = moving.iter().position(|other| *other == index);
            let is_held = joint.kind != JointKind::Fixed || behind_held[joint.parent];
            behind_held[joint.child] = own.is_none() && is_held;
            place[joint.child] = match own {
                Some(own) => {
                    found[own] = Some(RobotJoint {
                        name: joint.name.clone(),
                        turns: joint.kind.turns(),
                        parent: body,
                        placement,
                        axis: joint.axis,
                        limits: joint.limits,
                    });
                    (Some(own), Placement::identity())
                }
                None => {
                    if joint.kind != JointKind::Fixed {
                        held.push(joint.name.clone());
                    }
                    (body, placement)
                }
            };
            let (body, placement) = place[joint.child];
            if let (Some(body), Some(parameters)) = (body, &links[joint.child].body) {
                bodies[body] = bodies[body].plus(&parameters.moved(&placement));
            }
            if let Some(joint_index) = body {
                parts.push(RobotLink {
                    name: links[joint.child].name.clone(),
                    joint: joint_index,
                    placement,
                    body: links[joint.child].body.as_ref().map(|own| own.moved(&placement)),
                    is_held: behind_held[joint.child],
                });
            }
        }
        for (own, body) in bodies.iter().enumerate() {
            let joint = &joints[moving[own]];
            check_body(joint, &links[joint.child].name, body)?;
        }
        let last = Some(moving.len() - 1);
        let behind = order.iter().rev().map(|joint| joints[*joint].child);
        let flange = tip.or_else(|| behind.into_iter().find(|link| place[*link].0 == last));
        Ok(Self {
            flange: flange.map_or_else(Placement::identity, |link| place[link].1),
            name: name.clone(),
            joints: found.into_iter().flatten().collect(),
            bodies,
            gravity: Vector3::from(STANDARD_GRAVITY),
            held,
            links: parts,
        })
    }

    /// Warnings about links with an impossible inertia. They are accepted: many URDFs have some,
    /// and the inertias are only start values.
    pub fn impossible_links(&self) -> impl Iterator<Item = String> {
        let is_impossible = |link: &&RobotLink| link.body.is_some_and(|body| body.excess() > ROUNDED);
        self.links.iter().filter(is_impossible).map(|link| {
            format!(
                "link \"{}\": no body has its <inertia>: expected each principal inertia to be at most the sum of the two others, \
                 got one that is larger; look at ixx, iyy and izz, and at their unit",
                link.name
            )
        })
    }

    /// A warning about lengths or limits that no arm has: a joint or a centre of mass too far from
    /// the joint before it, or a joint that turns too far.
    pub fn suspicious_unit(&self) -> Option<String> {
        self.suspicious_length().or_else(|| self.suspicious_limit())
    }

    fn suspicious_limit(&self) -> Option<String> {
        let limits = self.joints.iter().filter(|joint| joint.turns).flat_map(|joint| {
            let [lower, upper] = [joint.limits.lower, joint.limits.upper];
            [lower, upper].into_iter().flatten().map(|limit| (limit, &joint.name))
        });
        let (limit, name) = limits
            .filter(|(limit, _)| DEGREES.contains(&limit.abs()))
            .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
        Some(format!(
            "joint \"{name}\": its <limit> is {limit:.1} rad; a URDF is in radians: if this one is in degrees, divide lower, upper \
             and velocity by 57.2958"
        ))
    }

    fn suspicious_length(&self) -> Option<String> {
        let joints = self.joints.iter().map(|joint| {
            let length_m = joint.placement.translation.norm();
            (length_m, format!("joint \"{}\": its <origin>", joint.name))
        });
        let centers = self.links.iter().filter_map(|link| {
            let body = link.body.filter(|body| body.mass() > 0.0)?;
            let center = body.first_moment() / body.mass();
            let what = format!("link \"{}\": the centre of its mass", link.name);
            Some((center.norm(), what))
        });
        let (length_m, what) = joints.chain(centers).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (length_m > LONGEST_M).then(|| {
            format!(
                "{what} is {length_m:.1} m from the joint before; a URDF is in metres and kg m²: if this one is in millimetres, \
                 divide its lengths by 1000 and its inertias by 1 000 000"
            )
        })
    }

    /// Number of moving joints.
    pub fn len(&self) -> usize {
        self.joints.len()
    }

    /// Always false: a robot has at least one moving joint.
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Placement of a joint's frame at position `q` \[rad or m\], in the frame of its parent joint.
    pub fn placement(&self, joint: usize, q: f64) -> Placement {
        let RobotJoint {
            turns, placement, axis, ..
        } = &self.joints[joint];
        let moved = if *turns {
            Placement {
                rotation: rotation(axis, q),
                translation: Vector3::zeros(),
            }
        } else {
            Placement {
                translation: axis * q,
                ..Placement::identity()
            }
        };
        placement.then(&moved)
    }
}

/// Rodrigues' formula: 1 + sin q [a]× + (1 − cos q) [a]×².
fn rotation(axis: &Vector3<f64>, q: f64) -> nalgebra::Matrix3<f64> {
    let cross = axis.cross_matrix();
    let (sin, cos) = q.sin_cos();
    nalgebra::Matrix3::identity() + cross * sin + cross * cross * (1.0 - cos)
}

/// Refuses a body without mass behind a moving joint, or one that is not finite.
fn check_body(joint: &Joint, link: &str, body: &BodyParameters) -> Result<(), UrdfError> {
    if !(body.mass() > 0.0) {
        return Err(joint.error(
            "a body with mass behind each moving joint; add an <inertial> to its child link",
            format!("link \"{link}\" without <inertial>"),
        ));
    }
    if !body.0.iter().all(|x| x.is_finite()) {
        return Err(joint.error(
            "a body of a size that a machine has",
            "an inertia that is not finite".to_owned(),
        ));
    }
    Ok(())
}
