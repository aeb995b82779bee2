//! What the folder holds: layout, counts, sizes, times.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::finding::{Finding, listed};
use crate::dataset::{Dataset, Layout, Partition, View};
use crate::files::frame_numbers;

/// Files by which layouts are known.
const MARKS: [(Layout, &str); 17] = [
    (Layout::N3dv, "poses_bounds.npy"),
    (Layout::Blender, "transforms_train.json"),
    (Layout::Blender, "transforms.json"),
    (Layout::Colmap, "sparse/0/cameras.bin"),
    (Layout::Colmap, "sparse/0/cameras.txt"),
    (Layout::Colmap, "sparse/cameras.bin"),
    (Layout::Colmap, "sparse/cameras.txt"),
    (Layout::Colmap, "cameras.bin"),
    (Layout::Colmap, "cameras.txt"),
    (Layout::Multipleview, "sparse_"),
    (Layout::Technicolor, "cameras_parameters.txt"),
    (Layout::Technicolor, "colmap/dense/workspace/sparse"),
    (Layout::Nerfies, "dataset.json"),
    (Layout::Panoptic, "train_meta.json"),
    (Layout::Rig, "videos"),
    (Layout::Rig, "transforms.json"),
    (Layout::Rig, "sparse"),
];
/// A step in time that is this many times the usual one is a gap.
const GAP: f64 = 3.5;
/// The same with one camera per timestep, whose times are irregular to begin with.
const GAP_MONOCULAR: f64 = 10.0;
/// Largest share of missing frames of a camera without a warning.
const FEW_LACKING: f64 = 0.02;

/// Which layout, and by which file.
pub(super) fn layout(root: &Path, layout: Layout, forced: bool) -> Finding {
    if forced {
        return Finding::ok("layout", format!("{layout}, as --layout says"));
    }
    let marks = MARKS.iter().filter(|(known, _)| *known == layout);
    let found = marks
        .map(|(_, mark)| *mark)
        .find(|mark| root.join(mark).exists());
    let reason = found.map_or_else(String::new, |mark| format!(", because there is {mark}"));
    Finding::ok("layout", format!("{layout}{reason}"))
}

/// Counts, sizes and times.
pub(super) fn contents(dataset: &Dataset, complete: bool) -> Vec<Finding> {
    let mut findings = vec![counts(dataset), pictures(dataset)];
    findings.extend(numbers(dataset).or_else(|| times(dataset)));
    if complete {
        findings.extend(lacking(dataset));
    }
    findings
}

fn counts(dataset: &Dataset) -> Finding {
    let held_out: BTreeSet<&str> = dataset
        .views_of(Partition::Test)
        .map(|view| view.camera_name.as_str())
        .collect();
    let held_out: Vec<&str> = held_out.into_iter().collect();
    let n_test = dataset.views_of(Partition::Test).count();
    let text = format!(
        "{} camera{} x {} frame{}: {} views to train on, {n_test} to test ({})",
        dataset.n_cameras,
        plural(dataset.n_cameras),
        dataset.n_frames,
        plural(dataset.n_frames),
        dataset.views.len() - n_test,
        listed(&held_out),
    );
    if n_test == 0 {
        return Finding::note(
            "counts",
            format!("{text}; without test views nothing measures the result (--test-cameras)"),
        );
    }
    Finding::ok("counts", text)
}

fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

fn pictures(dataset: &Dataset) -> Finding {
    let mut sizes: BTreeMap<(usize, usize), BTreeSet<&str>> = BTreeMap::new();
    for view in &dataset.views {
        let size = (view.camera.width, view.camera.height);
        sizes.entry(size).or_default().insert(&view.camera_name);
    }
    let with_alpha = dataset.views.iter().filter(|v| v.has_alpha()).count();
    let alpha = match with_alpha {
        0 => "without alpha",
        n if n == dataset.views.len() => "with alpha, over white",
        _ => "some with alpha, over white",
    };
    if let [(width, height)] = sizes.keys().collect::<Vec<_>>()[..] {
        return Finding::ok("pictures", format!("{width}x{height}, {alpha}"));
    }
    let sizes: Vec<String> = sizes
        .iter()
        .map(|((w, h), cameras)| {
            format!(
                "{w}x{h} of {} camera{}",
                cameras.len(),
                plural(cameras.len())
            )
        })
        .collect();
    Finding::note(
        "pictures",
        format!("several sizes: {}; {alpha}", listed(&sizes)),
    )
}

