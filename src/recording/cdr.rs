//! CDR, little-endian, as ROS 2 uses it: four bytes of encapsulation, then each scalar aligned to
//! its size from there.

use super::layout::Counts;
use crate::messages::{Field, Per, Visit, put_text, text_of};

/// Encapsulation: plain CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Appends messages to a reused buffer.
pub(super) struct CdrWriter<'a> {
    buffer: &'a mut Vec<u8>,
    counts: &'a Counts,
}

impl<'a> CdrWriter<'a> {
    pub(super) fn new(buffer: &'a mut Vec<u8>, counts: &'a Counts) -> Self {
        buffer.clear();
        buffer.extend_from_slice(&HEADER);
        Self { buffer, counts }
    }

    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let body = self.buffer.len() - HEADER.len();
        self.buffer.resize(HEADER.len() + body.next_multiple_of(N), 0);
        self.buffer.extend_from_slice(&bytes);
    }
}

impl Visit for CdrWriter<'_> {
    type Error = std::convert::Infallible;
    fn u8s(&mut self, field: &Field, values: &mut [u8]) -> Result<(), Self::Error> {
        if field.per == Per::Text {
            let text = text_of(values);
            // The length includes the final zero.
            self.put((text.len() as u32 + 1).to_le_bytes());
            self.buffer.extend_from_slice(text.as_bytes());
            self.buffer.push(0);
        } else {
            let count = self.counts.values(field, values.len());
            self.buffer.extend_from_slice(&values[..count]);
        }
        Ok(())
    }
    fn u32s(&mut self, field: &Field, values: &mut [u32]) -> Result<(), Self::Error> {
        let count = self.counts.values(field, values.len());
        values[..count].iter().for_each(|value| self.put(value.to_le_bytes()));
        Ok(())
    }
    fn u64s(&mut self, field: &Field, values: &mut [u64]) -> Result<(), Self::Error> {
        if let Some(bools) = self.counts.bools(field) {
            let bit = |i: usize| values.get(i / 64).is_some_and(|word| word >> (i % 64) & 1 == 1);
            self.buffer.extend((0..bools).map(|i| u8::from(bit(i))));
            return Ok(());
        }
        let count = self.counts.values(field, values.len());
        values[..count].iter().for_each(|value| self.put(value.to_le_bytes()));
        Ok(())
    }
    fn f64s(&mut self, field: &Field, values: &mut [f64]) -> Result<(), Self::Error> {
        let count = self.counts.values(field, values.len());
        values[..count].iter().for_each(|value| self.put(value.to_le_bytes()));
        Ok(())
    }
}

/// A message that is shorter than its fields or not little-endian CDR.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotThisMessage;

/// Fills messages; fields that are not in the file stay unchanged.
pub(super) struct CdrReader<'a> {
    body: &'a [u8],
    position: usize,
    counts: &'a Counts,
}

impl<'a> CdrReader<'a> {
    pub(super) fn new(message: &'a [u8], counts: &'a Counts) -> Result<Self, NotThisMessage> {
        match message.split_first_chunk::<4>() {
            Some((&[0, 1, _, _], body)) => Ok(Self {
                body,
                position: 0,
                counts,
            }),
            _ => Err(NotThisMessage),
        }
    }

    /// The bytes of scalars of `N` bytes each. No scalars need no alignment.
    fn scalars<const N: usize>(&mut self, count: usize) -> Result<&'a [[u8; N]], NotThisMessage> {
        if count == 0 {
            return Ok(&[]);
        }
        self.position = self.position.next_multiple_of(N);
        let (scalars, _) = self.bytes(count * N)?.as_chunks();
        Ok(scalars)
    }

    fn bytes(&mut self, len: usize) -> Result<&'a [u8], NotThisMessage> {
        let end = self.position.checked_add(len).ok_or(NotThisMessage)?;
        let bytes = self.body.get(self.position..end).ok_or(NotThisMessage)?;
        self.position = end;
        Ok(bytes)
    }
}

