//! The program `colmap`: where it is, how it starts, how it fails. Nothing else starts it.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::Error;
use crate::process::Child;

/// The program that finds poses and points.
pub const COLMAP: &str = "colmap";
/// The environment variable that names another program or path for [`COLMAP`].
pub const COLMAP_VARIABLE: &str = "DASH_COLMAP";
/// An error quotes so many of its last lines.
const QUOTED_LINES: usize = 4;
const MAX_QUOTED_CHARS: usize = 600;
/// The mapper's words when it finds no initial pair.
const NO_MODEL: [&str; 2] = [
    "failed to create sparse model",
    "No good initial image pair",
];

/// The lenses of the images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lenses<'a> {
    /// COLMAP's name of the camera model.
    pub(super) model: &'a str,
    /// Whether all cameras have one lens.
    pub(super) shared: bool,
}

/// An installed `colmap`, and the files it works on.
pub(super) struct Colmap {
    program: OsString,
    /// Its log files, database and models.
    workspace: PathBuf,
    /// Whether this version has the options that do not name the kind of feature.
    has_new_names: bool,
    n_threads: usize,
}

impl Colmap {
    /// Looks for the program: `DASH_COLMAP` where it is set, else [`COLMAP`] from the path.
    ///
    /// # Errors
    /// When it can't be started; says how to install it, what it was to find and what to do `instead`.
    pub(super) fn find(
        workspace: &Path,
        purpose: &'static str,
        instead: &'static str,
    ) -> Result<Self, Error> {
        let program = std::env::var_os(COLMAP_VARIABLE)
            .filter(|program| !program.is_empty())
            .unwrap_or_else(|| COLMAP.into());
        Self::find_at(program, workspace, purpose, instead)
    }

    pub(super) fn find_at(
        program: OsString,
        workspace: &Path,
        purpose: &'static str,
        instead: &'static str,
    ) -> Result<Self, Error> {
        let mut command = headless(&program);
        let help = Child::output(command.args(["feature_extractor", "-h"]));
        let help = help.map_err(|e| match e.kind() {
            ErrorKind::NotFound => Error::ColmapMissing {
                purpose,
                program: program.to_string_lossy().into_owned(),
                instead,
            },
            _ => Error::access(Path::new(&program))(e),
        })?;
        let help = [help.stdout, help.stderr].concat();
        let has_new_names = String::from_utf8_lossy(&help).contains("--FeatureExtraction.use_gpu");
        Ok(Self {
            program,
            workspace: workspace.to_path_buf(),
            has_new_names,
            n_threads: rayon::current_num_threads(),
        })
    }

    /// Finds features in every image of the folder and matches those of every pair; returns the database.
    pub(super) fn match_features(&self, images: &Path, lenses: Lenses) -> Result<PathBuf, Error> {
        let database = self.workspace.join("database.db");
        if database.is_file() {
            fs::remove_file(&database).map_err(Error::access(&database))?;
        }
        self.run(
            "feature_extractor",
            &self.extraction(&database, images, lenses),
            "check the pictures and the free memory, or make them smaller with --height",
        )?;
        self.run(
            "exhaustive_matcher",
            &self.matching(&database),
            "check the free memory, or make the pictures smaller with --height",
        )?;
        Ok(database)
    }

    fn extraction(&self, database: &Path, images: &Path, lenses: Lenses) -> Vec<OsString> {
        let section = if self.has_new_names {
            "FeatureExtraction"
        } else {
            "SiftExtraction"
        };
        let mut args = Arguments::default();
        args.path("--database_path", database)
            .path("--image_path", images)
            .value("--ImageReader.camera_model", lenses.model)
            .value("--ImageReader.single_camera", u8::from(lenses.shared))
            .value(
                "--ImageReader.single_camera_per_image",
                u8::from(!lenses.shared),
            )
            .value(&format!("--{section}.use_gpu"), 0)
            .value(&format!("--{section}.num_threads"), self.n_threads)
            // Slower features that match over wider baselines: a rig has one image per camera, far apart.
            .value("--SiftExtraction.estimate_affine_shape", 1)
            .value("--SiftExtraction.domain_size_pooling", 1)
            .value("--SiftExtraction.peak_threshold", "0.003");
        args.0
    }

