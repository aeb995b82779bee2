//! The devices that this crate's tests run on.

use burn::tensor::Device;

/// A device of each backend in this build.
#[cfg_attr(
    feature = "ndarray",
    expect(
        deprecated,
        reason = "burn-ndarray gives way to burn-flex; users still ask for it"
    )
)]
pub(crate) fn devices() -> Vec<Device> {
    vec![
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
        #[cfg(feature = "flex")]
        Device::flex(),
        #[cfg(feature = "wgpu")]
        Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "cuda")]
        Device::cuda(0),
    ]
}
