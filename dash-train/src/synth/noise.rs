//! Value noise and random numbers on a lattice.

use glam::DVec3;

/// Smooth noise in [0, 1] on the unit lattice (value noise, quintic blend).
pub fn noise(point: DVec3, seed: u32) -> f64 {
    let cell = point.floor();
    let blend = (point - cell)
        .to_array()
        .map(|t| t * t * t * (t * (6.0 * t - 15.0) + 10.0));
    let [x, y, z] = cell.to_array().map(|c| c as i64);
    let weights = blend.map(|blend| [1.0 - blend, blend]);
    let keys = [
        [x, x.wrapping_add(1)].map(key_x),
        [y, y.wrapping_add(1)].map(key_y),
        [z, z.wrapping_add(1)].map(key_z),
    ];
    let mut value = 0.0;
    for corner in 0..8 {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight = weights[0][i] * weights[1][j] * weights[2][k];
        value += weight * scramble(u64::from(seed) ^ keys[0][i] ^ keys[1][j] ^ keys[2][k]);
    }
    value
}

/// A number in [0, 1) that depends on the lattice point and the seed alone.
pub fn random(x: i64, y: i64, z: i64, seed: u32) -> f64 {
    scramble(u64::from(seed) ^ key_x(x) ^ key_y(y) ^ key_z(z))
}

fn key_x(x: i64) -> u64 {
    (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

fn key_y(y: i64) -> u64 {
    (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
}

fn key_z(z: i64) -> u64 {
    (z as u64).wrapping_mul(0x1656_67b1_9e37_79f9)
}

/// A number in [0, 1) from a key: splitmix64's finaliser.
fn scramble(key: u64) -> f64 {
    let mut h = key;
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((h ^ (h >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_bounded_and_seeded() {
        let step = 1e-3;
        let mut differs = false;
        for i in 0..2000 {
            let p = DVec3::new(0.013 * f64::from(i), 0.37, -0.021 * f64::from(i));
            let (a, b) = (noise(p, 1), noise(p + DVec3::X * step, 1));
            assert!((0.0..=1.0).contains(&a), "{a} at {p}");
            // The quintic's steepest slope is 15/8 per cell.
            assert!((a - b).abs() <= 1.9 * step, "{a} {b} at {p}");
            differs |= (a - noise(p, 2)).abs() > 0.1;
        }
        assert!(differs, "the seed has no effect");
    }
}
