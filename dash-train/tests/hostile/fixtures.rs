//! Small valid files of every kind.

use std::fs;
use std::io::Cursor;

use burn::tensor::Device;
use dash_kernels::splats::NEAR_PLANE;
use dash_model::{
    DeformationConfig, DeformationField, DynamicPart, DynamicScene, Gaps, GaussianRows, Gaussians,
    HashEncoderConfig, Heads, OffsetPlacement, Representation, SceneSettings, SpaceBox,
    TimeWindows, TrajectoryBasis, write_splat_ply, write_splats,
};
use dash_train::cameras::{CameraEntry, write_cameras};
#[cfg(feature = "fourdgs")]
use dash_train::four_dgs::{ClipOptions, write_clip};
use dash_train::ply::{PointCloud, write_points};
use dash_train::synth::{self, SynthConfig, SynthLayout};
use dash_train::train::{DataConfig, Preset, RunConfig, TrainConfig};
use image::{DynamicImage, ImageFormat};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::compressed;

/// Valid files for the parser of this name.
pub fn fixtures(parser: &str) -> Vec<Vec<u8>> {
    match parser {
        "npy" => vec![npy("<f8", "False", 8, 17), npy(">f4", "True", 4, 17)],
        "points_npy" => vec![npy("<f4", "False", 4, 3), npy(">f8", "True", 8, 3)],
        "cloud_npz" => vec![of_panoptic("init_pt_cld.npz")],
        "panoptic_meta" => vec![of_panoptic("train_meta.json")],
        "technicolor" => vec![TECHNICOLOR.into()],
        "nerfies_camera" => vec![NERFIES.into()],
        "transforms" => vec![NERFSTUDIO.into(), BLENDER.into()],
        "frame_names" => FRAME_NAMES.map(|names| names.into()).to_vec(),
        "colmap_cameras_binary" => vec![model_cameras()],
        "colmap_images_binary" => vec![model_images(&["a.png", "left/b.jpg"])],
        "colmap_points_binary" => vec![model_points()],
        "colmap_cameras_text" => vec![CAMERAS_TEXT.into()],
        "colmap_images_text" => vec![IMAGES_TEXT.into()],
        "colmap_points_text" => vec![POINTS_TEXT.into()],
        "points_ply" => points_ply(),
        "image_header" | "image" => images(),
        "splat_ply" => splat_ply(),
        "splat_spz" => vec![splats("spz")],
        "splat_raw" => vec![splats("splat")],
        "splat_glb" => vec![splats("glb")],
        #[cfg(feature = "fourdgs")]
        "splat_4dgs" => vec![clip()],
        "cameras_json" => vec![cameras_json()],
        "scene" => vec![
            scene(Some(Tables::Whole)),
            scene(Some(Tables::AsRead)),
            scene(None),
        ],
        "checkpoint_state" => vec![checkpoint_state()],
        "config_toml" => vec![config_toml()],
        other => panic!("no valid file for the parser {other}"),
    }
}

const NERFSTUDIO: &str = r#"{"camera_model": "OPENCV", "fl_x": 60.5, "fl_y": 61, "cx": 32, "cy": 24,
 "w": 64, "h": 48, "distortion_params": [0.01, -0.002, 0, 0, 0.0003, 0],
 "applied_transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "rolling_shutter": [0, 0, 0], "ply_file_path": "points.ply",
 "frames": [{"file_path": "images/a.png", "time": 0.25, "unknown": [1, {"x": null}],
 "transform_matrix": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]},
 {"file_path": "b", "fl_x": 50, "k1": 0.01, "x_fov": 40, "transform_matrix": [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 2]]}]}"#;

const BLENDER: &str = r#"{"camera_angle_x": 0.69, "frames": [{"file_path": "./train/r_000",
 "rotation": 0.03, "time": 0.0, "transform_matrix": [[-0.9999, 0.0042, -0.0133, -0.0538],
 [-0.0140, -0.2997, 0.9539, 3.8455], [-4.6566e-10, 0.9540, 0.2997, 1.2081], [0, 0, 0, 1]]}]}"#;

const FRAME_NAMES: [&str; 2] = [
    "frame_0009.a\nframe_0010.a\nframe_0011.a\n",
    "é-2024-01-31_1\né-2024-01-31_2\n",
];

const TECHNICOLOR: &str = "f cu cv ar sk qw qx qy qz tx ty tz\n\
60.5 32.1 23.8 1.0 0 1 0 0 0 0.1 -0.2 3\n61 31.5 24.5 0.999 0 0.9 0.1 -0.2 0.3 1 2 0.5\n";

