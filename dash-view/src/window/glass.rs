//! The pictures in the window: uploaded, or on the GPU already.

use eframe::egui::{ColorImage, Context, TextureHandle, TextureId, TextureOptions};
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;

use crate::draw::Frame;
use crate::worker::{Drawn, DrawnPicture};

/// The picture in the window.
pub struct Shown {
    pub drawn: Drawn,
    pub picture: TextureId,
    pub captured: Option<TextureHandle>,
    pub difference: Option<TextureHandle>,
    /// What keeps an uploaded picture.
    _uploaded: Option<TextureHandle>,
}

impl Shown {
    /// A picture that was drawn; `None` of one on a GPU that the window is not drawn by.
    pub fn of(drawn: Drawn, ctx: &Context, glass: Option<&mut Glass>) -> Option<Self> {
        let texture = |name: &str, frame: &Frame| {
            let size = [frame.width, frame.height];
            // Opaque, so nothing is to be multiplied.
            let image = ColorImage::from_rgba_premultiplied(size, &frame.rgba);
            ctx.load_texture(name, image, TextureOptions::LINEAR)
        };
        let (picture, uploaded) = match &drawn.picture {
            DrawnPicture::Texture(texture) => (glass?.show(texture), None),
            DrawnPicture::Host(frame) => {
                let uploaded = texture("picture", frame);
                (uploaded.id(), Some(uploaded))
            }
        };
        let beside = drawn.beside.as_ref();
        Some(Self {
            picture,
            captured: beside.map(|beside| texture("captured", &beside.captured)),
            difference: beside.map(|beside| texture("difference", &beside.difference)),
            _uploaded: uploaded,
            drawn,
        })
    }
}

/// Where the window draws, and the picture in it.
pub struct Glass {
    state: RenderState,
    picture: Option<TextureId>,
}

impl Glass {
    pub fn new(state: RenderState) -> Self {
        Self {
            state,
            picture: None,
        }
    }

    /// Puts a texture of the window's device in the place of the last one.
    pub fn show(&mut self, texture: &wgpu::Texture) -> TextureId {
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let (device, filter) = (&self.state.device, wgpu::FilterMode::Linear);
        let mut renderer = self.state.renderer.write();
        match self.picture {
            Some(id) => {
                renderer.update_egui_texture_from_wgpu_texture(device, &view, filter, id);
                id
            }
            None => {
                let id = renderer.register_native_texture(device, &view, filter);
                *self.picture.insert(id)
            }
        }
    }
}
