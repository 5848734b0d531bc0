//! Contents read from a URDF, and errors that name element and line.

use super::{SEVEN_AXIS, SIX_AXIS, robot};
use crate::support::TestRng;
use thetabus::robot::{Robot, Selection};

const BODY: &str =
    r#"<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>"#;

/// A chain of `a` to `e` that moves at j1 to j3; each line of the text is one element.
fn chain() -> String {
    format!(
        r#"<robot name="r">
<link name="a"/>
<link name="b">{BODY}</link>
<link name="c">{BODY}</link>
<link name="d">{BODY}</link>
<link name="e"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/></joint>
<joint name="j3" type="prismatic"><parent link="c"/><child link="d"/><axis xyz="1 0 0"/></joint>
<joint name="j4" type="fixed"><parent link="d"/><child link="e"/></joint>
</robot>"#
    )
}

fn error(text: &str, selection: &Selection) -> String {
    Robot::from_urdf(text, selection).unwrap_err().to_string()
}

#[test]
fn regress_a_wrong_urdf_is_refused_by_element_and_line() {
    assert_eq!(robot(&chain()).len(), 3);
    // Old text, new text, and the required words of the message.
    let cases = [
        (
            "type=\"continuous\"",
            "type=\"planar\"",
            "line 8: <joint name=\"j2\">: expected revolute",
        ),
        ("type=\"continuous\"", "type=\"floating\"", "a floating joint"),
        ("type=\"continuous\"", "type=\"spherical\"", "got \"spherical\""),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"0 1 1\"/>",
            "line 8: <axis> of <joint name=\"j2\">: expected a unit vector",
        ),
        ("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 0 0\"/>", "length 0"),
        ("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 1\"/>", "three numbers"),
        ("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 one 0\"/>", "got \"one\""),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"0 nan 0\"/>",
            "finite numbers, got \"nan\"",
        ),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"0 1 0\"/><mimic joint=\"j1\"/>",
            "<joint name=\"j2\">: expected a joint that moves by itself",
        ),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"0 1 0\"/><axis xyz=\"0 1 0\"/>",
            "a second one",
        ),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<limit lower=\"2\" upper=\"1\"/>",
            "expected lower ≤ upper",
        ),
        (
            "<parent link=\"b\"/>",
            "<parent link=\"x\"/>",
            "line 8: <parent> of <joint name=\"j2\">: expected the name of a link of this file, got \"x\"",
        ),
        ("<parent link=\"b\"/>", "", "expected a <parent> element, got none"),
        ("<parent link=\"b\"/>", "<parent link=\"c\"/>", "the same link for both"),
        ("<parent link=\"a\"/>", "<parent link=\"e\"/>", "a joint in a cycle"),
        (
            "<joint name=\"j4\" type=\"fixed\"><parent link=\"d\"/><child link=\"e\"/>",
            "<joint name=\"j4\" type=\"fixed\"><parent link=\"d\"/><child link=\"b\"/>",
            "a second joint to link \"b\", beside joint \"j1\"",
        ),
        ("<link name=\"c\">", "<link name=\"b\">", "a second link of this name"),
        ("<joint name=\"j2\"", "<joint name=\"j1\"", "the first is in line 7"),
        ("<joint name=\"j2\"", "<joint", "the attribute name"),
        ("<robot name=\"r\">", "<sdf name=\"r\">", "well-formed XML"),
        ("</robot>", "", "well-formed XML"),
        (
            "<link name=\"a\"/>",
            "<link xmlns=\"http://ros.org/wiki/xacro\" name=\"a\"/>",
            "xacro",
        ),
        (
            "<axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"${axis}\"/>",
            "expand macros with `xacro robot.urdf.xacro > robot.urdf`, got \"${axis}\"",
        ),
        (
            "<link name=\"a\"/>",
            "<link name=\"a\"/><link name=\"z\"/>",
            "links without a joint before them are a, z",
        ),
    ];
    for (from, to, message) in cases {
        let text = chain().replacen(from, to, 1);
        assert_ne!(text, chain(), "{from}");
        let found = error(&text, &Selection::default());
        assert!(found.contains(message), "{to}: {found}");
    }
}

