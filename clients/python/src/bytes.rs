//! A message as its bytes, in the layout that the tables of fields tell.

use std::convert::Infallible;
use thetabus::messages::{Field, Message, Visit};

struct Bytes(Vec<u8>);

impl Visit for Bytes {
    type Error = Infallible;
    fn u8s(&mut self, _: &Field, values: &mut [u8]) -> Result<(), Infallible> {
        self.0.extend_from_slice(values);
        Ok(())
    }
    fn u32s(&mut self, _: &Field, values: &mut [u32]) -> Result<(), Infallible> {
        self.0.extend(values.iter().flat_map(|value| value.to_ne_bytes()));
        Ok(())
    }
    fn u64s(&mut self, _: &Field, values: &mut [u64]) -> Result<(), Infallible> {
        self.0.extend(values.iter().flat_map(|value| value.to_ne_bytes()));
        Ok(())
    }
    fn f64s(&mut self, _: &Field, values: &mut [f64]) -> Result<(), Infallible> {
        self.0.extend(values.iter().flat_map(|value| value.to_ne_bytes()));
        Ok(())
    }
}

/// Appends the bytes of a message: no message has implicit padding, so its fields in order are its
/// memory.
pub(crate) fn append<M: Message>(target: &mut Vec<u8>, mut message: M) {
    let mut bytes = Bytes(std::mem::take(target));
    bytes.0.reserve(M::LAYOUT.size);
    let Ok(()) = message.visit(&mut bytes);
    *target = bytes.0;
}

/// The bytes of a message.
pub(crate) fn of<M: Message>(message: M) -> Vec<u8> {
    let mut bytes = Vec::new();
    append(&mut bytes, message);
    bytes
}

/// Takes fields from the bytes of a message.
struct Taken<'a>(&'a [u8]);

impl Taken<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], TooShort> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(TooShort)?;
        self.0 = rest;
        Ok(*head)
    }
}

/// Fewer bytes than a message has.
#[derive(Debug)]
pub(crate) struct TooShort;

impl Visit for Taken<'_> {
    type Error = TooShort;
    fn u8s(&mut self, _: &Field, values: &mut [u8]) -> Result<(), TooShort> {
        values.iter_mut().try_for_each(|value| {
            *value = self.take::<1>()?[0];
            Ok(())
        })
    }
    fn u32s(&mut self, _: &Field, values: &mut [u32]) -> Result<(), TooShort> {
        values.iter_mut().try_for_each(|value| {
            *value = u32::from_ne_bytes(self.take()?);
            Ok(())
        })
    }
    fn u64s(&mut self, _: &Field, values: &mut [u64]) -> Result<(), TooShort> {
        values.iter_mut().try_for_each(|value| {
            *value = u64::from_ne_bytes(self.take()?);
            Ok(())
        })
    }
    fn f64s(&mut self, _: &Field, values: &mut [f64]) -> Result<(), TooShort> {
        values.iter_mut().try_for_each(|value| {
            *value = f64::from_ne_bytes(self.take()?);
            Ok(())
        })
    }
}

/// The message that begins with these bytes.
pub(crate) fn read<M: Message>(bytes: &[u8]) -> Result<M, TooShort> {
    let mut message = M::EMPTY;
    message.visit(&mut Taken(bytes))?;
    Ok(message)
}
