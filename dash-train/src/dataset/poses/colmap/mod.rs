//! COLMAP's sparse models: cameras, poses and points, from binary or text files.

pub(crate) mod binary;
mod model;
mod rows;
pub(crate) mod text;
mod tracks;

pub(crate) use model::{
    MODEL_FOLDERS, Model, RIG_MODEL_FOLDERS, has_file, model_folder, pinhole, place, read_model,
    read_model_points, warn_of_larger,
};
pub(crate) use rows::{ModelCamera, ModelImage};
pub(crate) use tracks::{TrackedPoint, read_tracked_points};
