//! Points that are nowhere on pixels of their colours: which mistake would explain it.

use dash_kernels::Camera;
use glam::{DMat3, DVec3};

use super::agreement::{Agreement, Picture, middle_score};
use super::cloud::Cloud;
use super::conventions::CONVENTIONS;
use super::finding::Finding;

/// Points that are compared under each of many hypotheses.
const POINTS: usize = 400;
/// Pictures that are compared under each of them.
const PICTURES: usize = 12;
/// A hypothesis explains what is seen from this score on, and if it is better than the data as they are
/// by half as much.
const EXPLAINS: f64 = 0.3;
/// Cameras whose order is looked into; every picture is tried with every pose.
const MAX_REORDERED: usize = 48;
/// Score from which on a picture fits another's pose.
const ORDER_FITS: f64 = 0.45;
/// Score from which on points without an explanation fit loosely, not at all below.
const LOOSE: f64 = 0.25;
/// Share of strangers' colours that agree from which on colours say little.
const ALIKE: f64 = 0.6;
/// Factors of the points' coordinates that are tried, and from one to the next.
const SCALES: [f64; 2] = [1e-3, 1e3];
/// Factors of the focal length that are tried.
const FOCALS: [f64; 2] = [0.25, 4.0];
const SCALE_STEP: f64 = 1.01;

/// The best explanation, or that there is none.
pub(super) fn explain(
    cloud: &Cloud,
    pictures: &[Picture],
    (score, chance): (f64, f64),
    text: &str,
) -> Finding {
    let stride = cloud.positions.len().div_ceil(POINTS);
    let kept = pictures.len().min(PICTURES);
    let some: Vec<Picture> = (0..kept)
        .map(|k| pictures[k * pictures.len() / kept].clone())
        .collect();
    let same = |camera: &Camera| camera.clone();
    let mut best: Option<(f64, String, &str)> = None;
    let mut consider = |found: f64, words: String, mend: &'static str| {
        let better = best.as_ref().is_none_or(|best| found > best.0);
        if better && found >= EXPLAINS.max(score + EXPLAINS / 2.0) {
            best = Some((found, words, mend));
        }
    };
    for convention in CONVENTIONS {
        let found = middle_score(&some, cloud, stride, |c| convention.apply(c), |x| x);
        consider(
            found,
            format!("with {}", convention.words),
            "convert the poses that way",
        );
    }
    for (turn, words) in quarter_turns() {
        let found = middle_score(&some, cloud, stride, same, |x| {
            (turn * DVec3::from(x)).to_array()
        });
        consider(
            found,
            format!("with the points' (x, y, z) taken as {words}"),
            "turn the points that way",
        );
    }
    let zooms = ((FOCALS[1] / FOCALS[0]).ln() / SCALE_STEP.ln()) as i32;
    for k in 0..=zooms {
        let zoom = FOCALS[0] * SCALE_STEP.powi(k);
        let zoomed = |c: &Camera| Camera {
            fx: zoom * c.fx,
            fy: zoom * c.fy,
            ..c.clone()
        };
        let found = middle_score(&some, cloud, stride, zoomed, |x| x);
        consider(
            found,
            format!("with focal lengths times {zoom:.2}"),
            "scale the focal lengths: they may be for pictures of another size",
        );
    }
    let steps = ((SCALES[1] / SCALES[0]).ln() / SCALE_STEP.ln()) as i32;
    for k in 0..=steps {
        let scale = SCALES[0] * SCALE_STEP.powi(k);
        let found = middle_score(&some, cloud, stride, same, |x| x.map(|v| scale * v));
        consider(
            found,
            format!("with the points' coordinates times {scale:.3}"),
            "scale the points, or the cameras' positions, to one unit",
        );
    }
    let displaced = displaced(cloud, pictures, stride);
    if 2 * displaced >= pictures.len() && best.as_ref().is_none_or(|best| best.0 < ORDER_FITS) {
        return Finding::error(
            "poses",
            format!(
                "{text}; {displaced} of {} pictures fit the pose of another camera",
                pictures.len()
            ),
            "put the poses into the order of the cameras' names",
        );
    }
    match best {
        Some((found, words, mend)) => Finding::error(
            "poses",
            format!("{text}; it would be {found:.2} {words}"),
            mend,
        ),
        None if score > LOOSE => Finding::note(
            "colours",
            format!("{text}: points fit the pictures loosely, and no usual mistake explains it"),
        ),
        None if chance > ALIKE => Finding::note(
            "colours",
            format!(
                "{text}: colours are too much alike to tell whether points and poses belong together"
            ),
        ),
        None => Finding::warning(
            "colours",
            format!("{text}: poses and points do not seem to belong together"),
            "check the order of the cameras, and that points and poses are of one reconstruction",
        ),
    }
}

/// Pictures that show what another camera's pose sees.
fn displaced(cloud: &Cloud, pictures: &[Picture], stride: usize) -> usize {
    if pictures.len() > MAX_REORDERED {
        return 0;
    }
    let fits = |picture: &Picture, other: &Picture| {
        let camera = picture.at_pose_of(&other.camera);
        Agreement::of(picture, &camera, cloud, stride, |x| x).score() >= ORDER_FITS
    };
    let shows_another = |i: &usize| {
        let (picture, rest) = (&pictures[*i], (0..pictures.len()).filter(|k| k != i));
        !fits(picture, picture) && rest.into_iter().any(|k| fits(picture, &pictures[k]))
    };
    (0..pictures.len()).filter(shows_another).count()
}

/// The turns that interchange axes, and what they make of (x, y, z).
fn quarter_turns() -> Vec<(DMat3, String)> {
    let mut turns = Vec::new();
    for order in [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ] {
        for signs in 0..8 {
            let sign = |axis: usize| if signs >> axis & 1 == 1 { -1.0 } else { 1.0 };
            let mut rows = [DVec3::ZERO; 3];
            let mut words = Vec::new();
            for (row, &axis) in order.iter().enumerate() {
                rows[row][axis] = sign(row);
                let name = ["x", "y", "z"][axis];
                words.push(if sign(row) < 0.0 {
                    format!("-{name}")
                } else {
                    name.into()
                });
            }
            let turn = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            if turn.determinant() > 0.0 && turn != DMat3::IDENTITY {
                turns.push((turn, format!("({})", words.join(", "))));
            }
        }
    }
    turns
}
