//! Where the dynamic Gaussians go.

#[cfg(not(target_family = "wasm"))]
use dash_kernels::Camera;
use dash_model::{DynamicScene, ModelError, to_host};

/// Times at which the clip is looked at, at most.
const MOST_TIMES: usize = 65;
/// Positions that are kept, at most.
const MOST_POSITIONS: usize = 4_000_000;
/// How near to a Gaussian's centre a click has to be, pixels.
#[cfg(not(target_family = "wasm"))]
const PICK_RADIUS: f64 = 12.0;

/// Positions of the dynamic Gaussians over the clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracks {
    /// In [0, 1].
    times: Vec<f32>,
    /// Means, for each time.
    positions: Vec<Vec<[f32; 3]>>,
    /// The speed that 95 % of all steps stay below, world units over the whole clip.
    pub fastest: f32,
}

impl Tracks {
    /// Those of a scene; `None` where nothing is dynamic.
    ///
    /// # Errors
    /// When the field refuses its input, or the device fails.
    pub fn of(scene: &DynamicScene, n_frames: usize) -> Result<Option<Self>, ModelError> {
        let Some(dynamic) = scene.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
            return Ok(None);
        };
        let fits = MOST_POSITIONS / dynamic.gaussians.len();
        let n = n_frames.min(MOST_TIMES).min(fits).max(2);
        let times: Vec<f32> = (0..n).map(|k| k as f32 / (n - 1) as f32).collect();
        let positions = times
            .iter()
            .map(|&time| {
                let means = dynamic.deform(&scene.settings, time)?.means;
                Ok(to_host(means)?.as_chunks::<3>().0.to_vec())
            })
            .collect::<Result<Vec<_>, ModelError>>()?;
        let fastest = fastest(&positions);
        Ok(Some(Self {
            times,
            positions,
            fastest,
        }))
    }

    /// Where a Gaussian is at each of the times.
    #[cfg(not(target_family = "wasm"))]
    pub fn track(&self, gaussian: usize) -> impl Iterator<Item = (f32, [f64; 3])> {
        let times = self.times.iter().copied();
        times
            .zip(&self.positions)
            .map(move |(time, positions)| (time, positions[gaussian].map(f64::from)))
    }

    /// The dynamic Gaussian that a click means: of those near to it the one nearest to the eye; `None` where there is none.
    ///
    /// # Units
    /// `pixel` in pixels of the camera's picture.
    #[cfg(not(target_family = "wasm"))]
    pub fn pick(&self, camera: &Camera, time: f32, pixel: [f64; 2]) -> Option<usize> {
        let last = self.times.len() - 1;
        let at = (f64::from(time) * last as f64).round() as usize;
        let near = |(index, position): (usize, &[f32; 3])| {
            let (seen, depth) = camera.project(position.map(f64::from))?;
            let distance = (seen[0] - pixel[0]).hypot(seen[1] - pixel[1]);
            (distance <= PICK_RADIUS).then_some((index, depth))
        };
        let candidates = self.positions[at.min(last)].iter().enumerate();
        candidates
            .filter_map(near)
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
            .map(|(index, _)| index)
    }
}

fn fastest(positions: &[Vec<[f32; 3]>]) -> f32 {
    let steps_per_clip = (positions.len() - 1) as f32;
    let mut speeds: Vec<f32> = positions
        .windows(2)
        .flat_map(|pair| pair[0].iter().zip(&pair[1]))
        .map(|(a, b)| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
            squares.sum::<f32>().sqrt() * steps_per_clip
        })
        .filter(|speed| speed.is_finite())
        .collect();
    let place = speeds.len() * 95 / 100;
    match place < speeds.len() {
        true => *speeds.select_nth_unstable_by(place, f32::total_cmp).1,
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tracks() -> Tracks {
        // The second moves to the right, twice as fast in the end; the third hides behind it.
        let positions = [0.0, 0.2, 0.6]
            .map(|x| vec![[0.0, 0.0, 3.0], [x, 0.0, 2.0], [x, 0.0, 4.0]])
            .to_vec();
        Tracks {
            times: vec![0.0, 0.5, 1.0],
            fastest: fastest(&positions),
            positions,
        }
    }

    #[test]
    fn a_click_finds_the_nearest_to_the_eye() {
        let camera = Camera::new(50.0, 50.0, 40.0, 30.0, 80, 60);
        let tracks = tracks();
        assert_eq!(tracks.pick(&camera, 0.0, [40.0, 30.0]), Some(1));
        assert_eq!(tracks.pick(&camera, 1.0, [40.0, 30.0]), Some(0));
        assert_eq!(tracks.pick(&camera, 1.0, [55.0, 30.0]), Some(1));
        assert_eq!(tracks.pick(&camera, 1.0, [10.0, 50.0]), None);
    }

    #[test]
    fn a_track_is_the_way_of_one() {
        let tracks = tracks();
        let way: Vec<_> = tracks
            .track(1)
            .map(|(time, at)| (time, at[0] as f32))
            .collect();
        assert_eq!(way, [(0.0, 0.0), (0.5, 0.2), (1.0, 0.6)]);
        assert!((tracks.fastest - 0.8).abs() < 1e-6, "{}", tracks.fastest);
    }
}