#[test]
fn regress_a_body_without_sound_mass_is_refused_by_name() {
    for (from, to, message) in [
        (
            "<mass value=\"1\"/>",
            "",
            "<inertial> of <link name=\"c\">: expected a <mass> element",
        ),
        (
            "<mass value=\"1\"/>",
            "<mass value=\"0\"/>",
            "<mass> of <link name=\"c\">: expected a mass above 0 kg",
        ),
        ("<mass value=\"1\"/>", "<mass value=\"-1\"/>", "got -1"),
        ("<mass value=\"1\"/>", "<mass value=\"inf\"/>", "got \"inf\""),
        ("ixx=\"0.1\"", "ixx=\"0\"", "expected a positive definite inertia"),
        ("ixx=\"0.1\"", "ixx=\"-0.1\"", "expected a positive definite inertia"),
        ("ixy=\"0\"", "ixy=\"0.2\"", "expected a positive definite inertia"),
        (
            "ixx=\"0.1\"",
            "",
            "<inertia> of <link name=\"c\">: expected the attribute ixx",
        ),
        ("ixx=\"0.1\"", "ixx=\"NaN\"", "got \"NaN\""),
        (
            "<mass value=\"1\"/>",
            "<mass value=\"1\"/><origin xyz=\"1e200 0 0\"/>",
            "lengths up to",
        ),
        (
            BODY,
            "",
            "line 8: <joint name=\"j2\">: expected a body with mass behind each moving joint",
        ),
    ] {
        let whole = chain();
        let (before, after) = whole.split_at(whole.find("<link name=\"c\">").unwrap());
        let changed = after.replacen(from, to, 1);
        assert_ne!(changed, after, "{from}");
        let found = error(&format!("{before}{changed}"), &Selection::default());
        assert!(found.contains(message), "{to}: {found}");
    }
}

#[test]
fn regress_branches_need_a_choice() {
    let branch = format!(
        r#"<link name="f">{BODY}</link><joint name="k" type="revolute"><parent link="b"/><child link="f"/></joint></robot>"#
    );
    let text = chain().replace("</robot>", &branch);
    let found = error(&text, &Selection::default());
    assert!(found.contains("the last joints of its branches are k, j3"), "{found}");
    let tip = |name: &str| Selection {
        tip: Some(name.to_owned()),
        ..Selection::default()
    };
    let chosen = Robot::from_urdf(&text, &tip("e")).unwrap();
    assert_eq!((chosen.len(), chosen.held), (3, vec!["k".to_owned()]));
    // The branch that is held belongs to the body that carries it.
    assert_eq!(
        chosen.bodies.iter().map(|b| b.mass()).collect::<Vec<_>>(),
        [2.0, 1.0, 1.0]
    );
    assert!(error(&text, &tip("x")).contains("tip: expected the name of a link"));
    let joints = |names: &[&str]| Selection {
        joints: Some(names.iter().map(|name| (*name).to_owned()).collect()),
        ..Selection::default()
    };
    assert_eq!(
        Robot::from_urdf(&text, &joints(&["j1", "k", "j3"])).unwrap().held,
        ["j2"]
    );
    for (names, message) in [
        (&["j3", "j1"][..], "\"j3\" before \"j1\", which carries it"),
        (&["j1", "j1"], "\"j1\" twice"),
        (&["j4"], "\"j4\", which is fixed"),
        (&["nobody"], "got \"nobody\""),
        (&[], "expected 1 to 8 moving joints"),
    ] {
        let found = error(&text, &joints(names));
        assert!(found.contains(message), "{found}");
    }
    let both = Selection {
        tip: Some("e".to_owned()),
        ..joints(&["j1"])
    };
    assert!(error(&text, &both).contains("either a tip or a list of joints"));
    let above = Selection {
        base: Some("c".to_owned()),
        tip: Some("b".to_owned()),
        joints: None,
    };
    assert!(error(&text, &above).contains("a link that base \"c\" carries"));
}

