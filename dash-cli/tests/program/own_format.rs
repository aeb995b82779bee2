//! A dataset format from outside the crate: one camera that stands still, and a folder of its frames.

use dash_kernels::Camera;
use dash_train::Error;
use dash_train::dataset::{
    Capture, FORMATS, Folder, Format, Layout, LoadOptions, Loader, PlannedView, Reader, load,
    load_with,
};

/// The file that makes a folder this format's; it holds the focal length in pixels.
const FOCAL_FILE: &str = "focal.txt";

struct Tripod;

struct TripodReader {
    images: Vec<String>,
}

impl Format for Tripod {
    fn layout(&self) -> Layout {
        Layout::Custom
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        if !folder.has(FOCAL_FILE) {
            return Ok(None);
        }
        let names = folder.names().iter();
        let images = names.filter(|name| name.ends_with(".png"));
        Ok(Some(Box::new(TripodReader {
            images: images.cloned().collect(),
        })))
    }
}

impl Reader for TripodReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let path = loader.root().join(FOCAL_FILE);
        let text = std::fs::read_to_string(&path).map_err(|source| Error::Access {
            path: path.clone(),
            source,
        })?;
        let focal = text.trim().parse().map_err(|_| Error::Invalid {
            path: path.clone(),
            expected: "a focal length in pixels".into(),
            found: text.clone(),
            remedy: "write one number".into(),
        })?;
        let n_frames = self.images.len();
        let view = |(frame, image): (usize, &String)| {
            let camera = Camera::new(focal, focal, 4.0, 3.0, 8, 6);
            let mut view = PlannedView::of_image(&loader.root().join(image), image, camera);
            view.frame = frame;
            view.time = frame as f32 / (n_frames - 1).max(1) as f32;
            view
        };
        let planned = self.images.iter().enumerate().map(view).collect();
        Ok(Capture {
            views: loader.load_views(planned)?,
            points: None,
            n_frames,
            n_cameras: 1,
            stated_span: None,
            frame_rate: None,
        })
    }
}

#[test]
fn a_format_from_outside_the_crate_is_recognised_and_read() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let root = folder.path();
    for frame in 0..3u8 {
        image::RgbImage::from_pixel(8, 6, image::Rgb([50 * frame; 3]))
            .save(root.join(format!("{frame}.png")))
            .expect("writes");
    }
    std::fs::write(root.join(FOCAL_FILE), "9\n").expect("writes");
    let options = LoadOptions {
        downscale: 2.0,
        ..LoadOptions::default()
    };
    load(root, &options).expect_err("no format of the crate's own");

    let mut formats: Vec<&dyn Format> = vec![&Tripod];
    formats.extend(FORMATS);
    let dataset = load_with(root, &options, &formats).expect("loads");
    assert_eq!(dataset.layout, Layout::Custom);
    assert_eq!((dataset.n_frames, dataset.n_cameras), (3, 1));
    for (frame, view) in dataset.views.iter().enumerate() {
        assert_eq!((view.frame, view.time), (frame, frame as f32 / 2.0));
        assert_eq!((view.camera.width, view.camera.height), (4, 3));
        assert_eq!(view.camera.fx, 4.5);
        let expected = 50.0 * frame as f32 / 255.0;
        assert_eq!(view.rgb([1.0; 3]).expect("in memory"), [expected; 36]);
    }

    std::fs::write(root.join(FOCAL_FILE), "nine").expect("writes");
    let error = load_with(root, &options, &formats).expect_err("no number");
    assert!(error.to_string().contains("focal.txt"), "{error}");
}
