//! Makes many frames at once, and of damaged videos the frames that still decode.

use std::sync::Arc;

use rayon::prelude::*;

use super::groups::{groups, make_group};
use super::recipe::{Recipe, Source};
use crate::Error;
use crate::dataset::pixels::image::ImageData;

/// A decoded frame or its error; `None` if the error of another frame covers it.
pub(crate) type Outcome<T> = Option<Result<T, Error>>;

/// Makes all images, in parallel over files and videos, and keeps the result of `keep`.
pub(crate) fn make_all<T: Send>(
    recipes: &[Recipe],
    keep: impl Fn(ImageData) -> T + Sync,
) -> Vec<Outcome<T>> {
    make_groups(recipes, videos(recipes), keep)
        .into_iter()
        .map(Some)
        .collect()
}

/// Makes the frames of failed videos that still decode, and changes their recipes to read only these. The error of
/// a video's first lost frame covers all of them.
pub(crate) fn salvage<T: Send>(
    recipes: &mut [Recipe],
    made: &mut [Outcome<T>],
    keep: impl Fn(ImageData) -> T + Sync,
) {
    for group in videos(recipes) {
        let reason = group.iter().find_map(|&index| match made[index].take() {
            Some(Err(reason)) => Some((index, reason)),
            outcome => {
                made[index] = outcome;
                None
            }
        });
        let Some((failed, reason)) = reason else {
            continue;
        };
        let (Source::Video { video, .. }, Error::VideoDecode { .. }) =
            (&recipes[failed].source, &reason)
        else {
            made[failed] = Some(Err(reason));
            continue;
        };
        let sound = Arc::new(video.without_damage());
        let mut damage = Some(sound.damage(&reason));
        let mut had = Vec::new();
        for index in group {
            if let Source::Video { video, frame } = &mut recipes[index].source {
                *video = sound.clone();
                if sound.is_sound(*frame) {
                    had.push(index);
                } else {
                    made[index] = damage.take().map(Err);
                }
            }
        }
        let own: Vec<Recipe> = had.iter().map(|&index| recipes[index].clone()).collect();
        let again = make_groups(&own, groups(&own), &keep);
        for (index, outcome) in had.into_iter().zip(again) {
            made[index] = Some(outcome);
        }
    }
}

/// Makes the images of all groups, which follow one another in the recipes' order.
fn make_groups<T: Send>(
    recipes: &[Recipe],
    groups: Vec<Vec<usize>>,
    keep: impl Fn(ImageData) -> T + Sync,
) -> Vec<Result<T, Error>> {
    let made: Vec<Vec<Result<T, Error>>> = groups
        .into_par_iter()
        .map(|group| {
            let mut made: Vec<Option<T>> = group.iter().map(|_| None).collect();
            let first = group.first().copied().unwrap_or(0);
            let outcome = make_group(recipes, &group, |index, image| {
                if let Some(place) = made.get_mut(index - first) {
                    *place = Some(keep(image));
                }
                Ok(())
            });
            // The first missing frame gets the reason, the others are named.
            let mut reason = outcome.err();
            group
                .iter()
                .zip(made)
                .map(|(&index, made)| match made {
                    Some(made) => Ok(made),
                    None => Err(reason
                        .take()
                        .unwrap_or_else(|| recipes[index].source.is_missing())),
                })
                .collect()
        })
        .collect();
    made.into_iter().flatten().collect()
}

/// As [`groups`], with those of one video together.
fn videos(recipes: &[Recipe]) -> Vec<Vec<usize>> {
    let mut joined: Vec<Vec<usize>> = Vec::new();
    let video = |group: &[usize]| match &recipes[*group.first()?].source {
        Source::File(_) => None,
        Source::Video { video, .. } => Some(Arc::as_ptr(video)),
    };
    for group in groups(recipes) {
        match joined.last_mut() {
            Some(last) if video(&group).is_some() && video(last) == video(&group) => {
                last.extend(group);
            }
            _ => joined.push(group),
        }
    }
    joined
}
