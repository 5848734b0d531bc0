//! Text of fixed size: UTF-8, filled up with zeros.

/// Writes `words` and zeros behind them; what does not fit is cut off between two characters.
pub fn put_text(target: &mut [u8], words: &str) {
    let mut len = words.len().min(target.len());
    while !words.is_char_boundary(len) {
        len -= 1;
    }
    target[..len].copy_from_slice(&words.as_bytes()[..len]);
    target[len..].fill(0);
}

/// The text up to the first zero; what is no UTF-8 ends it, too.
pub fn text_of(bytes: &[u8]) -> &str {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) => text,
        Err(error) => std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or(""),
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
}
