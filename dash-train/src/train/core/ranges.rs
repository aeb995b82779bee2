//! Whether values of a configuration are in their ranges.

use std::fmt::Display;

use crate::Error;

/// A section of the configuration.
pub trait Section {
    /// The ranges of its keys.
    fn check(&self, _ranges: &mut Ranges) {}
}

/// Asks each section for the ranges of its keys, and keeps the first value that is not in its own.
#[derive(Debug, Default)]
pub struct Ranges {
    /// The section that is asked, with a dot behind it.
    prefix: String,
    error: Option<String>,
}

impl Ranges {
    /// Asks a section.
    pub fn section(&mut self, name: &str, ask: impl FnOnce(&mut Self)) {
        let length = self.prefix.len();
        self.prefix.push_str(name);
        self.prefix.push('.');
        ask(self);
        self.prefix.truncate(length);
    }

    /// A key whose value was `found`, and is in its range or not.
    pub fn expect(&mut self, key: &str, range: &str, found: impl Display, is_in: bool) {
        if !is_in && self.error.is_none() {
            let prefix = &self.prefix;
            self.error = Some(format!("{prefix}{key}: expected {range}, found {found}"));
        }
    }

    /// From 0 to 1.
    pub fn share(&mut self, key: &str, value: f32) {
        self.expect(key, "0 to 1", value, (0.0..=1.0).contains(&value));
    }

    /// Finite, 0 or more.
    pub fn not_negative(&mut self, key: &str, value: f32) {
        let is_in = value.is_finite() && value >= 0.0;
        self.expect(key, "a finite number of at least 0", value, is_in);
    }

    /// Finite, more than 0.
    pub fn positive(&mut self, key: &str, value: f32) {
        let is_in = value.is_finite() && value > 0.0;
        self.expect(key, "a finite number above 0", value, is_in);
    }

    /// Above 0, up to 1.
    pub fn factor(&mut self, key: &str, value: f32) {
        let is_in = value > 0.0 && value <= 1.0;
        self.expect(key, "above 0 and at most 1", value, is_in);
    }

    /// 1 or more.
    pub fn at_least_one(&mut self, key: &str, value: usize) {
        self.expect(key, "at least 1", value, value > 0);
    }

    /// From 1 to `most`.
    pub fn up_to(&mut self, key: &str, most: usize, value: usize) {
        self.expect(
            key,
            &format!("1 to {most}"),
            value,
            (1..=most).contains(&value),
        );
    }

    /// Two numbers of which the first is not larger.
    pub fn in_order<T: PartialOrd + Display>(&mut self, key: &str, [low, high]: [T; 2]) {
        let is_in = low <= high;
        self.expect(
            key,
            "the smaller number first",
            format!("[{low}, {high}]"),
            is_in,
        );
    }

    /// The first value that is not in its range.
    ///
    /// # Errors
    /// Names the key, the range and the value.
    pub fn finish(self) -> Result<(), Error> {
        self.error.map_or(Ok(()), |error| Err(Error::Config(error)))
    }
}
