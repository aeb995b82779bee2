//! Hostile files: whatever the bytes, a parser answers with an error or a valid result, without a panic
//! and without memory out of proportion to the file.
//!
//! `DASH_FUZZ_RUNS=1000000` sets the number of random files per parser, `DASH_FUZZ_PARSER=npy` picks one
//! parser, `DASH_FUZZ_SEED=7` other random numbers; `DASH_FUZZ_CORPUS=fuzz/corpus` writes the valid files
//! as the corpus of the fuzz targets.

mod allocation;
mod compressed;
mod fixtures;
mod mutate;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use dash_train::fuzzing::{PARSERS, Parser};
use fixtures::fixtures;
use mutate::{Mutator, flip_bit};
use tempfile::TempDir;

/// Bit flips of each valid file.
const BIT_FLIPS: usize = 10_000;
/// Random files per parser when none are asked for: some seconds in all.
const DEFAULT_RUNS: u64 = 2_000;
/// Room for what does not depend on the file: buffers of readers, error messages, and serde, which
/// believes a sequence's length up to 1 MiB.
const ALLOWED_BYTES: usize = 2 << 20;
/// Memory per byte of a file: a short text such as `{},` becomes a map of some hundred bytes.
const ALLOWED_PER_BYTE: usize = 128;
/// Memory per byte of a compressed image: no encoder saves more.
const ALLOWED_PER_IMAGE_BYTE: usize = 8192;

/// What many files led to.
#[derive(Debug, Default)]
struct Tally {
    files: u64,
    accepted: u64,
    /// Largest use of memory beyond the constant part, bytes per byte of the file.
    most_per_byte: usize,
    most_bytes: usize,
}

impl Tally {
    /// Parses a file; panics, with the file, when the parser does or takes too much memory.
    fn parse(&mut self, parser: &Parser, scratch: &Path, bytes: &[u8], origin: &str) -> bool {
        let measured = allocation::peak(|| {
            catch_unwind(AssertUnwindSafe(|| (parser.accepts)(scratch, bytes)))
        });
        let Ok(accepted) = measured.0 else {
            panic!("{}: a panic {origin}: {}", parser.name, shown(bytes));
        };
        let per_byte = if parser.name == "image" {
            ALLOWED_PER_IMAGE_BYTE
        } else {
            ALLOWED_PER_BYTE
        };
        assert!(
            measured.1 <= ALLOWED_BYTES + per_byte * bytes.len(),
            "{}: {} bytes of memory for a file of {} {origin}: {}",
            parser.name,
            measured.1,
            bytes.len(),
            shown(bytes)
        );
        self.files += 1;
        self.accepted += u64::from(accepted);
        self.most_bytes = self.most_bytes.max(measured.1);
        let beyond = measured.1.saturating_sub(ALLOWED_BYTES);
        self.most_per_byte = self.most_per_byte.max(beyond / bytes.len().max(1));
        accepted
    }
}

/// A folder in memory where the system has one: a disk takes longer to write a file than its parser.
fn scratch() -> TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("a scratch folder")
}

fn shown(bytes: &[u8]) -> String {
    let text = bytes.escape_ascii().to_string();
    let end = text.len().min(4000);
    format!("b\"{}\"", &text[..end])
}

/// The parsers that are asked for.
fn parsers() -> impl Iterator<Item = &'static Parser> {
    let wanted = std::env::var("DASH_FUZZ_PARSER").unwrap_or_default();
    PARSERS
        .iter()
        .filter(move |parser| wanted.is_empty() || parser.name == wanted)
}

fn number(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    Some(
        text.parse()
            .unwrap_or_else(|_| panic!("{variable}={text} is no number")),
    )
}

#[test]
fn valid_files_are_accepted_and_damaged_ones_are_no_panic() {
    for parser in parsers() {
        let scratch = scratch();
        let mut tally = Tally::default();
        for (index, valid) in fixtures(parser.name).iter().enumerate() {
            let whole = format!("from fixture {index}");
            assert!(
                tally.parse(parser, scratch.path(), valid, &whole),
                "{}: fixture {index} is refused: {}",
                parser.name,
                shown(valid)
            );
            for end in 0..valid.len() {
                tally.parse(parser, scratch.path(), &valid[..end], "from a truncation");
            }
            let mut mutator = Mutator::new(11 + index as u64);
            let mut damaged = valid.clone();
            for flip in 0..BIT_FLIPS {
                // Small files are flipped at every bit, then at random ones, two at a time.
                let bit = if flip < 8 * valid.len() && 8 * valid.len() <= BIT_FLIPS {
                    flip
                } else {
                    mutator.below(8 * valid.len())
                };
                flip_bit(&mut damaged, bit);
                tally.parse(parser, scratch.path(), &damaged, "from a flipped bit");
                if flip % 3 != 0 {
                    damaged.copy_from_slice(valid);
                }
            }
        }
        println!("{}: {tally:?}", parser.name);
    }
}

