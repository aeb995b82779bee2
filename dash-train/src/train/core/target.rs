//! The picture that a step is judged by, on the step's device.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dash_kernels::limits;
use dash_kernels::rgba8::from_bytes;

use crate::Error;
use crate::dataset::View;

/// Values from which on a picture goes to a GPU as bytes, a quarter of what they are as numbers: of smaller ones, the
/// launches that unpack them would cost more.
const LARGE: usize = 1 << 19;
/// Bytes of a word.
const BYTES: usize = 4;

/// The picture of a view `[H, W, 3]`, where it goes to its device as bytes; `None` where it is smaller or has
/// transparent pixels or some that do not count, and on a CPU.
///
/// # Errors
/// When the image is read only now and is damaged or gone.
pub(super) fn as_bytes(view: &View, device: &Device) -> Result<Option<Tensor<3>>, Error> {
    let shape = [view.camera.height, view.camera.width, 3];
    let is_large = shape.iter().product::<usize>() >= LARGE;
    if !is_large || limits::largest_buffer_bytes(device).is_none() {
        return Ok(None);
    }
    let unpacked = |bytes: &[u8]| unpack(bytes, shape, device);
    view.with_plain_rgb(unpacked)
}

/// Bytes as numbers in [0, 1], on an autodiff device.
fn unpack(bytes: &[u8], shape: [usize; 3], device: &Device) -> Tensor<3> {
    let (whole, rest) = bytes.as_chunks::<BYTES>();
    let mut words: Vec<i32> = whole.iter().map(|&word| i32::from_le_bytes(word)).collect();
    if !rest.is_empty() {
        let mut word = [0; BYTES];
        word[..rest.len()].copy_from_slice(rest);
        words.push(i32::from_le_bytes(word));
    }
    let n_words = words.len();
    let device = device.clone().inner();
    let words = Tensor::<1, Int>::from_data(TensorData::new(words, [n_words]), &device);
    let numbers = from_bytes(words, bytes.len()).expect("words of all bytes");
    Tensor::from_inner(numbers.reshape(shape))
}

#[cfg(test)]
mod tests {
    use dash_kernels::Camera;
    use dash_kernels::testing::devices;

    use super::*;
    use crate::train::core::to_host;

    #[test]
    fn bytes_become_the_numbers_that_a_view_has() {
        // Of each number of bytes beyond whole words, and all values of a byte in each place of a word.
        for width in [341, 342, 343, 344] {
            let camera = Camera::new(1.0, 1.0, 1.0, 1.0, width, 1);
            let pixels: Vec<u8> = (0..3 * width).map(|i| (i * 61 + i / 256) as u8).collect();
            let view = View::from_rgb8("made", camera, 0.0, pixels.clone());
            let expected = view.rgb([0.0; 3]).expect("in memory");
            for device in devices() {
                let found = to_host(unpack(&pixels, [1, width, 3], &device));
                assert_eq!(found.len(), expected.len());
                // A division on a GPU may be off by 2.5 units in the last place (WGSL).
                let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 2.5 * f32::EPSILON * b;
                assert!(found.iter().zip(&expected).all(close), "{device:?}");
            }
        }
    }

    #[test]
    fn only_a_gpu_takes_bytes_and_only_of_large_pictures() {
        let of = |width: usize, height: usize, device: &Device| {
            let camera = Camera::new(1.0, 1.0, 1.0, 1.0, width, height);
            let view = View::from_rgb8("made", camera, 0.0, vec![51; 3 * width * height]);
            as_bytes(&view, device).expect("in memory")
        };
        assert!(of(512, 512, &Device::flex()).is_none());
        #[cfg(feature = "wgpu")]
        {
            let device = Device::wgpu(burn::tensor::DeviceKind::DefaultDevice);
            assert!(of(32, 32, &device.clone().autodiff()).is_none());
            let picture = of(512, 512, &device.autodiff()).expect("large");
            assert_eq!(picture.dims(), [512, 512, 3]);
            assert!(to_host(picture).iter().all(|v| (v - 0.2).abs() < 1e-6));
        }
    }
}
