//! Commands to an identifier as metadata of a recording: readable, and exact for a replay.

use crate::messages::{Command, DATA, Journal, Request};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// An entry as the name-value pairs of a metadata record.
pub(super) fn journal_to_map(entry: &Journal) -> BTreeMap<String, String> {
    let request = &entry.request;
    let command = Command::from_wire(request.command).map_or("unknown", Command::name);
    let mut pairs = vec![
        ("command", command.to_owned()),
        ("stream_id", entry.stream_id.to_string()),
        ("from_seq", request.from_seq.to_string()),
        ("block", entry.block.to_string()),
        ("name", request.name().to_owned()),
    ];
    if let Some(value) = request.value() {
        // the shortest text that reads back to the same number
        pairs.push(("value", format!("{value:?}")));
    }
    if request.stream > 0 {
        pairs.push(("stream", request.stream.to_string()));
    }
    if request.parts > 0 {
        pairs.push(("part", request.part.to_string()));
        pairs.push(("parts", request.parts.to_string()));
    }
    // A payload has data but is not part of a state.
    if request.parts > 0 || request.data_len > 0 {
        let bytes = &request.data[..(request.data_len as usize).min(DATA)];
        let hex = bytes
            .iter()
            .fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
                let _ = write!(text, "{byte:02x}");
                text
            });
        pairs.push(("data", hex));
    }
    pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// The entry in a metadata record; `None` if it is invalid.
pub(super) fn journal_from_map(map: &BTreeMap<String, String>) -> Option<Journal> {
    let number = |key: &str| map.get(key)?.parse::<u64>().ok();
    let small = |key: &str| u32::try_from(number(key)?).ok();
    let mut request = Request::new(Command::from_name(map.get("command")?)?).named(map.get("name")?);
    request.from_seq = number("from_seq")?;
    if let Some(value) = map.get("value") {
        request = request.with_value(value.parse().ok()?);
    }
    if map.contains_key("stream") {
        request.stream = small("stream")?;
    }
    if map.contains_key("parts") {
        (request.part, request.parts) = (small("part")?, small("parts")?);
    }
    if request.parts > 0 || map.contains_key("data") {
        let hex = map.get("data")?.as_bytes();
        if hex.len() > 2 * DATA || !hex.len().is_multiple_of(2) {
            return None;
        }
        request.data_len = (hex.len() / 2) as u32;
        for (byte, pair) in request.data.iter_mut().zip(hex.chunks_exact(2)) {
            *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
        }
    }
    Some(Journal {
        // its name in schema 2
        stream_id: number("stream_id").or_else(|| number("boot_id"))?,
        block: number("block")?,
        request,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_entries_come_back_to_the_bit_and_damaged_ones_do_not() {
        let mut set = Request::new(Command::Set)
            .named("forgetting_factor")
            .with_value(0.1 + 0.2);
        set.from_seq = 1900;
        let state: Vec<u8> = (0..1500u32).map(|i| (i * 7) as u8).collect();
        let body = std::array::from_fn(|i| 0.1 * i as f64 - 0.3);
        let payloads = [Request::payload(Some(&body)), Request::payload(None)];
        // Every command that this schema has.
        let plain = (1..).map_while(Command::from_wire).map(Request::new);
        let requests = Request::restore(&state)
            .unwrap()
            .into_iter()
            .chain(payloads)
            .chain([set]);
        for request in requests.chain(plain) {
            let entry = Journal {
                stream_id: u64::MAX,
                block: 2,
                request,
            };
            let map = journal_to_map(&entry);
            assert_eq!(journal_from_map(&map), Some(entry));
            for key in ["command", "stream_id", "from_seq", "block"] {
                let mut damaged = map.clone();
                damaged.insert(key.into(), "x".into());
                assert_eq!(journal_from_map(&damaged), None, "{key}");
            }
        }
    }
}
