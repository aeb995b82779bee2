//! The programs `ffmpeg` and `ffprobe`: where they are, how they start, how they fail.

use std::ffi::{OsStr, OsString};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, Command, ExitStatus};
use std::thread::{self, JoinHandle};

use crate::process::Child;

/// The program that decodes and encodes videos.
pub const FFMPEG: &str = "ffmpeg";
/// The environment variable that names another program or path for [`FFMPEG`].
pub const FFMPEG_VARIABLE: &str = "DASH_FFMPEG";
const FFPROBE: &str = "ffprobe";
/// Names another `ffprobe` program.
const FFPROBE_VARIABLE: &str = "DASH_FFPROBE";
/// An error quotes this much of what a running program complains about,
const MAX_COMPLAINT_BYTES: u64 = 4096;
/// and this much of what one that has ended wrote.
const MAX_QUOTED_CHARS: usize = 1000;

/// The program that will be run: `DASH_FFMPEG` where it is set, else [`FFMPEG`] from the path.
pub fn ffmpeg_program() -> OsString {
    set(FFMPEG_VARIABLE).unwrap_or_else(|| FFMPEG.into())
}

/// The program that lists a video's frames: `DASH_FFPROBE` where it is set, else `ffprobe` beside the
/// `ffmpeg` that `DASH_FFMPEG` names, else `ffprobe` from the path.
pub fn ffprobe_program() -> OsString {
    let beside = || {
        let ffmpeg = PathBuf::from(set(FFMPEG_VARIABLE)?);
        let name = ffmpeg.file_name()?.to_str()?.replace(FFMPEG, FFPROBE);
        let beside = ffmpeg.with_file_name(name);
        (beside != ffmpeg && beside.is_file()).then(|| beside.into_os_string())
    };
    set(FFPROBE_VARIABLE)
        .or_else(beside)
        .unwrap_or_else(|| FFPROBE.into())
}

/// Whether `ffmpeg` can be run, so that a command can complain before it renders for an hour.
pub fn ffmpeg_available() -> bool {
    version_status(&ffmpeg_program()).is_ok_and(|status| status.success())
}

/// How the program ends when it is asked for its version.
///
/// # Errors
/// The system's, when it does not start.
pub(crate) fn version_status(program: &OsStr) -> io::Result<ExitStatus> {
    let output = Child::output(Command::new(program).arg("-version"))?;
    Ok(output.status)
}

fn set(variable: &str) -> Option<OsString> {
    std::env::var_os(variable).filter(|program| !program.is_empty())
}

/// Why a program gave no result.
#[derive(Debug)]
pub(super) enum Failure {
    /// It is not installed.
    Missing,
    /// The system could not start it.
    System(io::Error),
    /// It ended with an error.
    Stopped { status: ExitStatus, words: String },
}

impl Failure {
    fn of_start(source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::NotFound => Self::Missing,
            _ => Self::System(source),
        }
    }
}

/// `ffmpeg` without questions, banner and progress.
pub(super) fn ffmpeg(program: &OsStr) -> Command {
    let mut command = Command::new(program);
    command.args(["-nostdin", "-hide_banner", "-loglevel", "error"]);
    command
}

/// `ffprobe`, which prints errors only.
pub(super) fn ffprobe() -> Command {
    let mut command = Command::new(ffprobe_program());
    command.args(["-v", "error"]);
    command
}

/// A file's name as both programs take it.
pub(super) fn file_argument(path: &Path) -> OsString {
    // `file:` keeps names with a colon or a leading dash from being taken for protocols or options.
    let mut argument = OsString::from("file:");
    argument.push(path);
    argument
}

/// Starts a command whose pipes are set.
pub(super) fn start(command: &mut Command) -> Result<Child, Failure> {
    Child::start(command).map_err(Failure::of_start)
}

/// Runs a command to its end; what it wrote to its output.
pub(super) fn output(command: &mut Command) -> Result<String, Failure> {
    let output = Child::output(command).map_err(Failure::of_start)?;
    let words = quotable(&output.stderr);
    // As in `encode.rs`: success does not mean that the last write succeeded.
    if output.status.success() && refusal(&words).is_none() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    Err(Failure::Stopped {
        status: output.status,
        words: words.chars().take(MAX_QUOTED_CHARS).collect(),
    })
}

/// What of a program's words says that the system did not take what it wrote.
pub(super) fn refusal(words: &str) -> Option<io::Error> {
    let known = [
        ("No space left on device", io::ErrorKind::StorageFull),
        ("Disk quota exceeded", io::ErrorKind::QuotaExceeded),
        ("File too large", io::ErrorKind::FileTooLarge),
        ("Read-only file system", io::ErrorKind::ReadOnlyFilesystem),
    ];
    let found = known.iter().find(|(said, _)| words.contains(said));
    found.map(|(_, kind)| io::Error::from(*kind))
}

/// Reads what a program complains about while it runs.
pub(super) fn listen(mut stderr: ChildStderr) -> JoinHandle<String> {
    thread::spawn(move || {
        let mut kept = Vec::new();
        let _ = stderr
            .by_ref()
            .take(MAX_COMPLAINT_BYTES)
            .read_to_end(&mut kept);
        // Drained, so that a talkative program never waits for a reader.
        let _ = io::copy(&mut stderr, &mut io::sink());
        quotable(&kept)
    })
}

/// What was heard of a program that has ended.
pub(super) fn heard(complaints: Option<JoinHandle<String>>) -> String {
    // Without its words the status alone is reported.
    complaints
        .and_then(|listener| listener.join().ok())
        .unwrap_or_default()
}

/// A program's words without what differs from run to run.
fn quotable(words: &[u8]) -> String {
    without_addresses(String::from_utf8_lossy(words).trim())
}

/// `[h264 @ 0x55c8] error` as `[h264] error`.
fn without_addresses(complaint: &str) -> String {
    let mut pieces = complaint.split(" @ 0x");
    let mut text = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        text.push_str(piece.trim_start_matches(|c: char| c.is_ascii_hexdigit()));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_are_the_same_in_every_run() {
        for (said, kept) in [
            (
                "[h264 @ 0x55da3366f940] error\n[nut @ 0xa] @ 0x",
                "[h264] error\n[nut]",
            ),
            (
                "[mov,mp4,m4a @ 0x5581b2c0] moov atom not found\n",
                "[mov,mp4,m4a] moov atom not found",
            ),
            ("a.mp4: @ 3", "a.mp4: @ 3"),
            ("", ""),
        ] {
            assert_eq!(quotable(said.as_bytes()), kept);
        }
    }
}
