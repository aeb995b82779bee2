//! What the keys of `transforms*.json` mean that are no field of [`Transforms`]: harmless, passed over with a
//! warning, or refused, since they change pixels or poses. The keys are those that the loaders of nerfstudio and
//! instant-ngp read, and those that their writers leave behind.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::Transforms;
use crate::Error;

/// What to do with a key whose value is not neutral (null, false, zero, empty).
#[derive(Debug, Clone, Copy, PartialEq)]
enum Meaning {
    /// It changes neither pixels nor poses.
    Harmless,
    /// It does, and is not followed: what that means.
    PassedOver(&'static str),
    /// Pixels or poses would be wrong: what it says, and what to do.
    Refused(&'static str, &'static str),
    /// The name of a projection, which has to be a perspective one.
    Projection,
}
use Meaning::{Harmless, PassedOver, Projection, Refused};

/// Names of perspective projections, apart from those of `camera_model`.
const PERSPECTIVES: [&str; 11] = [
    "perspective",
    "persp",
    "pinhole",
    "simple_pinhole",
    "opencv",
    "simple_radial",
    "radial",
    "brown",
    "radtan",
    "plumb_bob",
    "none",
];
const UNDISTORT: &str = "undistort the images first and remove it";
const MOVING: Meaning = Refused(
    "a camera that moves while a picture is taken",
    "undo that in the images and remove it, or leave these frames out",
);
const OTHER_LENS: Meaning = Refused("a lens that is not supported", UNDISTORT);
const TRANSPARENT: Meaning = Refused(
    "a colour that means transparent",
    "write transparency into the images' alpha channel and remove it",
);
const OTHER_AXES: Meaning = Refused(
    "poses in other axes than OpenGL's",
    "turn the poses into OpenGL's axes and remove it",
);

/// The known keys of the file and of its frames; those of [`Transforms`] are not among them.
const KEYS: [(&str, Meaning); 79] = [
    // What was done to the poses, which have it already. Points of a COLMAP model get it; `applied_scale` is judged with
    // the points.
    ("applied_transform", Harmless),
    ("applied_scale", Harmless),
    ("orientation_override", Harmless),
    ("auto_scale_poses_override", Harmless),
    // instant-ngp's own box, which does not move the cameras against the scene.
    ("aabb", Harmless),
    ("aabb_scale", Harmless),
    ("render_aabb", Harmless),
    ("offset", Harmless),
    ("scale", Harmless),
    ("up", Harmless),
    // Settings of other trainers.
    ("importance_sampling", Harmless),
    ("n_extra_learnable_dims", Harmless),
    ("enable_depth_loading", Harmless),
    ("enable_ray_loading", Harmless),
    ("integer_depth_scale", Harmless),
    ("depth_unit_scale_factor", Harmless),
    ("sharpness", Harmless),
    // Further pictures, names and numbers of a frame.
    ("depth_file_path", Harmless),
    ("depth_path", Harmless),
    ("normal_file_path", Harmless),
    ("semantics_path", Harmless),
    ("colmap_im_id", Harmless),
    ("camera_id", Harmless),
    ("camera_index", Harmless),
    ("camera_indices", Harmless),
    ("frame_id", Harmless),
    ("frame_index", Harmless),
    ("video_id", Harmless),
    ("timestamp", Harmless),
    ("fps", Harmless),
    ("exposure_time", Harmless),
    ("iso", Harmless),
    ("near", Harmless),
    ("far", Harmless),
    ("background_color", Harmless),
    ("scene_scale", Harmless),
    ("scene_center", Harmless),
    // How far Blender's camera turned since the last frame: NeRF's writer leaves it behind.
    ("rotation", Harmless),
    ("sharpen", PassedOver("images are not sharpened")),
    ("fix_premult", PassedOver("colours are taken as they are")),
    ("envmap", PassedOver("there is no environment map")),
    (
        "driver_parameters",
        PassedOver("light is taken as constant"),
    ),
    ("n_frames", PassedOver("all frames are read")),
    (
        "sharpness_discard_threshold",
        PassedOver("blurred frames are read, too"),
    ),
    (
        "camera_linear_velocity",
        PassedOver("blur by motion is not undone"),
    ),
    (
        "camera_angular_velocity",
        PassedOver("blur by motion is not undone"),
    ),
    ("rolling_shutter", MOVING),
    ("rolling_shutter_time", MOVING),
    ("transform_matrix_start", MOVING),
    ("transform_matrix_end", MOVING),
    ("ftheta_p0", OTHER_LENS),
    ("ftheta_p1", OTHER_LENS),
    ("ftheta_p2", OTHER_LENS),
    ("ftheta_p3", OTHER_LENS),
    ("ftheta_p4", OTHER_LENS),
    ("latlong", OTHER_LENS),
    ("equirectangular", OTHER_LENS),
    ("orthographic", OTHER_LENS),
    ("fisheye_crop_radius", OTHER_LENS),
    ("k5", OTHER_LENS),
    ("k6", OTHER_LENS),
    ("s1", OTHER_LENS),
    ("s2", OTHER_LENS),
    ("s3", OTHER_LENS),
    ("s4", OTHER_LENS),
    ("sx1", OTHER_LENS),
    ("sy1", OTHER_LENS),
    ("xi", OTHER_LENS),
    ("skew", OTHER_LENS),
    ("camera_type", Projection),
    ("projection", Projection),
    ("distortion_model", Projection),
    ("lens_model", Projection),
    ("lens_type", Projection),
    ("white_transparent", TRANSPARENT),
    ("black_transparent", TRANSPARENT),
    ("from_na", OTHER_AXES),
    ("from_mitsuba", OTHER_AXES),
    ("normal_mts_args", OTHER_AXES),
];

/// Words in names of numbers that describe a lens or a shutter.
const LENS_WORDS: [&str; 17] = [
    "focal",
    "fov",
    "distort",
    "skew",
    "shift",
    "aspect",
    "principal",
    "intrinsic",
    "lens",
    "fisheye",
    "shutter",
    "crop",
    "radial",
    "tangential",
    "camera_angle",
    "camera_matrix",
    "sensor",
];
/// Whole names of such numbers, apart from a letter and a digit (`k7`).
const LENS_NAMES: [&str; 17] = [
    "f", "fx", "fy", "f_x", "f_y", "fl", "c_x", "c_y", "px", "py", "ppx", "ppy", "u0", "v0", "k",
    "d", "alpha_c",
];
/// Words in names of lists that place a camera.
const POSE_WORDS: [&str; 7] = [
    "transform",
    "extrinsic",
    "pose",
    "quaternion",
    "translation",
    "c2w",
    "w2c",
];

impl Transforms {
    /// Refuses keys that change pixels or poses in a way that can't be followed.
    ///
    /// # Errors
    /// Names the file, the key and its frame.
    pub(super) fn check_keys(&self, path: &Path) -> Result<(), Error> {
        for (key, value, frame) in self.others() {
            let place = frame.map_or("at the top level".into(), |f| format!("in frame `{f}`"));
            let found = |what: &str| format!("`{key}` {}: {what}, {place}", shown(value));
            let (what, remedy) = match meaning(key) {
                Some(Refused(what, remedy)) => (what, remedy),
                Some(Projection) if !is_perspective(value) => {
                    ("a lens that is not supported", UNDISTORT)
                }
                _ => continue,
            };
            let expected = "keys that pinhole images without further change can follow";
            return Err(Error::invalid(path, expected, found(what), remedy));
        }
        let scale = self.other.get("applied_scale").and_then(Value::as_f64);
        if let Some(scale) = scale.filter(|&scale| scale != 1.0)
            && let Some(points) = &self.ply_file_path
        {
            return Err(Error::invalid(
                path,
                "points in the world of the poses",
                format!(
                    "`applied_scale` {scale} beside `ply_file_path` {points}: whether the points have it, too, is not known"
                ),
                "scale the points as the poses are, and remove applied_scale",
            ));
        }
        Ok(())
    }

