//! A file for many robots: its entries are read like any other part of a configuration.

use crate::support::{edited, edits};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use thetabus::config::CellRobot;

fn read(text: &str) -> Result<Option<Vec<CellRobot>>, String> {
    CellRobot::parse(text, Path::new("dir/cell.toml")).map_err(|e| e.to_string())
}

#[test]
fn regress_entries_are_robots_in_their_order_with_paths_from_the_files_directory() {
    let text = "[bus]\ndomain = \"cell\"\n[[robot]]\nname = \"b\"\ncount = 10\nconfig = \"../b.toml\"\n\
                [[robot]]\nname = \"a\"\n[[robot]]\nname = \"c\"\nconfig = \"/c.toml\"\n";
    let robots = read(text).unwrap().unwrap();
    let names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).collect();
    let expected: Vec<String> = (1..=10).map(|i| format!("b-{i}")).collect();
    assert_eq!(names[..10], expected);
    assert_eq!(names[10..], ["a", "c"]);
    let config = |i: usize| robots[i].config.clone();
    assert_eq!(config(9), Some(PathBuf::from("dir/../b.toml")));
    assert_eq!((config(10), config(11)), (None, Some(PathBuf::from("/c.toml"))));
    // Others are for the ordinary loader.
    for text in [
        "",
        "[bus]\nrobot = \"a\"\n",
        "robot = 5\n",
        "[robot]\nname = \"a\"\n",
        "[[robot]\n",
    ] {
        assert_eq!(read(text), Ok(None), "{text}");
    }
}

#[test]
fn fault_all_errors_of_a_cells_file_are_told_at_once() {
    let text = r#"[bus]
robt = 1
[estimator]
block_len = "long"
[[robot]]
name = "Arm 1"
[[robot]]
nmae = "arm"
[[robot]]
name = "arm"
count = 0
[[robot]]
name = "axis"
config = 5
count = 3
[[robot]]
name = "axis-2"
[[robot]]
name = "a-name-of-thirty-characters-aa"
count = 10
[[robots]]
name = "a"
"#;
    let error = read(text).unwrap_err();
    for said in [
        "dir/cell.toml:2: bus.robt: unknown key; did you mean bus.robot?",
        "dir/cell.toml:4: estimator.block_len: expected a whole number from 1 to",
        "dir/cell.toml:6: robot[1].name: expected a name of 1 to 32 characters a-z 0-9 _ -, got \"Arm 1\" (a string)",
        "dir/cell.toml:8: robot[2].nmae: unknown key; expected \"name\", \"config\" or \"count\"; did you mean name?",
        "dir/cell.toml:7: robot[2]: expected name = a name of 1 to 32 characters a-z 0-9 _ -, got none",
        "dir/cell.toml:11: robot[3].count: expected a whole number from 1 to 4096, got 0 (a whole number)",
        "dir/cell.toml:14: robot[4].config: expected a path as a string, got 5 (a whole number)",
        "dir/cell.toml:17: robot[5].name: expected another name than in robot[4], got \"axis-2\"",
        "dir/cell.toml:19: robot[6].name: expected a name of at most 32 characters with its number, got \"a-name-of-thirty-characters-aa-10\"",
        "dir/cell.toml:21: robots: unknown key; did you mean robot?",
    ] {
        assert!(error.contains(said), "{said}\n{error}");
    }
    assert_eq!(error.lines().count(), 10, "{error}");
    for (text, said) in [
        (
            "robot = []",
            "dir/cell.toml:1: robot: expected 1 to 4096 robots, got none",
        ),
        (
            "robot = [5]",
            "dir/cell.toml:1: robot[1]: expected a table, got 5 (a whole number)",
        ),
        (
            "[[robot]]\nname = \"a\"\ncount = 4096\n[[robot]]\nname = \"b\"\n",
            "dir/cell.toml:5: robot[2].name: expected 1 to 4096 robots in a file, got more",
        ),
    ] {
        assert_eq!(read(text).unwrap_err(), said);
    }
    let many = read(&"[[robot]]\nname = \"a\"\n".repeat(1000)).unwrap_err();
    assert!(many.ends_with("dir/cell.toml: and 899 more problems"), "{many}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000, failure_persistence: None, ..ProptestConfig::default() })]

    /// The shipped file with bytes changed: robots with names of their own, or errors with their
    /// place.
    #[test]
    fn fault_corrupt_files_of_cells_never_panic(edits in edits()) {
        let text = edited(include_str!("../../config/robots/cell.toml"), &edits);
        match read(&text) {
            Ok(robots) => {
                let names: Vec<String> = robots.into_iter().flatten().map(|robot| robot.name).collect();
                let different: std::collections::BTreeSet<&String> = names.iter().collect();
                prop_assert_eq!(different.len(), names.len());
            }
            Err(message) => {
                prop_assert!(message.lines().all(|line| line.starts_with("dir/cell.toml:")), "{}", message);
            }
        }
    }
}
