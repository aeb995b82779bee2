//! Folders that belong to one comparison or benchmark.

use std::fs;
use std::io::Write;
use std::path::Path;

use dash_model::scene_file::write_atomically;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::is_occupied;
use crate::Error;

/// What the folder `out` belongs to, as its file `name` says.
///
/// # Errors
/// When the file is not there, or is damaged.
pub(crate) fn read_owner<T: DeserializeOwned>(out: &Path, name: &str) -> Result<T, Error> {
    let path = out.join(name);
    let text = fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
    toml::from_str(&text).map_err(|e| Error::Config(format!("{}: {}", path.display(), e.message())))
}

/// Makes `out` the folder of `owner`, which its file `name` then holds, or finds that it is. `what` calls the owner in
/// errors.
///
/// # Errors
/// When `out` is another owner's, or holds other files.
pub(crate) fn claim<T: Serialize + DeserializeOwned + PartialEq>(
    out: &Path,
    name: &str,
    owner: &T,
    what: &str,
) -> Result<(), Error> {
    let path = out.join(name);
    if path.is_file() {
        let found = fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
        return match toml::from_str::<T>(&found) {
            Ok(found) if found == *owner => Ok(()),
            _ => Err(Error::run(
                out,
                format!(
                    "expected a new folder or this {what}'s, found another one's ({name} differs); choose \
                     another --out"
                ),
            )),
        };
    }
    let occupied = is_occupied(out).map_err(|e| Error::io(out, "list", e))?;
    if occupied {
        return Err(Error::run(
            out,
            format!(
                "expected a new or empty folder for the {what}, found files in it; choose another --out"
            ),
        ));
    }
    fs::create_dir_all(out).map_err(|e| Error::io(out, "create", e))?;
    write_owner(out, name, owner)
}

/// Writes the file `name` that says what the folder `out` belongs to.
///
/// # Errors
/// When it can't be written; what was there before stays.
pub(crate) fn write_owner<T: Serialize>(out: &Path, name: &str, owner: &T) -> Result<(), Error> {
    let text = toml::to_string(owner).map_err(|e| Error::Config(e.to_string()))?;
    write_atomically(&out.join(name), |mut file| file.write_all(text.as_bytes()))?;
    Ok(())
}
