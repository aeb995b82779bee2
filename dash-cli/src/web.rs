//! `dash export --web`: a scene as a web page.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;
use dash_model::unfinished::Unfinished;
use dash_model::{ModelError, rgb8};
use dash_train::render::Picture;
use dash_train::video::write_png;
use dash_view::page::{Page, PlayerCode};
use dash_view::{Content, Source, ViewError};

use crate::Shared;
use crate::failure::Failure;
use crate::summary::bytes;
use crate::view::Desk;

#[derive(Args)]
pub struct WebArgs {
    /// Folder to make: a web page that plays the scene in a browser with WebGPU, for any static host
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "time", "frames", "sh_degree"])]
    pub web: Option<PathBuf>,
    /// With --web: one HTML file with everything in it instead of a folder
    #[arg(long, requires = "web")]
    single_file: bool,
    /// With --web: folder of the player that dash-view/web/build.sh made [default: the program's own, if it has one]
    #[arg(long, value_name = "DIR", requires = "web")]
    player: Option<PathBuf>,
}

/// The player that the program carries.
#[cfg(feature = "player")]
const OWN: Option<(&str, &[u8])> = Some((
    include_str!(concat!(env!("DASH_PLAYER"), "/dash_view.js")),
    include_bytes!(concat!(env!("DASH_PLAYER"), "/dash_view_bg.wasm")),
));
#[cfg(not(feature = "player"))]
const OWN: Option<(&str, &[u8])> = None;

/// The player's script and module.
pub fn player(folder: Option<&Path>) -> Result<(String, Vec<u8>), Failure> {
    let Some(folder) = folder else {
        return match OWN {
            Some((script, module)) => Ok((script.into(), module.into())),
            None => Err(Failure::usage(
                "this program was built without the player of web pages; expected --player DIR, with what \
                 `dash-view/web/build.sh DIR` makes",
            )),
        };
    };
    let read = |name| {
        let path = folder.join(name);
        fs::read(&path).map_err(|e| match e.kind() {
            ErrorKind::NotFound => Failure::usage(format!(
                "{}: expected the player of web pages, found none; make it with `dash-view/web/build.sh {}`",
                path.display(),
                folder.display()
            )),
            _ => ModelError::io(&path, "read", e).into(),
        })
    };
    let script = String::from_utf8(read("dash_view.js")?);
    let script = script.map_err(|_| {
        Failure::new(format!(
            "{}: expected JavaScript, found other bytes; build the player anew",
            folder.join("dash_view.js").display()
        ))
    })?;
    Ok((script, read("dash_view_bg.wasm")?))
}

pub fn run(
    run: &Path,
    out: &Path,
    args: &WebArgs,
    fps: Option<f64>,
    shared: &Shared,
) -> Result<String, Failure> {
    let (script, module) = player(args.player.as_deref())?;
    refuse_taken(out)?;
    let device = shared.device.unwrap_or_default().device()?;
    let content = Desk::new(device, fps).content(run, None)?;
    if let Some(parent) = out.parent().filter(|parent| *parent != Path::new("")) {
        fs::create_dir_all(parent).map_err(|e| ModelError::io(parent, "create", e))?;
    }
    let scratch = Unfinished::folder(out).map_err(|e| ModelError::io(out, "write", e))?;
    let poster = poster(&content, &scratch.path().join("poster.png"))?;
    let code = PlayerCode {
        script: &script,
        module: &module,
    };
    let page = Page::new(&content, code, &poster).map_err(told)?;
    let files = match args.single_file {
        true => BTreeMap::from([("page.html".to_string(), page.single_file().into_bytes())]),
        false => page.folder(),
    };
    let size: usize = files.values().map(Vec::len).sum();
    for (name, bytes) in &files {
        let path = scratch.path().join(name);
        fs::write(&path, bytes).map_err(|e| ModelError::io(&path, "write", e))?;
    }
    let finished = scratch.finish(|scratch| match args.single_file {
        true => fs::rename(scratch.join("page.html"), out),
        false => fs::rename(scratch, out),
    });
    finished.map_err(|e| ModelError::io(out, "write", e))?;
    let next = match args.single_file {
        true => "open it in a browser with WebGPU".to_string(),
        false => format!(
            "first picture after {}; put the folder on a web server: python3 -m http.server -d {}",
            bytes(page.first_bytes() as u64),
            out.display()
        ),
    };
    Ok(format!("{}: {}; {next}", out.display(), bytes(size as u64)))
}

fn refuse_taken(out: &Path) -> Result<(), Failure> {
    match fs::symlink_metadata(out) {
        Ok(_) => Err(Failure::new(format!(
            "{}: expected nothing there, found something; remove it or choose another name",
            out.display()
        ))),
        Err(_) => Ok(()),
    }
}

/// A picture of the clip's start from the first camera, as PNG; of one grey pixel where there is no camera.
fn poster(content: &Content, path: &Path) -> Result<Vec<u8>, Failure> {
    let first = match &content.source {
        Source::Scene(scene) => Some((**scene).clone()),
        Source::Windows(windows) => Some(windows.scene(0).map_err(told)?),
        _ => None,
    };
    let (width, height, rgb) = match (first, content.cameras.first()) {
        (Some(scene), Some(named)) => {
            let picture = Picture::of(scene.render(&named.camera, named.time.unwrap_or(0.0))?)?;
            (picture.width, picture.height, rgb8(&picture.rgb))
        }
        _ => (1, 1, vec![17; 3]),
    };
    write_png(path, width, height, &rgb)?;
    Ok(fs::read(path).map_err(|e| ModelError::io(path, "read", e))?)
}

fn told(error: ViewError) -> Failure {
    match error {
        ViewError::Model(error) => error.into(),
        error => Failure::new(error.to_string()),
    }
}