/// A mimic joint that is held does no harm, unless the joint that it imitates moves.
#[test]
fn regress_a_mimic_joint_is_refused_where_it_would_move() {
    let finger = format!(
        r#"<link name="f">{BODY}</link><joint name="k" type="revolute"><parent link="d"/><child link="f"/><mimic joint="LEADER"/></joint></robot>"#
    );
    let tip = Selection {
        tip: Some("e".to_owned()),
        ..Selection::default()
    };
    let led_by = |leader: &str| chain().replace("</robot>", &finger.replace("LEADER", leader));
    assert!(Robot::from_urdf(&led_by("gripper"), &tip).is_ok());
    assert!(error(&led_by("j2"), &tip).contains("<joint name=\"k\">: expected a joint that moves by itself"));
}

#[test]
fn regress_long_and_deep_files_end_in_words() {
    let mut many = String::from("<robot name=\"r\"><link name=\"l0\"/>");
    for i in 1..=9 {
        many += &format!(
            "<link name=\"l{i}\">{BODY}</link><joint name=\"j{i}\" type=\"revolute\"><parent link=\"l{}\"/><child link=\"l{i}\"/></joint>",
            i - 1
        );
    }
    many += "</robot>";
    assert!(error(&many, &Selection::default()).contains("expected 1 to 8 moving joints"));
    let links: String = (0..5000).map(|i| format!("<link name=\"l{i}\"/>")).collect();
    assert!(error(&format!("<robot name=\"r\">{links}</robot>"), &Selection::default()).contains("at most 4096 links"));
    let deep = format!(
        "<robot name=\"r\">{}{}</robot>",
        "<x>".repeat(20_000),
        "</x>".repeat(20_000)
    );
    assert!(error(&deep, &Selection::default()).contains("expected"));
    assert!(error(&" ".repeat((16 << 20) + 1), &Selection::default()).contains("at most 16777216 bytes"));
    assert!(error("", &Selection::default()).contains("well-formed XML"));
    let missing = Robot::from_file(std::path::Path::new("no/such.urdf"), &Selection::default()).unwrap_err();
    assert!(
        missing
            .to_string()
            .starts_with("no/such.urdf: the file: expected a URDF"),
        "{missing}"
    );
}

/// Cut, swapped, repeated and overwritten pieces of a sound file: an error or a robot whose numbers
/// are finite.
#[test]
fn fault_mutated_files_give_an_error_or_a_sound_robot() {
    let mut rng = TestRng(20);
    let (mut refused, mut read) = (0, 0);
    let pieces = [
        "0",
        "-1",
        "nan",
        "1e308",
        "-1e308",
        "1e-308",
        "\"",
        "<",
        ">",
        "/>",
        "<joint>",
        "link_3",
        "joint_2",
        "fixed",
        "prismatic",
        "é",
        "mimic",
        "&amp;",
    ];
    for round in 0..1500 {
        let mut text: Vec<u8> = if round % 2 == 0 { SIX_AXIS } else { SEVEN_AXIS }.bytes().collect();
        for _ in 0..1 + rng.bits() % 3 {
            let at = |rng: &mut TestRng, len: usize| (rng.bits() % len.max(1) as u64) as usize;
            let (a, b) = (at(&mut rng, text.len()), at(&mut rng, 40));
            let end = (a + b).min(text.len());
            match rng.bits() % 6 {
                0 => drop(text.drain(a..end)),
                1 => {
                    let copy = text[a..end].to_vec();
                    let to = at(&mut rng, text.len());
                    text.splice(to..to, copy);
                }
                2 => text.truncate(a.max(1)),
                3 => {
                    // A number becomes another one.
                    let digits: Vec<usize> = (1..text.len())
                        .filter(|i| text[*i].is_ascii_digit() && text[i - 1] == b'"')
                        .collect();
                    if let Some(&i) = digits.get(at(&mut rng, digits.len())) {
                        let end = (i..text.len())
                            .find(|j| text[*j] == b'"' || text[*j] == b' ')
                            .unwrap_or(text.len());
                        text.splice(i..end, pieces[at(&mut rng, 6)].bytes());
                    }
                }
                _ => {
                    let piece = pieces[at(&mut rng, pieces.len())];
                    text.splice(a..end.min(a + piece.len()), piece.bytes());
                }
            }
        }
        match Robot::from_urdf(&String::from_utf8_lossy(&text), &Selection::default()) {
            Ok(robot) => {
                read += 1;
                assert!(
                    robot
                        .bodies
                        .iter()
                        .all(|body| body.mass() > 0.0 && body.0.iter().all(|x| x.is_finite()))
                );
                assert!(robot.joints.iter().all(|joint| (joint.axis.norm() - 1.0).abs() < 1e-12));
                thetabus::robot::BaseParameters::of(&robot, round % 3 == 0);
            }
            Err(error) => {
                refused += 1;
                let text = error.to_string();
                assert!(text.contains("expected") && text.len() < 1000, "{text}");
            }
        }
    }
    println!("{refused} refused, {read} read");
    assert!(refused > 500 && read > 50, "{refused} {read}");
}

