//! Frames that are decoded together.

use std::sync::Arc;

use super::recipe::{Recipe, Source};
use crate::Error;
use crate::dataset::pixels::image::ImageData;
use crate::video::VideoIndex;

/// Recipes that are decoded together: a group of pictures of a video, or a single file.
pub(crate) fn groups(recipes: &[Recipe]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut open: Option<(*const VideoIndex, usize)> = None;
    for (index, recipe) in recipes.iter().enumerate() {
        let key = match &recipe.source {
            Source::File(_) => None,
            Source::Video { video, frame } => {
                Some((Arc::as_ptr(video), video.group_of(*frame).start))
            }
        };
        match groups.last_mut() {
            Some(group) if key.is_some() && key == open => group.push(index),
            _ => groups.push(vec![index]),
        }
        open = key;
    }
    groups
}

/// Makes the images of a group, one after the other as they are decoded.
pub(crate) fn make_group(
    recipes: &[Recipe],
    group: &[usize],
    mut on_image: impl FnMut(usize, ImageData) -> Result<(), Error>,
) -> Result<(), Error> {
    let frames_of_video = |index: usize| match &recipes[index].source {
        Source::File(_) => None,
        Source::Video { video, frame } => Some((video, *frame)),
    };
    let Some((video, first)) = group.first().and_then(|&index| frames_of_video(index)) else {
        return group
            .iter()
            .try_for_each(|&index| on_image(index, recipes[index].make()?));
    };
    let wanted: Vec<(usize, usize)> = group
        .iter()
        .filter_map(|&index| Some((index, frames_of_video(index)?.1)))
        .collect();
    let end = wanted
        .iter()
        .map(|&(_, frame)| frame + 1)
        .max()
        .unwrap_or(first);
    video.decode(first..end, |frame, image| {
        let mut wanting = wanted
            .iter()
            .filter(|(_, wanted)| *wanted == frame)
            .peekable();
        let mut image = Some(ImageData::from(image));
        while let Some(&(index, _)) = wanting.next() {
            // The last one takes the image without a copy; more than one is rare.
            let own = match wanting.peek() {
                Some(_) => image.clone(),
                None => image.take(),
            };
            on_image(
                index,
                recipes[index].finish(own.ok_or_else(|| video.is_missing(frame))?)?,
            )?;
        }
        Ok(())
    })
}
