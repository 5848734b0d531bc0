//! Text of fixed size: UTF-8, filled up with zeros.

use std::fmt::{self, Write};

/// Writes `words` and zeros behind them; what does not fit is cut off between two characters.
pub fn put_text(target: &mut [u8], words: &str) {
    let mut len = words.len().min(target.len());
    while !words.is_char_boundary(len) {
        len -= 1;
    }
    target[..len].copy_from_slice(&words.as_bytes()[..len]);
    target[len..].fill(0);
}

/// The text up to the first zero; invalid UTF-8 also ends it.
pub fn text_of(bytes: &[u8]) -> &str {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) => text,
        Err(error) => std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or(""),
    }
}

/// Text of at most N bytes, written without allocation.
#[derive(Debug, Clone)]
pub(crate) struct FixedText<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Default for FixedText<N> {
    fn default() -> Self {
        Self { bytes: [0; N], len: 0 }
    }
}

impl<const N: usize> FixedText<N> {
    pub(crate) fn as_str(&self) -> &str {
        text_of(&self.bytes[..self.len])
    }

    /// Appends a text, or nothing of it if it does not fit.
    pub(crate) fn push_whole(&mut self, text: &str) {
        if self.len + text.len() <= N {
            let _ = self.write_str(text);
        }
    }
}

impl<const N: usize> Write for FixedText<N> {
    /// Text beyond N bytes is dropped at a character boundary, which is an error, so nothing can
    /// follow.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = &mut self.bytes[self.len..];
        put_text(room, text);
        let written = text_of(room).len();
        self.len += written;
        match written == text.len() {
            true => Ok(()),
            false => Err(fmt::Error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_text_comes_back_and_damage_ends_it() {
        let mut field = [9; 8];
        put_text(&mut field, "θ_1");
        assert_eq!(text_of(&field), "θ_1");
        put_text(&mut field, "12345678");
        assert_eq!(text_of(&field), "12345678");
        field[3] = 0xff;
        assert_eq!(text_of(&field), "123");
    }

    #[test]
    fn prop_text_of_a_fixed_size_ends_at_a_character_and_nothing_follows_a_cut() {
        let mut text = FixedText::<6>::default();
        assert!(write!(text, "a{}b", "θθ".to_owned()).is_ok());
        assert_eq!(text.as_str(), "aθθb");
        text.push_whole("x");
        assert_eq!(text.as_str(), "aθθb");
        let mut cut = FixedText::<4>::default();
        assert!(write!(cut, "aθθ{}", 1).is_err());
        assert_eq!(cut.as_str(), "aθ");
    }
}
