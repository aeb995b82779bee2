//! Times of ever larger scenes: what a picture and a training step take more of, and what they do not.
//!
//! One number of the scene of [`scene`](super::scene) changes at a time; the others stay as they are there, but for the size
//! of pictures and the number of Gaussians, which a CPU has the time for.

use dash_kernels::limits::largest_buffer_bytes;
use rayon::ThreadPoolBuilder;

use super::scene::{Made, Taken, take_times};
use super::{Bench, Op, Target};
use crate::Error;
use crate::train::Preset;

/// Pixels of a picture.
const SIZE: [usize; 2] = [640, 480];
/// Gaussians, in units of those of the others.
const GAUSSIANS: [(usize, usize); 5] = [(1, 9), (1, 3), (1, 1), (3, 1), (9, 1)];
/// Sides of a picture, in units of those of the others: 0.1 to 8 megapixels.
const SIDES: [f64; 5] = [0.57, 1.0, 1.8, 3.1, 5.1];
/// Percent of the Gaussians that move.
const MOVING: [usize; 5] = [0, 5, 20, 50, 90];
/// Frames of the clip.
const FRAMES: [usize; 4] = [24, 75, 300, 1200];

const NOTE: &str = "`growth`, values: one picture; gradients: one step of training in the 4D stage, between rounds of \
                    density control, with the field of quick";

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let base = Made {
        size: SIZE,
        ..Made::of(n)
    };
    sweep(bench, target, base)
}

/// Times scenes that differ from `base` in one number.
pub(super) fn sweep(bench: &mut Bench, target: Target, base: Made) -> Result<(), Error> {
    for (times, over) in GAUSSIANS {
        let n = base.n * times / over;
        note(bench, target, "Gaussians", n, Made { n, ..base })?;
    }
    for side in SIDES {
        let size = base.size.map(|own| (side * own as f64) as usize);
        note(
            bench,
            target,
            "pixels",
            size[0] * size[1],
            Made { size, ..base },
        )?;
    }
    for moving in MOVING {
        note(
            bench,
            target,
            "percent that moves",
            moving,
            Made { moving, ..base },
        )?;
    }
    for frames in FRAMES {
        note(bench, target, "frames", frames, Made { frames, ..base })?;
    }
    let is_cpu = largest_buffer_bytes(target.device).is_none();
    let all = rayon::current_num_threads();
    let counts = (0..).map(|k| 1 << k).take_while(|&n| n < all);
    for threads in counts.chain([all]).filter(|_| is_cpu) {
        (bench.on_part)(&format!("{}: growth, {threads} threads", target.name));
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|e| Error::Config(format!("{threads} threads: {e}")))?;
        let taken = pool.install(|| take_times(Preset::Quick, base, target.device))?;
        add(bench, target, "threads", threads, taken);
    }
    Ok(())
}

fn note(
    bench: &mut Bench,
    target: Target,
    what: &str,
    value: usize,
    made: Made,
) -> Result<(), Error> {
    (bench.on_part)(&format!("{}: growth, {value} {what}", target.name));
    let taken = take_times(Preset::Quick, made, target.device)?;
    add(bench, target, what, value, taken);
    Ok(())
}

fn add(bench: &mut Bench, target: Target, what: &str, value: usize, taken: Taken) {
    let measurement = |pass| target.measurement(Op::Growth, what, pass, value);
    taken.add_to(bench, NOTE, measurement);
}