impl Visit for CdrReader<'_> {
    type Error = NotThisMessage;
    #[inline]
    fn u8s(&mut self, field: &Field, values: &mut [u8]) -> Result<(), NotThisMessage> {
        if field.per == Per::Text {
            let len = self.scalars(1)?.first().map_or(0, |len| u32::from_le_bytes(*len));
            put_text(values, text_of(self.bytes(len as usize)?));
        } else {
            let count = self.counts.values(field, values.len());
            values[..count].copy_from_slice(self.bytes(count)?);
        }
        Ok(())
    }
    #[inline]
    fn u32s(&mut self, field: &Field, values: &mut [u32]) -> Result<(), NotThisMessage> {
        let count = self.counts.values(field, values.len());
        for (value, bytes) in values.iter_mut().zip(self.scalars(count)?) {
            *value = u32::from_le_bytes(*bytes);
        }
        Ok(())
    }
    #[inline]
    fn u64s(&mut self, field: &Field, values: &mut [u64]) -> Result<(), NotThisMessage> {
        if let Some(bools) = self.counts.bools(field) {
            values.fill(0);
            for (i, byte) in self.bytes(bools)?.iter().enumerate() {
                if let Some(word) = values.get_mut(i / 64) {
                    *word |= u64::from(*byte != 0) << (i % 64);
                }
            }
            return Ok(());
        }
        let count = self.counts.values(field, values.len());
        for (value, bytes) in values.iter_mut().zip(self.scalars(count)?) {
            *value = u64::from_le_bytes(*bytes);
        }
        Ok(())
    }
    #[inline]
    fn f64s(&mut self, field: &Field, values: &mut [f64]) -> Result<(), NotThisMessage> {
        let count = self.counts.values(field, values.len());
        for (value, bytes) in values.iter_mut().zip(self.scalars(count)?) {
            *value = f64::from_le_bytes(*bytes);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::info::tests::arm;
    use super::*;
    use crate::messages::Message as _;
    use crate::messages::table::message;

    message! {
        /// One field of each kind, in an order that needs alignment.
        struct Mixed {
            a: u32, One, "", "a";
            pad: u32, Padding, "", "Zero";
            b: f64, One, "", "b";
            c: u32, One, "", "c";
            pad2: u32, Padding, "", "Zero";
            d: u64, One, "", "d";
            text: [u8; 8], Text, "", "text";
        }
    }

    #[test]
    fn prop_scalars_are_aligned_from_behind_the_encapsulation_and_come_back_to_the_bit() {
        let counts = Counts::of(&arm());
        let mut buffer = Vec::new();
        let mut sent = Mixed {
            a: 7,
            b: f64::from_bits(0x7ff8_0000_dead_beef),
            c: 8,
            d: u64::MAX,
            text: *b"gap\0\0\0\0\0",
            ..Mixed::EMPTY
        };
        let Ok(()) = sent.visit(&mut CdrWriter::new(&mut buffer, &counts));
        // 4 encapsulation, 4 + 4 padding, 8, 4 + 4 padding, 8, a length and a text of 4
        assert_eq!(buffer.len(), 4 + 8 + 8 + 8 + 8 + 8);

        let mut got = Mixed {
            text: [9; 8],
            ..Mixed::EMPTY
        };
        got.visit(&mut CdrReader::new(&buffer, &counts).unwrap()).unwrap();
        assert_eq!(
            (got.a, got.b.to_bits(), got.c, got.d),
            (7, sent.b.to_bits(), 8, u64::MAX)
        );
        assert_eq!(got.text, sent.text);
        let cut = &buffer[..buffer.len() - 1];
        assert_eq!(
            got.visit(&mut CdrReader::new(cut, &counts).unwrap()),
            Err(NotThisMessage)
        );
        assert!(CdrReader::new(&[0, 0, 0, 0], &counts).is_err(), "big-endian is refused");
    }

    #[test]
    fn prop_one_scalar_is_written_per_joint_and_parameter_and_sets_stand_as_each_form_has_them() {
        use crate::messages::Estimate;
        let mut info = arm();
        let mut lengths = Vec::new();
        for (schema, first_form) in [(2, true), (3, true), (3, false)] {
            (info.schema, info.first_form) = (schema, first_form);
            let counts = Counts::of(&info);
            let mut sent = Estimate {
                usable: [0, 5].into_iter().collect(),
                fit_probability: 0.5,
                ..Estimate::EMPTY
            };
            (sent.theta[8], sent.theta[9], sent.derived[0]) = (1.5, 99.0, 2.5);
            let mut buffer = Vec::new();
            let Ok(()) = sent.visit(&mut CdrWriter::new(&mut buffer, &counts));
            let mut got = Estimate::EMPTY;
            got.visit(&mut CdrReader::new(&buffer, &counts).unwrap()).unwrap();
            assert_eq!((got.usable, got.fit_probability), (sent.usable, 0.5));
            assert_eq!((got.theta[8], got.theta[9], got.derived[0]), (1.5, 0.0, 2.5));
            lengths.push(buffer.len());
        }
        // Three sets: one more word each, then 9 bools instead of 16 bytes, and padding.
        assert_eq!(lengths[1] - lengths[0], 3 * 8);
        assert_eq!(lengths[1] - lengths[2], 3 * 16 - 32);
    }
}
