//! Devices by the names that the command line and `config.toml` give them.

use std::env::temp_dir;
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use std::sync::OnceLock;
use std::time::Duration;

use burn::tensor::{Device, DeviceKind, Tensor};

use crate::Error;
use crate::jobs::Hold;

/// How long to wait before GPUs that others have taken are looked at again.
const PAUSE: Duration = Duration::from_millis(500);

/// A device as the user names it.
///
/// ```
/// use dash_train::device::DeviceChoice;
///
/// assert_eq!("cuda:1".parse(), Ok(DeviceChoice::Cuda(1)));
/// assert!("abacus".parse::<DeviceChoice>().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// A real GPU where there is one, else the CPU; never a GPU emulated in software.
    #[default]
    Auto,
    /// The CPU through `burn-ndarray`.
    NdArray,
    /// The CPU through `burn-flex`.
    Flex,
    /// A GPU through wgpu, emulated in software where there is none.
    Wgpu,
    /// The NVIDIA GPU with this index.
    Cuda(usize),
    /// An NVIDIA GPU that no other process of this machine has taken by this name.
    CudaAll,
}

impl DeviceChoice {
    /// The choice, with [`DeviceChoice::Auto`] replaced by this machine's device, and [`DeviceChoice::CudaAll`] by a GPU that
    /// is this process's from then on; waits until one is free.
    pub fn resolved(self) -> Self {
        static AUTO: OnceLock<DeviceChoice> = OnceLock::new();
        match self {
            Self::Auto => *AUTO.get_or_init(|| {
                if first_cuda_works() {
                    Self::Cuda(0)
                } else if wgpu_gpu().is_some() {
                    Self::Wgpu
                } else if cfg!(feature = "flex") {
                    Self::Flex
                } else {
                    Self::NdArray
                }
            }),
            Self::CudaAll => {
                static FREE: OnceLock<usize> = OnceLock::new();
                Self::Cuda(*FREE.get_or_init(|| free_of(cuda_devices().len(), &temp_dir())))
            }
            named => named,
        }
    }

    /// The device itself.
    ///
    /// # Errors
    /// [`Error::Device`] when this build has no backend for it, or this machine no such
    /// device.
    pub fn device(self) -> Result<Device, Error> {
        let found = match self.resolved() {
            #[cfg(feature = "flex")]
            Self::Flex => return Ok(Device::flex()),
            #[cfg(feature = "ndarray")]
            Self::NdArray => return Ok(ndarray()),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => match wgpu_gpu().or_else(wgpu_software) {
                Some(adapter) => return Ok(Device::wgpu(adapter)),
                None => "no adapter that wgpu can use; is a Vulkan driver installed?".into(),
            },
            #[cfg(feature = "cuda")]
            Self::Cuda(index) => {
                let devices = cuda_devices();
                match devices.get(index).map(|device| (device, computes(device))) {
                    Some((device, Ok(()))) => return Ok(device.clone()),
                    Some((_, Err(cause))) => format!("a GPU that can't compute: {cause}"),
                    None => format!("{} CUDA devices on this machine", devices.len()),
                }
            }
            missing => format!("a build without the feature `{}`", missing.feature()),
        };
        Err(Error::Device {
            device: self,
            found,
        })
    }

    /// The adapter of a choice that wgpu serves; `None` of another choice, and where there is no adapter.
    pub fn adapter(self) -> Option<DeviceKind> {
        match self.resolved() {
            Self::Wgpu => wgpu_gpu().or_else(wgpu_software),
            _ => None,
        }
    }

    /// The feature of this crate that brings the device.
    fn feature(self) -> &'static str {
        match self {
            Self::Auto | Self::Flex => "flex",
            Self::NdArray => "ndarray",
            Self::Wgpu => "wgpu",
            Self::Cuda(_) | Self::CudaAll => "cuda",
        }
    }
}

/// Every adapter that wgpu can use, software included.
fn wgpu_devices() -> Vec<Device> {
    #[cfg(feature = "wgpu")]
    return Device::enumerate(burn::tensor::DeviceType::Wgpu).into_vec();
    #[cfg(not(feature = "wgpu"))]
    Vec::new()
}

/// The strongest adapter that is no software.
fn wgpu_gpu() -> Option<DeviceKind> {
    wgpu_first(&[
        DeviceKind::DiscreteGpu(0),
        DeviceKind::IntegratedGpu(0),
        DeviceKind::VirtualGpu(0),
    ])
}

/// An adapter in software, or of a kind that wgpu can't name.
fn wgpu_software() -> Option<DeviceKind> {
    wgpu_first(&[DeviceKind::Cpu]).or_else(|| {
        let any = !wgpu_devices().is_empty();
        any.then_some(DeviceKind::DefaultDevice)
    })
}

/// The first of these kinds that there is an adapter of.
#[cfg(feature = "wgpu")]
fn wgpu_first(kinds: &[DeviceKind]) -> Option<DeviceKind> {
    let devices = wgpu_devices();
    let is_there = |kind: &&DeviceKind| devices.contains(&Device::wgpu((*kind).clone()));
    kinds.iter().find(is_there).cloned()
}

#[cfg(not(feature = "wgpu"))]
fn wgpu_first(_kinds: &[DeviceKind]) -> Option<DeviceKind> {
    None
}

/// Every CUDA device.
fn cuda_devices() -> Vec<Device> {
    #[cfg(feature = "cuda")]
    return Device::enumerate(burn::tensor::DeviceType::Cuda).into_vec();
    #[cfg(not(feature = "cuda"))]
    Vec::new()
}

