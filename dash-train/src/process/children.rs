//! Programs that run for this one: `ffmpeg`, `ffprobe`, `colmap`. They end when it is done with them, or has to stop.

use std::io::{self, Read};
use std::process::{ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The ids of those that run.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A program that runs, and ends at the latest when this is dropped.
pub(crate) struct Child(std::process::Child);

impl Child {
    /// Starts a command whose pipes are set.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn start(command: &mut Command) -> io::Result<Self> {
        // Ctrl-C is for this program, which may still need the other to write its checkpoint.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut running = running();
        let child = command.spawn()?;
        running.push(child.id());
        Ok(Self(child))
    }

    /// Runs a command without input to its end: how it ended, and all that it wrote.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn output(command: &mut Command) -> io::Result<Output> {
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = Self::start(command)?;
        let complaints = child.stderr();
        let listener = std::thread::spawn(move || read(complaints));
        let stdout = read(child.stdout())?;
        let status = child.wait()?;
        // The thread only reads.
        let stderr = listener.join().unwrap_or_else(|_| Ok(Vec::new()))?;
        Ok(Output {
            status,
            stdout,
            stderr,
        })
    }

    pub(crate) fn stdin(&mut self) -> Option<ChildStdin> {
        self.0.stdin.take()
    }

    pub(crate) fn stdout(&mut self) -> Option<ChildStdout> {
        self.0.stdout.take()
    }

    pub(crate) fn stderr(&mut self) -> Option<ChildStderr> {
        self.0.stderr.take()
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn wait(&mut self) -> io::Result<ExitStatus> {
        self.0.wait()
    }
}

fn read(pipe: Option<impl Read>) -> io::Result<Vec<u8>> {
    let mut written = Vec::new();
    if let Some(mut pipe) = pipe {
        pipe.read_to_end(&mut written)?;
    }
    Ok(written)
}

impl Drop for Child {
    fn drop(&mut self) {
        // Both fail only when the program is gone already.
        let _ = self.0.kill();
        let _ = self.0.wait();
        let id = self.0.id();
        running().retain(|&running| running != id);
    }
}

/// Ends all of them, and keeps other threads from starting more.
#[cfg(unix)]
pub(super) fn end_all() {
    let running = running();
    for &id in running.iter() {
        // SAFETY: both take numbers, and `info` is large enough. Where the program is gone they fail.
        unsafe {
            libc::kill(id as libc::pid_t, libc::SIGKILL);
            let mut info = std::mem::zeroed();
            // It may still be writing; its thread gets the status.
            libc::waitid(
                libc::P_PID,
                id as libc::id_t,
                &mut info,
                libc::WEXITED | libc::WNOWAIT,
            );
        }
    }
    std::mem::forget(running);
}
