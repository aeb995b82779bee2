//! The protocols, each with its source.

use super::protocol::{Protocol, ProtocolName, Scene};

const fn scene(name: &'static str, aliases: &'static [&'static str]) -> Scene {
    Scene {
        name,
        aliases,
        frames: None,
        caution: None,
    }
}

const fn part(name: &'static str, aliases: &'static [&'static str], frames: (u64, u64)) -> Scene {
    Scene {
        frames: Some(frames),
        ..scene(name, aliases)
    }
}

/// The protocols, in the order of [`ProtocolName::ALL`].
pub static PROTOCOLS: [Protocol; 6] = [N3DV, TECHNICOLOR, PANOPTIC, D_NERF, NVIDIA, HYPERNERF];

/// Six cooking scenes.
///
/// # Source
/// Li et al. 2022 (arXiv 2103.02597) published the scenes; half the size of 2704x2028 and camera 0 are what K-Planes,
/// HyperReel, 4DGaussians and DASH use. Flame salmon has 1,200 frames, of which the first 300 count.
const N3DV: Protocol = Protocol {
    name: ProtocolName::N3dv,
    title: "Neural 3D Video",
    scenes: &[
        Scene {
            caution: Some(
                "cam13 is out of step with the others; MixVoxels, K-Planes and E-D3DGS leave it out: \
                 --drop-cameras coffee_martini:cam13",
            ),
            ..scene("coffee_martini", &[])
        },
        scene("cook_spinach", &[]),
        scene("cut_roasted_beef", &["cut_beef"]),
        part("flame_salmon_1", &["flame_salmon"], (0, 299)),
        scene("flame_steak", &[]),
        scene("sear_steak", &[]),
    ],
    layout: "n3dv",
    held_out: Some(&[0]),
    size: [1352, 1014],
    n_frames: Some(300),
    background: "none: the pictures are opaque",
    lpips: "AlexNet in most papers",
    source: "arXiv 2103.02597; half size as in 2301.10241 (K-Planes) and 2507.19141 (DASH)",
};

/// Five scenes of a 4x4 rig.
///
/// # Source
/// Sabater et al. 2017 published the rig; HyperReel (arXiv 2301.02238) chose the scenes, frames and camera at full size.
const TECHNICOLOR: Protocol = Protocol {
    name: ProtocolName::Technicolor,
    title: "Technicolor",
    scenes: &[
        part("Birthday", &[], (151, 200)),
        part("Fabien", &[], (51, 100)),
        part("Painter", &[], (100, 149)),
        part("Theater", &[], (51, 100)),
        part("Train", &["Trains"], (151, 200)),
    ],
    layout: "technicolor",
    held_out: Some(&[10]),
    size: [2048, 1088],
    n_frames: Some(50),
    background: "none: the pictures are opaque",
    lpips: "AlexNet in most papers",
    source: "scenes, frames and camera of arXiv 2301.02238 (HyperReel)",
};

/// Six sports in a dome.
///
/// # Source
/// Luiten et al. 2024 (arXiv 2308.09713, Dynamic 3D Gaussians).
const PANOPTIC: Protocol = Protocol {
    name: ProtocolName::Panoptic,
    title: "Panoptic Sports",
    scenes: &[
        scene("basketball", &[]),
        scene("boxes", &[]),
        scene("football", &[]),
        scene("juggle", &[]),
        scene("softball", &[]),
        scene("tennis", &[]),
    ],
    layout: "panoptic, as published: ims/, train_meta.json, test_meta.json, init_pt_cld.npz; or a rig",
    held_out: Some(&[0, 10, 15, 30]),
    size: [640, 360],
    n_frames: Some(150),
    background: "none: the pictures are opaque",
    lpips: "not stated",
    source: "arXiv 2308.09713 (Dynamic 3D Gaussians)",
};

/// Eight synthetic scenes.
///
/// # Source
/// Pumarola et al. 2021 (arXiv 2011.13961) at half of 800x800, over white. Several later papers measure at 800x800; their
/// rows say so.
const D_NERF: Protocol = Protocol {
    name: ProtocolName::DNerf,
    title: "D-NeRF",
    scenes: &[
        scene("bouncingballs", &[]),
        scene("hellwarrior", &[]),
        scene("hook", &[]),
        scene("jumpingjacks", &[]),
        Scene {
            caution: Some(
                "its test views show the shovel in another pose than its training views, so that no method does \
                 well; some papers take its validation views",
            ),
            ..scene("lego", &[])
        },
        scene("mutant", &[]),
        scene("standup", &[]),
        scene("trex", &[]),
    ],
    layout: "blender",
    held_out: None,
    size: [400, 400],
    n_frames: None,
    background: "white",
    lpips: "VGG16 or not stated",
    source: "arXiv 2011.13961 (D-NeRF)",
};

/// Seven scenes of a moving camera.
///
/// # Source
/// Yoon et al. 2020 (arXiv 2004.01294) published the captures; Gao et al. 2021 (arXiv 2105.06468, DynamicNeRF) train on one
/// camera per time, and test the first camera at every time, with pictures 270 high.
const NVIDIA: Protocol = Protocol {
    name: ProtocolName::Nvidia,
    title: "NVIDIA Dynamic Scenes",
    scenes: &[
        scene("Balloon1", &[]),
        scene("Balloon2", &[]),
        scene("Jumping", &[]),
        scene("Playground", &[]),
        scene("Skating", &[]),
        scene("Truck", &[]),
        scene("Umbrella", &[]),
    ],
    layout: "blender: transforms_train.json with one camera per time, transforms_test.json with the first camera at \
             every time",
    held_out: None,
    size: [480, 270],
    n_frames: Some(12),
    background: "none: the pictures are opaque",
    lpips: "not stated",
    source: "arXiv 2105.06468 (DynamicNeRF), view fixed and time changing",
};

/// The four scenes with a camera for validation.
///
/// # Source
/// Park et al. 2021 (arXiv 2106.13228): the four scenes of the validation rig, one camera to train on and the other to
/// test with, at half size (`rgb/2x`).
const HYPERNERF: Protocol = Protocol {
    name: ProtocolName::HyperNerf,
    title: "HyperNeRF, vrig",
    scenes: &[
        scene("broom2", &["broom", "vrig-broom", "vrig_broom"]),
        scene("vrig-3dprinter", &["3dprinter", "vrig_3dprinter"]),
        scene("vrig-chicken", &["chicken", "vrig_chicken"]),
        scene("vrig-peel-banana", &["peel-banana", "vrig_peel-banana"]),
    ],
    layout: "nerfies",
    held_out: None,
    size: [536, 960],
    n_frames: None,
    background: "none: the pictures are opaque",
    lpips: "not measured in most papers",
    source: "arXiv 2106.13228 (HyperNeRF)",
};
