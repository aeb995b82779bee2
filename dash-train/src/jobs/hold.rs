//! Who works on what.

use std::fs::{self, File, TryLockError};
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use crate::Error;

/// How long to wait before a file that another process holds is tried again.
const PAUSE: Duration = Duration::from_millis(200);

/// A file that this process holds and no other can meanwhile, until this is dropped or the process ends, however it does.
/// The system keeps count of it, also among machines that share a folder, where that folder's file system has locks (NFS
/// does).
#[derive(Debug)]
pub struct Hold {
    _file: File,
}

impl Hold {
    /// Holds the file at `path`, which is made where it is not there; `None` where another process holds it.
    ///
    /// # Errors
    /// When the file can't be opened, or its file system has no locks.
    pub fn take(path: &Path) -> Result<Option<Self>, Error> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
        }
        let mut options = File::options();
        let opened = options.create(true).append(true).open(path);
        // Another user's can only be read.
        let opened = opened.or_else(|error| File::open(path).map_err(|_| error));
        let file = opened.map_err(|e| Error::io(path, "open", e))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { _file: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(e)) => Err(Error::io(path, "lock", e)),
        }
    }

    /// The same once nobody else holds it; `None` where `stop` says so before. `waiting` is called once if it has to wait.
    ///
    /// # Errors
    /// As [`Hold::take`].
    pub fn wait(
        path: &Path,
        stop: &dyn Fn() -> bool,
        waiting: impl FnOnce(),
    ) -> Result<Option<Self>, Error> {
        let mut waiting = Some(waiting);
        while !stop() {
            if let Some(hold) = Self::take(path)? {
                return Ok(Some(hold));
            }
            if let Some(waiting) = waiting.take() {
                waiting();
            }
            sleep(PAUSE);
        }
        Ok(None)
    }
}