    fn matching(&self, database: &Path) -> Vec<OsString> {
        let section = if self.has_new_names {
            "FeatureMatching"
        } else {
            "SiftMatching"
        };
        let mut args = Arguments::default();
        args.path("--database_path", database)
            .value(&format!("--{section}.use_gpu"), 0)
            .value(&format!("--{section}.num_threads"), self.n_threads)
            .value(&format!("--{section}.guided_matching"), 1);
        args.0
    }

    /// Structure from motion; the folders of its models, none where it found no initial pair.
    pub(super) fn map(&self, database: &Path, images: &Path) -> Result<Vec<PathBuf>, Error> {
        let out = self.fresh_folder("models")?;
        let mut args = Arguments::default();
        args.path("--database_path", database)
            .path("--image_path", images)
            .path("--output_path", &out)
            .value("--Mapper.num_threads", self.n_threads)
            // A third of the default, for rigs with few images. The number for a further camera keeps its
            // default: with fewer inliers, wrong poses get in.
            .value("--Mapper.init_min_num_inliers", 30)
            .value("--Mapper.init_min_tri_angle", 4);
        let remedy = "give known poses with --poses";
        if let Err(error) = self.run("mapper", &args.0, remedy) {
            let log = fs::read(self.log("mapper")).unwrap_or_default();
            let log = String::from_utf8_lossy(&log);
            if !NO_MODEL.iter().any(|words| log.contains(words)) {
                return Err(error);
            }
        }
        let entries = fs::read_dir(&out).map_err(Error::access(&out))?;
        let mut models = Vec::new();
        for entry in entries {
            let path = entry.map_err(Error::access(&out))?.path();
            if path.is_dir() {
                models.push(path);
            }
        }
        models.sort();
        Ok(models)
    }

    /// Finds points with the poses of the model `known`; returns the model with points.
    pub(super) fn triangulate(
        &self,
        database: &Path,
        images: &Path,
        known: &Path,
    ) -> Result<PathBuf, Error> {
        let out = self.fresh_folder("triangulated")?;
        let mut args = Arguments::default();
        args.path("--database_path", database)
            .path("--image_path", images)
            .path("--input_path", known)
            .path("--output_path", &out)
            // Has the model's images matched to the database's by their names.
            .value("--clear_points", 1)
            .value("--Mapper.num_threads", self.n_threads)
            .value("--Mapper.ba_refine_focal_length", 0)
            .value("--Mapper.ba_refine_extra_params", 0)
            // Many points of a rig have tracks of two images.
            .value("--Mapper.tri_ignore_two_view_tracks", 0);
        let remedy = "check that the poses belong to these pictures, or write random points with --random-points";
        self.run("point_triangulator", &args.0, remedy)?;
        Ok(out)
    }

    pub(super) fn fresh_folder(&self, name: &str) -> Result<PathBuf, Error> {
        let folder = self.workspace.join(name);
        if folder.is_dir() {
            fs::remove_dir_all(&folder).map_err(Error::access(&folder))?;
        }
        fs::create_dir(&folder).map_err(Error::access(&folder))?;
        Ok(folder)
    }

    fn log(&self, step: &str) -> PathBuf {
        self.workspace.join(format!("{step}.log"))
    }

    fn run(
        &self,
        step: &'static str,
        args: &[OsString],
        remedy: &'static str,
    ) -> Result<(), Error> {
        let path = self.log(step);
        // COLMAP complains on either stream and writes megabytes.
        let log = File::create(&path).map_err(Error::access(&path))?;
        let complaints = log.try_clone().map_err(Error::access(&path))?;
        let mut command = headless(&self.program);
        command.arg(step).args(args).stdout(log).stderr(complaints);
        let status = Child::start(&mut command)
            .and_then(|mut child| child.wait())
            .map_err(Error::access(Path::new(&self.program)))?;
        if status.success() {
            return Ok(());
        }
        let log = fs::read(&path).unwrap_or_default();
        Err(Error::ColmapFailed {
            step,
            status,
            words: last_words(&String::from_utf8_lossy(&log)),
            remedy,
        })
    }
}