    /// Warns of keys that are passed over and may matter.
    pub(crate) fn warn_of_keys(&self, path: &Path) {
        for told in self.passed_over() {
            tracing::warn!("{}: {told}", path.display());
        }
    }

    /// What [`Transforms::warn_of_keys`] says, by key.
    fn passed_over(&self) -> Vec<String> {
        let mut told: BTreeMap<&str, (String, usize)> = BTreeMap::new();
        for (key, value, frame) in self.others() {
            let what = match meaning(key) {
                Some(PassedOver(what)) => what.to_string(),
                None if is_of_lens(key, value) || is_of_pose(key, value) => {
                    "it is not a key that is read. Where it belongs to the lens or the pose, write it as fl_x, \
                     fl_y, cx, cy, k1 to k4, p1, p2 or transform_matrix"
                        .to_string()
                }
                _ => continue,
            };
            let n = &mut told.entry(key).or_insert((what, 0)).1;
            *n += usize::from(frame.is_some());
        }
        let line = |(key, (what, n)): (&str, (String, usize))| match n {
            0 => format!("`{key}` is passed over: {what}"),
            n => format!("`{key}` of {n} frames is passed over: {what}"),
        };
        told.into_iter().map(line).collect()
    }

    /// The keys that are no fields and have a value that says something: with the frame's path, where it is a frame's.
    fn others(&self) -> impl Iterator<Item = (&str, &Value, Option<&str>)> {
        let top = self.other.iter().map(|(key, value)| (key, value, None));
        let frames = self.frames.iter().flat_map(|frame| {
            let path = Some(frame.file_path.as_str());
            frame
                .other
                .iter()
                .map(move |(key, value)| (key, value, path))
        });
        let says_something = |(_, value, _): &(&String, &Value, _)| !is_neutral(value);
        top.chain(frames)
            .filter(says_something)
            .map(|(key, value, frame)| (key.as_str(), value, frame))
    }
}

fn meaning(key: &str) -> Option<Meaning> {
    let known = KEYS.iter().find(|(known, _)| *known == key);
    known.map(|&(_, meaning)| meaning)
}

/// Null, false, zero, empty, or lists of these.
fn is_neutral(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Bool(value) => !value,
        Value::Number(value) => value.as_f64() == Some(0.0),
        Value::String(value) => value.is_empty(),
        Value::Array(values) => values.iter().all(is_neutral),
        Value::Object(values) => values.is_empty(),
    }
}

