//! Masks of the pixels that count: finding a view's mask, and warnings about all of them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::mask_file::decode_mask;
use crate::Error;
use crate::files::{self};

/// Folder with masks of the pixels that count.
pub(crate) const MASK_FOLDER: &str = "masks";
/// If a smaller share of all pixels counts, the masks may be inverted.
pub(crate) const HARDLY_ANY: f64 = 0.01;
/// Masks that are checked on loading, evenly chosen: they give the share to a few per cent.
const LOOKED_AT: usize = 64;

/// The mask of a view's pixels that count.
#[derive(Debug, Clone)]
pub(crate) struct CountedMask {
    pub(crate) path: PathBuf,
    /// Whether white marks the pixels to ignore.
    pub(crate) inverted: bool,
}

/// The mask of the view `name` in a folder of masks: `NAME.png`, or with the extension of the view's `image`
/// before that, as COLMAP names masks.
pub(crate) fn beside(folder: &Path, name: &str, image: Option<&Path>) -> Option<PathBuf> {
    let mut names = vec![format!("{name}.png")];
    if let Some(extension) = image.and_then(Path::extension) {
        names.push(format!("{name}.{}.png", extension.to_string_lossy()));
    }
    let mut paths = names
        .into_iter()
        .map(|name| files::in_either_form(folder, Path::new(&name)));
    paths.find(|path| path.is_file())
}

/// A warning for a folder of masks that no view uses, with the expected name of the view `name`'s mask.
pub(crate) fn unused_folder(root: &Path, name: &str) -> Option<String> {
    let names = files::list(&root.join(MASK_FOLDER)).ok()?;
    (!names.is_empty()).then(|| {
        format!(
            "no view uses anything in {MASK_FOLDER}/: the mask of the view {name} would be \
             {MASK_FOLDER}/{name}.png"
        )
    })
}

/// A warning for masks that no view uses, where `without` of all `n` views have none.
pub(crate) fn unused_files(
    root: &Path,
    used: &BTreeSet<&Path>,
    without: &[&str],
    n: usize,
) -> Option<String> {
    let first = without.first()?;
    let folder = root.join(MASK_FOLDER);
    let inside = |path: PathBuf| match path.is_dir() {
        true => files::list(&path)
            .unwrap_or_default()
            .iter()
            .map(|name| path.join(name))
            .collect(),
        false => vec![path],
    };
    let all = files::list(&folder).ok()?;
    let mut all = all.iter().flat_map(|name| inside(folder.join(name)));
    let is_mask = |path: &PathBuf| {
        path.is_file() && files::has_extension(&path.to_string_lossy(), &files::IMAGE_EXTENSIONS)
    };
    let unused = all.find(|path| is_mask(path) && !used.contains(path.as_path()))?;
    Some(format!(
        "{} of {n} views have no mask, and no view uses {}: the mask of the view {first} would be \
         {MASK_FOLDER}/{first}.png",
        without.len(),
        unused.strip_prefix(root).unwrap_or(&unused).display()
    ))
}

/// A warning if hardly any pixel counts by the masks of all views, each with its image's size.
///
/// # Errors
/// When a mask that is looked at does not fit or can't be read.
pub(crate) fn doubt(
    masks: &[Option<(&CountedMask, (usize, usize))>],
) -> Result<Option<String>, Error> {
    let masked: Vec<_> = masks.iter().flatten().copied().collect();
    if masked.is_empty() {
        return Ok(None);
    }
    let kept = masked.len().min(LOOKED_AT);
    let looked_at: Vec<_> = (0..kept).map(|k| masked[k * masked.len() / kept]).collect();
    let shares: Vec<f64> = looked_at
        .into_par_iter()
        .map(|(mask, size)| counted_share(mask, size))
        .collect::<Result<_, Error>>()?;
    let without = (masks.len() - masked.len()) as f64;
    let counted = without + shares.iter().sum::<f64>() / kept as f64 * masked.len() as f64;
    let share = counted / masks.len() as f64;
    Ok((share < HARDLY_ANY).then(|| {
        format!(
            "masks let only {:.2} % of all pixels count; if white marks what does not, use --invert-masks",
            100.0 * share
        )
    }))
}

/// Share of the pixels that count in an image, before its lens is undone.
fn counted_share(mask: &CountedMask, size: (usize, usize)) -> Result<f64, Error> {
    let counted = decode_mask(&mask.path, size)?.thresholded(mask.inverted);
    let n = counted.iter().filter(|&&counts| counts > 0).count();
    Ok(n as f64 / counted.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Masks of 20x10 pixels of which so many count.
    fn masks(folder: &Path, counted: &[usize]) -> Vec<CountedMask> {
        let write = |(index, &n): (usize, &usize)| {
            let path = folder.join(format!("{index}.png"));
            let white = |x, y| image::Luma([if (x + 20 * y) < n as u32 { 255 } else { 0 }]);
            let mask = image::GrayImage::from_fn(20, 10, white);
            mask.save(&path).expect("writes");
            let inverted = false;
            CountedMask { path, inverted }
        };
        counted.iter().enumerate().map(write).collect()
    }

    #[test]
    fn masks_with_which_hardly_any_pixel_counts_are_doubted() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let size = (20, 10);
        // Less than 1 % of 200, and as much.
        for (counted, doubted) in [([0, 3], true), ([0, 4], false), ([0, 0], true)] {
            let masks = masks(folder.path(), &counted);
            let of_views: Vec<_> = masks.iter().map(|mask| Some((mask, size))).collect();
            let found = doubt(&of_views).expect("reads");
            assert_eq!(found.is_some(), doubted, "{counted:?}: {found:?}");
            let said = found.unwrap_or("--invert-masks".into());
            assert!(said.contains("--invert-masks"), "{said}");
            // Views without a mask count as a whole.
            let with_others = [of_views, vec![None]].concat();
            assert_eq!(doubt(&with_others).expect("reads"), None);
        }
        assert_eq!(doubt(&[None, None]).expect("reads"), None);
        let one = &masks(folder.path(), &[1])[0];
        assert!(doubt(&[Some((one, (10, 10)))]).is_err());
    }

    #[test]
    fn masks_that_no_view_uses_are_told_where_views_have_none() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path();
        std::fs::create_dir_all(root.join("masks/cam")).expect("made");
        let [used, other] = ["masks/cam/0.png", "masks/cam/1.jpg"].map(|name| root.join(name));
        std::fs::write(&used, "").expect("writes");
        std::fs::write(root.join("masks/README.txt"), "").expect("writes");
        let told =
            |without: &[&str]| unused_files(root, &BTreeSet::from([used.as_path()]), without, 2);
        assert_eq!(told(&["cam/1"]), None);
        std::fs::write(other, "").expect("writes");
        assert_eq!(told(&[]), None, "every view has a mask");
        let said = told(&["cam/1"]).expect("one is not used");
        assert!(said.contains("no view uses masks/cam/1.jpg"), "{said}");
        assert!(said.contains("would be masks/cam/1.png"), "{said}");
    }

    #[test]
    fn a_folder_of_masks_that_no_view_uses_is_told() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path();
        assert_eq!(unused_folder(root, "images/a"), None);
        std::fs::create_dir(root.join("masks")).expect("made");
        assert_eq!(unused_folder(root, "images/a"), None, "an empty folder");
        std::fs::write(root.join("masks/a.png"), "").expect("writes");
        let said = unused_folder(root, "images/a").expect("a file");
        assert!(said.contains("would be masks/images/a.png"), "{said}");
    }
}
