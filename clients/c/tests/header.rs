//! The generated files are those that are committed, and the header declares what the library
//! exports.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn place(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// `THETABUS_WRITE=1` writes the file anew.
fn compare(path: &str, expected: &str) {
    let path = place(path);
    if std::env::var_os("THETABUS_WRITE").is_some() {
        std::fs::write(&path, expected).expect("written");
    }
    let text = std::fs::read_to_string(&path).expect("the file");
    assert!(text == expected, "{} differs from the tables of fields", path.display());
}

#[test]
fn regress_the_header_is_the_one_that_the_tables_give() {
    compare("include/thetabus.h", &thetabus_c::header::header());
}

#[test]
fn regress_the_page_of_layouts_is_the_one_that_the_tables_give() {
    compare("../../docs/layout.md", &thetabus_c::header::page());
}

/// Names behind `before`, up to a parenthesis.
fn names(text: &str, before: &str) -> BTreeSet<String> {
    text.match_indices(before)
        .filter_map(|(at, _)| {
            let rest = &text[at + before.len()..];
            let name = &rest[..rest.find('(')?];
            let whole = name.starts_with("thetabus_") && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            whole.then(|| name.to_owned())
        })
        .collect()
}

#[test]
fn prop_the_header_declares_every_exported_function_and_no_other() {
    let mut exported = BTreeSet::new();
    for file in ["lib", "error", "reader", "machine", "control", "controller"] {
        let text = std::fs::read_to_string(place(&format!("src/{file}.rs"))).expect("a source");
        exported.extend(names(&text, "extern \"C\" fn "));
        // the readers' names are arguments of a macro
        exported.extend(text.lines().filter_map(|line| {
            let line = line.trim().trim_end_matches(',');
            let is_name = line.starts_with("thetabus_") && line.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            is_name.then(|| line.to_owned())
        }));
    }
    let header = thetabus_c::header::header();
    let declared: BTreeSet<String> = ["int32_t ", "uint32_t ", "uint64_t ", "void ", "char *"]
        .iter()
        .flat_map(|kind| names(&header, kind))
        .collect();
    assert_eq!(declared, exported);
}
