//! Writes identified values back into a URDF; the rest of the text stays unchanged, including
//! comments and meshes.

use super::error::UrdfError;
use super::spatial::BodyParameters;
use super::xml;
use nalgebra::Matrix3;
use roxmltree::Node;
use std::collections::HashMap;
use std::ops::Range;

/// Values to write for a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkValues {
    /// Name in the URDF.
    pub name: String,
    /// Ten parameters in the link's own frame, of a body with mass.
    pub body: BodyParameters,
    /// Their origin: lines of a comment.
    pub source: Vec<String>,
}

/// Values to write for a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointValues {
    /// Name in the URDF.
    pub name: String,
    /// Viscous friction \[N m s/rad or N s/m\]; `None` keeps the present value.
    pub damping: Option<f64>,
    /// Coulomb friction \[N m or N\]; `None` keeps the present value.
    pub friction: Option<f64>,
    /// Their origin, and values for which a URDF has no element: lines of a comment.
    pub source: Vec<String>,
}

/// Prefix of this writer's comments, by which it can remove them.
const MARK: &str = "thetabus:";

/// The text of a URDF with these values instead of its own; `header` is a comment at its top.
/// Comments of an earlier writing are replaced too.
///
/// # Errors
/// If the text is not XML, or a link or joint is missing, or a link has no `<inertial>`.
pub fn write_urdf(
    text: &str,
    header: &[String],
    links: &[LinkValues],
    joints: &[JointValues],
) -> Result<String, UrdfError> {
    let document = xml::parse(text)?;
    let robot = document.root_element();
    let named = |tag: &str| -> HashMap<&str, Node<'_, '_>> {
        let elements = robot.children().filter(|node| node.has_tag_name(tag));
        elements
            .filter_map(|node| Some((node.attribute("name")?.trim(), node)))
            .collect()
    };
    let missing = |tag: &str, name: &str, expected: &str| {
        UrdfError::new(None, format!("<{tag} name=\"{name}\">"), expected, "none")
    };
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    if let Some(first) = robot.first_child() {
        let at = first.range().start;
        edits.push((at..at, format!("\n{}", comment(header, "  ").trim_end())));
    }
    remove_own_comments(text, &robot, &mut edits);
    let (all_links, all_joints) = (named("link"), named("joint"));
    for link in links {
        let node = all_links
            .get(link.name.as_str())
            .ok_or_else(|| missing("link", &link.name, "a link of this file"))?;
        remove_own_comments(text, node, &mut edits);
        let old = child(node, "inertial")
            .ok_or_else(|| missing("inertial", &link.name, "an <inertial> in the link"))?
            .range();
        let indent = indent(text, old.start);
        edits.push((
            old,
            format!(
                "{}\n{indent}{}",
                comment(&link.source, &indent).trim(),
                inertial(&link.body, &indent)
            ),
        ));
    }
    for joint in joints {
        let node = all_joints
            .get(joint.name.as_str())
            .ok_or_else(|| missing("joint", &joint.name, "a joint of this file"))?;
        remove_own_comments(text, node, &mut edits);
        edits.extend(dynamics_edit(text, node, joint));
    }
    // from the end to the beginning; of two edits at one place the removal first
    edits.sort_by_key(|(range, _)| std::cmp::Reverse((range.start, range.end)));
    let mut out = text.to_owned();
    for (range, new) in edits {
        out.replace_range(range, &new);
    }
    Ok(out)
}