#[test]
fn random_files_are_no_panic() {
    let runs = number("DASH_FUZZ_RUNS").unwrap_or(DEFAULT_RUNS);
    let seed = number("DASH_FUZZ_SEED").unwrap_or(1);
    for parser in parsers() {
        let scratch = scratch();
        let valid = fixtures(parser.name);
        let mut mutator = Mutator::new(seed);
        let mut tally = Tally::default();
        for run in 0..runs {
            let file = mutator.mutant(&valid);
            tally.parse(parser, scratch.path(), &file, &format!("in run {run}"));
        }
        println!("{}: {tally:?}", parser.name);
    }
}

#[test]
fn the_corpus_of_the_fuzz_targets_is_written_on_demand() {
    let Some(root) = std::env::var_os("DASH_FUZZ_CORPUS") else {
        return;
    };
    for parser in PARSERS {
        let folder = Path::new(&root).join(parser.name);
        fs::create_dir_all(&folder).expect("a folder");
        for (index, bytes) in fixtures(parser.name).iter().enumerate() {
            fs::write(folder.join(format!("valid-{index}")), bytes).expect("writable");
        }
    }
}

#[test]
fn names_that_leave_the_folder_are_refused() {
    let scratch = scratch();
    let accepts = |name: &str, bytes: &[u8]| {
        let parser = PARSERS.iter().find(|p| p.name == name).expect("a parser");
        (parser.accepts)(scratch.path(), bytes)
    };
    for (file, inside) in [
        ("images/a.png", true),
        ("images/../a.png", true),
        ("../a.png", false),
        ("images/../../a.png", false),
        ("/etc/passwd", false),
        ("..", false),
        ("", false),
    ] {
        let json = format!(
            "{{\"fl_x\": 50.0, \"frames\": [{{\"file_path\": \"{file}\", \"transform_matrix\": \
             [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}]}}"
        );
        assert_eq!(accepts("transforms", json.as_bytes()), inside, "{file:?}");
        let binary = fixtures::model_images(&[file]);
        assert_eq!(accepts("colmap_images_binary", &binary), inside, "{file:?}");
    }
}

#[test]
fn images_that_claim_more_pixels_than_they_can_hold_cost_nothing() {
    let scratch = scratch();
    let parser = PARSERS
        .iter()
        .find(|p| p.name == "image")
        .expect("a parser");
    for side in [8_000u32, 16_384, 16_385, 65_535, u32::MAX] {
        for valid in fixtures("image") {
            let bomb = fixtures::with_image_size(&valid, side);
            let (accepted, bytes) = allocation::peak(|| (parser.accepts)(scratch.path(), &bomb));
            assert!(!accepted, "{side}");
            assert!(bytes < ALLOWED_BYTES, "{bytes} bytes for {side}");
        }
    }
}

/// Sizes that a file states without holding anything of that size.
#[test]
fn sizes_in_settings_are_not_believed() {
    let scratch = scratch();
    for (name, changes) in [
        (
            "scene",
            &[
                ("\"hidden\": 2", "\"hidden\": 4000000000"),
                ("\"layers\": 2", "\"layers\": 1000000000000000000"),
                ("\"n_levels\": 2", "\"n_levels\": 1000000000000000000"),
                ("\"log2_hashmap_size\": 3", "\"log2_hashmap_size\": 31"),
                (
                    "\"trajectory_width\": 6",
                    "\"trajectory_width\": 1000000000000000000",
                ),
                ("\"spans\": 2", "\"spans\": 1000000000000000000"),
                ("\"sh_degree\": 1", "\"sh_degree\": 4000000000000000000"),
                ("\"n_static\": 2", "\"n_static\": 4000000000000000000"),
            ][..],
        ),
        (
            "config_toml",
            &[
                ("hidden = ", "hidden = 4000000000 # "),
                ("n_levels = ", "n_levels = 1000000000000000000 # "),
                ("log2_hashmap_size = ", "log2_hashmap_size = 63 # "),
                ("resolution = [", "resolution = [8, 4000000000] # ["),
            ],
        ),
    ] {
        let parser = PARSERS.iter().find(|p| p.name == name).expect("a parser");
        let valid = fixtures(name).remove(0);
        for (stated, claimed) in changes {
            let (bytes, changed) = replaced(&valid, stated.as_bytes(), claimed.as_bytes(), name);
            assert!(changed, "{name}: no {stated} in {}", shown(&valid));
            let (accepted, held) = allocation::peak(|| (parser.accepts)(scratch.path(), &bytes));
            assert!(!accepted, "{name}: {claimed} is accepted");
            assert!(held < ALLOWED_BYTES, "{name}: {held} bytes for {claimed}");
        }
    }
}

/// The file with the first occurrence of a text replaced, and whether there was one. A scene's leading
/// length is kept right.
fn replaced(bytes: &[u8], old: &[u8], new: &[u8], parser: &str) -> (Vec<u8>, bool) {
    let Some(at) = bytes.windows(old.len()).position(|window| window == old) else {
        return (bytes.to_vec(), false);
    };
    let mut out = bytes.to_vec();
    out.splice(at..at + old.len(), new.iter().copied());
    if parser == "scene"
        && let Some(length) = out.first_chunk_mut::<4>()
    {
        let json_bytes = u32::from_le_bytes(*length) + new.len() as u32 - old.len() as u32;
        *length = json_bytes.to_le_bytes();
    }
    (out, true)
}
