//! Lines, dots and numbers on a picture.

use image::{Rgb, RgbImage};

/// Rows of the digits 0 to 9, three pixels wide, five high; the highest bit is on the left.
const DIGITS: [[u8; 5]; 10] = [
    [0b111, 0b101, 0b101, 0b101, 0b111],
    [0b010, 0b110, 0b010, 0b010, 0b111],
    [0b111, 0b001, 0b111, 0b100, 0b111],
    [0b111, 0b001, 0b111, 0b001, 0b111],
    [0b101, 0b101, 0b111, 0b001, 0b001],
    [0b111, 0b100, 0b111, 0b001, 0b111],
    [0b111, 0b100, 0b111, 0b101, 0b111],
    [0b111, 0b001, 0b010, 0b010, 0b010],
    [0b111, 0b101, 0b111, 0b101, 0b111],
    [0b111, 0b101, 0b111, 0b001, 0b111],
];
/// Pixels of a digit's pixel.
const DIGIT_SCALE: i64 = 2;

/// Part of a picture that is drawn on; coordinates are its pixels, and what is outside is cut off.
pub(super) struct Panel<'a> {
    pub(super) image: &'a mut RgbImage,
    pub(super) left: i64,
    pub(super) side: i64,
}

impl Panel<'_> {
    /// Mixes a colour into a pixel.
    fn mix(&mut self, x: i64, y: i64, color: [u8; 3], share: f32) {
        if !((0..self.side).contains(&x) && (0..self.side).contains(&y)) {
            return;
        }
        let (x, y) = ((x + self.left) as u32, y as u32);
        if x < self.image.width() && y < self.image.height() {
            let Rgb(before) = *self.image.get_pixel(x, y);
            let mixed = std::array::from_fn(|c| {
                (f32::from(before[c]) * (1.0 - share) + f32::from(color[c]) * share).round() as u8
            });
            self.image.put_pixel(x, y, Rgb(mixed));
        }
    }

    /// A square dot.
    pub(super) fn dot(&mut self, at: [f64; 2], radius: i64, color: [u8; 3]) {
        let [x, y] = at.map(|v| v.floor() as i64);
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                self.mix(x.saturating_add(dx), y.saturating_add(dy), color, 0.8);
            }
        }
    }

    /// A line one pixel wide.
    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], color: [u8; 3]) {
        let Some((from, to)) = self.clipped(from, to) else {
            return;
        };
        let length = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        let steps = length.ceil().max(1.0) as i64;
        for step in 0..=steps {
            let share = step as f64 / steps as f64;
            let at = |axis: usize| (from[axis] + share * (to[axis] - from[axis])).floor() as i64;
            self.mix(at(0), at(1), color, 1.0);
        }
    }

    /// The part of a line inside the panel, so that a line to far away costs nothing.
    fn clipped(&self, from: [f64; 2], to: [f64; 2]) -> Option<([f64; 2], [f64; 2])> {
        let (mut start, mut end) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let (a, d) = (from[axis], to[axis] - from[axis]);
            if !(a.is_finite() && d.is_finite()) {
                return None;
            }
            let bounds = [-a, self.side as f64 - a];
            if d == 0.0 {
                if bounds[0] > 0.0 || bounds[1] < 0.0 {
                    return None;
                }
            } else {
                let (low, high) = (bounds[0] / d, bounds[1] / d);
                start = start.max(low.min(high));
                end = end.min(low.max(high));
            }
        }
        let at = |share: f64| [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        (start <= end).then(|| (at(start), at(end)))
    }

    /// A number, its top left corner at `at`.
    pub(super) fn number(&mut self, at: [f64; 2], number: usize, color: [u8; 3]) {
        let [left, top] = at.map(|v| v.floor() as i64);
        for (place, digit) in number.to_string().bytes().enumerate() {
            let rows = DIGITS[usize::from(digit - b'0')];
            for (row, bits) in rows.into_iter().enumerate() {
                for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                    let x = left.saturating_add(DIGIT_SCALE * (4 * place as i64 + column));
                    let y = top.saturating_add(DIGIT_SCALE * row as i64);
                    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        self.mix(x.saturating_add(dx), y.saturating_add(dy), color, 1.0);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(draw: impl Fn(&mut Panel)) -> Vec<(u32, u32)> {
        let mut image = RgbImage::new(24, 10);
        draw(&mut Panel {
            image: &mut image,
            left: 10,
            side: 10,
        });
        let marked = image.enumerate_pixels().filter(|(_, _, p)| p.0 != [0; 3]);
        marked.map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn lines_and_dots_stay_on_their_panel() {
        let white = [255; 3];
        let line = drawn(|p| p.line([-1e12, 3.5], [1e12, 3.5], white));
        assert_eq!(line, (10..20).map(|x| (x, 3)).collect::<Vec<_>>());
        assert_eq!(drawn(|p| p.dot([4.2, 5.9], 0, white)), [(14, 5)]);
        assert_eq!(drawn(|p| p.dot([f64::INFINITY, f64::NAN], 1, white)), []);
        assert_eq!(drawn(|p| p.line([f64::NAN, 0.0], [1.0, 1.0], white)), []);
        assert_eq!(drawn(|p| p.line([20.0, 0.0], [30.0, 4.0], white)), []);
    }

    #[test]
    fn a_one_is_a_one() {
        let one = drawn(|p| p.number([0.0, 0.0], 1, [255; 3]));
        assert_eq!(one.len(), 4 * 8);
        assert!(one.contains(&(12, 0)) && !one.contains(&(10, 0)));
    }
}
