//! The README and the book: every command runs or exists, every code block is what a file holds, every
//! link leads somewhere.
//!
//! A fenced block says what it is after its language:
//!
//! | fence | what is tested |
//! | --- | --- |
//! | `sh` | it runs; the blocks of a page share a folder |
//! | `sh short` | the same, with training shortened |
//! | `sh long`, `sh data=NAME`, `sh needs=TOOL` | its programs, subcommands, options and named values exist |
//! | any language, `file=NAME` | it is written into the page's folder, for later blocks |
//! | `rust excerpt=PATH` | the file holds these lines |
//! | `text` | nothing: it shows output |

mod commands;
mod page;
mod program;

use std::fs;
use std::path::{Path, PathBuf};

use dash_train::train::{Preset, TrainConfig};

use self::commands::check;
use self::page::{Block, Page};
use self::program::Program;

/// Most words of the README, everything counted.
const README_WORDS: usize = 700;
/// The README's commands that other scripts take from it.
const README_COMMANDS: [&str; 2] = [
    "cargo run --release --example quickstart",
    "tests/prepare.sh && cargo test --release --workspace",
];

/// The repository's root.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn book() -> PathBuf {
    root().join("docs/src")
}

/// The README and every page of the book.
fn pages() -> Vec<Page> {
    let mut paths = vec![root().join("README.md")];
    markdown_files(&book(), &mut paths);
    paths.sort();
    assert!(paths.len() > 10, "the book has pages: {paths:?}");
    paths.into_iter().map(Page::read).collect()
}

fn markdown_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("docs/src can be listed") {
        let path = entry.expect("docs/src can be listed").path();
        if path.is_dir() {
            markdown_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

#[test]
fn commands_run_or_exist() {
    let program = Program::find();
    let mut faults = Vec::new();
    let (mut n_run, mut n_checked) = (0, 0);
    for page in pages() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for block in &page.blocks {
            if let Some(name) = block.value("file") {
                fs::write(folder.path().join(name), &block.text).expect("a file of the page");
            }
            let outcome = match block.language.as_str() {
                "sh" if block.is_run() => {
                    n_run += 1;
                    program.run(&block.text, folder.path(), block.has("short"))
                }
                "sh" => {
                    n_checked += 1;
                    check(&block.text, &program, root())
                }
                _ => Ok(()),
            };
            if let Err(why) = outcome {
                faults.push(format!("{}: {why}", page.place(block)));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(
        n_run >= 10 && n_checked >= 10,
        "{n_run} run, {n_checked} checked"
    );
}

#[test]
fn every_key_that_a_page_sets_exists() {
    let mut faults = Vec::new();
    let mut n_keys = 0;
    for page in pages() {
        let text = fs::read_to_string(&page.path).expect("a page");
        let set = text.split("--set").skip(1);
        let keys =
            set.filter_map(|after| after.trim_start_matches(['=', ' ', '\n']).split_once('='));
        let is_key = |key: &str| {
            key.chars()
                .all(|c| c.is_ascii_lowercase() || "._".contains(c))
        };
        for (key, _) in keys.filter(|(key, _)| is_key(key)) {
            n_keys += 1;
            // What is wrong with the value of a known key is another matter.
            let refused = TrainConfig::preset(Preset::Quick).set(&format!("{key}=no value"));
            let why = refused.map_or_else(|error| error.to_string(), |()| String::new());
            if why.contains("no key") || why.contains("no section") {
                faults.push(format!("{}: {why}", page.path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(n_keys >= 5, "{n_keys}");
}

#[test]
fn code_is_what_files_hold() {
    for page in pages() {
        for block in &page.blocks {
            assert!(is_known(block), "{}: {}", page.place(block), block.fence);
            let Some(path) = block.value("excerpt") else {
                continue;
            };
            let file = fs::read_to_string(root().join(path));
            let file = file.unwrap_or_else(|e| panic!("{}: {path}: {e}", page.place(block)));
            let holds = format!("\n{file}").contains(&format!("\n{}", block.text));
            assert!(holds, "{}: {path} has other lines", page.place(block));
        }
    }
}

/// Whether a test looks at the block, or it shows output.
fn is_known(block: &Block) -> bool {
    match block.language.as_str() {
        "sh" | "text" => true,
        "rust" => block.value("excerpt").is_some(),
        _ => block.value("file").is_some(),
    }
}

#[test]
fn links_lead_somewhere() {
    let mut faults = Vec::new();
    let mut n_links = 0;
    for page in pages() {
        for (link, _) in page.links.iter().filter(|(link, _)| !link.contains("://")) {
            n_links += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() {
                page.path.clone()
            } else {
                page.folder().join(path)
            };
            if !target.exists() {
                faults.push(format!("{}: {link}: no such file", page.path.display()));
            } else if !anchor.is_empty() && !Page::read(target).anchors.iter().any(|a| a == anchor)
            {
                faults.push(format!("{}: {link}: no such heading", page.path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(n_links > 50, "{n_links}");
}

#[test]
fn the_summary_names_every_page() {
    let summary = Page::read(book().join("SUMMARY.md"));
    let named: Vec<PathBuf> = summary
        .links
        .iter()
        .map(|(link, _)| book().join(link))
        .collect();
    for page in pages().iter().filter(|page| page.path.starts_with(book())) {
        let is_named = page.path == summary.path || named.contains(&page.path);
        assert!(is_named, "{} is not in SUMMARY.md", page.path.display());
    }
}

#[test]
fn the_readme_is_short_and_has_its_commands() {
    let readme = Page::read(root().join("README.md"));
    let words = readme.text.split_whitespace().count();
    assert!(words <= README_WORDS, "{words} words");
    for command in README_COMMANDS {
        let stands_alone = readme.text.lines().any(|line| line == command);
        assert!(stands_alone, "no line `{command}`");
    }
}

/// Negative controls: what these tests look for is found.
#[test]
fn mistakes_are_found() {
    let program = Program::find();
    for mistake in [
        "dash trian FOLDER --out runs/a",
        "dash train FOLDER --out runs/a --no-such-option",
        "dash train FOLDER --out runs/a --preset fast",
        "dash compare FOLDER --budget 5 --out a --methods dash,nerf",
        "dash synth out/room && dash train out/room --outt runs/a",
        "cargo run --release --example no_such_example",
        "cargo run --release -p dash-cli --bin dash -- trian",
        "tests/no_such_script.sh",
        "no_such_program --help",
    ] {
        assert!(check(mistake, &program, root()).is_err(), "{mistake}");
    }
    for right in [
        "dash train FOLDER --out runs/a --preset quick   # a comment --with words",
        "dash compare FOLDER --budget 5 --out a \\\n  --methods dash,grid4d+dec",
        "tests/prepare.sh && cargo test --release --workspace",
        "cargo run --release -p dash-cli --bin dash -- train FOLDER --out a",
    ] {
        assert_eq!(check(right, &program, root()), Ok(()), "{right}");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    assert!(
        program
            .run("dash info no_such_folder", folder.path(), false)
            .is_err()
    );
    let page = Page::of(
        PathBuf::from("a.md"),
        "# A b\n\n[x](no.md)\n\n```rust\nfn f() {}\n```\n".into(),
    );
    assert_eq!(page.anchors, ["a-b"]);
    assert_eq!(page.links[0].0, "no.md");
    assert!(!is_known(&page.blocks[0]));
}
