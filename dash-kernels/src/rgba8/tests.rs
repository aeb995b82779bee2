use burn::tensor::{Device, Int, Tensor, TensorData};
use rand::Rng;

use super::{from_bytes, rgba8};
use crate::testing::{devices, poison, rng, tensor, uniform, values};

/// What the operation says it does, one pixel at a time.
fn reference(values: &[f32], [height, width, channels]: [usize; 3], pitch: usize) -> Vec<u8> {
    let level = |value: f32| match f64::from(value) {
        value if value.is_finite() => (value.clamp(0.0, 1.0) * 255.0).round() as u8,
        _ => 0,
    };
    let mut bytes = vec![0; height * pitch * 4];
    for row in 0..height {
        for column in 0..width {
            let pixel = &values[(row * width + column) * channels..][..channels];
            let color = match channels {
                1 | 2 => [pixel[0]; 3],
                _ => [pixel[0], pixel[1], pixel[2]],
            };
            let place = (row * pitch + column) * 4;
            bytes[place..place + 3].copy_from_slice(&color.map(level));
            bytes[place + 3] = 255;
        }
    }
    bytes
}

fn packed(values: &[f32], shape: [usize; 3], pitch: usize, device: &Device) -> Vec<u8> {
    let pixels = rgba8(tensor(values, shape, device), pitch).expect("packs");
    assert_eq!(pixels.dims(), [shape[0], pitch]);
    pixels.into_data().as_bytes().to_vec()
}

#[test]
fn every_backend_packs_as_the_reference() {
    let mut rng = rng(3);
    for channels in [1, 2, 3, 4, 5, 7] {
        // Rows on both sides of a piece's length, pitches with and without a margin.
        for (height, width, margin) in [
            (1, 1, 0),
            (3, 5, 3),
            (37, 64, 0),
            (2, 40_001, 63),
            (300, 257, 7),
        ] {
            let mut values = uniform(&mut rng, height * width * channels, -0.2, 1.2);
            for special in poison() {
                let place = rng.random_range(0..values.len());
                values[place] = special;
            }
            let shape = [height, width, channels];
            let expected = reference(&values, shape, width + margin);
            for device in devices() {
                let found = packed(&values, shape, width + margin, &device);
                // A value halfway between two levels may go either way: 0.5 is added in f32.
                let wrong = found
                    .iter()
                    .zip(&expected)
                    .position(|(a, b)| a.abs_diff(*b) > 1);
                assert_eq!(wrong, None, "{device:?}, {shape:?}");
                let apart = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
                assert!(
                    apart * 10_000 <= found.len(),
                    "{device:?}, {shape:?}: {apart} differ"
                );
            }
        }
    }
}

#[test]
fn each_level_comes_back() {
    let values: Vec<f32> = (0..=255u8).map(|level| f32::from(level) / 255.0).collect();
    let expected: Vec<u8> = (0..=255u8).flat_map(|v| [v, v, v, 255]).collect();
    for device in devices() {
        assert_eq!(
            packed(&values, [2, 128, 1], 128, &device),
            expected,
            "{device:?}"
        );
    }
}

#[test]
fn a_strided_view_is_read_as_such() {
    for device in devices() {
        let whole = tensor(
            &[0.0, 1.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.0],
            [1, 2, 4],
            &device,
        );
        let columns = whole.narrow(2, 1, 3);
        let bytes = rgba8(columns, 2).expect("packs").into_data();
        assert_eq!(
            bytes.as_bytes(),
            [255, 51, 102, 255, 204, 255, 0, 255],
            "{device:?}"
        );
    }
}

#[test]
fn empty_pictures_have_no_pixels_and_no_channels_are_refused() {
    for device in devices() {
        for shape in [[0, 4, 3], [0, 0, 1]] {
            assert!(packed(&[], shape, 64, &device).is_empty());
        }
        assert_eq!(packed(&[], [2, 0, 5], 1, &device), [0; 8]);
        let empty = |shape| Tensor::<3>::zeros(shape, &device);
        for (shape, pitch) in [([2, 2, 0], 2), ([1, 3, 3], 2)] {
            let error = rgba8(empty(shape), pitch)
                .expect_err("is refused")
                .to_string();
            assert!(error.contains("rgba8: `image` has shape"), "{error}");
        }
    }
}

#[cfg(feature = "wgpu")]
#[test]
fn a_gpu_shows_its_buffer_and_a_cpu_has_none() {
    for device in devices() {
        let picture = tensor(&[1.0; 64 * 3], [1, 64, 3], &device);
        let buffer = super::wgpu_buffer(&rgba8(picture, 64).expect("packs"));
        let is_gpu = format!("{device:?}").contains("Wgpu");
        assert_eq!(buffer.is_some(), is_gpu, "{device:?}");
        if let Some((buffer, offset)) = buffer {
            assert!(offset + 64 * 4 <= buffer.size());
        }
    }
}

#[test]
fn bytes_become_numbers_whatever_their_place_in_a_word() {
    let bytes: Vec<u8> = (0..=255).cycle().take(1_023).collect();
    for device in devices() {
        for n in [1, 2, 3, 4, 5, 1_020, 1_023] {
            let words = bytes.chunks(4).map(|chunk| {
                let mut word = [0; 4];
                word[..chunk.len()].copy_from_slice(chunk);
                i32::from_le_bytes(word)
            });
            let words: Vec<i32> = words.collect();
            let shape = [words.len()];
            let words = Tensor::<1, Int>::from_data(TensorData::new(words, shape), &device);
            let found = values(from_bytes(words, n).expect("as many"));
            assert_eq!(found.len(), n);
            for (found, byte) in found.iter().zip(&bytes) {
                let expected = f32::from(*byte) / 255.0;
                // A division on a GPU may be off by 2.5 units in the last place (WGSL).
                let off = (found - expected).abs();
                assert!(
                    off <= 2.5 * f32::EPSILON * expected,
                    "{device:?}: {byte} {found}"
                );
            }
        }
        let words = || Tensor::<1, Int>::zeros([2], &device);
        assert!(from_bytes(words(), 8).is_ok());
        assert!(from_bytes(words(), 9).is_err() && from_bytes(words(), 0).is_err());
    }
}
