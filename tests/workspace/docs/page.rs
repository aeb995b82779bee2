//! A page of Markdown: its fenced blocks, links and headings.

use std::fs;
use std::path::{Path, PathBuf};

/// A fenced block.
pub struct Block {
    /// All that stands after the opening fence.
    pub fence: String,
    /// The first word of that.
    pub language: String,
    /// The lines in between, without the fence's indentation.
    pub text: String,
    /// The opening fence's line, from 1.
    pub line: usize,
}

impl Block {
    /// Whether the fence has this word.
    pub fn has(&self, mark: &str) -> bool {
        self.fence.split_whitespace().any(|word| word == mark)
    }

    /// What stands after `NAME=` in the fence.
    pub fn value(&self, name: &str) -> Option<&str> {
        let words = self.fence.split_whitespace();
        words
            .filter_map(|word| word.split_once('='))
            .find(|(key, _)| *key == name)
            .map(|(_, value)| value)
    }

    /// Whether its commands run in the test; ffmpeg is there, since `tests/prepare.sh` installs it.
    pub fn is_run(&self) -> bool {
        let can_run = self.value("needs").is_none_or(|tool| tool == "ffmpeg");
        can_run && self.value("data").is_none() && !self.has("long")
    }
}

/// A file of Markdown.
pub struct Page {
    /// Where it lies.
    pub path: PathBuf,
    /// All of it.
    pub text: String,
    /// Its fenced blocks, in order.
    pub blocks: Vec<Block>,
    /// Targets of links and images, with their lines from 1.
    pub links: Vec<(String, usize)>,
    /// Anchors of its headings, as mdBook and GitHub make them.
    pub anchors: Vec<String>,
}

impl Page {
    /// Reads a file.
    pub fn read(path: PathBuf) -> Self {
        let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        Self::of(path, text)
    }

    /// Takes a text apart.
    pub fn of(path: PathBuf, text: String) -> Self {
        let (mut blocks, mut links, mut anchors) = (Vec::new(), Vec::new(), Vec::new());
        let mut open: Option<(Block, usize)> = None;
        for (index, line) in text.lines().enumerate() {
            let indent = line.len() - line.trim_start().len();
            let fence = line.trim_start().strip_prefix("```");
            match (open.take(), fence) {
                (Some((block, _)), Some("")) => blocks.push(block),
                (Some((mut block, depth)), _) => {
                    block.text += line.get(depth.min(indent)..).unwrap_or_default();
                    block.text.push('\n');
                    open = Some((block, depth));
                }
                (None, Some(fence)) => {
                    let language = fence.split_whitespace().next().unwrap_or_default();
                    let block = Block {
                        fence: fence.into(),
                        language: language.into(),
                        text: String::new(),
                        line: index + 1,
                    };
                    open = Some((block, indent));
                }
                (None, None) => {
                    links.extend(targets(line).map(|target| (target.to_string(), index + 1)));
                    if let Some(heading) = line.strip_prefix('#') {
                        anchors.push(anchor(heading.trim_start_matches('#').trim()));
                    }
                }
            }
        }
        assert!(open.is_none(), "{}: a block has no end", path.display());
        Self {
            path,
            text,
            blocks,
            links,
            anchors,
        }
    }

    /// The folder that its links start from.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }

    /// Where a block is, for a message.
    pub fn place(&self, block: &Block) -> String {
        format!("{}:{}", self.path.display(), block.line)
    }
}

/// What the links of a line lead to; code spans aside.
fn targets(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').step_by(2).flat_map(|text| {
        text.split("](")
            .skip(1)
            .filter_map(|rest| rest.split_once(')'))
            .map(|(target, _)| target)
    })
}

fn anchor(heading: &str) -> String {
    let kept = heading
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| {
        if c == ' ' {
            '-'
        } else {
            c.to_ascii_lowercase()
        }
    })
    .collect()
}