/// Writes the friction of a joint in place of its old element, or as a new one at its end.
fn dynamics_edit(text: &str, node: &Node<'_, '_>, joint: &JointValues) -> Option<(Range<usize>, String)> {
    let old = child(node, "dynamics");
    let kept = |name: &str| old.and_then(|node| node.attribute(name)).map(str::to_owned);
    let attribute = |name: &str, value: Option<f64>| -> Option<String> {
        // negative friction is written as 0; the comment has the estimate
        let text = value.map(|x| number(x.max(0.0))).or_else(|| kept(name))?;
        Some(format!(" {name}=\"{text}\""))
    };
    let attributes = [
        attribute("damping", joint.damping),
        attribute("friction", joint.friction),
    ];
    let attributes: String = attributes.into_iter().flatten().collect();
    let element = match attributes.is_empty() {
        true => String::new(),
        false => format!("<dynamics{attributes}/>"),
    };
    if let Some(old) = old {
        let indent = indent(text, old.range().start);
        let note = comment(&joint.source, &indent);
        return Some((old.range(), format!("{}\n{indent}{element}", note.trim())));
    }
    let range = node.range();
    let end = range.start + text[range.clone()].rfind("</")?;
    let indent = format!("{}  ", indent(text, range.start));
    let mut note = comment(&joint.source, &indent);
    if !element.is_empty() {
        note.push_str(&format!("{indent}{element}\n"));
    }
    // before the line of the end tag, or before the tag if there is other text on its line
    let line = text[..end].rfind('\n').map_or(0, |at| at + 1);
    Some(match text[line..end].trim().is_empty() {
        true => (line..line, note),
        false => (end..end, format!("\n{note}")),
    })
}

fn child<'a>(node: &Node<'a, 'a>, tag: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(tag))
}

/// Removes the comments of an earlier writing from an element, with lines that contain nothing
/// else.
fn remove_own_comments(text: &str, of: &Node<'_, '_>, edits: &mut Vec<(Range<usize>, String)>) {
    let is_ours = |node: &Node<'_, '_>| {
        node.is_comment() && node.text().is_some_and(|words| words.trim_start().starts_with(MARK))
    };
    for node in of.children().filter(is_ours) {
        let Range { mut start, mut end } = node.range();
        let line = text[..start].rfind('\n').map_or(0, |at| at + 1);
        let next = text[end..].find('\n').map_or(text.len(), |at| end + at + 1);
        if text[line..start].trim().is_empty() {
            match text[end..next].trim().is_empty() {
                true => (start, end) = (line, next),
                false => start = line.saturating_sub(1),
            }
        }
        edits.push((start..end, String::new()));
    }
}

/// White space before a place in its line.
fn indent(text: &str, at: usize) -> String {
    let line = text[..at].rfind('\n').map_or(0, |at| at + 1);
    text[line..at].chars().take_while(|c| *c == ' ' || *c == '\t').collect()
}

/// The text without two consecutive hyphens.
fn apart(line: &str) -> String {
    // twice, because the first pass leaves two of three hyphens
    line.replace("--", "- -").replace("--", "- -")
}

/// Lines as one XML comment, which must not contain two consecutive hyphens.
fn comment(lines: &[String], indent: &str) -> String {
    let mut lines: Vec<String> = lines.iter().map(|line| apart(line)).collect();
    if let Some(first) = lines.first_mut() {
        first.insert_str(0, &format!("{MARK} "));
    }
    match &lines[..] {
        [] => String::new(),
        [line] => format!("{indent}<!-- {line} -->\n"),
        lines => format!(
            "{indent}<!-- {}\n{indent}-->\n",
            lines.join(&format!("\n{indent}     "))
        ),
    }
}

/// About the centre of mass, in the axes of the link.
fn inertial(body: &BodyParameters, indent: &str) -> String {
    let mass = body.mass();
    let c = body.first_moment() / mass;
    let j = body.inertia() - mass * (Matrix3::identity() * c.norm_squared() - c * c.transpose());
    let [x, y, z] = [c.x, c.y, c.z].map(number);
    let [xx, xy, xz, yy, yz, zz] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| number(j[at]));
    format!(
        "<inertial>\n\
         {indent}  <origin xyz=\"{x} {y} {z}\" rpy=\"0 0 0\"/>\n\
         {indent}  <mass value=\"{}\"/>\n\
         {indent}  <inertia ixx=\"{xx}\" ixy=\"{xy}\" ixz=\"{xz}\" iyy=\"{yy}\" iyz=\"{yz}\" izz=\"{zz}\"/>\n\
         {indent}</inertial>",
        number(mass)
    )
}

