//! Intrinsics as files state them, checked.

use dash_kernels::Camera;

use crate::dataset::pixels::MAX_IMAGE_SIDE;
use crate::dataset::pixels::scale::is_in_the_middle;

/// What was expected, and what was found.
pub(crate) type Wrong = (&'static str, String);

/// A smaller skew moves no pixel that matters.
const MAX_SKEW_PX: f64 = 0.1;

/// Intrinsics and the size of the pictures that they are for, pixels.
pub(crate) struct Intrinsics {
    /// Width and height, which some writers state as real numbers.
    pub(crate) size: [f64; 2],
    pub(crate) focal: [f64; 2],
    pub(crate) principal_point: [f64; 2],
    pub(crate) skew: f64,
}

impl Intrinsics {
    /// A camera that is not placed yet.
    ///
    /// # Errors
    /// What is wrong: a size that is none, numbers that are not finite or not positive, skew, or a principal point of
    /// pictures of another size.
    pub(crate) fn camera(&self) -> Result<Camera, Wrong> {
        let [width, height] = self.size;
        let side = |v: f64| v.fract() == 0.0 && v >= 1.0 && v <= f64::from(MAX_IMAGE_SIDE);
        if !(side(width) && side(height)) {
            return Err(("a whole width and height", format!("{width} and {height}")));
        }
        let (width, height) = (width as usize, height as usize);
        check_finite(self.focal, self.principal_point)?;
        check_skew(self.skew)?;
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal_point);
        if !is_in_the_middle([cx, cy], (width, height)) {
            return Err((
                "a principal point near the middle of pictures of the stated size",
                format!("{cx}, {cy} for {width}x{height}"),
            ));
        }
        Ok(Camera::new(fx, fy, cx, cy, width, height))
    }
}

/// Focal lengths must be positive, and all be finite.
pub(crate) fn check_finite([fx, fy]: [f64; 2], [cx, cy]: [f64; 2]) -> Result<(), Wrong> {
    let positive = |v: f64| v > 0.0 && v.is_finite();
    match positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite() {
        true => Ok(()),
        false => Err((
            "positive finite intrinsics",
            format!("focal lengths {fx}, {fy}, principal point {cx}, {cy}"),
        )),
    }
}

/// Cameras have none.
pub(crate) fn check_skew(skew: f64) -> Result<(), Wrong> {
    match skew.abs() <= MAX_SKEW_PX {
        true => Ok(()),
        false => Err(("pixels without skew", format!("skew {skew}"))),
    }
}
