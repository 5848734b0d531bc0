//! Seeded mutations of bytes, texts and numbers that typically break parsers.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Numbers at the limits of their types, and texts that some parsers accept as numbers.
const NUMBERS: [&str; 24] = [
    "0",
    "-0",
    "-1",
    "1e-320",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "-9223372036854775808",
    "4294967296",
    "2147483648",
    "1e15",
    "1e-15",
    "0x10",
    "1_000",
    "1,5",
    "",
    "000000000000000000000000000000000000000000000000000000000001",
];

/// Fragments of the formats.
const PIECES: [&str; 24] = [
    "\n",
    "\r\n",
    "\"",
    "'''",
    "\"\"\"",
    ",",
    ";",
    "\t",
    "#",
    "[",
    "]",
    "[[",
    "{",
    "}",
    "=",
    ".",
    "\u{feff}",
    "\0",
    "\u{1b}[2J",
    "𝛉",
    "a.a.a.a.a.a.a.a",
    "[plant.setpoint.csv]\npath = \"/dev/zero\"\n",
    "2026-11-21T08:15:30Z",
    "\\u0000",
];

/// The random numbers of one case.
pub(super) struct Random(ChaCha8Rng);

impl Random {
    pub(super) fn of(target: &str, case: u64) -> Self {
        let salt = target.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Self(ChaCha8Rng::seed_from_u64(salt ^ case))
    }

    pub(super) fn next(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number below `n`, which is at least 1.
    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// True once in `n` times.
    pub(super) fn once_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub(super) fn pick<'a, T: ?Sized>(&mut self, all: &[&'a T]) -> &'a T {
        all[self.below(all.len())]
    }

    /// A real number of any kind, often an ordinary one.
    pub(super) fn real(&mut self) -> f64 {
        match self.below(8) {
            0 => f64::NAN,
            1 => [f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, 0.0, -0.0][self.below(6)],
            2 => f64::from_bits(self.next()),
            3 => 10.0_f64.powi(self.below(40) as i32 - 20),
            _ => (self.below(2_000_001) as f64 - 1e6) * 1e-6,
        }
    }

    /// A whole number, often small, sometimes at the edge of its type.
    pub(super) fn whole(&mut self) -> u64 {
        match self.below(4) {
            0 => [u64::MAX, u64::MAX - 1, 1 << 63, 1 << 32, u64::from(u32::MAX)][self.below(5)],
            1 => self.next(),
            _ => self.below(100) as u64,
        }
    }

    /// A text that should be a number and may be one.
    pub(super) fn number(&mut self) -> String {
        match self.below(3) {
            0 => format!("{:?}", self.real()),
            1 => self.whole().to_string(),
            _ => self.pick(&NUMBERS).to_owned(),
        }
    }

    /// Changes a few places of a file.
    pub(super) fn mutate(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..=self.below(6) {
            self.mutate_once(bytes);
        }
    }

    fn mutate_once(&mut self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            bytes.push(0);
        }
        let at = self.below(bytes.len());
        let rest = bytes.len() - at;
        match self.below(12) {
            0 => bytes[at] ^= 1 << self.below(8),
            1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'\n', b',', b'"'][self.below(8)],
            2 => {
                let len = (1 + self.below(64)).min(rest);
                self.0.fill_bytes(&mut bytes[at..at + len]);
            }
            3 => {
                let longest = 1 << self.below(12);
                let len = (1 + self.below(longest)).min(rest);
                bytes.drain(at..at + len);
            }
            4 => bytes.truncate(at),
            5 => {
                let len = (1 + self.below(200)).min(rest);
                let most = 1 << self.below(8);
                let piece = bytes[at..at + len].repeat(1 + self.below(most));
                insert(bytes, at, &piece);
            }
            6 => {
                let byte = [0_u8, b'a', b'[', b'"', b'9', b',', b'.'][self.below(7)];
                let run = vec![byte; 1 << self.below(18)];
                insert(bytes, at, &run);
            }
            7 => insert(bytes, at, self.pick(&PIECES).as_bytes()),
            // possibly a length or a count in a binary file
            8 if rest >= 8 => bytes[at..at + 8].copy_from_slice(&self.whole().to_le_bytes()),
            9 if rest >= 4 => bytes[at..at + 4].copy_from_slice(&(self.whole() as u32).to_le_bytes()),
            _ => self.another_number(bytes, at),
        }
    }

    /// Replaces the next number in a text.
    fn another_number(&mut self, bytes: &mut Vec<u8>, from: usize) {
        let is_number = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
        let Some(start) = bytes[from..].iter().position(u8::is_ascii_digit).map(|i| from + i) else {
            return;
        };
        let len = bytes[start..].iter().take_while(|b| is_number(b)).count();
        bytes.splice(start..start + len, self.number().into_bytes());
    }
}

fn insert(bytes: &mut Vec<u8>, at: usize, piece: &[u8]) {
    bytes.splice(at..at, piece.iter().copied());
}
