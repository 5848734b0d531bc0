//! CDR, little-endian, as ROS 2 uses it: four bytes of encapsulation, then each scalar aligned to its size from there.

use super::layout::Visit;
use crate::messages::{put_text, text_of};

/// Encapsulation: plain CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Appends scalars to a buffer that is kept between messages.
pub(super) struct CdrWriter<'a>(&'a mut Vec<u8>);

impl<'a> CdrWriter<'a> {
    pub(super) fn new(buffer: &'a mut Vec<u8>) -> Self {
        buffer.clear();
        buffer.extend_from_slice(&HEADER);
        Self(buffer)
    }

    fn align(&mut self, size: usize) {
        let body = self.0.len() - HEADER.len();
        self.0.resize(HEADER.len() + body.next_multiple_of(size), 0);
    }
}

impl Visit for CdrWriter<'_> {
    type Error = std::convert::Infallible;
    fn u32(&mut self, _: &str, _: &str, value: &mut u32) -> Result<(), Self::Error> {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
        Ok(())
    }
    fn u64(&mut self, _: &str, _: &str, value: &mut u64) -> Result<(), Self::Error> {
        self.align(8);
        self.0.extend_from_slice(&value.to_le_bytes());
        Ok(())
    }
    fn f64(&mut self, _: &str, _: &str, value: &mut f64) -> Result<(), Self::Error> {
        self.align(8);
        self.0.extend_from_slice(&value.to_le_bytes());
        Ok(())
    }
    fn text(&mut self, name: &str, comment: &str, value: &mut [u8]) -> Result<(), Self::Error> {
        let text = text_of(value);
        // The length counts the closing zero.
        let Ok(()) = self.u32(name, comment, &mut (text.len() as u32 + 1));
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
        Ok(())
    }
}

/// A message that is shorter than its fields or not little-endian CDR.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotThisMessage;

/// Takes scalars from a message.
pub(super) struct CdrReader<'a> {
    body: &'a [u8],
    position: usize,
}

impl<'a> CdrReader<'a> {
    pub(super) fn new(message: &'a [u8]) -> Result<Self, NotThisMessage> {
        match message.split_first_chunk::<4>() {
            Some((&[0, 1, _, _], body)) => Ok(Self { body, position: 0 }),
            _ => Err(NotThisMessage),
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], NotThisMessage> {
        let start = self.position.next_multiple_of(N);
        let bytes = self.body.get(start..).and_then(|rest| rest.first_chunk::<N>());
        self.position = start + N;
        bytes.copied().ok_or(NotThisMessage)
    }
}

impl Visit for CdrReader<'_> {
    type Error = NotThisMessage;
    fn u32(&mut self, _: &str, _: &str, value: &mut u32) -> Result<(), NotThisMessage> {
        *value = u32::from_le_bytes(self.take()?);
        Ok(())
    }
    fn u64(&mut self, _: &str, _: &str, value: &mut u64) -> Result<(), NotThisMessage> {
        *value = u64::from_le_bytes(self.take()?);
        Ok(())
    }
    fn f64(&mut self, _: &str, _: &str, value: &mut f64) -> Result<(), NotThisMessage> {
        *value = f64::from_le_bytes(self.take()?);
        Ok(())
    }
    fn text(&mut self, _: &str, _: &str, value: &mut [u8]) -> Result<(), NotThisMessage> {
        let len = u32::from_le_bytes(self.take()?) as usize;
        let end = self.position.checked_add(len).ok_or(NotThisMessage)?;
        let bytes = self.body.get(self.position..end).ok_or(NotThisMessage)?;
        put_text(value, text_of(bytes));
        self.position = end;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_scalars_are_aligned_from_behind_the_encapsulation_and_come_back_to_the_bit() {
        let mut buffer = Vec::new();
        let nan = f64::from_bits(0x7ff8_0000_dead_beef);
        let mut writer = CdrWriter::new(&mut buffer);
        let Ok(()) = writer.u32("", "", &mut 7);
        let Ok(()) = writer.f64("", "", &mut nan.clone());
        let Ok(()) = writer.u32("", "", &mut 8);
        let Ok(()) = writer.u64("", "", &mut u64::MAX.clone());
        let Ok(()) = writer.text("", "", &mut b"gap\0\0".to_owned());
        // 4 encapsulation, 4 + 4 padding, 8, 4 + 4 padding, 8, a length and a text of 4
        assert_eq!(buffer.len(), 4 + 8 + 8 + 8 + 8 + 8);

        let mut reader = CdrReader::new(&buffer).unwrap();
        let (mut a, mut b, mut c, mut d) = (0, 0.0, 0, 0);
        reader.u32("", "", &mut a).unwrap();
        reader.f64("", "", &mut b).unwrap();
        reader.u32("", "", &mut c).unwrap();
        reader.u64("", "", &mut d).unwrap();
        assert_eq!((a, b.to_bits(), c, d), (7, nan.to_bits(), 8, u64::MAX));
        let mut text = [9; 6];
        reader.text("", "", &mut text).unwrap();
        assert_eq!(&text, b"gap\0\0\0");
        assert_eq!(reader.u32("", "", &mut a), Err(NotThisMessage));
        assert!(CdrReader::new(&[0, 0, 0, 0]).is_err(), "big-endian is refused");
    }
}