const NERFIES: &str = r#"{"orientation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "position": [0.5, -1, 2],
 "focal_length": 60.5, "principal_point": [32, 24], "skew": 0.0, "pixel_aspect_ratio": 1.001,
 "radial_distortion": [0.01, -0.002, 0.0], "tangential": [0.0001, 0.0], "image_size": [64, 48]}"#;

const CAMERAS_TEXT: &str = "# Camera list\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
1 PINHOLE 64 48 60.5 61 32 24\n2 OPENCV 64 48 60 60 32 24 0.01 -0.002 0.0003 0\n\
3 SIMPLE_RADIAL 640 480 600 320 240 0.02\n";

const IMAGES_TEXT: &str = "# Image list\n\
1 0.9 0.1 -0.2 0.3 1.5 -0.5 2 1 a.png\n12.5 30.25 7 13 31 -1\n\
2 1 0 0 0 0 0 0 2 left/b c.jpg\n\n";

const POINTS_TEXT: &str = "# 3D point list\n\
1 0.5 -1.5 2.25 255 0 7 0.31 1 0 2 1\n2 1e3 0 -4 1 2 3 0.5\n";

/// `poses_bounds.npy` of two cameras.
fn npy(descr: &str, fortran_order: &str, width: usize, columns: u8) -> Vec<u8> {
    let header = format!(
        "{{'descr': '{descr}', 'fortran_order': {fortran_order}, 'shape': (2, {columns}), }}          \n"
    );
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    for index in 0..2 * columns {
        let value = f64::from(index) - 3.5;
        if width == 8 {
            bytes.extend(value.to_le_bytes());
        } else {
            bytes.extend((value as f32).to_be_bytes());
        }
    }
    bytes
}

/// A file of a made-up capture in the layout of Dynamic 3D Gaussians.
fn of_panoptic(name: &str) -> Vec<u8> {
    let config = SynthConfig {
        layout: SynthLayout::Panoptic,
        cameras: 2,
        frames: 2,
        width: 16,
        height: 16,
        ..SynthConfig::default()
    };
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path().join("clip");
    synth::write(&out, &config).expect("writes");
    fs::read(out.join(name)).expect("written above")
}

/// `cameras.bin`: a pinhole camera and one with distortion.
fn model_cameras() -> Vec<u8> {
    let mut bytes = 2u64.to_le_bytes().to_vec();
    for (id, model, parameters) in [
        (1u32, 1u32, &[60.5, 61.0, 32.0, 24.0][..]),
        (7, 4, &[60.0, 60.0, 32.0, 24.0, 0.01, -0.002, 0.0003, 0.0]),
    ] {
        bytes.extend(id.to_le_bytes());
        bytes.extend(model.to_le_bytes());
        bytes.extend(64u64.to_le_bytes());
        bytes.extend(48u64.to_le_bytes());
        bytes.extend(
            parameters
                .iter()
                .flat_map(|value: &f64| value.to_le_bytes()),
        );
    }
    bytes
}

/// `images.bin` with these names, two observations each.
pub fn model_images(names: &[&str]) -> Vec<u8> {
    let mut bytes = (names.len() as u64).to_le_bytes().to_vec();
    for (id, name) in names.iter().enumerate() {
        bytes.extend((id as u32).to_le_bytes());
        for value in [0.9f64, 0.1, -0.2, 0.3, 1.5, -0.5, 2.0] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(name.bytes());
        bytes.push(0);
        bytes.extend(2u64.to_le_bytes());
        for observation in 0..2u64 {
            bytes.extend(12.5f64.to_le_bytes());
            bytes.extend(30.25f64.to_le_bytes());
            bytes.extend(observation.to_le_bytes());
        }
    }
    bytes
}

/// `points3D.bin` of two points.
fn model_points() -> Vec<u8> {
    let mut bytes = 2u64.to_le_bytes().to_vec();
    for id in 1..3u64 {
        bytes.extend(id.to_le_bytes());
        for value in [0.5f64, -1.5, 2.25] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([255, 0, 7]);
        bytes.extend(0.31f64.to_le_bytes());
        bytes.extend(id.to_le_bytes());
        for _ in 0..id {
            bytes.extend(1u32.to_le_bytes());
            bytes.extend(0u32.to_le_bytes());
        }
    }
    bytes
}

