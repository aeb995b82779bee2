//! Files and folders that have another name until they are complete, and their removal when a program stops before.
//!
//! An [`Unfinished`] goes when it is dropped. A program that is told to stop calls [`remove_all`]. What a killed one has
//! left is removed by the next that writes under the same name: whoever writes holds a lock, which ends with the
//! program.
//!
//! Whatever makes or names one of them takes the lock of a list, which [`remove_all`] keeps: from then on no thread can
//! name what is partly removed, or make it anew.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What is under way in this program.
static UNDER_WAY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Attempts at removing a folder into which other threads may still be writing, a millisecond apart.
const ATTEMPTS: usize = 2000;
/// Characters of a name that are kept: at 4 bytes each, what is added still fits.
const MOST_CHARS: usize = 60;
/// Elsewhere a lock keeps even its owner from writing by another handle.
const HAS_LOCKS: bool = cfg!(unix);
/// Programs that may write under the same name at once.
const MOST_AT_ONCE: usize = 100;

fn under_way() -> MutexGuard<'static, Vec<PathBuf>> {
    UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file or folder that is not complete; removed when dropped.
///
/// ```
/// use std::fs;
///
/// use dash_model::unfinished::Unfinished;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("scores.json");
/// let unfinished = Unfinished::file(&path)?;
/// fs::write(unfinished.path(), "{}")?;
/// assert!(!path.exists());
/// unfinished.finish(|scratch| fs::rename(scratch, &path))?;
/// assert!(path.exists());
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    /// Held as long as this is. `None` where the file system has no locks.
    _lock: Option<File>,
}

impl Unfinished {
    /// An empty file in the folder that `path` is in, for what becomes `path`.
    ///
    /// # Errors
    /// The system's.
    pub fn file(path: &Path) -> io::Result<Self> {
        let make = |scratch: &Path| {
            let mut options = OpenOptions::new();
            options.write(true).create_new(true).open(scratch)
        };
        Self::beside(path, |scratch| make(scratch).map(|_| ()))
    }

    /// An empty folder in the folder that `path` is in, for what becomes `path`.
    ///
    /// # Errors
    /// The system's.
    pub fn folder(path: &Path) -> io::Result<Self> {
        Self::beside(path, |scratch| fs::create_dir(scratch))
    }

    /// `.NAME.partial` beside `path`, or with a number where another program writes that.
    fn beside(path: &Path, make: impl Fn(&Path) -> io::Result<()>) -> io::Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name: String = name.chars().take(MOST_CHARS).collect();
        let mut list = under_way();
        for n in 0..MOST_AT_ONCE {
            let number = if n == 0 {
                String::new()
            } else {
                format!("{n}.")
            };
            let scratch = path.with_file_name(format!(".{name}.{number}partial"));
            if list.contains(&scratch) || !free(&scratch)? {
                continue;
            }
            make(&scratch)?;
            let lock = match locked(&scratch) {
                Lock::Ours(file) => Some(file),
                Lock::None => None,
                // Who tidies took it for what a killed program left, and removes it.
                Lock::Others => continue,
            };
            list.push(scratch.clone());
            return Ok(Self {
                path: scratch,
                _lock: lock,
            });
        }
        Err(ErrorKind::ResourceBusy.into())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Has `put` give it, or what is in it, its name. Once this has begun, [`remove_all`] waits for it.
    ///
    /// # Errors
    /// Those of `put`.
    pub fn finish<E>(self, put: impl FnOnce(&Path) -> Result<(), E>) -> Result<(), E> {
        let list = under_way();
        let done = put(&self.path);
        drop(list);
        done
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut list = under_way();
        // It is gone where it was given its name.
        let _ = remove(&self.path);
        list.retain(|path| *path != self.path);
    }
}

/// Whether the name is free, after what a killed program left there is removed.
fn free(scratch: &Path) -> io::Result<bool> {
    let left = match File::open(scratch) {
        Ok(left) => left,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
        // Not ours to remove.
        Err(_) => return Ok(false),
    };
    if HAS_LOCKS && !is_ours(&left) {
        return Ok(false);
    }
    remove(scratch).map(|()| true)
}

/// Who has the lock of something that this program has just made.
enum Lock {
    Ours(File),
    Others,
    /// There are no locks here.
    None,
}

fn locked(scratch: &Path) -> Lock {
    if !HAS_LOCKS {
        return Lock::None;
    }
    let Ok(file) = File::open(scratch) else {
        return Lock::Others;
    };
    match file.try_lock() {
        // It may have been removed between the two.
        Ok(()) if scratch.exists() => Lock::Ours(file),
        Ok(()) | Err(TryLockError::WouldBlock) => Lock::Others,
        Err(TryLockError::Error(_)) => Lock::None,
    }
}

