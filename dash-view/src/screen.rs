//! A GPU that draws the scene and the window alike, so that a picture never leaves it.

use burn::tensor::wgpu::{WgpuSetup, wgpu};
use burn::tensor::{Device, DeviceKind};
use dash_kernels::rgba8::wgpu_buffer;
use dash_model::ModelError;
use eframe::egui_wgpu::WgpuSetupExisting;

use crate::ViewError;
use crate::draw::Shown;

/// Bytes that a row of pixels is a multiple of where a GPU copies it into a texture.
const ROW_BYTES: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;
/// Bytes of a pixel.
const PIXEL_BYTES: usize = 4;

/// A GPU that scene and window share: one device, one queue.
#[derive(Debug, Clone)]
pub struct Screen {
    setup: WgpuSetup,
}

impl Screen {
    /// Opens an adapter that nothing uses yet, for Burn and for a window.
    ///
    /// # Errors
    /// When the adapter can't be used, or Burn uses it already.
    pub fn open(kind: DeviceKind) -> Result<(Device, Self), ViewError> {
        let options = Device::wgpu_options().device_kind(kind);
        let (device, setup) = options
            .init_with_setup()
            .map_err(|error| ViewError::Window(error.to_string()))?;
        Ok((device, Self { setup }))
    }

    /// What the window is to be made with.
    pub(crate) fn setup(&self) -> WgpuSetupExisting {
        let setup = self.setup.clone();
        WgpuSetupExisting {
            instance: setup.instance,
            adapter: setup.adapter,
            device: setup.device,
            queue: setup.queue,
        }
    }

    /// The picture as a texture of this GPU, which stays there; `None` of a picture that another device draws. Waits for
    /// the device.
    ///
    /// # Errors
    /// [`ModelError`] when packing fails.
    pub fn texture(&self, shown: &Shown) -> Result<Option<wgpu::Texture>, ModelError> {
        let [width, height] = shown.size();
        let pitch = width.next_multiple_of(ROW_BYTES / PIXEL_BYTES);
        let pixels = shown.packed(pitch)?;
        let Some((buffer, offset)) = wgpu_buffer(&pixels) else {
            return Ok(None);
        };
        let WgpuSetup { device, queue, .. } = &self.setup;
        let size = wgpu::Extent3d {
            width: width as u32,
            height: height as u32,
            depth_or_array_layers: 1,
        };
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            // What egui takes.
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let rows = wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset,
                bytes_per_row: Some((pitch * PIXEL_BYTES) as u32),
                rows_per_image: None,
            },
        };
        let mut commands =
            device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        commands.copy_buffer_to_texture(rows, texture.as_image_copy(), size);
        queue.submit([commands.finish()]);
        // The pixels' memory is theirs until they are copied; and who asks for pictures faster than the GPU draws has to wait.
        pixels
            .device()
            .sync()
            .map_err(|error| ModelError::Device(error.to_string()))?;
        Ok(Some(texture))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use dash_kernels::Camera;
    use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};

    use super::*;
    use crate::draw::{SpeedColors, ViewLayer, show};

    fn scene(device: &Device) -> DynamicScene {
        let points = [[0.0, 0.0, 2.0], [0.3, 0.1, 2.5], [-0.4, -0.2, 3.0]];
        let colors = [[0.9, 0.3, 0.1], [0.1, 0.8, 0.4], [0.2, 0.3, 1.0]];
        let mut rows = GaussianRows::from_points(&points, &colors, 0, 0.2);
        rows.opacity_logits = vec![2.0; 3];
        DynamicScene {
            static_set: Gaussians::from_rows(&rows, device),
            dynamic: None,
            settings: SceneSettings::default(),
        }
    }

    /// A texture's bytes, row by row.
    fn read(screen: &Screen, texture: &wgpu::Texture) -> Vec<u8> {
        let WgpuSetup { device, queue, .. } = &screen.setup;
        let row = texture.width() as usize * PIXEL_BYTES;
        let pitch = row.next_multiple_of(ROW_BYTES);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: (pitch * texture.height() as usize) as u64,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let rows = wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(pitch as u32),
                rows_per_image: None,
            },
        };
        let mut commands =
            device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        commands.copy_texture_to_buffer(texture.as_image_copy(), rows, texture.size());
        queue.submit([commands.finish()]);
        let (done, mapped) = channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = done.send(result);
        });
        device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device works");
        mapped.recv().expect("an answer").expect("is mapped");
        let bytes = buffer.get_mapped_range(..).expect("is mapped");
        bytes
            .chunks(pitch)
            .flat_map(|padded| &padded[..row])
            .copied()
            .collect()
    }

    /// Widths on both sides of a row that needs no margin, and pictures one after the other in the same memory.
    #[test]
    fn a_texture_holds_the_picture_and_other_devices_have_none() {
        let (device, screen) = Screen::open(DeviceKind::DefaultDevice).expect("an adapter");
        let colors = SpeedColors::new(0.0, 1);
        for (width, layer) in [
            (64, ViewLayer::Full),
            (65, ViewLayer::Ellipsoids),
            (301, ViewLayer::Depth),
            (17, ViewLayer::Alpha),
        ] {
            let camera = Camera::new(60.0, 60.0, 0.5 * width as f64, 20.0, width, 40);
            let shown = show(&scene(&device), &camera, 0.0, layer, &colors).expect("draws");
            let texture = screen.texture(&shown).expect("copies").expect("a texture");
            let frame = shown.frame().expect("copies");
            assert_eq!([texture.width(), texture.height()], [width as u32, 40]);
            assert!(read(&screen, &texture) == frame.rgba, "{layer}");
            assert!(frame.rgb().iter().any(|&v| v > 100), "{layer}");
        }
        let camera = Camera::new(60.0, 60.0, 32.0, 20.0, 64, 40);
        for device in dash_kernels::testing::devices() {
            let shown = show(&scene(&device), &camera, 0.0, ViewLayer::Full, &colors);
            let texture = screen.texture(&shown.expect("draws")).expect("copies");
            let is_host = !format!("{device:?}").contains("Wgpu");
            assert_eq!(texture.is_none(), is_host, "{device:?}");
        }
    }
}
