//! Largest buffer of a device.

use std::sync::Mutex;

use burn::tensor::Device;

use crate::KernelError;

/// Bytes of a value: all tensors of this crate are `f32`.
const VALUE_BYTES: usize = 4;

/// The largest buffer that the device binds, in bytes; `None` where memory alone is the limit, as
/// on the CPU.
pub fn largest_buffer_bytes(device: &Device) -> Option<u64> {
    static KNOWN: Mutex<Vec<(Device, Option<u64>)>> = Mutex::new(Vec::new());
    let mut known = KNOWN
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some((_, limit)) = known.iter().find(|(other, _)| other == device) {
        return *limit;
    }
    let limit = ask(device);
    known.push((device.clone(), limit));
    limit
}

#[cfg(feature = "cube")]
fn ask(device: &Device) -> Option<u64> {
    use burn::backend::Autodiff;
    use burn::tensor::Tensor;
    use burn_cubecl::CubeBackend;

    let probe = Tensor::<1>::zeros([1], device);
    let tensor = match probe.clone().try_into_primitive::<CubeBackend>() {
        Ok(tensor) => tensor,
        Err(_) => {
            let tracked = probe.try_into_primitive::<Autodiff<CubeBackend>>().ok()?;
            tracked.into_parts().0
        }
    };
    // Kernels count values in 32 bits.
    let countable = u64::from(u32::MAX) * VALUE_BYTES as u64;
    Some(crate::cube::largest_buffer(&tensor.client).min(countable))
}

#[cfg(not(feature = "cube"))]
fn ask(_: &Device) -> Option<u64> {
    None
}

/// Refuses a tensor of `n_values` that the device can't bind.
///
/// # Errors
/// [`KernelError::Limit`], naming `what` is too large and what the `remedy` is.
///
/// # Example
/// ```
/// use burn::tensor::Device;
/// use dash_kernels::limits::{check_values, largest_buffer_bytes};
///
/// // Memory is the only limit of a CPU.
/// let device = Device::flex();
/// assert_eq!(largest_buffer_bytes(&device), None);
/// assert!(check_values("the table", 1 << 30, "lower `log2_hashmap_size`", &device).is_ok());
/// ```
pub fn check_values(
    what: &'static str,
    n_values: usize,
    remedy: &'static str,
    device: &Device,
) -> Result<(), KernelError> {
    let bytes = n_values.saturating_mul(VALUE_BYTES) as u64;
    match largest_buffer_bytes(device) {
        Some(limit) if bytes > limit => Err(KernelError::Limit {
            what,
            bytes,
            limit,
            remedy,
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::devices;

    #[test]
    fn what_does_not_fit_is_refused_with_the_limit_and_a_way_out() {
        for device in devices() {
            for device in [device.clone(), device.autodiff()] {
                let Some(limit) = largest_buffer_bytes(&device) else {
                    assert!(check_values("a table", usize::MAX, "lower it", &device).is_ok());
                    continue;
                };
                let n = limit as usize / VALUE_BYTES;
                assert!(check_values("a table", n, "lower it", &device).is_ok());
                let error = check_values("a table", n + 1, "lower it", &device);
                let message = error.expect_err("one too many").to_string();
                assert!(
                    message.contains("a table")
                        && message.contains(&limit.to_string())
                        && message.contains("lower it"),
                    "{message}"
                );
            }
        }
    }

    #[test]
    #[cfg(feature = "wgpu")]
    fn a_gpu_has_a_limit() {
        let device = Device::wgpu(burn::tensor::DeviceKind::DefaultDevice);
        assert!(largest_buffer_bytes(&device).is_some());
    }
}
