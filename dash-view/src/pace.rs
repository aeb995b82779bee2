//! How large pictures are while something moves.

/// Seconds that a picture may take while something moves.
const TARGET_SECS: f64 = 1.0 / 20.0;
/// The smallest side of such a picture as a share of the full one.
const LEAST_SHARE: f64 = 0.2;
/// Shares are changed in steps, so that pictures keep their size.
const STEPS: f64 = 20.0;

/// Chooses pictures as large as can be drawn in time: full ones at rest, smaller ones while something moves.
///
/// ```
/// use dash_view::pace::Pace;
///
/// let (mut pace, full) = (Pace::default(), [800, 600]);
/// // A full picture takes a second: too long while something moves.
/// pace.saw(full, full, 1.0);
/// assert!(pace.size(full, true)[0] < 400);
/// assert_eq!(pace.size(full, false), full);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Pace {
    /// Of a side.
    share: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self { share: 0.5 }
    }
}

impl Pace {
    /// The size of the next picture.
    ///
    /// # Units
    /// Pixels.
    pub fn size(&self, full: [usize; 2], moving: bool) -> [usize; 2] {
        let share = match moving {
            true => (self.share * STEPS).floor() / STEPS,
            false => 1.0,
        };
        full.map(|side| ((side as f64 * share).round() as usize).max(1))
    }

    /// Takes in how long a picture took.
    pub fn saw(&mut self, size: [usize; 2], full: [usize; 2], secs: f64) {
        let pixels = |[width, height]: [usize; 2]| (width * height).max(1) as f64;
        let share = (pixels(size) / pixels(full)).sqrt();
        // In the positive form, so that NaN says nothing.
        let is_known = secs > 0.0;
        if !is_known {
            return;
        }
        let fits = share * (TARGET_SECS / secs).sqrt();
        // Halfway, since one picture is not like the next.
        self.share = (0.5 * (self.share + fits)).clamp(LEAST_SHARE, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever a pixel costs, pictures settle where they take the time that they may, or at either end.
    #[test]
    fn pictures_settle_in_time() {
        let full = [1000, 500];
        for (secs_per_pixel, expected) in [(1e-9, 1.0), (4e-7, 0.5), (1e-4, LEAST_SHARE)] {
            let mut pace = Pace::default();
            for _ in 0..40 {
                let size = pace.size(full, true);
                let secs = (size[0] * size[1]) as f64 * secs_per_pixel;
                pace.saw(size, full, secs);
            }
            let share = pace.size(full, true)[0] as f64 / 1000.0;
            assert!(
                (share - expected).abs() <= 0.051,
                "{secs_per_pixel}: {share}"
            );
            assert_eq!(pace.size(full, false), full);
        }
    }

    #[test]
    fn no_picture_is_empty() {
        let mut pace = Pace::default();
        pace.saw([0, 0], [0, 0], f64::NAN);
        assert_eq!(pace.size([1, 2], true), [1, 1]);
    }
}
