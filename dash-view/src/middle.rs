//! Where most Gaussians are.

use dash_model::{DynamicScene, ModelError, to_host};

/// Gaussians that are looked at to find the middle of all.
const SAMPLES: usize = 20_000;

/// The median of points along each axis, and the distance from it within which half of them are; 1 where there is none.
fn middle(points: &[[f32; 3]]) -> ([f64; 3], f64) {
    let stride = points.len().div_ceil(SAMPLES).max(1);
    let sample: Vec<[f32; 3]> = points.iter().copied().step_by(stride).collect();
    let median = |mut values: Vec<f32>| {
        let place = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => f64::from(*values.select_nth_unstable_by(place, f32::total_cmp).1),
        }
    };
    let middle =
        [0, 1, 2].map(|axis| median(sample.iter().map(|point| point[axis]).collect::<Vec<_>>()));
    let distances = sample.iter().map(|point| {
        let squares = point
            .iter()
            .zip(middle)
            .map(|(p, m)| (f64::from(*p) - m).powi(2));
        squares.sum::<f64>().sqrt() as f32
    });
    let radius = median(distances.collect());
    (middle, if radius > 0.0 { radius } else { 1.0 })
}

/// [`middle`] of a scene's Gaussians where nothing has moved yet.
///
/// # Errors
/// When the device fails.
pub fn middle_of(scene: &DynamicScene) -> Result<([f64; 3], f64), ModelError> {
    let means = to_host(scene.static_set.means.val())?;
    let mut points = means.as_chunks::<3>().0.to_vec();
    if let Some(dynamic) = &scene.dynamic {
        let means = to_host(dynamic.gaussians.means.val())?;
        points.extend_from_slice(means.as_chunks::<3>().0);
    }
    Ok(middle(&points))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_where_most_are() {
        let mut points: Vec<[f32; 3]> = (-5..=5).map(|x| [x as f32, 1.0, 2.0]).collect();
        points.push([1e6, -1e6, 0.0]);
        let (at, radius) = middle(&points);
        assert!(at[0].abs() <= 1.0 && at[1..] == [1.0, 2.0], "{at:?}");
        assert!((2.0..=4.0).contains(&radius), "{radius}");
        // One point, or none, has no extent.
        assert_eq!(middle(&points[..1]), ([-5.0, 1.0, 2.0], 1.0));
        assert_eq!(middle(&[]), ([0.0; 3], 1.0));
    }
}
