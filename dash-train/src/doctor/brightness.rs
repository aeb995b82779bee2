//! Exposure: jumps between cameras and along time.

use super::finding::{Finding, listed};
use super::tracks::{Track, Tracks};
use crate::numbers::median;

/// A camera that is this much brighter or darker than the middle one, a third of a stop, is set
/// differently.
const CAMERA_JUMP: f64 = 1.26;
/// A smaller difference that is worth knowing.
const CAMERA_DIFFERENCE: f64 = 1.12;
/// The same for means of whole pictures, which also differ by their content.
const WHOLE_DIFFERENCE: f64 = 1.5;
/// A change of most of a picture by this factor from one frame to the next is a jump.
const FRAME_JUMP: f64 = 1.08;
/// Restless exposure: the middle change from frame to frame.
const FLICKER: f64 = 1.015;
/// A drift over the whole track by this factor is worth knowing.
const DRIFT: f64 = 1.3;
/// Steps that make a flicker.
const MIN_STEPS: usize = 6;

/// Exposures `gains` of cameras, measured on points, against each other.
pub(super) fn between_cameras(gains: &[(String, f64)]) -> Option<Finding> {
    let middle = median(gains.iter().map(|(_, gain)| *gain))?;
    let relative: Vec<(&str, f64)> = gains
        .iter()
        .map(|(name, gain)| (name.as_str(), gain / middle))
        .collect();
    let off = |gain: f64| gain.max(1.0 / gain);
    let beyond = |least: f64| {
        let mut found: Vec<&(&str, f64)> = relative.iter().filter(|r| off(r.1) > least).collect();
        found.sort_by(|a, b| off(b.1).total_cmp(&off(a.1)));
        let named = found
            .iter()
            .map(|(name, gain)| format!("{name} x{gain:.2}"));
        named.collect::<Vec<_>>()
    };
    let (low, high) = relative
        .iter()
        .fold((1.0_f64, 1.0_f64), |(low, high), (_, gain)| {
            (low.min(*gain), high.max(*gain))
        });
    let range = format!(
        "exposures from {low:.2} to {high:.2} of the middle one, on the points that cameras share"
    );
    let (jumps, differences) = (beyond(CAMERA_JUMP), beyond(CAMERA_DIFFERENCE));
    Some(if !jumps.is_empty() {
        Finding::warning(
            "brightness",
            format!(
                "cameras are brighter or darker than the middle one: {}",
                listed(&jumps)
            ),
            "divide these cameras' pictures by their factor, or fix exposure and white balance when recording",
        )
    } else if !differences.is_empty() {
        Finding::note("brightness", format!("{range}: {}", listed(&differences)))
    } else {
        Finding::ok("brightness", range)
    })
}

/// The same by whole pictures, which show different things: only large differences are told.
pub(super) fn of_whole_pictures(looked: &Tracks) -> Option<Finding> {
    if !looked.rig {
        return None;
    }
    let usual = |track: &Track| {
        let means = track.looks.iter().map(|look| look.mean);
        Some((track.name.clone(), median(means)?))
    };
    let means: Vec<(String, f64)> = looked.tracks.iter().filter_map(usual).collect();
    let middle = median(means.iter().map(|(_, mean)| *mean))?;
    let off = |mean: f64| mean > WHOLE_DIFFERENCE * middle || WHOLE_DIFFERENCE * mean < middle;
    let named: Vec<String> = means
        .iter()
        .filter(|(_, mean)| off(*mean))
        .map(|(name, mean)| format!("{name} x{:.2}", mean / middle))
        .collect();
    (!named.is_empty()).then(|| {
        let text = format!(
            "whole pictures are brighter or darker than the middle camera's: {}",
            listed(&named)
        );
        Finding::note("brightness", text)
    })
}

/// Exposure along each camera's time.
pub(super) fn along_time(looked: &Tracks) -> Option<Finding> {
    let (mut jumps, mut restless, mut drifting) = (Vec::new(), Vec::new(), Vec::new());
    let mut told = false;
    for track in &looked.tracks {
        let log_gain = |gain: Option<f64>| gain.map(f64::ln);
        let gains: Vec<f64> = track
            .steps
            .iter()
            .filter_map(|s| log_gain(s.gain))
            .collect();
        told |= !gains.is_empty();
        let usual = median(gains.iter().map(|g| g.abs())).unwrap_or(0.0);
        let worst = track
            .steps
            .iter()
            .enumerate()
            .filter_map(|(i, step)| Some((log_gain(step.gain)?, track.looks[i + 1].frame)))
            .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        let drift: f64 = gains.iter().sum();
        if gains.len() >= MIN_STEPS && usual > FLICKER.ln() {
            restless.push(format!("{} {:.1} %", track.name, 100.0 * usual));
        } else if let Some((jump, frame)) = worst
            && jump.abs() > FRAME_JUMP.ln()
        {
            jumps.push(format!(
                "{} x{:.2} at frame {frame}",
                track.name,
                jump.exp()
            ));
        } else if drift.abs() > DRIFT.ln() {
            drifting.push(format!("{} x{:.2}", track.name, drift.exp()));
        }
    }
    if !told {
        return None;
    }
    if jumps.is_empty() && restless.is_empty() && drifting.is_empty() {
        return Some(Finding::ok(
            "exposure",
            "no jumps and no flicker along time",
        ));
    }
    let mut parts = Vec::new();
    for (what, found) in [
        ("brightness jumps", jumps),
        ("brightness flickers from frame to frame", restless),
        ("brightness drifts over the clip", drifting),
    ] {
        if !found.is_empty() {
            parts.push(format!("{what}: {}", listed(&found)));
        }
    }
    let mend = "fix exposure when recording, or even it out (ffmpeg's `deflicker`): changes of light are \
                otherwise modelled as motion";
    Some(Finding::warning("exposure", parts.join("; "), mend))
}