/// Ten digits: the error is far below any standard deviation, and lines stay readable.
fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.9e}").parse().unwrap_or(x);
    format!("{rounded}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const TEXT: &str = "<?xml version=\"1.0\"?>\n<robot name=\"one\">\n  <!-- kept -->\n  <link name=\"base\"/>\n  \
        <joint name=\"turn\" type=\"revolute\">\n    <parent link=\"base\"/>\n    <child link=\"arm\"/>\n    \
        <limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"1\"/>\n  </joint>\n  <link name=\"arm\">\n    <inertial>\n      \
        <mass value=\"1\"/>\n      <inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/>\n    </inertial>\n    \
        <visual><geometry><mesh filename=\"arm.stl\"/></geometry></visual>\n  </link>\n</robot>\n";

    fn values() -> ([LinkValues; 1], [JointValues; 1]) {
        let body = BodyParameters::new(2.5, Vector3::new(0.1, 0.0, -0.2), Matrix3::identity() * 0.03);
        let link = LinkValues {
            name: "arm".to_owned(),
            body,
            source: vec!["from -- a test".to_owned()],
        };
        let joint = JointValues {
            name: "turn".to_owned(),
            damping: Some(0.4),
            friction: Some(-0.1),
            source: vec!["coulomb".to_owned(), "rotor".to_owned()],
        };
        ([link], [joint])
    }

    #[test]
    fn prop_what_is_written_is_read_and_the_rest_stays() {
        let (links, joints) = values();
        let text = write_urdf(TEXT, &["header".to_owned()], &links, &joints).unwrap();
        let robot = crate::robot::Robot::from_urdf(&text, &crate::robot::Selection::default()).unwrap();
        for (read, written) in robot.bodies[0].0.iter().zip(links[0].body.0) {
            // Ten digits of numbers up to 2.5.
            assert!((read - written).abs() < 1e-8, "{text}");
        }
        for kept in [
            "<!-- kept -->",
            "<mesh filename=\"arm.stl\"/>",
            "<!-- thetabus: header -->",
            "<!-- thetabus: from - - a test -->",
        ] {
            assert!(text.contains(kept), "{kept}: {text}");
        }
        assert!(
            text.contains("<dynamics damping=\"0.4\" friction=\"0\"/>\n  </joint>"),
            "{text}"
        );
        // Writing twice gives the same text.
        let again = write_urdf(&text, &["header".to_owned()], &links, &joints).unwrap();
        assert_eq!(again, text);
        let again = write_urdf(&text, &[], &links, &joints).unwrap();
        assert_eq!(again.matches("thetabus:").count(), 2);
        assert_eq!(again.matches("<dynamics").count(), 1);
        assert_eq!(again.matches("<inertial>").count(), 1);
    }

    #[test]
    fn fault_names_that_the_file_does_not_have_are_refused() {
        let (mut links, mut joints) = values();
        links[0].name = "base".to_owned();
        let error = write_urdf(TEXT, &[], &links, &[]).unwrap_err().to_string();
        assert!(error.contains("expected an <inertial> in the link"), "{error}");
        joints[0].name = "slide".to_owned();
        let error = write_urdf(TEXT, &[], &[], &joints).unwrap_err().to_string();
        assert!(
            error.contains("slide") && error.contains("a joint of this file"),
            "{error}"
        );
        assert!(write_urdf("<robot", &[], &[], &[]).is_err());
    }

    #[test]
    fn prop_writing_again_replaces_the_comments_also_on_one_line_and_with_many_hyphens() {
        let (links, joints) = values();
        let line = TEXT.replace("\n  <!-- kept -->\n  ", "").replace('\n', " ");
        let header = |text: &str| vec![text.to_owned()];
        let first = write_urdf(&line, &header("one --- two"), &links, &joints).unwrap();
        let second = write_urdf(&first, &header("three ---- four"), &links, &joints).unwrap();
        let third = write_urdf(&second, &header("one --- two"), &links, &joints).unwrap();
        assert!(
            second.contains("thetabus: three - - - - four -->") && !second.contains("one -"),
            "{second}"
        );
        assert_eq!(first.matches("<!--").count(), third.matches("<!--").count(), "{third}");
        assert!(third.contains("thetabus: one - - - two -->"), "{third}");
        roxmltree::Document::parse(&third).unwrap();
    }
}
