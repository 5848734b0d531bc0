//! Finds the joints of a robot in a URDF: from its base to its tip, or those that are named.

use super::error::UrdfError;
use super::urdf::{Joint, JointKind, Urdf};
use super::xml;
use crate::model::MAX_JOINTS;

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

/// The selected part, as indices in the URDF.
pub(super) struct Selected {
    /// The joints after the base, each after its parent joint.
    pub order: Vec<usize>,
    /// Those of them that move, proximal before distal.
    pub moving: Vec<usize>,
    /// The link at the end of the chain, if it was named.
    pub tip: Option<usize>,
}

impl Selection {
    /// The part of a URDF.
    pub(super) fn of(&self, urdf: &Urdf) -> Result<Selected, UrdfError> {
        let tree = Tree::new(urdf)?;
        let base = tree.base(self)?;
        let order = tree.below(base);
        let moving = tree.moving(&order, base, self)?;
        let tip = self.tip.as_ref().map(|name| tree.link("tip", name)).transpose()?;
        Ok(Selected { order, moving, tip })
    }
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
                return Err(joint.error(
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
            Some(joint) => Err(joint.error(
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
                return Err(joint.error(expected, format!("a {} joint", joint.kind.name())));
            }
            let Some(leader) = &joint.mimic else { continue };
            let leads = moving.iter().any(|other| joints[*other].name == *leader);
            if moving.contains(&index) || leads {
                return Err(joint.error(
                    "a joint that moves by itself; mimic joints are not supported, leave both out by `tip` or `joints`",
                    format!("<mimic joint=\"{}\">", xml::shortened(leader)),
                ));
            }
        }
        Ok(())
    }
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
