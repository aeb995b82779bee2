//! DASH (ICCV 2025): a warm-up in which nothing moves, a coarse motion field that finds what moves, and the 4D field
//! that deforms it.
//!
//! | equations | where |
//! | --- | --- |
//! | 1-2, 10 | `dash_model::DynamicScene` |
//! | 3-5: coarse motion, which Gaussians are dynamic | `motion`, `decomposition` |
//! | 6, 12: photometric loss | `core` |
//! | 7-9: the 4D field | `dash_model::DeformationField` |
//! | 11: smoothness | `smoothness` |

mod config;
mod decomposition;
mod method;
mod motion;
pub mod published;
pub mod scale;
mod smoothness;
mod stages;
mod state;

pub use config::{
    Decomposition, FieldConfig, Form, MethodConfig, MotionFieldConfig, MotionMeasure,
    TimeResolution, Trajectories,
};
pub(crate) use config::{FEATURES_PER_LEVEL, LAYERS};
pub(crate) use method::{KEPT_BACK, MASK_INTERVAL};
pub(crate) use smoothness::STEP;
pub use stages::{GROWN, Stages};
pub use state::Dash;
