//! A scene in parts, and whole again.

use burn::module::Param;
use burn::tensor::Tensor;
use dash_model::{DynamicScene, GaussianRows, Gaussians};

/// The static Gaussians of the first part, as a share of all.
const FIRST_SHARE: f64 = 0.25;
/// Static Gaussians that are not worth two parts.
const ONE_PART: usize = 4_000;

/// The scene in parts; each is whole without the others.
pub fn parts(scene: &DynamicScene) -> Vec<DynamicScene> {
    let device = scene.static_set.means.val().device();
    let rows = scene.static_set.to_rows();
    let set = |sources: &[usize]| Gaussians::from_rows(&rows.gather(sources), &device);
    let still = |static_set| DynamicScene {
        static_set,
        dynamic: None,
        settings: scene.settings.clone(),
    };
    let order = by_contribution(&rows);
    let first = match rows.len() > ONE_PART {
        true => (FIRST_SHARE * rows.len() as f64) as usize,
        false => rows.len(),
    };
    let mut parts = vec![still(set(&order[..first]))];
    if first < rows.len() {
        parts.push(still(set(&order[first..])));
    }
    if scene.dynamic.is_some() {
        parts.push(DynamicScene {
            dynamic: scene.dynamic.clone(),
            ..still(set(&[]))
        });
    }
    parts
}

/// Rows in falling order of opacity times area, which is what a picture shows of them at one distance.
pub(super) fn by_contribution(rows: &GaussianRows) -> Vec<usize> {
    let shown = |row: usize| {
        let mut log_scales = rows.log_scales[row];
        log_scales.sort_by(f32::total_cmp);
        let opacity = 1.0 / (1.0 + (-rows.opacity_logits[row]).exp());
        opacity * (log_scales[1] + log_scales[2]).exp()
    };
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by(|&a, &b| shown(b).total_cmp(&shown(a)));
    order
}

/// A scene and its next part: static Gaussians behind those that are there, and the dynamic part where it has one.
pub fn joined(scene: DynamicScene, part: DynamicScene) -> DynamicScene {
    DynamicScene {
        static_set: behind(scene.static_set, part.static_set),
        dynamic: part.dynamic.or(scene.dynamic),
        settings: part.settings,
    }
}

fn behind(first: Gaussians, second: Gaussians) -> Gaussians {
    match (first.is_empty(), second.is_empty()) {
        (_, true) => return first,
        (true, _) => return second,
        _ => {}
    }
    Gaussians {
        means: rows(first.means, second.means),
        quats: rows(first.quats, second.quats),
        log_scales: rows(first.log_scales, second.log_scales),
        opacity_logits: rows(first.opacity_logits, second.opacity_logits),
        sh_dc: rows(first.sh_dc, second.sh_dc),
        sh_rest: rows(first.sh_rest, second.sh_rest),
        trajectories: None,
        embeddings: None,
    }
}

fn rows<const D: usize>(first: Param<Tensor<D>>, second: Param<Tensor<D>>) -> Param<Tensor<D>> {
    Param::from_tensor(Tensor::cat(vec![first.val(), second.val()], 0))
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_model::SceneSettings;

    use super::*;

    /// Larger and more opaque ones come first, and nothing is lost.
    #[test]
    fn parts_are_the_scene_in_another_order() {
        let n = ONE_PART + 9;
        let points: Vec<[f32; 3]> = (0..n).map(|k| [k as f32, 0.0, 1.0]).collect();
        let mut rows = GaussianRows::from_points(&points, &vec![[0.5; 3]; n], 1, 0.1);
        for (k, scales) in rows.log_scales.iter_mut().enumerate() {
            *scales = [0.0, ((k * 7919) % n) as f32 * 1e-3, 0.0];
        }
        let device = Device::flex();
        let scene = DynamicScene {
            static_set: Gaussians::from_rows(&rows, &device),
            dynamic: None,
            settings: SceneSettings::default(),
        };
        let parts = parts(&scene);
        let counts: Vec<_> = parts.iter().map(DynamicScene::counts).collect();
        assert_eq!(counts, [(n / 4, 0), (n - n / 4, 0)]);
        let whole = parts.into_iter().reduce(joined).expect("two parts");
        let whole = whole.static_set.to_rows();
        let sizes: Vec<f32> = whole.log_scales.iter().map(|s| s[1]).collect();
        assert!(sizes.is_sorted_by(|a, b| a >= b));
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| rows.log_scales[b][1].total_cmp(&rows.log_scales[a][1]));
        assert_eq!(whole, rows.gather(&order));
    }
}