fn is_perspective(value: &Value) -> bool {
    let name = value.as_str().unwrap_or_default();
    PERSPECTIVES
        .iter()
        .any(|known| known.eq_ignore_ascii_case(name))
}

/// Whether a number or a list of numbers has a name that is a lens's.
fn is_of_lens(key: &str, value: &Value) -> bool {
    let key = key.to_ascii_lowercase();
    let coefficient = match key.as_bytes() {
        [letter, digits @ ..] => {
            b"kpsbd".contains(letter) && !digits.is_empty() && digits.iter().all(u8::is_ascii_digit)
        }
        [] => false,
    };
    let named = coefficient
        || LENS_NAMES.contains(&key.as_str())
        || LENS_WORDS.iter().any(|word| key.contains(word));
    named && is_numeric(value)
}

/// Whether a list of numbers has a name that is a pose's.
fn is_of_pose(key: &str, value: &Value) -> bool {
    let key = key.to_ascii_lowercase();
    value.is_array() && is_numeric(value) && POSE_WORDS.iter().any(|word| key.contains(word))
}

fn is_numeric(value: &Value) -> bool {
    match value {
        Value::Number(_) => true,
        Value::Array(values) => values.iter().all(is_numeric),
        // A set of numbers by name.
        Value::Object(values) => values.values().all(is_numeric),
        _ => false,
    }
}

/// A value in an error, in short.
fn shown(value: &Value) -> String {
    const MOST: usize = 60;
    let text = value.to_string();
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}..", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests;
