//! The program `dash` as the tests find it: what it knows, and running it.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;

/// Steps of a training in blocks that are marked as short.
const SHORT_ITERATIONS: usize = 60;

/// The built program.
pub struct Program {
    path: PathBuf,
    /// A folder for the `PATH`, in which `dash` is.
    shim: TempDir,
    /// `--help` of its commands; of itself under the empty name.
    help: RefCell<BTreeMap<String, String>>,
}

impl Program {
    /// The program that was built beside this test.
    pub fn find() -> Self {
        let test = env::current_exe().expect("the path of this test");
        let path = test
            .parent()
            .and_then(Path::parent)
            .expect("target/release")
            .join("dash");
        assert!(
            path.is_file(),
            "{} is not there: build it with `cargo build --release -p dash-cli --bin dash`, or test with --workspace",
            path.display()
        );
        let shim = tempfile::tempdir().expect("a temporary folder");
        let script = format!(
            "#!/bin/sh\nif [ \"${{DASH_DOCS_SHORT:-}}\" ] && [ \"$1\" = train ]; then set -- \"$@\" --iterations {SHORT_ITERATIONS}; fi\nexec '{}' \"$@\"\n",
            path.display()
        );
        let file = shim.path().join("dash");
        fs::write(&file, script).expect("a script");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("a script that runs");
        Self {
            path,
            shim,
            help: RefCell::default(),
        }
    }

    /// Runs a block in a folder; an error is what it printed.
    pub fn run(&self, block: &str, folder: &Path, short: bool) -> Result<(), String> {
        let path = format!(
            "{}:{}",
            self.shim.path().display(),
            env::var("PATH").unwrap_or_default()
        );
        let output = Command::new("bash")
            .args(["-euo", "pipefail", "-c", block])
            .current_dir(folder)
            .env("PATH", path)
            .env("DASH_DOCS_SHORT", if short { "1" } else { "" })
            .stdin(Stdio::null())
            .output()
            .map_err(|e| e.to_string())?;
        if output.status.success() {
            return Ok(());
        }
        Err(format!(
            "{}\n{}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        ))
    }

    /// `dash COMMAND --help`, or `dash --help`. A command may have a command of its own behind a space.
    pub fn help(&self, command: &str) -> Result<String, String> {
        if let Some(known) = self.help.borrow().get(command) {
            return Ok(known.clone());
        }
        let words = command.split_whitespace();
        let output = Command::new(&self.path).args(words).arg("--help").output();
        let output = output.map_err(|e| e.to_string())?;
        if !output.status.success() {
            return Err(format!("dash has no command `{command}`"));
        }
        let help = String::from_utf8_lossy(&output.stdout).into_owned();
        self.help.borrow_mut().insert(command.into(), help.clone());
        Ok(help)
    }
}
