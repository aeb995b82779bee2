//! From the paths that a user names to a report.

use std::path::{Path, PathBuf};

use super::groups::{RunGroup, group_by_seed};
use super::published::published_beside;
use super::runs::{RunRecord, read_run};
use super::training::training_blocks;
use super::{Block, Report, kernel_blocks};
use crate::Error;
use crate::bench::read_bench;

impl Report {
    /// The report of runs' folders and files of `dash bench`, in any mixture. Runs on different data
    /// have sections of their own; those that differ in nothing but their seed are one group.
    ///
    /// # Errors
    /// When a path is neither, or is named twice, or there is none.
    pub fn of_paths(paths: &[PathBuf]) -> Result<Self, Error> {
        if paths.is_empty() {
            return Err(Error::Config(
                "expected runs' folders or files of `dash bench`, found none; name at least one"
                    .into(),
            ));
        }
        let mut seen = Vec::new();
        let (mut runs, mut benches) = (Vec::new(), Vec::new());
        for path in paths {
            let known = path
                .canonicalize()
                .map_err(|e| Error::io(path, "open", e))?;
            if seen.contains(&known) {
                return Err(Error::run(
                    path,
                    "expected different runs and files, found this one twice; name each once",
                ));
            }
            seen.push(known);
            if path.is_dir() {
                runs.push(read_run(path)?);
            } else {
                benches.push((stem(path), read_bench(path)?));
            }
        }
        let mut blocks = Vec::new();
        let sections = by_data(runs);
        for (number, (title, runs)) in sections.iter().enumerate() {
            blocks.push(Block::Heading(title.clone()));
            let prefix = prefix(number, sections.len());
            let groups = group_by_seed(runs.clone());
            let published = published_beside(&groups, &prefix);
            blocks.extend(training_blocks(&groups, &prefix));
            blocks.extend(published.map(Block::Table));
        }
        let n_benches = benches.len();
        for (number, (name, bench)) in benches.iter().enumerate() {
            blocks.push(Block::Heading(format!("Kernels: {name}")));
            let prefix = format!("kernels-{}", prefix(number, n_benches));
            blocks.extend(kernel_blocks(bench, &prefix));
        }
        let title = match (sections.as_slice(), n_benches) {
            ([(title, _)], 0) => title.clone(),
            ([], _) => "Kernels: error against run time".into(),
            _ => "Error against run time".into(),
        };
        Ok(Self { title, blocks })
    }
}

/// What the names of a section's files begin with: nothing where there is one section.
fn prefix(number: usize, sections: usize) -> String {
    if sections > 1 {
        format!("{}-", number + 1)
    } else {
        String::new()
    }
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Runs by the data that they were trained and scored on, with a title.
fn by_data(runs: Vec<RunRecord>) -> Vec<(String, Vec<RunRecord>)> {
    let mut sections: Vec<(String, Vec<RunRecord>)> = Vec::new();
    for run in runs {
        let same = |other: &RunRecord| {
            let mut data = other.config.data.clone();
            data.device.clone_from(&run.config.data.device);
            data == run.config.data
        };
        match sections.iter_mut().find(|(_, others)| same(&others[0])) {
            Some((_, others)) => others.push(run),
            None => {
                let data = &run.config.data;
                let mut title = format!("Training on {}", stem(&data.dataset));
                if data.downscale != 1.0 {
                    title.push_str(&format!(", made smaller by {}", data.downscale));
                }
                if let Some(frames) = data.frames {
                    title.push_str(&format!(", frames {frames}"));
                }
                sections.push((title, vec![run]));
            }
        }
    }
    sections
}

/// Runs that are grouped already, as one section with a title.
pub fn compared(title: String, groups: &[RunGroup]) -> Report {
    Report {
        title,
        blocks: training_blocks(groups, ""),
    }
}
