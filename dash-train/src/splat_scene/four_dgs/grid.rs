//! The grids on which the file has its values.

use fourdgs::GaussianSet;
use fourdgs::quantization::{
    Bounds, DEFAULT_CUTOFF, Profile, Steps, dequantize_rotation, life_class, motion_step,
    quantize_rotation, support_k,
};

/// How finely values are rounded.
pub(super) const PROFILE: Profile = Profile::Fine;

/// Puts values on the grids that the file has for them.
///
/// The writer refuses a file in which a value is off by more than half a step, and in single precision a value halfway between two
/// steps is off by a little more.
pub(super) fn snap(set: &mut GaussianSet) {
    let steps_of = |scales: &[f32]| Steps::of(&Bounds::for_profile(PROFILE, median(scales)));
    let put = |value: &mut f32, origin: f64, step: f64| {
        let bin = ((f64::from(*value) - origin) / step).round();
        *value = (origin + bin * step) as f32;
    };
    // These first: the other grids depend on their median.
    let step = steps_of(&set.scales).scale_log;
    for scale in &mut set.scales {
        let mut log = f64::from(*scale).max(1e-30).ln() as f32;
        put(&mut log, 0.0, step);
        *scale = log.exp();
    }
    let steps = steps_of(&set.scales);
    for axis in 0..3 {
        let values = set.positions.iter_mut().skip(axis).step_by(3);
        let mut values: Vec<&mut f32> = values.collect();
        let origin = values.iter().map(|value| f64::from(**value));
        let origin = origin.fold(f64::INFINITY, f64::min);
        values
            .iter_mut()
            .for_each(|value| put(value, origin, steps.pos));
    }
    for rotation in set.rotations.as_chunks_mut::<4>().0 {
        let (largest, bins) = quantize_rotation(rotation.map(f64::from), steps.rot);
        *rotation = dequantize_rotation(largest, &bins, steps.rot);
    }
    for color in set.colors.as_chunks_mut::<4>().0 {
        let (rgb, opacity) = color.split_at_mut(3);
        rgb.iter_mut().for_each(|value| put(value, 0.0, steps.rgb));
        put(&mut opacity[0], 0.0, steps.alpha);
    }
    let cutoff = support_k(DEFAULT_CUTOFF);
    let windows = set.win_lo.iter().zip(&set.win_hi);
    let motions = set.motions.as_chunks_mut::<3>().0.iter_mut();
    for (motion, (lo, hi)) in motions.zip(windows) {
        let length = f64::from(*hi) - f64::from(*lo);
        let class = life_class(0, steps.sigma_log, true, length, cutoff);
        let step = motion_step(class, steps.motion);
        motion.iter_mut().for_each(|value| put(value, 0.0, step));
    }
}

/// The median as the writer takes it.
fn median(values: &[f32]) -> f64 {
    let mut values: Vec<f64> = values.iter().map(|value| f64::from(*value)).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 1.0,
        n if n % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}