/// What a writer of files writes.
fn written(name: &str, write: impl FnOnce(&std::path::Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join(name);
    write(&path);
    fs::read(path).expect("written above")
}

fn points_ply() -> Vec<Vec<u8>> {
    let cloud = PointCloud {
        positions: vec![[1.0, -2.5, 3.0], [0.1, 0.2, 0.3]],
        colors: vec![[255, 0, 7], [1, 2, 3]],
    };
    let binary = written("points.ply", |path| {
        write_points(path, &cloud).expect("writes");
    });
    let ascii = "ply\nformat ascii 1.0\ncomment by hand\nelement camera 1\n\
        property list uchar int a\nelement vertex 2\nproperty double x\nproperty float y\n\
        property float z\nproperty float red\nproperty float green\nproperty float blue\n\
        property list uint short more\nend_header\n3 7 8 9\n1 0.5 -2 1 0.5 0 0\n\
        4 5 6 0.25 0 1 2 7 8\n";
    let mut big_endian = b"ply\nformat binary_big_endian 1.0\nelement face 1\n\
        property list uchar uint corners\nelement vertex 1\nproperty float x\nproperty float y\n\
        property double z\nend_header\n\x02\0\0\0\x01\0\0\0\x02"
        .to_vec();
    big_endian.extend(1f32.to_be_bytes());
    big_endian.extend(2f32.to_be_bytes());
    big_endian.extend(3f64.to_be_bytes());
    vec![binary, ascii.into(), big_endian]
}

fn rows(n: usize, trajectory_width: usize) -> GaussianRows {
    let positions: Vec<[f32; 3]> = (0..n).map(|i| [i as f32, 0.5, -1.0]).collect();
    let mut rows = GaussianRows::from_points(&positions, &vec![[0.2, 0.5, 0.9]; n], 1, 0.1);
    rows.trajectory_width = trajectory_width;
    rows.trajectories = vec![0.25; n * trajectory_width];
    rows
}

fn splat_ply() -> Vec<Vec<u8>> {
    let binary = written("splat.ply", |path| {
        write_splat_ply(path, &rows(2, 0), NEAR_PLANE).expect("writes");
    });
    let columns = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
        "rot_0", "rot_1", "rot_2", "rot_3",
    ];
    let properties: String = columns
        .map(|name| format!("property float {name}\n"))
        .concat();
    let ascii = format!(
        "ply\nformat ascii 1.0\nelement vertex 2\n{properties}end_header\n\
         1 2 3 0.5 0.5 0.5 -1 -3 -3 -3 1 0 0 0\n4 5 6 1 1 1 2.5 -3 -3 -3 0.5 0.5 0.5 0.5\n"
    );
    vec![binary, ascii.into(), compressed::two_gaussians()]
}

fn splats(extension: &str) -> Vec<u8> {
    written(&format!("a.{extension}"), |path| {
        write_splats(path, &rows(2, 0), NEAR_PLANE).expect("writes");
    })
}

fn cameras_json() -> Vec<u8> {
    let entry = |id: u64, time| CameraEntry {
        id,
        img_name: format!("frame_{id}"),
        camera: dash_model::Camera::new(60.0, 61.0, 32.0, 24.0, 64, 48),
        time,
    };
    written("cameras.json", |path| {
        write_cameras(path, &[entry(0, None), entry(1, Some(0.5))]).expect("writes");
    })
}

fn images() -> Vec<Vec<u8>> {
    let rgb = image::RgbImage::from_fn(20, 12, |x, y| {
        image::Rgb([(x * 12) as u8, (y * 20) as u8, (x * y % 251) as u8])
    });
    let color = DynamicImage::from(rgb);
    let encoded = |image: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("encodes");
        bytes.into_inner()
    };
    vec![
        encoded(&color, ImageFormat::Png),
        encoded(&DynamicImage::from(color.to_rgba16()), ImageFormat::Png),
        encoded(&DynamicImage::from(color.to_luma8()), ImageFormat::Png),
        encoded(&color, ImageFormat::Jpeg),
    ]
}

/// The image with another width and height in its header, and the checksum to match.
pub fn with_image_size(image: &[u8], side: u32) -> Vec<u8> {
    let mut bytes = image.to_vec();
    if image.starts_with(b"\x89PNG") {
        bytes[16..20].copy_from_slice(&side.to_be_bytes());
        bytes[20..24].copy_from_slice(&side.to_be_bytes());
        let checksum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    } else {
        let frame = image
            .windows(2)
            .position(|w| w == [0xFF, 0xC0])
            .expect("a baseline JPEG");
        let side = (side.min(65_535) as u16).to_be_bytes();
        bytes[frame + 5..frame + 7].copy_from_slice(&side);
        bytes[frame + 7..frame + 9].copy_from_slice(&side);
    }
    bytes
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |mut crc, byte| {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
        crc
    })
}

