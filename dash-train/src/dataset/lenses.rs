//! Intrinsics that are hardly meant: of millimetres, of pictures one unit wide, of another size.

use super::pixels::scale::is_in_the_middle;
use super::view::View;

/// Degrees from which on a field of view is no lens's that pictures without distortion can be of.
const WIDEST: f64 = 150.0;
/// Degrees up to which one is hardly meant: an angle in other units gives such.
const NARROWEST: f64 = 2.0;

/// A view whose intrinsics are hardly meant.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OddLens {
    view: String,
    what: String,
    /// How many views have such a lens.
    n: usize,
}

impl OddLens {
    /// The first of these views with such a lens.
    pub(crate) fn of(views: &[View]) -> Option<Self> {
        let mut odd = views.iter().filter_map(|view| Some((view, odd(view)?)));
        let (view, what) = odd.next()?;
        Some(Self {
            view: view.name.clone(),
            what,
            n: 1 + odd.count(),
        })
    }

    /// What is wrong, in words.
    pub(crate) fn text(&self) -> String {
        let more = match self.n {
            1 => String::new(),
            n => format!(", and {} views more have such a lens", n - 1),
        };
        format!("{} has {}{more}", self.view, self.what)
    }

    /// What to do about it.
    pub(crate) fn mend(&self) -> String {
        "state focal lengths and principal points in pixels of the stated size".into()
    }
}

fn odd(view: &View) -> Option<String> {
    let camera = &view.camera;
    let angle = 2.0 * (0.5 * camera.width as f64 / camera.fx).atan().to_degrees();
    if !(NARROWEST..=WIDEST).contains(&angle) {
        let told = "a field of view of";
        return Some(format!(
            "{told} {angle:.1} degrees (focal length {:.3} pixels)",
            camera.fx
        ));
    }
    let (cx, cy) = (camera.cx, camera.cy);
    let size = (camera.width, camera.height);
    (!is_in_the_middle([cx, cy], size)).then(|| {
        let told = "a principal point outside the middle half of its picture";
        format!("{told}: {cx:.1}, {cy:.1} of {}x{}", size.0, size.1)
    })
}

#[cfg(test)]
mod tests {
    use dash_kernels::Camera;

    use super::*;

    #[test]
    fn millimetres_and_fractions_are_told() {
        let of = |focal: f64, [cx, cy]: [f64; 2]| {
            let camera = Camera::new(focal, focal, cx, cy, 64, 48);
            OddLens::of(&[View::from_rgb8("v", camera, 0.0, vec![0; 3 * 64 * 48])])
        };
        assert_eq!(of(50.0, [32.0, 24.0]), None);
        assert_eq!(of(50.0, [20.0, 30.0]), None);
        let told = of(0.035, [32.0, 24.0]).expect("odd").text();
        assert!(told.contains("179.9 degrees"), "{told}");
        let told = of(50.0, [0.5, 0.5]).expect("odd").text();
        assert!(told.contains("0.5, 0.5 of 64x48"), "{told}");
    }
}
