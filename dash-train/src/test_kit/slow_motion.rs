//! A clip in which something moves slowly, or nothing does, with the noise of a sensor.

use std::path::PathBuf;

use dash_kernels::Camera;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::dataset::{Dataset, Layout, View};

const SIZE: [usize; 2] = [160, 120];
/// Side of the square that moves, pixels.
const SIDE: f64 = 24.0;

/// A clip of a camera that stands still.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlowClip {
    pub(crate) n_frames: usize,
    /// How far the square goes from frame to frame, pixels.
    pub(crate) speed: f64,
    /// Standard deviation of each channel, of 255.
    pub(crate) noise: f64,
}

impl SlowClip {
    /// Its only camera's views.
    pub(crate) fn dataset(self) -> Dataset {
        let mut rng = Pcg64::seed_from_u64(self.n_frames as u64);
        let [width, height] = SIZE;
        let (w, h) = (width as f64, height as f64);
        let camera = Camera::new(w, w, 0.5 * w, 0.5 * h, width, height);
        let views = (0..self.n_frames).map(|frame| {
            let pixels = self.picture(frame, &mut rng);
            let time = frame as f32 / (self.n_frames - 1).max(1) as f32;
            View {
                frame,
                ..View::from_rgb8("cam00", camera.clone(), time, pixels)
            }
        });
        Dataset {
            name: "slow".into(),
            root: PathBuf::new(),
            layout: Layout::N3dv,
            views: views.collect(),
            points: None,
            n_frames: self.n_frames,
            n_cameras: 1,
            stated_span: None,
            frame_rate: None,
            background: None,
        }
    }

    fn picture(self, frame: usize, rng: &mut Pcg64) -> Vec<u8> {
        let left = 40.0 + self.speed * frame as f64;
        let mut pixels = Vec::with_capacity(SIZE[0] * SIZE[1] * 3);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let (x, y) = (x as f64, y as f64);
                let cover = |at: f64, from: f64| {
                    (at + 1.0 - from).clamp(0.0, 1.0) * (from + SIDE - at).clamp(0.0, 1.0)
                };
                let share = cover(x, left) * cover(y, 50.0);
                let wall = 0.45 + 0.15 * (0.21 * x).sin() * (0.17 * y).cos();
                let square = 0.55 + 0.15 * (0.5 * (x - left)).sin();
                let value = 255.0 * (share * square + (1.0 - share) * wall);
                for _ in 0..3 {
                    pixels.push((value + self.noise * normal(rng)).round() as u8);
                }
            }
        }
        pixels
    }
}

/// The sum of twelve even values, less its mean.
fn normal(rng: &mut Pcg64) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// Slow clips at the rates of cameras, a second each, and the same at rest: beside whether they move.
pub(crate) fn slow_clips() -> impl Iterator<Item = (SlowClip, bool)> {
    let clip = |n_frames, speed, noise| SlowClip {
        n_frames,
        speed,
        noise,
    };
    let rates = [24, 60, 240];
    rates.into_iter().flat_map(move |n_frames| {
        [0.0, 1.5, 4.0, 8.0].into_iter().flat_map(move |noise| {
            [
                (clip(n_frames, 0.2, noise), true),
                (clip(n_frames, 0.0, noise), false),
            ]
        })
    })
}
