//! The Gaussians of one instant.

use dash_model::{GaussianRows, logit};

use super::{Drawn, SceneOverTime};
use crate::Error;

/// All Gaussians that show `time` in [0, 1], and the near plane that they are drawn with. Where windows of time fade into each
/// other these are the Gaussians of both, each with as much opacity as leaves both layers together as opaque as one.
///
/// # Errors
/// When a file can't be read, or a kernel refuses its input.
pub fn rows_at(scene: &dyn SceneOverTime, time: f32) -> Result<(GaussianRows, f64), Error> {
    let (mut all, mut near_plane) = (None, 0.0);
    for Drawn { scene, time, share } in scene.drawn_at(time)? {
        let mut rows = scene.at(time)?;
        if share < 1.0 {
            for opacity in &mut rows.opacity_logits {
                *opacity = thinned(*opacity, share);
            }
        }
        near_plane = scene.settings.near_plane;
        all = Some(match all {
            None => rows,
            Some(before) => joined(before, rows),
        });
    }
    Ok((all.unwrap_or_default(), near_plane))
}

/// Rows behind others. One scene may have been found to need no higher colour coefficients.
fn joined(first: GaussianRows, second: GaussianRows) -> GaussianRows {
    let degree = first.sh_degree().max(second.sh_degree());
    let mut rows = first.with_sh_degree(degree);
    rows.append(&second.with_sh_degree(degree));
    rows
}

/// The logit of an opacity that lets through a power of what another one does: two layers of shares that add up to 1 let
/// through what one whole layer does.
fn thinned(opacity_logit: f32, share: f32) -> f32 {
    let through = 1.0 / (1.0 + f64::from(opacity_logit).exp());
    logit((1.0 - through.powf(f64::from(share))) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_thin_layers_let_through_what_one_does() {
        let through = |logit: f32| 1.0 / (1.0 + f64::from(logit).exp());
        for logit in [-6.0, -1.0, 0.0, 2.5, 9.0] {
            for share in [0.1, 0.5, 0.83] {
                let both = through(thinned(logit, share)) * through(thinned(logit, 1.0 - share));
                assert!(
                    (both / through(logit) - 1.0).abs() < 1e-3,
                    "{logit} {share}: {both}"
                );
            }
        }
        assert!(thinned(40.0, 0.5).is_finite());
    }

    #[test]
    fn colours_of_two_degrees_become_those_of_the_higher() {
        let rows = |degree| GaussianRows::from_points(&[[0.0; 3]], &[[0.5; 3]], degree, 0.1);
        let both = joined(rows(1), rows(0));
        assert_eq!((both.len(), both.sh_degree()), (2, 1));
    }
}
