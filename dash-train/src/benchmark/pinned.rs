//! What a protocol pins, in words.

use super::Benchmark;
use crate::metrics::lpips::LPIPS_RULE;
use crate::metrics::{MS_SSIM_RULE, PSNR_RULE, SSIM_RULE};

/// What is the same for every scene of a benchmark, and for those who run it elsewhere: names and values.
pub fn pinned(benchmark: &Benchmark) -> Vec<(&'static str, String)> {
    let protocol = benchmark.protocol.protocol();
    let [width, height] = protocol.size;
    let mut pinned = vec![
        ("dataset", format!("{}, {} scenes", protocol.title, protocol.scenes.len())),
        ("protocol", protocol.source.into()),
        ("layout", protocol.layout.into()),
        (
            "held out",
            match protocol.held_out {
                None => "the views that the dataset lists for testing".into(),
                Some([one]) => format!("camera {one}, at every frame"),
                Some(several) => {
                    let numbers: Vec<String> = several.iter().map(ToString::to_string).collect();
                    format!("cameras {}, at every frame", numbers.join(", "))
                }
            },
        ),
        (
            "frames",
            protocol.n_frames.map_or("all".into(), |n| n.to_string()),
        ),
        (
            "pictures",
            format!(
                "{width}x{height}; larger ones are made smaller, averaging over the area of each new pixel and \
                 rounding to 8 bits"
            ),
        ),
        ("background", protocol.background.into()),
        ("PSNR", PSNR_RULE.into()),
        ("SSIM", SSIM_RULE.into()),
        ("MS-SSIM", MS_SSIM_RULE.into()),
        ("LPIPS", format!("{LPIPS_RULE}; published with: {}", protocol.lpips)),
        (
            "means",
            "of a scene: over its test views, then the median over seeds; of the dataset: over its scenes".into(),
        ),
    ];
    for scene in protocol.scenes {
        if let Some((first, last)) = scene.frames {
            pinned.push(("frames of", format!("{}: {first} to {last}", scene.name)));
        }
    }
    if !benchmark.drop_cameras.is_empty() {
        let dropped = benchmark.drop_cameras.iter();
        let dropped: Vec<String> = dropped.map(ToString::to_string).collect();
        pinned.push(("left out", dropped.join(", ")));
    }
    pinned
}
