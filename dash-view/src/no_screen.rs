//! A build without wgpu: scene and window share no GPU.

use burn::tensor::{Device, DeviceKind};
use dash_model::ModelError;
use eframe::egui_wgpu::WgpuSetupExisting;
use eframe::wgpu;

use crate::ViewError;
use crate::draw::Shown;

/// A GPU that scene and window share; there is none in a build without the feature `wgpu`.
#[derive(Debug, Clone)]
pub enum Screen {}

impl Screen {
    /// Opens an adapter for Burn and for a window.
    ///
    /// # Errors
    /// Always: this build has no wgpu.
    pub fn open(_kind: DeviceKind) -> Result<(Device, Self), ViewError> {
        let missing = "a build without the feature `wgpu` shares no GPU";
        Err(ViewError::Window(missing.into()))
    }

    pub(crate) fn setup(&self) -> WgpuSetupExisting {
        match *self {}
    }

    /// The picture as a texture of this GPU.
    ///
    /// # Errors
    /// None: there is no such GPU.
    pub fn texture(&self, _shown: &Shown) -> Result<Option<wgpu::Texture>, ModelError> {
        match *self {}
    }
}