/// What a scene's file has of its field's tables.
#[derive(Clone, Copy, PartialEq)]
enum Tables {
    Whole,
    /// The entries that the Gaussians read.
    AsRead,
}

/// A scene's two files, as the parser takes them; `None` for one in which nothing moves.
fn dynamic_scene(tables: Option<Tables>) -> DynamicScene {
    let device = Device::flex();
    let basis = TrajectoryBasis::polyline(2);
    let (log2_hashmap_size, finest) = match tables {
        Some(Tables::AsRead) => (8, 4),
        _ => (3, 2),
    };
    let config = DeformationConfig {
        representation: Representation::Hash,
        heads: Heads::default(),
        temporal: None,
        encoder: HashEncoderConfig {
            n_levels: 2,
            n_features_per_level: 1,
            log2_hashmap_size,
            base_resolution: vec![1, 1, 1, 1],
            finest_resolution: vec![finest; 4],
            smoothstep: false,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        },
        hidden: 2,
        layers: 2,
    };
    let mut rng = Pcg64::seed_from_u64(3);
    DynamicScene {
        static_set: Gaussians::from_rows(&rows(2, 0), &device),
        dynamic: tables.map(|tables| {
            let whole = DynamicPart {
                gaussians: Gaussians::from_rows(&rows(1, 3 * basis.len()), &device),
                field: DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)
                    .expect("a small field"),
            };
            match tables {
                Tables::Whole => whole,
                Tables::AsRead => whole.without_unread().expect("a hash grid").0,
            }
        }),
        settings: SceneSettings {
            background: [0.0; 3],
            sh_degree: 1,
            near_plane: 0.01,
            trajectory_basis: basis,
            offsets: OffsetPlacement::BeforeActivation,
            gaps: Gaps::default(),
        },
    }
}

/// A clip of a scene that moves.
#[cfg(feature = "fourdgs")]
fn clip() -> Vec<u8> {
    let options = ClipOptions {
        n_frames: 3,
        frame_rate: 30.0,
        max_error: 1e-3,
    };
    let scene = dynamic_scene(Some(Tables::Whole));
    written("a.4dgs", |path| {
        write_clip(
            path,
            &TimeWindows::whole(),
            &|_| Ok(scene.clone()),
            &options,
        )
        .expect("writes");
    })
}

fn scene(tables: Option<Tables>) -> Vec<u8> {
    let scene = dynamic_scene(tables);
    let folder = tempfile::tempdir().expect("a scratch folder");
    scene.save(folder.path()).expect("writes");
    let [json, tensors] =
        ["scene.json", "scene.safetensors"].map(|name| fs::read(folder.path().join(name)));
    let json = json.expect("written above");
    let mut bytes = (json.len() as u32).to_le_bytes().to_vec();
    bytes.extend(json);
    bytes.extend(tensors.expect("written above"));
    bytes
}

fn checkpoint_state() -> Vec<u8> {
    let config = serde_json::to_string(&TrainConfig::preset(Preset::Quick)).expect("JSON");
    let rng = serde_json::to_string(&Pcg64::seed_from_u64(1)).expect("JSON");
    format!(
        "{{\"step\": 12, \"train_seconds\": 3.5, \"rng\": {rng}, \"sampler\": {{\"left\": [2, 0]}}, \
         \"optimizer_steps\": {{\"static_set.means\": 12}}, \"method\": \
         {{\"motion_space\": {{\"min\": [-1, -1, -1], \"max\": [1, 1, 1], \"clamp\": true}}, \
         \"held_still\": [true, false], \"nothing_moves\": false}}, \"extensions\": [[\"averaging\", null], [\"crowding\", 400]], \
         \"dataset\": {{\"n_views\": 3, \"hash\": 7}}, \
         \"start\": {{\"given\": 0, \"rng\": {rng}}}, \"config\": {config}}}"
    )
    .into()
}

fn config_toml() -> Vec<u8> {
    let config = RunConfig::new(
        DataConfig {
            dataset: "rig".into(),
            layout: None,
            downscale: 1.0,
            test_cameras: Some(vec![0]),
            drop_cameras: vec!["right".into()],
            invert_masks: false,
            frames: None,
            skip_broken: false,
            backdrop: None,
            device: "flex".into(),
        },
        TrainConfig::preset(Preset::Quick),
    );
    toml::to_string(&config).expect("TOML").into()
}