/// The program with no display asked for.
fn headless(program: &OsStr) -> Command {
    let mut command = Command::new(program);
    command
        .env("QT_QPA_PLATFORM", "offscreen")
        .stdin(Stdio::null());
    command
}

/// The last lines without stack traces.
fn last_words(log: &str) -> String {
    let says_something = |line: &&str| {
        !line.is_empty()
            && !line.starts_with(['@', '*', '=', '-'])
            && !line.starts_with("Elapsed time")
    };
    let lines: Vec<&str> = log.lines().map(str::trim).filter(says_something).collect();
    let words = lines[lines.len().saturating_sub(QUOTED_LINES)..].join(" | ");
    match words.char_indices().nth_back(MAX_QUOTED_CHARS) {
        _ if words.is_empty() => "none".into(),
        Some((at, _)) => format!("..{}", &words[at..]),
        None => words,
    }
}

/// Arguments as `--name value`.
#[derive(Default)]
struct Arguments(Vec<OsString>);

impl Arguments {
    fn value(&mut self, name: &str, value: impl ToString) -> &mut Self {
        self.0.extend([name.into(), value.to_string().into()]);
        self
    }

    fn path(&mut self, name: &str, path: &Path) -> &mut Self {
        self.0.extend([name.into(), path.into()]);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn colmap(has_new_names: bool) -> Colmap {
        Colmap {
            program: COLMAP.into(),
            workspace: "work".into(),
            has_new_names,
            n_threads: 3,
        }
    }

    fn value<'a>(args: &'a [OsString], name: &str) -> Option<&'a str> {
        let at = args.iter().position(|arg| arg == name)?;
        args.get(at + 1)?.to_str()
    }

    #[test]
    fn features_are_found_without_a_gpu_in_old_and_new_versions() {
        let lenses = Lenses {
            model: "OPENCV",
            shared: false,
        };
        for (has_new_names, extraction, matching) in [
            (false, "SiftExtraction", "SiftMatching"),
            (true, "FeatureExtraction", "FeatureMatching"),
        ] {
            let colmap = colmap(has_new_names);
            let args = colmap.extraction(Path::new("a b/db"), Path::new("pictures"), lenses);
            assert_eq!(value(&args, &format!("--{extraction}.use_gpu")), Some("0"));
            assert_eq!(
                value(&args, &format!("--{extraction}.num_threads")),
                Some("3")
            );
            assert_eq!(value(&args, "--database_path"), Some("a b/db"));
            assert_eq!(value(&args, "--ImageReader.camera_model"), Some("OPENCV"));
            assert_eq!(value(&args, "--ImageReader.single_camera"), Some("0"));
            assert_eq!(
                value(&args, "--ImageReader.single_camera_per_image"),
                Some("1")
            );
            let args = colmap.matching(Path::new("db"));
            assert_eq!(value(&args, &format!("--{matching}.use_gpu")), Some("0"));
        }
        let shared = Lenses {
            model: "RADIAL",
            shared: true,
        };
        let args = colmap(false).extraction(Path::new("db"), Path::new("pictures"), shared);
        assert_eq!(value(&args, "--ImageReader.single_camera"), Some("1"));
    }

    #[test]
    fn last_words_are_what_it_complained_about() {
        let log = "\n====\nFeature extraction\n====\n\nProcessed file [1/2]\nF1121 x.cc:7] Check failed: a\n\
            *** Check failure stack trace: ***\n    @     0x7f2 google::Fail()\n\nElapsed time: 0.1\n";
        assert_eq!(
            last_words(log),
            "Feature extraction | Processed file [1/2] | F1121 x.cc:7] Check failed: a"
        );
        assert_eq!(last_words("\n\n"), "none");
        let long = last_words(&"ä".repeat(5000));
        assert_eq!(long.chars().count(), MAX_QUOTED_CHARS + 3);
    }
}
