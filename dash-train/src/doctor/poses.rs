//! Poses: by where the cameras' axes meet, and by the colours of the points where they project.

use dash_kernels::Camera;

use super::agreement::{Agreement, Picture, TOLERANCE};
use super::cloud::{Cloud, Kind};
use super::conventions::{CONVENTIONS, Meeting, meeting_in_front};
use super::finding::{Finding, Severity, listed};
use super::misplaced;
use crate::cameras::in_one_place;
use crate::numbers::median;

/// Fewer points than this tell nothing of the poses.
const MIN_POINTS: usize = 100;
/// Correlation of colours from which on poses and points belong together: captures that do have 0.44 and
/// more in the middle camera, those that do not mostly stay near 0.1, and near 0.25 where neighbouring
/// cameras are interchanged.
const SOUND: f64 = 0.35;
/// The same where one model has both: then most points may be hidden in most pictures.
const SOUND_OF_MODEL: f64 = 0.15;
/// A camera's score below this part of the cameras' middle one is suspicious.
const SUSPICIOUS: f64 = 0.4;
/// A pose explains a picture that scores this part of the middle one with it.
const EXPLAINS: f64 = 0.6;
/// Share of the cameras that must have the meeting point in front.
const MOST: f64 = 0.75;
/// A camera whose share of points in sight is below this part of the middle one sees too few.
const HARDLY_ANY: f64 = 0.1;

/// What the colours say of the poses.
pub(super) struct Verdict {
    pub(super) findings: Vec<Finding>,
    /// Whether points and poses belong together; `None` when points can't tell.
    pub(super) sound: Option<bool>,
    /// Whether a mistake was found that explains why they don't.
    pub(super) explained: bool,
    /// Cameras whose poses are in doubt.
    pub(super) doubtful: Vec<usize>,
    /// The exposure of every picture whose pose is sound.
    pub(super) gains: Vec<(String, f64)>,
}

/// Compares the points' colours with the pictures'. `of_model`: whether one COLMAP model has poses and points. A camera of it
/// has no other convention than the rest, and points that miss its colours are hidden there.
pub(super) fn by_colors(cloud: Option<&Cloud>, pictures: &[Picture], of_model: bool) -> Verdict {
    let mut verdict = Verdict {
        findings: Vec::new(),
        sound: None,
        explained: false,
        doubtful: Vec::new(),
        gains: Vec::new(),
    };
    let telling =
        |cloud: &&Cloud| cloud.kind == Kind::Measured && cloud.positions.len() >= MIN_POINTS;
    let Some(cloud) = cloud.filter(telling) else {
        return verdict;
    };
    let found: Vec<Agreement> = pictures
        .iter()
        .map(|p| Agreement::of(p, &p.camera, cloud, 1, |x| x))
        .collect();
    let scores: Vec<f64> = found.iter().map(Agreement::score).collect();
    let middle = median(scores.clone()).unwrap_or(0.0);
    let seen = median(found.iter().map(|a| a.seen as f64)).unwrap_or(0.0);
    let total = found.iter().map(|a| a.seen).sum::<usize>().max(1) as f64;
    let pooled = |of: fn(&Agreement) -> f64| {
        100.0 * found.iter().map(|a| of(a) * a.seen as f64).sum::<f64>() / total
    };
    let text = format!(
        "{:.0} % of the points lie on pixels of their own colour (within {TOLERANCE} per channel, exposure \
         undone), {:.0} % if the points' colours are interchanged; correlation {middle:.2} in the middle camera",
        pooled(|a| a.own),
        pooled(|a| a.chance)
    );
    let least = if of_model { SOUND_OF_MODEL } else { SOUND };
    verdict.sound = Some(middle >= least);
    let chance = median(found.iter().map(|a| a.chance)).unwrap_or(0.0);
    if middle < least {
        let finding = misplaced::explain(cloud, pictures, (middle, chance), &text);
        verdict.explained = finding.severity == Severity::Error;
        verdict.findings.push(finding);
        return verdict;
    }
    verdict.findings.push(Finding::ok("colours", text));
    let suspects: Vec<usize> = (0..pictures.len())
        .filter(|&i| scores[i] < SUSPICIOUS * middle || (found[i].seen as f64) < HARDLY_ANY * seen)
        .collect();
    verdict.doubtful = suspects.iter().map(|&i| pictures[i].camera_index).collect();
    verdict.gains = (0..pictures.len())
        .filter(|i| !suspects.contains(i))
        .filter_map(|i| Some((pictures[i].name.clone(), found[i].gain?)))
        .collect();
    let scored = (&scores[..], middle);
    verdict.findings.extend(match of_model {
        true => hidden(pictures, &suspects, scored),
        false => single(cloud, pictures, &suspects, scored),
    });
    verdict
}

/// Cameras of a model in which most points are hidden.
fn hidden(
    pictures: &[Picture],
    suspects: &[usize],
    (scores, middle): (&[f64], f64),
) -> Vec<Finding> {
    let named = |&i: &usize| format!("{} ({:.2})", pictures[i].name, scores[i]);
    let names: Vec<String> = suspects.iter().map(named).collect();
    let text = format!(
        "points miss their colours in {} (correlation; {middle:.2} in the middle camera): most are hidden there, or the pictures \
         were changed since",
        listed(&names)
    );
    (!names.is_empty())
        .then(|| Finding::note("poses", text))
        .into_iter()
        .collect()
}