/// Each principal inertia of a body is at most the sum of the two others: of a rod they are 0, J, J,
/// of a plate J, J, 2 J, and rounding of a file takes no link for another.
#[test]
fn fault_links_whose_inertia_no_body_has_are_named() {
    let named = |inertia: &str| -> Vec<String> {
        let urdf = format!(
            r#"<robot name="r"><link name="base"/><joint name="j" type="continuous"><parent link="base"/><child link="arm"/>
            <axis xyz="0 0 1"/></joint><link name="arm"><inertial><origin xyz="0.3 0.1 -0.2" rpy="0.3 0.2 0.1"/><mass value="2"/>
            <inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#
        );
        Robot::from_urdf(&urdf, &Selection::default())
            .unwrap()
            .impossible_links()
            .collect()
    };
    for sound in [
        r#"ixx="0.1" iyy="0.1" izz="0.2""#,
        r#"ixx="0.1" iyy="0.1" izz="0.201""#,
        r#"ixx="1e-6" iyy="0.1" izz="0.1""#,
    ] {
        assert_eq!(named(sound), [""; 0], "{sound}");
    }
    let said = named(r#"ixx="0.1" iyy="0.1" izz="0.25""#);
    assert!(
        said.len() == 1 && said[0].starts_with("link \"arm\": no body has its <inertia>"),
        "{said:?}"
    );
    for urdf in [SIX_AXIS, SEVEN_AXIS] {
        assert_eq!(robot(urdf).impossible_links().count(), 0);
    }
}

/// A file that was exported in millimetres is read, because nothing in it is impossible, but told.
#[test]
fn fault_a_file_in_millimetres_is_told_by_its_longest_distance() {
    let urdf = |joint_m: f64, center_m: f64| {
        format!(
            r#"<robot name="r"><link name="base"/><joint name="j" type="continuous"><parent link="base"/><child link="arm"/>
            <origin xyz="0 0 {joint_m}"/><axis xyz="0 0 1"/></joint><link name="arm"><inertial><origin xyz="{center_m} 0 0"/>
            <mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"#
        )
    };
    for (joint_m, center_m, said) in [
        (0.3, 0.2, None),
        (15.0, 5.0, None),
        (300.0, 200.0, Some("joint \"j\": its <origin> is 300.0 m")),
        (0.0, 200.0, Some("link \"arm\": the centre of its mass is 200.0 m")),
    ] {
        let found = robot(&urdf(joint_m, center_m)).suspicious_unit();
        match said {
            None => assert_eq!(found, None),
            Some(said) => {
                let found = found.unwrap();
                assert!(found.starts_with(said) && found.contains("millimetres"), "{found}");
            }
        }
    }
    for urdf in [SIX_AXIS, SEVEN_AXIS] {
        assert_eq!(robot(urdf).suspicious_unit(), None);
    }
}

/// The limits of a joint that turns are in radians; those that stand for none are larger.
#[test]
fn fault_limits_in_degrees_are_told() {
    for (limit, is_told) in [("2.9", false), ("170", true), ("-360", true), ("1e16", false)] {
        let text = SIX_AXIS.replace(
            "lower=\"-2.88\" upper=\"2.88\"",
            &match limit.strip_prefix('-') {
                Some(lower) => format!("lower=\"-{lower}\" upper=\"2.88\""),
                None => format!("lower=\"-2.88\" upper=\"{limit}\""),
            },
        );
        assert_ne!(text, SIX_AXIS);
        let found = robot(&text).suspicious_unit();
        assert_eq!(found.is_some(), is_told, "{limit}");
        assert!(
            found.is_none_or(
                |words| words.starts_with("joint \"joint_1\": its <limit> is ") && words.contains("degrees")
            )
        );
    }
}
