//! Cameras out of step: when each sees motion, against when the others do.

use std::collections::BTreeMap;

use super::finding::Finding;
use super::tracks::{Track, Tracks};
use crate::numbers::median;

/// Least number of cameras to tell which one is out of step.
const MIN_CAMERAS: usize = 3;
/// Steps that must overlap at every offset.
const MIN_OVERLAP: usize = 15;
/// Largest offset that is tried, in frames and as a share of the clip.
const MAX_OFFSET: usize = 30;
const MAX_OFFSET_SHARE: f64 = 0.34;
/// Correlation at the best offset that makes it certain.
const CERTAIN: f64 = 0.75;
/// How much better it must be than no offset, in correlation.
const BETTER: f64 = 0.15;
/// How much better than all offsets more than one frame from it.
const UNIQUE: f64 = 0.1;
/// Correlation without offset above which a camera is in step.
const IN_STEP: f64 = 0.5;

/// Motion by frame: the change that leads to it, 0 on average and of spread 1.
fn motion(track: &Track) -> BTreeMap<i64, f64> {
    let steps = track.looks[1..].iter().zip(&track.steps);
    let raw: Vec<(i64, f64)> = steps
        .map(|(look, step)| (look.frame as i64, step.energy.sqrt()))
        .collect();
    let n = raw.len().max(1) as f64;
    let mean = raw.iter().map(|(_, v)| v).sum::<f64>() / n;
    let spread = (raw.iter().map(|(_, v)| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    if spread <= 1e-9 {
        return BTreeMap::new();
    }
    raw.into_iter()
        .map(|(frame, v)| (frame, (v - mean) / spread))
        .collect()
}

/// The correlation of `own`, read `offset` frames later, with `other`.
fn correlation(own: &BTreeMap<i64, f64>, other: &BTreeMap<i64, f64>, offset: i64) -> Option<f64> {
    let pairs: Vec<(f64, f64)> = other
        .iter()
        .filter_map(|(frame, b)| Some((*own.get(&(frame + offset))?, *b)))
        .collect();
    if pairs.len() < MIN_OVERLAP {
        return None;
    }
    let n = pairs.len() as f64;
    let (mean_a, mean_b) = (
        pairs.iter().map(|p| p.0).sum::<f64>() / n,
        pairs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    (aa > 0.0 && bb > 0.0).then(|| ab / (aa * bb).sqrt())
}

/// The offset at which a camera's motion fits the others', frames, and the correlation there; `None`
/// when it is not clear.
fn offset(own: &BTreeMap<i64, f64>, others: &BTreeMap<i64, f64>) -> Option<(i64, f64, f64)> {
    let reach = (MAX_OFFSET_SHARE * others.len() as f64).min(MAX_OFFSET as f64) as i64;
    let tried: Vec<(i64, f64)> = (-reach..=reach)
        .filter_map(|offset| Some((offset, correlation(own, others, offset)?)))
        .collect();
    let &(best, height) = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let at_rest = tried.iter().find(|t| t.0 == 0)?.1;
    let elsewhere = tried
        .iter()
        .filter(|t| (t.0 - best).abs() > 1)
        .map(|t| t.1)
        .fold(f64::NEG_INFINITY, f64::max);
    let clear = height >= CERTAIN && height >= elsewhere + UNIQUE;
    (clear && (best == 0 || height >= at_rest + BETTER)).then_some((best, height, at_rest))
}

/// Which cameras are out of step with the others, and by how much.
pub(super) fn check(looked: &Tracks) -> Option<Finding> {
    if !looked.rig || looked.tracks.len() < MIN_CAMERAS {
        return None;
    }
    let motions: Vec<BTreeMap<i64, f64>> = looked.tracks.iter().map(motion).collect();
    let others = |own: usize| {
        let mut by_frame: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
        for (_, motion) in motions.iter().enumerate().filter(|(i, _)| *i != own) {
            for (&frame, &value) in motion {
                by_frame.entry(frame).or_default().push(value);
            }
        }
        let middle = by_frame
            .into_iter()
            .filter_map(|(frame, values)| Some((frame, median(values)?)));
        middle.collect::<BTreeMap<i64, f64>>()
    };
    let (mut in_step, mut shifted) = (0, Vec::new());
    for (index, track) in looked.tracks.iter().enumerate() {
        let others = others(index);
        match offset(&motions[index], &others) {
            Some((0, _, _)) => in_step += 1,
            Some((offset, height, at_rest)) => {
                shifted.push((track.name.clone(), offset, height, at_rest))
            }
            None if correlation(&motions[index], &others, 0) > Some(IN_STEP) => in_step += 1,
            None => {}
        }
    }
    let n = looked.tracks.len();
    if shifted.is_empty() {
        let text = match in_step {
            0 => "whether cameras are in step can't be told from when they see motion".into(),
            _ => format!(
                "{in_step} of {n} cameras see motion at the same times; no offset is clear in the others"
            ),
        };
        return Some(if in_step == n {
            Finding::ok(
                "sync",
                format!("all {n} cameras see motion at the same times"),
            )
        } else {
            Finding::note("sync", text)
        });
    }
    let named: Vec<String> = shifted
        .iter()
        .map(|(name, offset, height, at_rest)| {
            let (frames, side) = (offset.abs(), if *offset > 0 { "late" } else { "early" });
            let plural = if frames == 1 { "" } else { "s" };
            format!("{name} is {frames} frame{plural} {side} (correlation {height:.2}, {at_rest:.2} as it is)")
        })
        .collect();
    Some(Finding::warning(
        "sync",
        format!("cameras out of step: {}", super::finding::listed(&named)),
        "drop as many frames at the start of a camera that is late, or of all others for one that is early",
    ))
}

#[cfg(test)]
mod tests {
    use super::super::small::Step;
    use super::super::tracks::Look;
    use super::*;

    /// A camera that sees one leap at frame `at` and a smaller one later.
    fn track(name: &str, offset: usize, size: f64) -> Track {
        let step = |frame: usize| {
            let at =
                |centre: usize| (-(frame as f64 - (centre + offset) as f64).powi(2) / 4.0).exp();
            Step {
                energy: size * (0.1 + at(8) + 0.4 * at(17)).powi(2),
                moved: 0.1,
                same: 0.0,
                gain: None,
            }
        };
        Track {
            name: name.into(),
            looks: (0..30)
                .map(|frame| Look {
                    frame,
                    mean: 0.5,
                    brightest: 1.0,
                    counted: None,
                })
                .collect(),
            steps: (1..30).map(step).collect(),
            span_moved: 0.0,
        }
    }

    fn looked(tracks: Vec<Track>) -> Tracks {
        Tracks {
            tracks,
            standing: true,
            rig: true,
            left_out: 0,
            broken: Vec::new(),
        }
    }

    #[test]
    fn a_late_and_an_early_camera_are_named_with_their_frames() {
        let mut tracks: Vec<Track> = (0..5)
            .map(|i| track(&format!("cam{i}"), 3, 1.0 + i as f64))
            .collect();
        let clean = check(&looked(tracks.clone())).expect("a rig");
        assert_eq!(clean.severity, super::super::Severity::Ok, "{clean}");
        tracks[1] = track("cam1", 5, 2.0);
        tracks[4] = track("cam4", 0, 2.0);
        let found = check(&looked(tracks)).expect("a rig").text;
        assert!(found.contains("cam1 is 2 frames late"), "{found}");
        assert!(found.contains("cam4 is 3 frames early"), "{found}");
        assert!(!found.contains("cam0"), "{found}");
    }

    #[test]
    fn motion_that_says_nothing_is_not_made_into_an_offset() {
        let mut tracks: Vec<Track> = (0..4).map(|i| track(&format!("cam{i}"), 3, 1.0)).collect();
        // Periodic motion fits at several offsets.
        for track in &mut tracks {
            for (i, step) in track.steps.iter_mut().enumerate() {
                step.energy = 1.0 + f64::from((i as u32).is_multiple_of(4));
            }
        }
        for (i, step) in tracks[2].steps.iter_mut().enumerate() {
            step.energy = 1.0 + f64::from(i as u32 % 4 == 2);
        }
        let found = check(&looked(tracks)).expect("a rig");
        assert!(found.severity < super::super::Severity::Warning, "{found}");
    }
}
