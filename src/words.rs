//! Short texts: truncation for messages, the characters of a name, and a hash that is the same in
//! every build.

/// The first characters, and an ellipsis if there are more than `limit`. Terminal control
/// characters are escaped.
#[cfg(any(feature = "config", feature = "recording", feature = "robot"))]
pub(crate) fn cut(text: &str, limit: usize) -> String {
    let more = if text.chars().nth(limit).is_some() { "…" } else { "" };
    let plain = |c: char| match c.is_control() {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    text.chars().take(limit).map(plain).chain([more.to_owned()]).collect()
}

/// True for a name that can stand in file names, service names and socket paths:
/// `[a-z0-9_-]{1,32}`.
#[cfg(any(feature = "config", feature = "bus"))]
pub fn is_name(text: &str) -> bool {
    let legal = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b"_-".contains(&b);
    (1..=32).contains(&text.len()) && text.bytes().all(legal)
}

/// FNV-1a of 64 bits: what identifies models and configurations, on every machine.
pub(crate) fn fnv1a(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// <http://www.isthe.com/chongo/tech/comp/fnv/>, test vectors.
    #[test]
    fn val_the_hash_is_fnv_1a() {
        for (text, hash) in [
            ("", 0xcbf2_9ce4_8422_2325),
            ("a", 0xaf63_dc4c_8601_ec8c),
            ("foobar", 0x8594_4171_f739_67e8),
        ] {
            assert_eq!(fnv1a(text.bytes()), hash, "{text}");
        }
    }

    #[cfg(feature = "config")]
    #[test]
    fn prop_texts_are_cut_between_characters_and_names_are_short_and_plain() {
        assert_eq!((cut("θ_1θ", 3), cut("θ_1", 3)), ("θ_1…".to_owned(), "θ_1".to_owned()));
        assert_eq!(cut("\u{1b}[31mq", 9), "\\u{1b}[31mq");
        assert!(is_name("arm-1_b") && is_name(&"a".repeat(32)));
        for wrong in ["", "Arm", "a b", "θ", &"a".repeat(33)] {
            assert!(!is_name(wrong), "{wrong}");
        }
    }
}
