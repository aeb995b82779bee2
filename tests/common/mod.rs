//! What the tests across crates share.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor};

/// The devices of the enabled backends by name.
#[cfg_attr(
    feature = "ndarray",
    expect(
        deprecated,
        reason = "burn-ndarray gives way to burn-flex; users still ask for it"
    )
)]
pub fn devices() -> Vec<(&'static str, Device)> {
    vec![
        #[cfg(feature = "ndarray")]
        ("ndarray", Device::ndarray()),
        #[cfg(feature = "flex")]
        ("flex", Device::flex()),
        #[cfg(feature = "wgpu")]
        (
            "wgpu",
            Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        ),
        #[cfg(feature = "cuda")]
        ("cuda", Device::cuda(0)),
    ]
}

/// A tensor's values, all of them finite.
#[track_caller]
pub fn host<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    let values = tensor.into_data().try_into_vec::<f32>().expect("f32");
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        panic!("value {index} is {}", values[index]);
    }
    values
}

/// The same values in the precision of the references.
pub fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// A file or folder of the test data, which is not part of the repository: below the folder that the variable
/// `DASH_TEST_DATA` names. `None` without the variable.
///
/// # Panics
/// When the variable is set and the data is missing.
pub fn test_data(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("DASH_TEST_DATA") else {
        eprintln!("DASH_TEST_DATA is not set: {name} is not tried");
        return None;
    };
    let path = Path::new(&folder).join(name);
    assert!(
        path.exists(),
        "{}: not there; DASH_TEST_DATA must name the folder of the test data",
        path.display()
    );
    Some(path)
}
