//! Masks of the pixels that count.

use image::{GrayImage, Luma};

use super::super::Severity::{Ok, Warning};
use super::{CAMERAS, FRAMES, Scene, else_clean, finds};

/// Masks of one camera, or of all, in which so many rows count.
fn write_masks(scene: &Scene, cameras: std::ops::Range<usize>, rows: u32) {
    let mask = GrayImage::from_fn(80, 60, |_, y| Luma([if y < rows { 255 } else { 0 }]));
    for camera in cameras {
        let folder = scene.root().join(format!("masks/cam{camera:02}"));
        std::fs::create_dir_all(&folder).expect("made");
        for frame in 0..FRAMES {
            mask.save(folder.join(format!("{frame:04}.png")))
                .expect("writes");
        }
    }
}

#[test]
fn how_much_counts_is_said_where_there_are_masks() {
    let scene = Scene::bounce();
    write_masks(&scene, 2..4, 30);
    let diagnosis = scene.examine();
    let words = ["48 of 192 views have a mask", "88 % of all pixels count"];
    finds(&diagnosis, "masks", Ok, &words);
    else_clean(&diagnosis, &[]);
    write_masks(&scene, 0..CAMERAS, 0);
    let words = ["192 of 192 views", "0 % of all pixels"];
    finds(&scene.examine(), "masks", Warning, &words);
}

#[test]
fn masks_that_no_view_uses_are_a_warning() {
    let scene = Scene::bounce();
    let lines = |diagnosis: &super::Diagnosis| {
        let masks = diagnosis.findings.iter().filter(|f| f.check == "masks");
        masks.count()
    };
    assert_eq!(lines(&scene.examine()), 0);
    write_masks(&scene, 0..1, 30);
    let folder = scene.root().join("masks");
    std::fs::rename(folder.join("cam00"), folder.join("left")).expect("renamed");
    let diagnosis = scene.examine();
    let words = ["no view uses", "masks/cam00/0000.png"];
    finds(&diagnosis, "masks", Warning, &words);
    else_clean(&diagnosis, &["masks"]);
}
