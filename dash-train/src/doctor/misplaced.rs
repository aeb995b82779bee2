//! The mistake that explains why no points lie on pixels of their colours.

use dash_kernels::Camera;
use glam::{DMat3, DVec3};

use super::agreement::{Agreement, Picture, middle_score};
use super::cloud::Cloud;
use super::conventions::CONVENTIONS;
use super::finding::Finding;

/// Points that are compared under each of many hypotheses.
const POINTS: usize = 400;
/// Pictures that are compared under each hypothesis.
const PICTURES: usize = 12;
/// A hypothesis explains the pictures from this score on, if it also beats the unchanged data by half as much.
const EXPLAINS: f64 = 0.3;
/// Most cameras whose order is checked: every picture is tried with every pose.
const MAX_REORDERED: usize = 48;
/// Score from which on a picture fits another's pose.
const ORDER_FITS: f64 = 0.45;
/// Least score of points that fit loosely without an explanation.
const LOOSE: f64 = 0.25;
/// Share of unrelated points with the same colour, above which colours are not telling.
const ALIKE: f64 = 0.6;
/// Least and largest factor of the points' coordinates that is tried.
const SCALES: [f64; 2] = [1e-3, 1e3];
/// Least and largest factor of the focal length that is tried.
const FOCALS: [f64; 2] = [0.25, 4.0];
/// From one factor to the next.
const SCALE_STEP: f64 = 1.01;

/// A mistake that would explain the pictures.
struct Explanation {
    /// The score without the mistake.
    score: f64,
    /// The correction, in words that follow the score.
    words: String,
    /// What the user can do.
    mend: &'static str,
}

/// Tries one correction after the other and keeps the best.
struct Search<'a> {
    cloud: &'a Cloud,
    pictures: Vec<Picture>,
    /// Every so many points are compared.
    stride: usize,
    /// Score from which on a correction explains the pictures.
    explains: f64,
    best: Option<Explanation>,
}

/// The best explanation, or that there is none.
pub(super) fn explain(
    cloud: &Cloud,
    pictures: &[Picture],
    (score, chance): (f64, f64),
    text: &str,
) -> Finding {
    let best = Search::new(cloud, pictures, score).best();
    let displaced = displaced(cloud, pictures, stride(cloud));
    if 2 * displaced >= pictures.len() && best.as_ref().is_none_or(|best| best.score < ORDER_FITS) {
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
        Some(Explanation { score, words, mend }) => Finding::error(
            "poses",
            format!("{text}; it would be {score:.2} {words}"),
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

fn stride(cloud: &Cloud) -> usize {
    cloud.positions.len().div_ceil(POINTS)
}

impl<'a> Search<'a> {
    fn new(cloud: &'a Cloud, pictures: &[Picture], score: f64) -> Self {
        let kept = pictures.len().min(PICTURES);
        let some = (0..kept).map(|k| pictures[k * pictures.len() / kept].clone());
        Self {
            cloud,
            pictures: some.collect(),
            stride: stride(cloud),
            explains: EXPLAINS.max(score + EXPLAINS / 2.0),
            best: None,
        }
    }

    fn best(mut self) -> Option<Explanation> {
        self.conventions();
        self.turns();
        self.zooms();
        self.scales();
        self.best
    }

    fn consider(
        &mut self,
        mend: &'static str,
        words: String,
        camera: impl Fn(&Camera) -> Camera,
        point: impl Fn([f64; 3]) -> [f64; 3],
    ) {
        let score = middle_score(&self.pictures, self.cloud, self.stride, camera, point);
        let better = self.best.as_ref().is_none_or(|best| score > best.score);
        if better && score >= self.explains {
            self.best = Some(Explanation { score, words, mend });
        }
    }

    fn conventions(&mut self) {
        for convention in CONVENTIONS {
            let words = format!("with {}", convention.words);
            let apply = |camera: &Camera| convention.apply(camera);
            self.consider("convert the poses that way", words, apply, |x| x);
        }
    }

    fn turns(&mut self) {
        for (turn, words) in quarter_turns() {
            let words = format!("with the points' (x, y, z) taken as {words}");
            let turned = |x: [f64; 3]| (turn * DVec3::from(x)).to_array();
            self.consider("turn the points that way", words, Camera::clone, turned);
        }
    }

    fn zooms(&mut self) {
        for zoom in factors(FOCALS) {
            let zoomed = |c: &Camera| Camera {
                fx: zoom * c.fx,
                fy: zoom * c.fy,
                ..c.clone()
            };
            self.consider(
                "scale the focal lengths: they may be for pictures of another size",
                format!("with focal lengths times {zoom:.2}"),
                zoomed,
                |x| x,
            );
        }
    }

    fn scales(&mut self) {
        for scale in factors(SCALES) {
            self.consider(
                "scale the points, or the cameras' positions, to one unit",
                format!("with the points' coordinates times {scale:.3}"),
                Camera::clone,
                |x| x.map(|v| scale * v),
            );
        }
    }
}

/// Factors from the least to the most, [`SCALE_STEP`] from one to the next.
fn factors([least, most]: [f64; 2]) -> impl Iterator<Item = f64> {
    let steps = ((most / least).ln() / SCALE_STEP.ln()) as i32;
    (0..=steps).map(move |k| least * SCALE_STEP.powi(k))
}

/// How many pictures fit another camera's pose, and not their own.
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

/// The rotations that interchange axes, and what becomes of (x, y, z).
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
