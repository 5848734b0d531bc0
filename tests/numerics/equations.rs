//! The reader's test: docs/equations.md names file and function of each equation of the paper, and
//! both are there.

use std::path::Path;

/// The bodies of all functions of this name.
fn bodies<'a>(source: &'a str, function: &str) -> Vec<&'a str> {
    let heads = [format!("fn {function}("), format!("fn {function}<")];
    let starts = heads.iter().flat_map(|head| source.match_indices(head.as_str()));
    starts
        .filter_map(|(start, _)| {
            let rest = &source[start..];
            let open = rest.find('{')?;
            // What a trait only declares ends with a semicolon; those of array types stand in
            // brackets.
            let outside = |at: usize| rest[..at].matches('[').count() == rest[..at].matches(']').count();
            if rest[..open].match_indices(';').any(|(at, _)| outside(at)) {
                return None;
            }
            let mut depth = 0;
            rest[open..].char_indices().find_map(|(at, letter)| {
                depth += i32::from(letter == '{') - i32::from(letter == '}');
                (depth == 0).then(|| &rest[open..open + at])
            })
        })
        .collect()
}

#[test]
fn regress_each_equation_stands_in_the_function_that_the_documents_name() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/equations.md")).unwrap();
    let mut named = Vec::new();
    for line in page.lines().filter(|line| line.starts_with("| (")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let number = cells[1];
        named.push(number.to_owned());
        for place in cells[3..].iter().filter(|cell| !cell.is_empty()) {
            let words: Vec<&str> = place.split('`').collect();
            let (file, function) = (words[1], words[3]);
            let source = std::fs::read_to_string(root.join(file)).unwrap_or_else(|e| panic!("{number}: {file}: {e}"));
            let bodies = bodies(&source, function);
            assert!(!bodies.is_empty(), "{number}: no function {function} in {file}");
            assert!(
                bodies.iter().any(|body| body.contains(number)),
                "{number} does not stand in {function} of {file}"
            );
        }
    }
    let expected: Vec<String> = (1..=27).map(|number| format!("({number})")).collect();
    assert_eq!(named, expected);
}
