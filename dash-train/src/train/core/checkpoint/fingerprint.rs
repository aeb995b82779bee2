//! Which dataset a checkpoint was trained on.

use serde::{Deserialize, Serialize};

use crate::dataset::{Partition, View};
use crate::hash::Fnv1a;

/// A dataset's views in short: the same for the same folder wherever it lies. Images count by the size of their files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Fingerprint {
    n_views: usize,
    /// Of every view's partition, camera, pose, name, size, time and file size, in order.
    hash: u64,
}

impl Fingerprint {
    pub(super) fn of(views: &[View]) -> Self {
        let mut hash = Fnv1a::default();
        for view in views {
            hash.write(&[u8::from(view.partition == Partition::Test)]);
            for text in [&view.camera_name, &view.name] {
                hash.write(&(text.len() as u64).to_le_bytes());
                hash.write(text.as_bytes());
            }
            for side in [view.camera.width, view.camera.height] {
                hash.write(&(side as u64).to_le_bytes());
            }
            hash.write(&view.time.to_bits().to_le_bytes());
            hash.write(&view.file_bytes.to_le_bytes());
            let camera = &view.camera;
            let intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy];
            let pose = camera
                .rotation
                .as_flattened()
                .iter()
                .chain(&camera.translation);
            for value in pose.chain(&intrinsics) {
                hash.write(&value.to_bits().to_le_bytes());
            }
        }
        Self {
            n_views: views.len(),
            hash: hash.value(),
        }
    }

    /// What was expected and what was found, where another dataset's is found in place of this one.
    pub(super) fn contradiction(&self, found: &Self) -> Option<String> {
        if self == found {
            return None;
        }
        let differing = match self.n_views == found.n_views {
            true => " of which some have another name, camera, pose, size, time, file or partition",
            false => "",
        };
        Some(format!(
            "expected the {} views that the run was begun with, found {}{differing}",
            self.n_views, found.n_views
        ))
    }
}

#[cfg(test)]
mod tests {
    use dash_kernels::Camera;

    use super::*;

    #[test]
    fn whatever_differs_between_views_is_noticed() {
        let view = |name: &str, time: f32| {
            let camera = Camera::new(9.0, 9.0, 1.0, 1.0, 2, 2);
            View::from_rgb8(name, camera, time, vec![0; 12])
        };
        let views = || vec![view("a", 0.0), view("b", 0.5)];
        let begun = Fingerprint::of(&views());
        assert_eq!(begun.contradiction(&Fingerprint::of(&views())), None);
        let changes: [fn(&mut View); 8] = [
            |view| view.partition = Partition::Test,
            |view| view.name.push('2'),
            |view| view.camera_name.push('2'),
            |view| view.camera.width = 3,
            |view| view.time = 0.500_000_1,
            |view| view.camera.translation[2] = 1e-9,
            |view| view.camera.fx = 9.1,
            |view| view.file_bytes = 1,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut changed = views();
            change(&mut changed[1]);
            let said = begun.contradiction(&Fingerprint::of(&changed));
            let said = said.unwrap_or_else(|| panic!("change {index}"));
            assert!(said.contains("found 2 of which some"), "{said}");
        }
        let said = begun.contradiction(&Fingerprint::of(&views()[..1]));
        let expected = "expected the 2 views that the run was begun with, found 1";
        assert_eq!(said.as_deref(), Some(expected));
        let mut swapped = views();
        swapped.reverse();
        assert!(begun.contradiction(&Fingerprint::of(&swapped)).is_some());
    }
}