/// Whether no other program holds the lock; then this one does.
fn is_ours(file: &File) -> bool {
    file.try_lock().is_ok()
}

/// Removes a file or folder; what is not there is removed.
fn remove(path: &Path) -> io::Result<()> {
    let found = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        found => found?,
    };
    match found.is_dir() {
        true => fs::remove_dir_all(path),
        false => fs::remove_file(path),
    }
}

/// Removes a file or folder as a whole: it loses its name first. What is not there is removed.
///
/// # Errors
/// The system's.
pub fn discard(path: &Path) -> io::Result<()> {
    match Unfinished::beside(path, |scratch| fs::rename(path, scratch)) {
        Ok(nameless) => remove(nameless.path()),
        Err(_) if fs::symlink_metadata(path).is_err_and(|e| e.kind() == ErrorKind::NotFound) => {
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// Removes what killed programs have left of files and folders in `folder`; nothing where there is no such folder.
///
/// # Errors
/// The system's.
pub fn remove_left(folder: &Path) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    let list = under_way();
    for entry in entries {
        let path = entry?.path();
        if is_unfinished(&path) && !list.contains(&path) {
            free(&path)?;
        }
    }
    Ok(())
}

/// Whether a path has the name of something unfinished.
pub fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with('.') && name.ends_with(".partial")
}

/// Creates a folder and those it is in, if any of them may be in something unfinished.
///
/// # Errors
/// The system's.
pub fn create_dir_all(folder: &Path) -> io::Result<()> {
    let _list = under_way();
    fs::create_dir_all(folder)
}

/// Removes all that is unfinished, and keeps other threads from making or naming more: for a program that ends at once.
/// Before it removes anything it has `end_writers` end the other programs that write to it.
pub fn remove_all(end_writers: impl FnOnce()) {
    let list = under_way();
    end_writers();
    for path in list.iter() {
        for _ in 0..ATTEMPTS {
            if remove(path).is_ok() {
                break;
            }
            // A thread has just written a file into it.
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    std::mem::forget(list);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("listed");
        let mut names: Vec<String> = entries
            .map(|entry| entry.expect("listed").file_name().to_string_lossy().into())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn what_is_dropped_goes_and_what_is_finished_has_its_name() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let out = folder.path().join("out");
        let first = Unfinished::folder(&out).expect("made");
        fs::write(first.path().join("a"), "a").expect("written");
        // A second writer of the same name does not disturb the first.
        let second = Unfinished::file(&out).expect("made");
        assert_eq!(names(folder.path()), [".out.1.partial", ".out.partial"]);
        drop(second);
        first
            .finish(|scratch| fs::rename(scratch, &out))
            .expect("renamed");
        assert_eq!(names(folder.path()), ["out"]);
        assert_eq!(names(&out), ["a"]);
        let failed = Unfinished::file(&out).expect("made");
        let error = failed.finish(|_| Err(io::Error::from(ErrorKind::StorageFull)));
        assert!(error.is_err());
        assert_eq!(names(folder.path()), ["out"]);
    }

    #[test]
    fn what_is_discarded_goes_and_what_is_left_is_removed_unless_it_is_held() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = |name: &str| folder.path().join(name);
        for name in ["000010", ".000020.partial", ".000030.partial", ".hidden"] {
            fs::create_dir(path(name)).expect("made");
            fs::write(path(name).join("state"), "s").expect("written");
        }
        discard(&path("000010")).expect("removed");
        discard(&path("000010")).expect("there is none");
        let ours = Unfinished::file(&path("000040")).expect("made");
        let held = File::open(path(".000030.partial")).expect("opened");
        held.try_lock().expect("free");
        remove_left(folder.path()).expect("removed");
        let left = [".000030.partial", ".000040.partial", ".hidden"];
        assert_eq!(names(folder.path()), left);
        drop(ours);
        remove_left(&path("none")).expect("nothing to remove");
    }

    #[test]
    fn what_a_killed_program_left_is_removed_and_what_another_writes_is_not() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let out = folder.path().join("out");
        let left = folder.path().join(".out.partial");
        fs::create_dir(&left).expect("made");
        fs::write(left.join("half"), "h").expect("written");
        let ours = Unfinished::folder(&out).expect("made");
        assert_eq!(ours.path(), left);
        assert!(names(&left).is_empty(), "what was left is gone");
        drop(ours);
        // As another program holds it.
        fs::create_dir(&left).expect("made");
        let held = File::open(&left).expect("opened");
        held.try_lock().expect("free");
        let beside = Unfinished::folder(&out).expect("made");
        assert_eq!(beside.path(), folder.path().join(".out.1.partial"));
        drop(beside);
        assert_eq!(names(folder.path()), [".out.partial"]);
    }
}
