//! Reports: figures and tables of what was measured, on one page that needs no other file, as CSV
//! and as PNG.
//!
//! A [`Report`] is a list of [`Block`]s. [`training_blocks`] makes them from runs, grouped under
//! any names ([`group_by_seed`] groups runs that differ in nothing but their seed);
//! [`kernel_blocks`] makes them from what `dash bench` measured.
//!
//! # Map
//! - this file: the report and its files; `page`: the page; `table`: tables and CSV.
//! - `plot`: figures.
//! - `inputs`: from paths to a report; `runs`: what a run's folder holds; `groups`: runs of several seeds;
//!   `statistics`: medians and times to a quality; `quantities`: what is measured of them;
//!   `training`, `log`, `tables`, `settings`: their figures, tables and captions.
//! - `published`: figures of others beside ours.
//! - `kernels`: figures of kernels' errors and times.

mod groups;
mod growth;
mod inputs;
mod kernel_tables;
mod kernels;
mod log;
mod page;
mod plot;
mod published;
mod quantities;
mod runs;
mod settings;
mod statistics;
mod table;
mod tables;
#[cfg(test)]
mod tests;
mod training;

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use dash_model::scene_file::write_atomically;
use image::ImageFormat;

use crate::Error;
pub use groups::{RunGroup, group_by_seed};
pub use inputs::compared;
pub use kernels::kernel_blocks;
pub use plot::{Axis, Figure, LegendEntry, Panel, Point, Scale, Series};
pub use published::{Beside, beside, published_figures};
pub use runs::{RunRecord, read_run};
pub use table::{Cell, Shown, Table};
pub use training::training_blocks;

/// Pixels of a PNG for one of the page.
const PNG_SCALE: f64 = 2.0;
/// The page's file.
const PAGE: &str = "report.html";

/// A part of a report.
#[derive(Debug, Clone, PartialEq)]
pub enum Block {
    /// A heading.
    Heading(String),
    /// A paragraph.
    Text(String),
    /// A figure.
    Figure(Figure),
    /// A table.
    Table(Table),
}

/// What was measured, in the order in which it is read.
///
/// ```
/// use dash_train::report::{Block, Report};
///
/// let report = Report {
///     title: "Two seeds".into(),
///     blocks: vec![Block::Text("Both are level.".into())],
/// };
/// assert!(report.page().contains("Both are level."));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The page's title.
    pub title: String,
    /// Its parts. Figures and tables have names of their own.
    pub blocks: Vec<Block>,
}

impl Report {
    /// The page, which refers to no other file.
    pub fn page(&self) -> String {
        page::page(self)
    }

    /// Writes `report.html`, a PNG of every figure and a CSV of every table into `folder`; what was
    /// there under these names is replaced.
    ///
    /// # Errors
    /// When the folder can't be made or a file in it not written.
    ///
    /// # Panics
    /// When two figures or two tables have one name.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Error> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
        let mut names = BTreeSet::new();
        let mut write = |name: String, bytes: &[u8]| {
            let path = folder.join(&name);
            assert!(names.insert(name), "two parts of a report have one name");
            write_atomically(&path, |file| {
                let mut file = BufWriter::new(file);
                file.write_all(bytes)?;
                file.flush()
            })?;
            Ok::<PathBuf, Error>(path)
        };
        let mut files = vec![write(PAGE.into(), self.page().as_bytes())?];
        for block in &self.blocks {
            match block {
                Block::Figure(figure) => {
                    let mut bytes = std::io::Cursor::new(Vec::new());
                    figure
                        .drawing()
                        .raster(PNG_SCALE)
                        .write_to(&mut bytes, ImageFormat::Png)
                        .expect("a picture of bytes is written to memory");
                    files.push(write(format!("{}.png", figure.name), bytes.get_ref())?);
                }
                Block::Table(table) => {
                    files.push(write(
                        format!("{}.csv", table.name),
                        table.csv().as_bytes(),
                    )?);
                }
                Block::Heading(_) | Block::Text(_) => {}
            }
        }
        Ok(files)
    }
}
