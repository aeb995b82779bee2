//! Motion: repeated, frozen and black pictures, and scenes at rest.

use super::finding::{Finding, listed, percent};
use super::tracks::{Track, Tracks};
use crate::numbers::median;

/// Brightest pixel of a picture that is black.
const BLACK: f32 = 0.04;
/// Brightness of a camera's other pictures from which on a black one is not its usual look.
const NOT_DARK: f64 = 0.02;
/// Share of exactly equal pixels in two equal pictures.
const REPEATED: f64 = 0.9999;
/// Share of unchanged pixels above which pictures have no sensor noise, as rendered ones. Two equal ones then only
/// show that nothing moved in view.
const NOISELESS: f64 = 0.6;
/// Change of a frozen camera, as a share of the other cameras'.
const FROZEN: f64 = 0.02;
/// The scene is at rest when less than this share of pixels moves in every camera.
const AT_REST: f64 = 0.0005;

/// Findings about motion.
pub(super) fn check(looked: &Tracks) -> Vec<Finding> {
    let mut findings = Vec::new();
    findings.extend(black(looked));
    findings.extend(repeated(looked));
    if looked.tracks.iter().all(|track| track.steps.is_empty()) {
        return findings;
    }
    if !looked.standing {
        let text = "one camera is carried along: motion and shape are found together, which is harder than with \
                    a rig, and the camera's poses must be exact";
        findings.push(Finding::note("motion", text));
        return findings;
    }
    let most = |track: &Track| track.steps.iter().map(|s| s.moved).fold(0.0, f64::max);
    let busiest = looked.tracks.iter().map(most).fold(0.0, f64::max);
    let spans = looked.tracks.iter().map(|track| track.span_moved);
    let over_clip = spans.fold(0.0, f64::max);
    let share = |moved: f64| percent((1e6 * moved) as usize, 1_000_000);
    findings.push(if busiest >= AT_REST {
        let text = format!("up to {} of a picture moves from frame to frame", share(busiest));
        Finding::ok("motion", text)
    } else if over_clip >= AT_REST {
        let text = format!(
            "slow motion: up to {} of a picture changes over the clip, at most {} from frame to frame",
            share(over_clip),
            share(busiest)
        );
        Finding::ok("motion", text)
    } else {
        let text = format!(
            "hardly anything moves (at most {} of a picture from frame to frame, {} over the clip): the scene is \
             static, and one frame says as much as all",
            share(busiest),
            share(over_clip)
        );
        Finding::note("motion", text)
    });
    findings
}

fn black(looked: &Tracks) -> Option<Finding> {
    let mut named = Vec::new();
    for track in &looked.tracks {
        let usual = median(track.looks.iter().map(|look| look.mean)).unwrap_or(0.0);
        let frames: Vec<usize> = track
            .looks
            .iter()
            .filter(|look| look.brightest < BLACK)
            .map(|look| look.frame)
            .collect();
        if frames.len() == track.looks.len() && !frames.is_empty() {
            named.push(format!("{} (all frames)", track.name));
        } else if usual > NOT_DARK {
            named.extend(
                frames
                    .iter()
                    .map(|frame| format!("{} frame {frame}", track.name)),
            );
        }
    }
    (!named.is_empty()).then(|| {
        let mend = "remove these frames from every camera, or record them again";
        Finding::warning(
            "frames",
            format!("black pictures: {}", listed(&named)),
            mend,
        )
    })
}

/// Frozen cameras, and single pictures that repeat the one before.
fn repeated(looked: &Tracks) -> Option<Finding> {
    let moving: Vec<&Track> = looked
        .tracks
        .iter()
        .filter(|track| !track.steps.is_empty())
        .collect();
    let usual = median(moving.iter().map(|track| track.usual_energy()))?;
    let (mut frozen, mut twice) = (Vec::new(), Vec::new());
    for track in moving {
        let same: Vec<bool> = track.steps.iter().map(|s| s.same >= REPEATED).collect();
        let all_same = same.iter().all(|&same| same);
        let noise = median(track.steps.iter().map(|s| s.same)).unwrap_or(1.0);
        if looked.rig && all_same && track.usual_energy() < FROZEN * usual {
            frozen.push(track.name.clone());
            continue;
        }
        let own = track.usual_energy();
        let around = |i: usize| {
            let before = i.checked_sub(1).map(|i| track.steps[i].energy);
            [before, track.steps.get(i + 1).map(|s| s.energy)]
        };
        for (i, _) in same.iter().enumerate().filter(|(_, same)| **same) {
            let sudden = around(i)
                .into_iter()
                .flatten()
                .all(|energy| energy > 0.5 * own);
            let lonely = own > 0.0 && sudden && others_move(looked, track, i);
            if noise < NOISELESS || lonely {
                twice.push(format!("{} frame {}", track.name, track.looks[i + 1].frame));
            }
        }
    }
    let mut parts = Vec::new();
    if !frozen.is_empty() {
        parts.push(format!(
            "the picture of {} never changes while the others' do",
            listed(&frozen)
        ));
    }
    if !twice.is_empty() {
        parts.push(format!(
            "pictures repeat the one before: {}",
            listed(&twice)
        ));
    }
    (!parts.is_empty()).then(|| {
        let mend = "record again or extract the frames again at the video's own rate; leave a frozen camera out";
        Finding::warning("frames", parts.join("; "), mend)
    })
}

/// Whether most other cameras see as much motion as usual while this one repeats a picture.
fn others_move(looked: &Tracks, own: &Track, step: usize) -> bool {
    let frame = own.looks[step + 1].frame;
    let share = |track: &Track| {
        let i = track
            .looks
            .iter()
            .position(|look| look.frame == frame)?
            .checked_sub(1)?;
        let usual = track.usual_energy();
        (usual > 0.0).then(|| track.steps[i].energy / usual)
    };
    let others: Vec<f64> = looked
        .tracks
        .iter()
        .filter(|track| track.name != own.name)
        .filter_map(share)
        .collect();
    median(others).is_none_or(|middle| middle > 0.5)
}

#[cfg(test)]
mod tests {
    use super::super::finding::Severity;
    use super::super::tracks::look;
    use super::*;
    use crate::test_kit::slow_clips;

    #[test]
    fn slow_motion_is_motion_at_every_rate_and_noise() {
        for (clip, moves) in slow_clips() {
            let findings = check(&look(&clip.dataset()));
            let last = findings.last().expect("about motion");
            let is_static = last.severity == Severity::Note;
            assert_eq!(!is_static, moves, "{clip:?}: {}", last.text);
        }
    }
}
