//! Commands that are not run: whether their programs, options and named values exist.

use std::fs;
use std::path::Path;

use super::program::Program;

/// Programs of a system whose options are not looked at.
const PLAIN: [&str; 9] = [
    "apt", "cd", "cp", "ls", "mkdir", "python3", "seq", "ssh", "tar",
];
/// Commands of `dash` that have commands of their own.
const WITH_COMMANDS: [&str; 1] = ["plan"];

/// Looks whether each command of a block could run.
pub fn check(block: &str, program: &Program, root: &Path) -> Result<(), String> {
    let joined = block.replace("\\\n", " ");
    for line in joined.lines() {
        let words = words(line);
        for command in words.split(|word| matches!(word.as_str(), "&&" | "||" | ";" | "|")) {
            check_command(command, program, root)?;
        }
    }
    Ok(())
}

/// The words of a line up to a comment.
fn words(line: &str) -> Vec<String> {
    let words = line
        .split_whitespace()
        .take_while(|word| !word.starts_with('#'));
    words
        .map(|word| word.trim_matches(['"', '\'']).to_string())
        .collect()
}

fn check_command(words: &[String], program: &Program, root: &Path) -> Result<(), String> {
    let Some((name, rest)) = words.split_first() else {
        return Ok(());
    };
    match name.as_str() {
        "xargs" => match rest.iter().position(|word| word == "dash") {
            Some(dash) => check_dash(&rest[dash + 1..], program),
            None => Ok(()),
        },
        "dash" | "./dash" => check_dash(rest, program),
        "cargo" => check_cargo(rest, program, root),
        plain if PLAIN.contains(&plain) => Ok(()),
        script if script.contains('/') && root.join(script).is_file() => Ok(()),
        other => Err(format!("`{other}` is no program that the docs may name")),
    }
}

/// A command of `dash`, without the program's name.
fn check_dash(words: &[String], program: &Program) -> Result<(), String> {
    let command = words.first().map_or("", String::as_str);
    let command = if command.starts_with('-') {
        ""
    } else {
        command
    };
    let own = words.get(1).filter(|_| WITH_COMMANDS.contains(&command));
    let command = &own.map_or_else(|| command.to_string(), |own| format!("{command} {own}"));
    let help = program.help(command)?;
    for (index, word) in words
        .iter()
        .enumerate()
        .filter(|(_, word)| word.starts_with("--"))
    {
        let (option, value) = word.split_once('=').unwrap_or((word, ""));
        let Some(section) = section(&help, option) else {
            return Err(format!("dash {command} has no option {option}"));
        };
        let next = words.get(index + 1).filter(|next| !next.starts_with('-'));
        let value = if value.is_empty() {
            next.map_or("", String::as_str)
        } else {
            value
        };
        let possible = possible_values(&section);
        if let Some(wrong) = value
            .split(',')
            .find(|v| !possible.is_empty() && !possible.iter().any(|p| p == v))
        {
            return Err(format!(
                "dash {command} {option}: `{wrong}` is none of {possible:?}"
            ));
        }
    }
    Ok(())
}

/// What the help says about an option.
fn section(help: &str, option: &str) -> Option<String> {
    let names = |line: &str| -> Vec<String> {
        let line = line.trim_start();
        let is_option = line.starts_with("--") || line.starts_with('-') && !line.starts_with("- ");
        let words = line
            .split([' ', ',', '='])
            .take(if is_option { 3 } else { 0 });
        words
            .filter(|word| word.starts_with("--"))
            .map(String::from)
            .collect()
    };
    let mut lines = help
        .lines()
        .skip_while(|line| !names(line).iter().any(|name| name == option));
    let first = lines.next()?;
    let rest = lines.take_while(|line| names(line).is_empty());
    Some(
        std::iter::once(first)
            .chain(rest)
            .collect::<Vec<_>>()
            .join("\n"),
    )
}

/// The values that an option takes, if they have names.
fn possible_values(section: &str) -> Vec<String> {
    if let Some((_, list)) = section.split_once("[possible values: ") {
        let list = list.split_once(']').map_or(list, |(list, _)| list);
        return list
            .split(',')
            .map(|value| value.trim().to_string())
            .collect();
    }
    let Some((_, list)) = section.split_once("Possible values:") else {
        return Vec::new();
    };
    let named = list
        .lines()
        .filter_map(|line| line.trim().strip_prefix("- "));
    named
        .filter_map(|line| line.split([':', ' ']).next())
        .map(String::from)
        .collect()
}

/// A command of cargo: the examples, crates, folders and features that it names exist.
fn check_cargo(words: &[String], program: &Program, root: &Path) -> Result<(), String> {
    let (own, ours) = match words.iter().position(|word| word == "--") {
        Some(end) => (&words[..end], Some(&words[end + 1..])),
        None => (words, None),
    };
    for pair in own.windows(2) {
        let (option, value) = (pair[0].as_str(), pair[1].as_str());
        let exists = match option {
            "--example" => root.join(format!("examples/{value}.rs")).is_file(),
            "-p" | "--path" => root.join(value).join("Cargo.toml").is_file(),
            "--bin" => value == "dash",
            "--features" => has_feature(root, value),
            _ => true,
        };
        if !exists {
            return Err(format!("cargo: there is no {option} {value}"));
        }
    }
    let is_dash = own
        .windows(2)
        .any(|pair| pair[0] == "--bin" && pair[1] == "dash");
    match ours {
        Some(ours) if is_dash => check_dash(ours, program),
        _ => Ok(()),
    }
}

fn has_feature(root: &Path, name: &str) -> bool {
    let manifest = fs::read_to_string(root.join("dash-cli/Cargo.toml")).unwrap_or_default();
    manifest
        .lines()
        .any(|line| line.split('=').next().is_some_and(|key| key.trim() == name))
}