/// What is wrong with single cameras' poses.
fn single(
    cloud: &Cloud,
    pictures: &[Picture],
    suspects: &[usize],
    (scores, middle): (&[f64], f64),
) -> Vec<Finding> {
    let explained = |score: f64| score >= EXPLAINS * middle;
    let best = |i: usize| Explained::best(cloud, pictures, i, explained);
    let mut findings = Vec::new();
    let mut unexplained = Vec::new();
    for &i in suspects {
        let name = &pictures[i].name;
        match best(i) {
            Some(Explained::ByConvention(fits, words)) => findings.push(Finding::error(
                "poses",
                format!(
                    "{name} has another convention than the other cameras: its colours correlate {:.2} \
                     with the points' as loaded, {fits:.2} with {words}",
                    scores[i]
                ),
                "write its pose as the others' are written",
            )),
            Some(Explained::ByPoseOf(fits, other)) => {
                let back = pose_that_fits(cloud, pictures, other, explained);
                let both = back.is_some_and(|back| back.1 == i);
                if both && other < i && suspects.contains(&other) {
                    continue;
                }
                let other = &pictures[other].name;
                let text = match both {
                    true => format!("the poses of {name} and {other} are interchanged"),
                    false => format!("{name} shows what the pose of {other} sees"),
                };
                findings.push(Finding::error(
                    "poses",
                    format!(
                        "{text}: colours of {name} correlate {:.2} with the points' as loaded, {fits:.2} \
                         with the other pose",
                        scores[i]
                    ),
                    "put the poses into the order of the cameras' names",
                ));
            }
            None => unexplained.push(format!("{name} ({:.2})", scores[i])),
        }
    }
    if !unexplained.is_empty() {
        findings.push(Finding::warning(
            "poses",
            format!(
                "points miss their colours in {} (correlation; {middle:.2} in the middle camera)",
                listed(&unexplained)
            ),
            "check pose, focal length and picture of these cameras, or leave them out",
        ));
    }
    findings
}

/// What explains a picture that its own pose doesn't, with the score.
enum Explained {
    /// Its pose in another convention.
    ByConvention(f64, &'static str),
    /// The pose of another picture.
    ByPoseOf(f64, usize),
}

impl Explained {
    fn best(
        cloud: &Cloud,
        pictures: &[Picture],
        i: usize,
        explained: impl Fn(f64) -> bool,
    ) -> Option<Self> {
        let convention = CONVENTIONS
            .iter()
            .map(|c| {
                let camera = c.apply(&pictures[i].camera);
                (score_at(cloud, &pictures[i], &camera), c.words)
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|best| explained(best.0));
        let pose = pose_that_fits(cloud, pictures, i, explained);
        match (convention, pose) {
            (Some((score, words)), pose) if pose.is_none_or(|pose| pose.0 < score) => {
                Some(Self::ByConvention(score, words))
            }
            (_, pose) => pose.map(|(score, other)| Self::ByPoseOf(score, other)),
        }
    }
}

/// The other picture whose pose explains picture `i` best, behind the score.
fn pose_that_fits(
    cloud: &Cloud,
    pictures: &[Picture],
    i: usize,
    explained: impl Fn(f64) -> bool,
) -> Option<(f64, usize)> {
    (0..pictures.len())
        .filter(|&other| other != i)
        .map(|other| {
            (
                score_at(cloud, &pictures[i], &pictures[other].camera),
                other,
            )
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|best| explained(best.0))
}

/// The score of a picture with the pose of `camera`.
fn score_at(cloud: &Cloud, picture: &Picture, camera: &Camera) -> f64 {
    let camera = picture.at_pose_of(camera);
    Agreement::of(picture, &camera, cloud, 1, |x| x).score()
}

/// Where the cameras look. `sound`: what the colours said, and `explained` whether they named a mistake.
pub(super) fn by_axes(
    cameras: &[Camera],
    names: &[String],
    sound: Option<bool>,
    explained: bool,
) -> Finding {
    let positions: Vec<glam::DVec3> = cameras.iter().map(|c| c.position().into()).collect();
    if cameras.len() > 1 && in_one_place(&positions) {
        return Finding::note(
            "poses",
            "all cameras stand in one place, where their axes meet",
        );
    }
    let Some(meeting) = Meeting::of(cameras) else {
        let text = match cameras.len() {
            0..=2 => "too few cameras for a point where axes meet",
            _ => "the cameras look in one direction (parallel axes), as before a stage",
        };
        return Finding::note("poses", text);
    };
    let share = meeting.share();
    let point: Vec<String> = meeting
        .point
        .to_array()
        .iter()
        .map(|v| format!("{v:.3}"))
        .collect();
    let text = format!(
        "axes meet at ({}), in front of {} of {} cameras, {:.0} % of their distance off",
        point.join(", "),
        meeting.in_front.iter().filter(|&&front| front).count(),
        cameras.len(),
        100.0 * meeting.off,
    );
    if share == 1.0 || sound == Some(true) && share >= MOST {
        return Finding::ok("poses", text);
    }
    if share >= MOST && !explained {
        let behind: Vec<&String> = names
            .iter()
            .zip(&meeting.in_front)
            .filter(|n| !n.1)
            .map(|n| n.0)
            .collect();
        return Finding::warning(
            "poses",
            format!("{text}, but behind {}", listed(&behind)),
            "check whether their poses are in another convention: y and z axes negated turn a camera around",
        );
    }
    if sound == Some(true) {
        return Finding::note("poses", format!("{text}: cameras look outwards"));
    }
    if explained {
        return Finding::note("poses", text);
    }
    match meeting_in_front(cameras) {
        Some((convention, other)) => Finding::warning(
            "poses",
            format!(
                "{text}; in front of {:.0} % and {:.0} % off with {}",
                100.0 * other.share(),
                100.0 * other.off,
                convention.words
            ),
            "unless the cameras look outwards from the middle of the scene, convert the poses that way",
        ),
        None => Finding::note(
            "poses",
            format!("{text}: cameras look in different directions"),
        ),
    }
}
