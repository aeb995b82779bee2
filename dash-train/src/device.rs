//! Devices by the names that the command line and `config.toml` give them.

use std::fmt;
use std::str::FromStr;

use burn::tensor::Device;

use crate::TrainError;

/// What [`DeviceChoice::Auto`] stands for: the CPU backend whose training steps took less time.
const AUTO: DeviceChoice = DeviceChoice::Flex;

/// A device as the user names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The fastest device that this build has.
    #[default]
    Auto,
    /// The CPU through `burn-ndarray`.
    NdArray,
    /// The CPU through `burn-flex`.
    Flex,
    /// Any GPU through wgpu.
    Wgpu,
    /// The NVIDIA GPU with this index.
    Cuda(usize),
}

impl DeviceChoice {
    /// The choice with [`DeviceChoice::Auto`] replaced by what it stands for.
    pub fn resolved(self) -> Self {
        match self {
            Self::Auto => AUTO,
            named => named,
        }
    }

    /// The device itself.
    ///
    /// # Errors
    /// [`TrainError::Device`] when this build has no backend for it.
    pub fn device(self) -> Result<Device, TrainError> {
        let refuse = |found: &str| {
            Err(TrainError::Device {
                device: self,
                found: found.into(),
            })
        };
        match self.resolved() {
            #[cfg(feature = "flex")]
            Self::Flex => Ok(Device::flex()),
            #[cfg(not(feature = "flex"))]
            Self::Flex => refuse("a build without the feature `flex`"),
            #[cfg(feature = "ndarray")]
            Self::NdArray => Ok(ndarray()),
            #[cfg(not(feature = "ndarray"))]
            Self::NdArray => refuse("a build without the feature `ndarray`"),
            Self::Auto | Self::Wgpu | Self::Cuda(_) => refuse("a build without GPU backends"),
        }
    }
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
        }
    }
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let unknown = || format!("expected auto, ndarray, flex, wgpu or cuda[:N], found `{name}`");
        match name {
            "auto" => Ok(Self::Auto),
            "ndarray" => Ok(Self::NdArray),
            "flex" => Ok(Self::Flex),
            "wgpu" => Ok(Self::Wgpu),
            "cuda" => Ok(Self::Cuda(0)),
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
        for name in ["auto", "ndarray", "flex", "wgpu", "cuda:3"] {
            let choice: DeviceChoice = name.parse().expect("a known name");
            assert_eq!(choice.to_string(), name);
        }
        assert_eq!("cuda".parse(), Ok(DeviceChoice::Cuda(0)));
        for bad in ["", "gpu", "cuda:", "cuda:x", "cuda:-1", "Flex"] {
            assert!(bad.parse::<DeviceChoice>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_gpu_is_refused_with_a_way_out() {
        let refused = DeviceChoice::Wgpu
            .device()
            .expect_err("no GPU backend in this build");
        let message = refused.to_string();
        assert!(
            message.contains("wgpu") && message.contains("--device auto"),
            "{message}"
        );
        assert!(DeviceChoice::Auto.device().is_ok());
    }
}
