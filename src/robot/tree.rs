//! Converts links and joints to the tree of moving bodies: fixed links are merged into the body
//! that carries them.

use super::error::{FILE, UrdfError};
use super::spatial::{BodyParameters, Placement};
use super::urdf::{Joint, JointKind, Limits, Urdf};
use super::xml;
use crate::model::MAX_JOINTS;
use nalgebra::Vector3;
use std::path::Path;

/// Acceleration of gravity in the base's frame, unless specified otherwise \[m/s²\].
const STANDARD_GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// Relative excess of a principal inertia that may be rounding in the file.
const ROUNDED: f64 = 0.02;

/// Distance from a joint to the next, or to a centre of mass, beyond which the file is hardly in
/// metres \[m\].
const LONGEST_M: f64 = 20.0;

/// The part of a URDF that is the robot.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Selection {
    /// The stationary link; the URDF's root if `None`.
    pub base: Option<String>,
    /// Link at the end of the chain.
    pub tip: Option<String>,
    /// The moving joints, in the order of the signals, proximal before distal; an alternative to
    /// `tip`.
    pub joints: Option<Vec<String>>,
}

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

/// A robot of 1 to [`MAX_JOINTS`] moving joints, with the body after each.
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
    /// [`MAX_JOINTS`]; a moving body without mass; a name that the file does not contain.
    pub fn from_urdf(text: &str, selection: &Selection) -> Result<Self, UrdfError> {
        let urdf = Urdf::parse(text)?;
        let tree = Tree::new(&urdf)?;
        let base = tree.base(selection)?;
        let order = tree.below(base);
        let moving = tree.moving(&order, base, selection)?;
        let tip = selection.tip.as_ref().map(|name| tree.link("tip", name)).transpose()?;
        tree.robot(&order, &moving, tip)
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

    /// A warning about lengths that no arm has: a joint or a centre of mass too far from the joint
    /// before it.
    pub fn suspicious_length(&self) -> Option<String> {
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

/// The joints before and after each link.
struct Tree<'a> {
    urdf: &'a Urdf,
    parent: Vec<Option<usize>>,
    children: Vec<Vec<usize>>,
}

impl<'a> Tree<'a> {
    fn new(urdf: &'a Urdf) -> Result<Self, UrdfError> {
        let mut parent = vec![None; urdf.links.len()];
        let mut children = vec![Vec::new(); urdf.links.len()];
        for (i, joint) in urdf.joints.iter().enumerate() {
            if let Some(first) = parent[joint.child].replace(i) {
                let first: &Joint = &urdf.joints[first];
                let link = &urdf.links[joint.child].name;
                return Err(refused(
                    joint,
                    "a tree; closed loops are not supported",
                    format!("a second joint to link \"{link}\", beside joint \"{}\"", first.name),
                ));
            }
            children[joint.parent].push(i);
        }
        let tree = Self { urdf, parent, children };
        // From a link in a cycle, the walk towards the base never ends.
        let mut reached = vec![false; urdf.links.len()];
        for root in tree.roots() {
            reached[root] = true;
            for joint in tree.below(root) {
                reached[urdf.joints[joint].child] = true;
            }
        }
        match urdf.joints.iter().find(|joint| !reached[joint.child]) {
            Some(joint) => Err(refused(
                joint,
                "a tree that begins at one base link",
                "a joint in a cycle: its child link carries its own parent link".to_owned(),
            )),
            None => Ok(tree),
        }
    }

    fn roots(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.parent.len()).filter(|link| self.parent[*link].is_none())
    }

    /// The joints after a link, each after its parent joint.
    fn below(&self, link: usize) -> Vec<usize> {
        let mut order: Vec<usize> = self.children[link].clone();
        let mut next = 0;
        while next < order.len() {
            order.extend_from_slice(&self.children[self.urdf.joints[order[next]].child]);
            next += 1;
        }
        order
    }

    fn link(&self, role: &str, name: &str) -> Result<usize, UrdfError> {
        let found = self.urdf.links.iter().position(|link| link.name == name);
        found.ok_or_else(|| {
            let known = self.urdf.links.iter().map(|link| link.name.as_str());
            selection_error(
                role,
                format!("the name of a link: {}", name_list(known)),
                format!("\"{name}\""),
            )
        })
    }

    fn base(&self, selection: &Selection) -> Result<usize, UrdfError> {
        if let Some(name) = &selection.base {
            return self.link("base", name);
        }
        let mut roots = self.roots();
        let first = roots.next();
        match (first, roots.next()) {
            (Some(root), None) => Ok(root),
            _ => {
                let names = self.roots().map(|link| self.urdf.links[link].name.as_str());
                Err(selection_error(
                    "base",
                    "the name of the base link, because the file has several parts".to_owned(),
                    format!("none; links without a joint before them are {}", name_list(names)),
                ))
            }
        }
    }

    /// The joints on the path from the base to a link.
    fn path(&self, base: usize, tip: usize, name: &str) -> Result<Vec<usize>, UrdfError> {
        let mut path = Vec::new();
        let mut link = tip;
        while link != base {
            let Some(joint) = self.parent[link] else {
                let base = &self.urdf.links[base].name;
                return Err(selection_error(
                    "tip",
                    format!("a link that base \"{base}\" carries"),
                    format!("\"{name}\""),
                ));
            };
            path.push(joint);
            link = self.urdf.joints[joint].parent;
        }
        path.reverse();
        Ok(path)
    }

    /// The moving joints, proximal before distal.
    fn moving(&self, order: &[usize], base: usize, selection: &Selection) -> Result<Vec<usize>, UrdfError> {
        let joints = &self.urdf.joints;
        let can_move = |joint: &usize| joints[*joint].kind != JointKind::Fixed;
        let moving: Vec<usize> = match (&selection.joints, &selection.tip) {
            (Some(_), Some(_)) => {
                return Err(selection_error(
                    "joints",
                    "either a tip or a list of joints".to_owned(),
                    "both".to_owned(),
                ));
            }
            (Some(names), None) => self.joint_order(order, names)?,
            (None, Some(tip)) => {
                let path = self.path(base, self.link("tip", tip)?, tip)?;
                path.into_iter().filter(can_move).collect()
            }
            (None, None) => {
                let all: Vec<usize> = order.iter().copied().filter(can_move).collect();
                self.refuse_unsupported(&all, &all)?;
                self.one_tip(base, &all)?;
                all
            }
        };
        self.refuse_unsupported(order, &moving)?;
        let count = moving.len();
        if !(1..=MAX_JOINTS).contains(&count) {
            let names = moving.iter().map(|joint| joints[*joint].name.as_str());
            return Err(selection_error(
                "the robot",
                format!("1 to {MAX_JOINTS} moving joints; choose them by `tip` or `joints`"),
                format!("{count}: {}", name_list(names)),
            ));
        }
        Ok(moving)
    }

    fn joint_order(&self, order: &[usize], names: &[String]) -> Result<Vec<usize>, UrdfError> {
        let joints = &self.urdf.joints;
        let mut moving: Vec<usize> = Vec::new();
        for name in names {
            let found = order.iter().copied().find(|joint| joints[*joint].name == *name);
            let movable = order
                .iter()
                .filter(|joint| joints[**joint].kind != JointKind::Fixed)
                .map(|joint| joints[*joint].name.as_str());
            let expected = || format!("names of joints behind the base that move: {}", name_list(movable));
            let Some(joint) = found else {
                return Err(selection_error("joints", expected(), format!("\"{name}\"")));
            };
            if joints[joint].kind == JointKind::Fixed {
                return Err(selection_error(
                    "joints",
                    expected(),
                    format!("\"{name}\", which is fixed"),
                ));
            }
            if moving.contains(&joint) {
                return Err(selection_error(
                    "joints",
                    "each joint once".to_owned(),
                    format!("\"{name}\" twice"),
                ));
            }
            moving.push(joint);
        }
        for (i, &joint) in moving.iter().enumerate() {
            let ancestors = self.ancestors(joint);
            if let Some(late) = moving[i + 1..].iter().find(|later| ancestors.contains(later)) {
                return Err(selection_error(
                    "joints",
                    "proximal joints before distal ones".to_owned(),
                    format!(
                        "\"{}\" before \"{}\", which carries it",
                        joints[joint].name, joints[*late].name
                    ),
                ));
            }
        }
        Ok(moving)
    }

    fn ancestors(&self, joint: usize) -> Vec<usize> {
        let mut found = Vec::new();
        let mut link = self.urdf.joints[joint].parent;
        while let Some(before) = self.parent[link] {
            found.push(before);
            link = self.urdf.joints[before].parent;
        }
        found
    }

    /// Without a selection the moving joints must form one chain.
    fn one_tip(&self, base: usize, moving: &[usize]) -> Result<(), UrdfError> {
        let mut is_moving = vec![false; self.urdf.joints.len()];
        let mut carries = vec![false; self.urdf.joints.len()];
        for &joint in moving {
            is_moving[joint] = true;
        }
        for &joint in moving {
            // The nearest moving joint before it.
            let mut link = self.urdf.joints[joint].parent;
            while link != base
                && let Some(before) = self.parent[link]
            {
                if is_moving[before] {
                    carries[before] = true;
                    break;
                }
                link = self.urdf.joints[before].parent;
            }
        }
        let ends: Vec<usize> = moving.iter().copied().filter(|joint| !carries[*joint]).collect();
        if ends.len() <= 1 {
            return Ok(());
        }
        let names = ends.iter().map(|joint| self.urdf.joints[*joint].name.as_str());
        Err(selection_error(
            "tip",
            "a `tip` link or a list of `joints`, because the robot branches".to_owned(),
            format!("none; the last joints of its branches are {}", name_list(names)),
        ))
    }

    /// Refuses joints that cannot be modelled, whether they move or are held.
    fn refuse_unsupported(&self, order: &[usize], moving: &[usize]) -> Result<(), UrdfError> {
        let joints = &self.urdf.joints;
        for &index in order {
            let joint = &joints[index];
            if matches!(joint.kind, JointKind::Planar | JointKind::Floating) {
                let expected =
                    "revolute, continuous, prismatic or fixed; set `base` to a link behind it if it may be left out";
                return Err(refused(joint, expected, format!("a {} joint", joint.kind.name())));
            }
            let Some(leader) = &joint.mimic else { continue };
            let leads = moving.iter().any(|other| joints[*other].name == *leader);
            if moving.contains(&index) || leads {
                return Err(refused(
                    joint,
                    "a joint that moves by itself; mimic joints are not supported, leave both out by `tip` or `joints`",
                    format!("<mimic joint=\"{}\">", xml::shortened(leader)),
                ));
            }
        }
        Ok(())
    }

    fn robot(&self, order: &[usize], moving: &[usize], tip: Option<usize>) -> Result<Robot, UrdfError> {
        let Urdf { name, links, joints } = self.urdf;
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
            if !(body.mass() > 0.0) {
                return Err(refused(
                    joint,
                    "a body with mass behind each moving joint; add an <inertial> to its child link",
                    format!("link \"{}\" without <inertial>", links[joint.child].name),
                ));
            }
            if !body.0.iter().all(|x| x.is_finite()) {
                return Err(refused(
                    joint,
                    "a body of a size that a machine has",
                    "an inertia that is not finite".to_owned(),
                ));
            }
        }
        let last = Some(moving.len() - 1);
        let behind = order.iter().rev().map(|joint| joints[*joint].child);
        let flange = tip.or_else(|| behind.into_iter().find(|link| place[*link].0 == last));
        Ok(Robot {
            flange: flange.map_or_else(Placement::identity, |link| place[link].1),
            name: name.clone(),
            joints: found.into_iter().flatten().collect(),
            bodies,
            gravity: Vector3::from(STANDARD_GRAVITY),
            held,
            links: parts,
        })
    }
}

fn refused(joint: &Joint, expected: &str, got: String) -> UrdfError {
    UrdfError::new(joint.line, format!("<joint name=\"{}\">", joint.name), expected, got)
}

fn selection_error(element: &str, expected: String, got: String) -> UrdfError {
    UrdfError::new(None, element, expected, got)
}

/// Names for a message: the first ten of them.
fn name_list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 10;
    let names: Vec<&str> = names.collect();
    let shown = names[..names.len().min(MOST)].join(", ");
    match names.len() {
        0 => "none".to_owned(),
        n if n > MOST => format!("{shown} and {} more", n - MOST),
        _ => shown,
    }
}
