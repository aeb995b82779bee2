use rand::Rng;

use crate::testing::rng;

use super::radix_sort::{DeviceCount, sort_pairs};
use super::scan::exclusive_scan;
use super::*;

/// The device that the CubeCL tests run on.
fn device() -> burn_cubecl::CubeDevice {
    cubecl::Device::default()
}

fn client() -> Client {
    device().client()
}

/// A tensor of the CubeCL backend.
pub(crate) fn cube_tensor<const R: usize>(values: &[f32], shape: [usize; R]) -> CubeTensor {
    let client = client();
    let handle = client.create_from_slice(bytemuck::cast_slice(values));
    CubeTensor::new_contiguous(client, device(), shape.into(), handle, DType::F32)
}

/// Its values.
pub(crate) fn cube_values(tensor: &CubeTensor) -> Vec<f32> {
    assert!(tensor.is_contiguous(), "results are row-major");
    let bytes = tensor
        .client
        .read_one(tensor.handle.clone())
        .expect("the device answers");
    bytemuck::cast_slice(&bytes[..tensor.meta.num_elements() * WORD_BYTES]).to_vec()
}

/// The words of a buffer.
pub(crate) fn words(client: &Client, buffer: &Buffer) -> Vec<u32> {
    let bytes = client
        .read_one(buffer.handle())
        .expect("the device answers");
    bytemuck::cast_slice(&bytes[..buffer.len() * WORD_BYTES]).to_vec()
}

#[test]
fn prefix_sums_of_any_length() {
    let client = client();
    let mut rng = rng(3);
    for n in [0, 1, 15, 16, 63, 1000, 1024, 8192, 8193, 100_000] {
        let values: Vec<u32> = (0..n).map(|_| rng.random_range(0..9)).collect();
        let got = words(
            &client,
            &exclusive_scan(&client, &Buffer::from_words(&client, &values)),
        );
        let mut sum = 0;
        for (i, value) in values.iter().chain([&0]).enumerate() {
            assert_eq!(got[i], sum, "{n} values, place {i}");
            sum += value;
        }
    }
}

#[test]
fn sums_that_outgrow_their_type_stay_at_its_largest_number() {
    let client = client();
    for n in [100, 20_000] {
        let values = vec![u32::MAX / 50; n];
        let got = words(
            &client,
            &exclusive_scan(&client, &Buffer::from_words(&client, &values)),
        );
        assert_eq!(got[50], u32::MAX / 50 * 50);
        assert!(got[51..].iter().all(|&sum| sum == u32::MAX), "{n} values");
    }
}

#[test]
fn sorting_is_stable_and_stops_at_the_count() {
    let client = client();
    let mut rng = rng(4);
    for (n, count, bits) in [
        (0, 0, 32),
        (1, 1, 32),
        (1000, 1000, 32),
        (5000, 4321, 9),
        (70_000, 70_000, 13),
        // On both sides of where cubes sum counts themselves.
        (131_072, 131_072, 7),
        (131_073, 131_000, 17),
        (3000, 9999, 4),
    ] {
        let mask = u32::MAX >> (32 - bits);
        let keys: Vec<u32> = (0..n).map(|_| rng.random::<u32>() & mask).collect();
        let values: Vec<u32> = (0..n).collect();
        let count_buffer = Buffer::from_words(&client, &[7, count]);
        let (sorted_keys, sorted_values) = sort_pairs(
            &client,
            Buffer::from_words(&client, &keys),
            Buffer::from_words(&client, &values),
            &DeviceCount {
                buffer: &count_buffer,
                at: 1,
            },
            bits,
        );
        let used = count.min(n) as usize;
        let mut expected: Vec<(u32, u32)> = keys.into_iter().zip(values).take(used).collect();
        expected.sort_by_key(|&(key, _)| key);
        let got = words(&client, &sorted_keys)
            .into_iter()
            .zip(words(&client, &sorted_values))
            .take(used);
        for (place, (got, expected)) in got.zip(expected).enumerate() {
            assert_eq!(got, expected, "{n} pairs, {bits} bits, place {place}");
        }
    }
}

/// Drivers' limits of 2^31 - 1 bytes can't be used up: a buffer of them would be rounded up beyond.
#[test]
fn largest_buffers_are_whole_pieces() {
    assert_eq!(whole_pieces(1 << 27, 256), 1 << 27);
    assert_eq!(whole_pieces((1 << 31) - 1, 32), (1 << 31) - 512);
    assert_eq!(whole_pieces((1 << 31) - 1, 4096), (1 << 31) - 4096);
}
