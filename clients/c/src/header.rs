//! `include/thetabus.h` and `docs/layout.md`, from the tables of fields.

use std::fmt::Write as _;
use thetabus::messages::{Field, Kind, Layout, Per, SCHEMA_VERSION, layouts};

/// The whole header.
pub fn header() -> String {
    let mut text = String::from(
        "/* thetabus for C: read estimates, publish samples, send commands.\n *\n \
         * Generated from the tables of fields: THETABUS_WRITE=1 cargo test -p thetabus-c --test header\n \
         * Units are SI and radians; {position}, {input}, {parameter}, {derived} stand for what the description tells. */\n\
         #ifndef THETABUS_H\n#define THETABUS_H\n\n#include <stddef.h>\n#include <stdint.h>\n\n\
         #ifdef __cplusplus\n#define THETABUS_CHECK(condition, words) static_assert(condition, words)\nextern \"C\" {\n#else\n\
         #define THETABUS_CHECK(condition, words) _Static_assert(condition, words)\n#endif\n\n",
    );
    let _ = writeln!(text, "#define THETABUS_SCHEMA_VERSION {SCHEMA_VERSION}\n");
    text.push_str("/* ---- messages ---- */\n");
    for layout in all() {
        structure(&mut text, layout);
    }
    text.push('\n');
    text.push_str(include_str!("functions.h"));
    text.push_str("\n#ifdef __cplusplus\n}\n#endif\n#endif\n");
    text
}

/// The page of layouts.
pub fn page() -> String {
    let mut text = String::from(
        "# Layouts of the messages\n\nGenerated from the tables of fields in `src/messages`: `THETABUS_WRITE=1 cargo test -p thetabus-c --test header`.\n\n\
         All messages have the memory layout of C on a 64-bit machine: little-endian, IEEE 754, no implicit padding. Services are\n\
         `thetabus/ROBOT/TOPIC` of iceoryx2 0.10.0. Each section names the type on the bus. The messages of every topic have the user header\n\
         `Header`. Texts are UTF-8, padded with zeros. Units in braces are given by the description. A set of parameters has bit i mod 64\n\
         of word i div 64 for parameter i, from 0.\n",
    );
    for layout in all() {
        let _ = writeln!(
            text,
            "\n## {}\n\n`{}`, {} bytes\n\n| offset | field | type | unit | meaning |\n|---|---|---|---|---|",
            layout.name, layout.type_name, layout.size
        );
        for field in layout.fields {
            let array = match field.is_array {
                true => format!("[{}]", field.len),
                false => String::new(),
            };
            let kind = match field.kind {
                Kind::U8 if field.per == Per::Text => "text ".to_owned(),
                Kind::U8 => "u8".to_owned(),
                Kind::U32 => "u32".to_owned(),
                Kind::U64 => "u64".to_owned(),
                Kind::F64 => "f64".to_owned(),
                Kind::Struct(inner) => inner.name.to_owned(),
            };
            let Field {
                offset,
                name,
                unit,
                meaning,
                ..
            } = field;
            let _ = writeln!(text, "| {offset} | `{name}` | {kind}{array} | {unit} | {meaning} |");
        }
    }
    text
}

/// Every structure, inner ones before those that hold them, each once.
fn all() -> Vec<&'static Layout> {
    fn add(layout: &'static Layout, list: &mut Vec<&'static Layout>) {
        for field in layout.fields {
            if let Kind::Struct(inner) = field.kind {
                add(inner, list);
            }
        }
        if !list.iter().any(|known| known.name == layout.name) {
            list.push(layout);
        }
    }
    let mut list = Vec::new();
    layouts().into_iter().for_each(|layout| add(layout, &mut list));
    list
}

/// `LastError` is `thetabus_last_error_t`.
fn type_name(name: &str) -> String {
    let mut snake = String::from("thetabus");
    for c in name.chars() {
        if c.is_ascii_uppercase() {
            snake.push('_');
        }
        snake.push(c.to_ascii_lowercase());
    }
    snake + "_t"
}

fn c_type(field: &Field) -> String {
    match field.kind {
        Kind::U8 if field.per == Per::Text => "char".to_owned(),
        Kind::U8 => "uint8_t".to_owned(),
        Kind::U32 => "uint32_t".to_owned(),
        Kind::U64 => "uint64_t".to_owned(),
        Kind::F64 => "double".to_owned(),
        Kind::Struct(inner) => type_name(inner.name),
    }
}

fn structure(text: &mut String, layout: &Layout) {
    let name = type_name(layout.name);
    let _ = writeln!(text, "\ntypedef struct {} {{", name.trim_end_matches("_t"));
    for field in layout.fields {
        let array = match field.is_array {
            true => format!("[{}]", field.len),
            false => String::new(),
        };
        let unit = match field.unit {
            "" => String::new(),
            unit => format!(" [{unit}]"),
        };
        let _ = writeln!(
            text,
            "    {} {}{array}; /* {}{unit} */",
            c_type(field),
            field.name,
            field.meaning
        );
    }
    let _ = writeln!(text, "}} {name};");
    let _ = writeln!(
        text,
        "THETABUS_CHECK(sizeof({name}) == {}, \"{name} has another size\");",
        layout.size
    );
    for field in layout.fields {
        let _ = writeln!(
            text,
            "THETABUS_CHECK(offsetof({name}, {0}) == {1}, \"{name}.{0} has another place\");",
            field.name, field.offset
        );
    }
}
