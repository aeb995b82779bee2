//! Valid files made hostile.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Numbers at which counts and sizes break.
const NUMBERS: [u64; 14] = [
    0,
    1,
    17,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x00ff_ffff,
    0x4000_0000,
    0x7fff_ffff,
    0xffff_ffff,
    1 << 40,
    i64::MAX as u64,
    u64::MAX,
];
/// The same in text, and what is no number.
const WORDS: [&str; 16] = [
    "0",
    "-1",
    "3",
    "65536",
    "16385",
    "99999999",
    "2147483648",
    "4294967295",
    "1099511627776",
    "9223372036854775807",
    "18446744073709551615",
    "1e308",
    "1e-320",
    "nan",
    "null",
    "\"\"",
];
/// Longest file that is made.
const MAX_BYTES: usize = 1 << 16;

/// Changes files at random, the same way for the same seed.
pub struct Mutator {
    rng: Pcg64,
}

/// Inverts one bit.
pub fn flip_bit(bytes: &mut [u8], bit: usize) {
    bytes[bit / 8] ^= 1 << (bit % 8);
}

impl Mutator {
    /// A source of changes.
    pub fn new(seed: u64) -> Self {
        Self {
            rng: Pcg64::seed_from_u64(seed),
        }
    }

    /// A number below `end`, 0 when there is none.
    pub fn below(&mut self, end: usize) -> usize {
        if end == 0 {
            0
        } else {
            self.rng.random_range(0..end)
        }
    }

    /// One of the valid files with a few changes.
    pub fn mutant(&mut self, valid: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = valid[self.below(valid.len())].clone();
        for _ in 0..1 + self.below(4) {
            self.change(&mut bytes, valid);
            bytes.truncate(MAX_BYTES);
        }
        bytes
    }

    fn change(&mut self, bytes: &mut Vec<u8>, valid: &[Vec<u8>]) {
        if bytes.is_empty() {
            bytes.extend((0..self.below(40)).map(|_| self.rng.random::<u8>()));
            return;
        }
        let at = self.below(bytes.len());
        let span = 1 + self.below((bytes.len() - at).min(64));
        match self.below(12) {
            0 | 1 => flip_bit(bytes, 8 * at + self.below(8)),
            2 => bytes[at] = self.rng.random(),
            3 | 4 => self.number(bytes, at),
            5 | 6 => self.word(bytes, at),
            7 => bytes.truncate(at),
            8 => drop(bytes.drain(at..at + span)),
            9 => {
                let part = bytes[at..at + span].to_vec();
                let copies = 1 + self.below(40);
                let part = part.repeat(if self.below(8) == 0 { 8 * copies } else { 1 });
                bytes.splice(at..at, part);
            }
            10 => {
                let other = &valid[self.below(valid.len())];
                let from = self.below(other.len());
                let until = from + self.below(other.len() - from + 1);
                bytes.splice(at..at + span, other[from..until].iter().copied());
            }
            _ => {
                // Deep nesting, long names, long numbers.
                let fill = b"[{(\"9 ,\n"[self.below(8)];
                let n = 1 + self.below(3000);
                bytes.splice(at..at, std::iter::repeat_n(fill, n));
            }
        }
    }

    /// Overwrites up to eight bytes with a number, in either byte order, at times only nearly.
    fn number(&mut self, bytes: &mut [u8], at: usize) {
        let mut number = NUMBERS[self.below(NUMBERS.len())];
        if self.below(3) == 0 {
            number = number.wrapping_add(self.below(32) as u64).wrapping_sub(16);
        }
        let width = [1, 2, 4, 8][self.below(4)];
        let mut encoded = number.to_le_bytes()[..width].to_vec();
        if self.below(3) == 0 {
            encoded.reverse();
        }
        for (byte, value) in bytes[at..].iter_mut().zip(encoded) {
            *byte = value;
        }
    }

    /// Replaces the number in text at or after a place.
    fn word(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let is_part = |byte: &u8| byte.is_ascii_digit() || b".-+e".contains(byte);
        let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit) else {
            return;
        };
        let start = at + start;
        let length = bytes[start..]
            .iter()
            .take_while(|byte| is_part(byte))
            .count();
        let word = WORDS[self.below(WORDS.len())];
        bytes.splice(start..start + length, word.bytes());
    }
}