/// The distinct times, and gaps between them.
fn times(dataset: &Dataset) -> Option<Finding> {
    if dataset.is_static() {
        let text = "one time only: the scene is taken as static";
        let mut seen = BTreeSet::new();
        let again = dataset.views.iter().find(|v| !seen.insert(v.camera_index));
        return Some(match again {
            None => Finding::note("times", text),
            Some(view) => Finding::warning(
                "times",
                format!("{text}, although {} has several pictures", view.camera_name),
                "unless nothing moves, give every frame a `time`",
            ),
        });
    }
    let mut times: Vec<f64> = dataset.views.iter().map(|v| f64::from(v.time)).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let (first, last) = (*times.first()?, *times.last()?);
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = crate::numbers::median(steps.iter().copied())?;
    let (at, widest) = steps
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)))?;
    let gap = if is_rig(&dataset.views, dataset.n_frames) {
        GAP
    } else {
        GAP_MONOCULAR
    };
    let stated = dataset
        .stated_span
        .map_or_else(String::new, |[first, last]| {
            format!(" (stretched; stated from {first} to {last})")
        });
    let rate = dataset
        .frame_rate
        .map_or_else(String::new, |rate| format!(", {rate:.2} in a second"));
    let range = format!(
        "{} times from {first:.3} to {last:.3}{stated}{rate}",
        times.len()
    );
    if times.len() > 3 && *widest > gap * usual {
        let text = format!(
            "{range}, with none between {:.3} and {:.3}, {:.0} times the usual step",
            times[at],
            times[at + 1],
            widest / usual
        );
        let mend = "add the missing frames, or train on the parts before and after apart: motion \
                    within the gap is guessed";
        return Some(Finding::warning("times", text, mend));
    }
    Some(Finding::ok("times", range))
}

/// Missing frame numbers, where the times have the same gaps.
fn numbers(dataset: &Dataset) -> Option<Finding> {
    if dataset.layout == Layout::Blender || dataset.is_static() {
        return None;
    }
    let first = &dataset.views.first()?.camera_name;
    let views = dataset.views.iter().filter(|v| &v.camera_name == first);
    let names: Vec<&str> = views.map(|view| view.name.as_str()).collect();
    let numbers: Vec<u64> = frame_numbers(&names)
        .into_iter()
        .filter_map(|digits| digits?.parse().ok())
        .collect();
    let steps: Vec<u64> = numbers
        .windows(2)
        .map(|p| p[1].saturating_sub(p[0]))
        .collect();
    let usual = *steps.iter().min().filter(|&&step| step > 0)?;
    let at = steps.iter().position(|&step| step > usual)?;
    let missing: u64 = steps.iter().map(|step| step / usual - 1).sum();
    let text = format!(
        "frame numbers leave out {missing}: after {} comes {}",
        numbers[at],
        numbers[at + 1]
    );
    let mend = "add the missing frames: motion within the gap is guessed";
    Some(Finding::warning("times", text, mend))
}

/// Cameras that do not have every frame, in a rig.
fn lacking(dataset: &Dataset) -> Option<Finding> {
    let mut frames: BTreeMap<&str, BTreeSet<usize>> = BTreeMap::new();
    for view in &dataset.views {
        frames
            .entry(&view.camera_name)
            .or_default()
            .insert(view.frame);
    }
    let most = frames.values().map(BTreeSet::len).max()?;
    if !is_rig(&dataset.views, dataset.n_frames) || most < 2 {
        return None;
    }
    let lacking: Vec<String> = frames
        .iter()
        .filter(|(_, own)| own.len() < dataset.n_frames)
        .map(|(name, own)| format!("{name} lacks {}", dataset.n_frames - own.len()))
        .collect();
    let n: usize = frames
        .values()
        .map(|own| dataset.n_frames - own.len())
        .sum();
    if lacking.is_empty() {
        return None;
    }
    let text = format!(
        "not every camera has all {} frames: {}",
        dataset.n_frames,
        listed(&lacking)
    );
    if (n as f64) < FEW_LACKING * dataset.views.len() as f64 {
        return Some(Finding::note("frames", text));
    }
    let mend = "add the frames, or leave these cameras out";
    Some(Finding::warning("frames", text, mend))
}

/// Whether several cameras look at the same time, as opposed to one that is carried, or to cameras in
/// turns.
pub(super) fn is_rig(views: &[View], n_frames: usize) -> bool {
    n_frames > 1 && views.len() >= 2 * n_frames
}