/// The first of `n` GPUs that no other process holds in `folder`, held by this one until it ends; waits for one. Where they
/// can't be held, or there is none, the first.
fn free_of(n: usize, folder: &Path) -> usize {
    if n == 0 {
        return 0;
    }
    let mut is_told = false;
    loop {
        for index in 0..n {
            match Hold::take(&folder.join(format!("dash-cuda-{index}"))) {
                Ok(Some(hold)) => {
                    // The system lets go of it when the process ends.
                    std::mem::forget(hold);
                    return index;
                }
                Ok(None) => {}
                Err(error) => {
                    tracing::warn!("cuda:all is cuda:0: {error}");
                    return 0;
                }
            }
        }
        if !std::mem::replace(&mut is_told, true) {
            tracing::info!("waiting for one of {n} GPUs, which other processes have taken");
        }
        std::thread::sleep(PAUSE);
    }
}

/// Whether there is a CUDA device and it computes; why one does not is told.
fn first_cuda_works() -> bool {
    let devices = cuda_devices();
    let Some(first) = devices.first() else {
        return false;
    };
    let works = computes(first);
    if let Err(cause) = &works {
        tracing::warn!("cuda:0 is left alone, it can't compute: {cause}");
    }
    works.is_ok()
}

/// Tries a kernel that needs a library of functions: CUDA compiles it with the toolkit's, and a driver may come
/// without a toolkit.
fn computes(device: &Device) -> Result<(), String> {
    let tried = Tensor::<1>::ones([1], device).exp().try_into_data();
    tried
        .map(|_| ())
        .map_err(|error| root_cause(&error.to_string()))
}

/// What a report of errors, each on the one before, ends with.
fn root_cause(report: &str) -> String {
    let last = report.rsplit("Caused by:").next().unwrap_or(report);
    let own = last.split("Backtrace:").next().unwrap_or(last);
    let line = own.split_whitespace().collect::<Vec<_>>().join(" ");
    line.trim_end_matches('.').into()
}

#[cfg(feature = "ndarray")]
#[expect(
    deprecated,
    reason = "burn-ndarray gives way to burn-flex; users still ask for it"
)]
fn ndarray() -> Device {
    Device::ndarray()
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::NdArray => f.write_str("ndarray"),
            Self::Flex => f.write_str("flex"),
            Self::Wgpu => f.write_str("wgpu"),
            Self::Cuda(index) => write!(f, "cuda:{index}"),
            Self::CudaAll => f.write_str("cuda:all"),
        }
    }
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let unknown =
            || format!("expected auto, ndarray, flex, wgpu, cuda[:N] or cuda:all, found `{name}`");
        match name {
            "auto" => Ok(Self::Auto),
            "ndarray" => Ok(Self::NdArray),
            "flex" => Ok(Self::Flex),
            "wgpu" => Ok(Self::Wgpu),
            "cuda" => Ok(Self::Cuda(0)),
            "cuda:all" => Ok(Self::CudaAll),
            _ => {
                let index = name.strip_prefix("cuda:").ok_or_else(unknown)?;
                index.parse().map(Self::Cuda).map_err(|_| unknown())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_a_round_trip() {
        for name in ["auto", "ndarray", "flex", "wgpu", "cuda:3", "cuda:all"] {
            let choice: DeviceChoice = name.parse().expect("a known name");
            assert_eq!(choice.to_string(), name);
        }
        assert_eq!("cuda".parse(), Ok(DeviceChoice::Cuda(0)));
        for bad in ["", "gpu", "cuda:", "cuda:x", "cuda:-1", "Flex"] {
            assert!(bad.parse::<DeviceChoice>().is_err(), "{bad}");
        }
    }

    #[test]
    fn each_process_takes_a_gpu_that_is_free() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        assert_eq!(free_of(0, folder.path()), 0);
        assert_eq!(free_of(2, folder.path()), 0);
        assert_eq!(free_of(2, folder.path()), 1);
        // Another process would wait for one of these two.
        let taken = Hold::take(&folder.path().join("dash-cuda-0")).expect("locks");
        assert!(taken.is_none());
        assert_eq!(free_of(3, folder.path()), 2);
    }

    #[test]
    fn a_missing_gpu_is_refused_with_a_way_out() {
        let refused = DeviceChoice::Cuda(99)
            .device()
            .expect_err("no machine has a hundred GPUs");
        let message = refused.to_string();
        assert!(
            message.contains("cuda:99") && message.contains("--device auto"),
            "{message}"
        );
        assert!(DeviceChoice::Auto.device().is_ok());
    }

    #[test]
    fn every_device_here_computes() {
        for choice in [
            DeviceChoice::Flex,
            DeviceChoice::NdArray,
            DeviceChoice::Wgpu,
        ] {
            if let Ok(device) = choice.device() {
                assert_eq!(computes(&device), Ok(()), "{choice}");
            }
        }
    }

    #[test]
    fn of_a_chain_of_errors_the_first_is_told() {
        let report = "A launch error happened\nCaused by:\n  Compiling failed\nCaused by:\n  no libdevice:\n  set \
                      CUDA_PATH.\nBacktrace:\nnone\nAsked at:\nnowhere";
        assert_eq!(root_cause(report), "no libdevice: set CUDA_PATH");
        assert_eq!(root_cause("lost"), "lost");
    }

    #[test]
    fn auto_never_takes_software_for_a_gpu() {
        let auto = DeviceChoice::Auto.resolved();
        let has_gpu = wgpu_gpu().is_some() || first_cuda_works();
        assert_eq!(
            matches!(auto, DeviceChoice::Wgpu | DeviceChoice::Cuda(_)),
            has_gpu
        );
    }
}
