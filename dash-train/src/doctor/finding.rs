//! What a check found: how bad it is, in words with figures, and what to do about it.

use std::fmt;

use serde::Serialize;

use crate::Error;
use crate::train::core::shortage::Shortage;

/// Names that are listed before the rest is only counted.
const NAMES_SHOWN: usize = 8;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// As it should be.
    Ok,
    /// Worth knowing; nothing to mend.
    Note,
    /// Training works, and the result suffers.
    Warning,
    /// Training fails, or can't succeed.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        })
    }
}

/// One line of a diagnosis.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at: `layout`, `poses`, `points`, `colours`, `sync`, ..
    pub check: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What was found, with figures, on one line.
    pub text: String,
    /// What to do about it, where there is something.
    pub mend: Option<String>,
}

impl Finding {
    pub(super) fn ok(check: &'static str, text: impl Into<String>) -> Self {
        Self::new(check, Severity::Ok, text, None)
    }

    pub(super) fn note(check: &'static str, text: impl Into<String>) -> Self {
        Self::new(check, Severity::Note, text, None)
    }

    pub(super) fn note_with_mend(check: &'static str, text: impl Into<String>, mend: &str) -> Self {
        Self::new(check, Severity::Note, text, Some(mend.into()))
    }

    pub(super) fn warning(check: &'static str, text: impl Into<String>, mend: &str) -> Self {
        Self::new(check, Severity::Warning, text, Some(mend.into()))
    }

    pub(super) fn error(check: &'static str, text: impl Into<String>, mend: &str) -> Self {
        Self::new(check, Severity::Error, text, Some(mend.into()))
    }

    /// What the dataset lacks.
    pub(super) fn of_shortage(shortage: Shortage) -> Self {
        match shortage.is_fatal {
            true => Self::error(shortage.concerns, shortage.text, shortage.mend),
            false => Self::warning(shortage.concerns, shortage.text, shortage.mend),
        }
    }

    /// What a reader refused.
    pub(super) fn refused(check: &'static str, error: &Error) -> Self {
        let (text, mend) = match error {
            Error::Invalid {
                path,
                expected,
                found,
                remedy,
            } => (
                format!("{}: expected {expected}, found {found}", path.display()),
                remedy.as_str(),
            ),
            Error::ImageDecode { path, reason } => (
                format!("{}: cannot be decoded: {reason}", path.display()),
                "replace the file, or remove that frame from every camera",
            ),
            Error::VideoDecode { path, reason, .. } => (
                format!("{}: cannot be decoded: {reason}", path.display()),
                "write the video again (ffmpeg -i OLD -c:v libx264 NEW.mp4), or train with --skip-broken",
            ),
            Error::TooLittle { found, remedy, .. } => (found.clone(), *remedy),
            other => (other.to_string(), "see the message"),
        };
        Self::error(check, text, mend)
    }

    fn new(
        check: &'static str,
        severity: Severity,
        text: impl Into<String>,
        mend: Option<String>,
    ) -> Self {
        let on_one_line = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
        Self {
            check,
            severity,
            text: on_one_line(text.into()),
            mend: mend.map(on_one_line),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:7}  {:10}  {}", self.severity, self.check, self.text)?;
        match &self.mend {
            Some(mend) => write!(f, " -> {mend}"),
            None => Ok(()),
        }
    }
}

/// Names in a row, the first few if they are many.
pub(super) fn listed<T: AsRef<str>>(names: &[T]) -> String {
    let shown: Vec<&str> = names.iter().take(NAMES_SHOWN).map(AsRef::as_ref).collect();
    match names.len() {
        0 => "none".into(),
        n if n > NAMES_SHOWN => format!("{}, .. ({n} in all)", shown.join(", ")),
        _ => shown.join(", "),
    }
}

/// A share in per cent.
pub(super) fn percent(part: usize, whole: usize) -> String {
    let share = 100.0 * part as f64 / whole.max(1) as f64;
    match share {
        share if part > 0 && share < 1.0 => format!("{share:.1} %"),
        share => format!("{share:.0} %"),
    }
}
