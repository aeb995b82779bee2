//! The order of names in which rows of `poses_bounds.npy` are written.
//!
//! LLFF's tools (`np.argsort`) and readers of Neural 3D Video (`sorted`) compare names byte by byte, so that `cam10`
//! comes before `cam2`; everywhere else here numbers in names are compared as numbers.

use std::path::Path;

use crate::files::natural_cmp;

/// Sorts items by their names byte by byte, and warns if natural order differs.
pub(crate) fn sort<T>(items: &mut [T], poses_file: &Path, name: impl Fn(&T) -> String) {
    items.sort_by_cached_key(&name);
    let names: Vec<String> = items.iter().map(name).collect();
    if let Some(told) = difference(&names) {
        tracing::warn!("{}: {told}", poses_file.display());
    }
}

/// The file's name with its extension, which counts in the order.
pub(crate) fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// A warning if names in plain order are not in natural order.
fn difference(plain: &[String]) -> Option<String> {
    let mut natural: Vec<&String> = plain.iter().collect();
    natural.sort_by(|a, b| natural_cmp(a, b));
    let (row, (plain, natural)) = plain
        .iter()
        .zip(natural)
        .enumerate()
        .find(|(_, (plain, natural))| plain != natural)?;
    Some(format!(
        "rows belong to names in plain order, as tools write them: row {row} to {plain} and not to {natural}; if it is \
         the other way round, write the numbers with leading zeros"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_byte_by_byte_and_what_differs_is_told() {
        let sorted = |mut names: Vec<&str>| {
            sort(&mut names, Path::new("poses_bounds.npy"), |name| {
                name.to_string()
            });
            let names: Vec<String> = names.into_iter().map(str::to_string).collect();
            (names.join(" "), difference(&names))
        };
        let padded = sorted(vec!["cam10", "cam02", "cam01"]);
        assert_eq!(padded, ("cam01 cam02 cam10".to_string(), None));
        let (names, told) = sorted(vec!["cam2", "cam11", "cam1", "cam10"]);
        assert_eq!(names, "cam1 cam10 cam11 cam2");
        let told = told.expect("differs from the second row on");
        assert!(told.contains("row 1 to cam10 and not to cam2"), "{told}");
        // The extension takes part, as in lists of files.
        let (names, _) = sorted(vec!["cam1.mp4", "cam1-b.mp4"]);
        assert_eq!(names, "cam1-b.mp4 cam1.mp4");
    }
}
