//! The `[[robot]]` entries of a file for many robots.

use super::super::kind::{Key, Kind, Section};

/// The key of the entries, at the top of the file.
pub const ROBOTS: &str = "robot";

/// Largest number of robots in one file.
pub const MAX_ROBOTS: u64 = 4096;

/// What only such a file has.
pub(super) static OWN: &[Section] = &[Section {
    name: "",
    meaning: "The robots of a cell",
    keys: &[key("", ROBOTS, Kind::Tables(ENTRY), "Each of them")],
}];

/// The keys of an entry.
const ENTRY: &[Key] = &[
    Key {
        optional: false,
        ..key(ROBOTS, "name", Kind::Name, "Its name: its topics are thetabus/NAME/…")
    },
    key(ROBOTS, "config", Kind::Path, "Its configuration, from this directory"),
    key(ROBOTS, "count", Kind::Whole(1, MAX_ROBOTS), "NAME-1 to NAME-count"),
];

/// A key that may be left out.
const fn key(section: &'static str, name: &'static str, kind: Kind, meaning: &'static str) -> Key {
    Key {
        section,
        name,
        kind,
        unit: "",
        meaning,
        optional: true,
    }
}
