//! How a command fails: one line and an exit code.

use std::io::{ErrorKind, Write};

use dash_model::{ModelError, io_remedy};
use dash_train::Error;
use dash_train::process::stop::{Asked, Signal};

/// Exit code of work that failed.
const FAILED: u8 = 1;
/// Exit code of arguments that can't be right whatever the files hold; clap's too.
const WRONG_USAGE: u8 = 2;

/// A message for the user and an exit code.
#[derive(Debug)]
pub struct Failure {
    message: String,
    exit_code: u8,
}

impl Failure {
    /// Work that a signal ended.
    pub fn stopped(signal: Signal, message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            exit_code: signal.exit_code(),
        }
    }

    /// Work that failed.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            exit_code: FAILED,
        }
    }

    /// Arguments that can't be right.
    pub fn usage(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            exit_code: WRONG_USAGE,
        }
    }

    /// The message without line breaks.
    pub fn line(&self) -> String {
        on_one_line(&self.message)
    }

    /// 1 for what failed, 2 for wrong usage, 128 and its number for a signal.
    pub fn exit_code(&self) -> u8 {
        self.exit_code
    }

    fn from_error(error: &dyn std::error::Error) -> Self {
        let mut message = error.to_string();
        let mut source = error.source();
        while let Some(cause) = source {
            let text = cause.to_string();
            // Most messages of ours quote their cause already.
            if !message.contains(&text) {
                message.push_str(": ");
                message.push_str(&text);
            }
            source = cause.source();
        }
        Self::new(message)
    }
}

/// What came of runs that the first signal stops with a checkpoint; `way_on` says how the user goes on from there.
pub fn unless_stopped<T>(
    outcome: Result<T, Error>,
    asked: Asked,
    way_on: &str,
) -> Result<T, Failure> {
    match (asked.end(), outcome) {
        (Some(signal), Err(error)) => {
            let name = signal.name();
            let told = match error {
                Error::Stopped { run, step } => format!(
                    "{}: stopped by {name} after step {step}, with a checkpoint; {way_on}",
                    run.display()
                ),
                other => format!("stopped by {name}, and: {other}"),
            };
            Err(Failure::stopped(signal, told))
        }
        (_, outcome) => Ok(outcome?),
    }
}

/// Prints a command's result.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout();
    let written = writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush());
    match written {
        // A reader that has seen enough, such as `head`, closes the pipe.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::new(format!(
            "the standard output: cannot write the result: {error}; {}",
            io_remedy(&error)
        ))),
        _ => Ok(()),
    }
}

/// Text with every run of white space that has a line break in it made one space.
pub fn on_one_line(text: &str) -> String {
    text.lines()
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .collect::<Vec<_>>()
        .join(" ")
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::Setting { .. } => Self::usage(error.to_string()),
            other => Self::from_error(&other),
        }
    }
}

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        Self::from_error(&error)
    }
}
