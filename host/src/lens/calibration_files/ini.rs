//! Calibrations in text of other forms, as YAML: ROS's INI files, and lines of `name = value`.

use std::{collections::HashSet, fmt::Write, path::Path};

use crate::error::{Error, Result};

/// The YAML of a text whose first line is `[section]` or `name = value`: a mapping for each section. `None` for other text.
///
/// In a section of ROS, a line of words is a name, and the numbers that follow, on that line and others, are its value.
pub fn as_yaml(path: &Path, text: &str) -> Result<Option<String>> {
    let lines = text.lines().filter_map(|line| line.split('#').next()).map(str::trim);
    let mut lines = lines.filter(|line| !line.is_empty() && !line.starts_with(';')).peekable();
    if !lines.peek().is_some_and(|line| section(line).is_some() || assignment(line, &['=']).is_some()) {
        return Ok(None);
    }
    let mut sections = HashSet::new();
    let (mut yaml, mut indent) = (String::new(), "");
    let mut entry: Option<(String, Vec<&str>)> = None;
    for line in lines {
        if let Some(name) = section(line) {
            end(&mut yaml, indent, entry.take());
            if !sections.insert(name) {
                let expected = "the calibration of one camera: keep the one that takes the images";
                return Err(Error::format(path, format!("[{name}] twice"), expected));
            }
            let _ = writeln!(yaml, "{}:", quoted(name));
            indent = "  ";
        } else if let Some((name, value)) = assignment(line, &['=', ':']) {
            end(&mut yaml, indent, entry.replace((name.into(), words(value).collect())));
        } else {
            let words: Vec<&str> = words(line).collect();
            let first = words.iter().position(|word| is_number(word)).unwrap_or(words.len());
            let (name, value) = words.split_at(first);
            if !name.is_empty() {
                end(&mut yaml, indent, entry.replace((name.join(" "), Vec::new())));
            }
            entry.get_or_insert_default().1.extend(value);
        }
    }
    let is_cut =
        yaml.contains("'camera matrix'") && entry.as_ref().is_none_or(|(name, value)| name != "projection" || value.len() != 12);
    if is_cut {
        return Err(Error::format(path, "no projection of 12 numbers at the end", "ROS's INI file, whole"));
    }
    end(&mut yaml, indent, entry);
    Ok(Some(yaml))
}

fn section(line: &str) -> Option<&str> {
    let name = line.strip_prefix('[')?.strip_suffix(']')?;
    (!name.is_empty() && !name.contains(['[', ',', '{', '"']) && !words(name).any(is_number)).then_some(name)
}

fn assignment<'a>(line: &'a str, separators: &[char]) -> Option<(&'a str, &'a str)> {
    let (name, value) = line.split_once(separators)?;
    (!name.trim().is_empty() && !name.contains(['<', '{', '[', ':', '"', '%'])).then_some((name.trim(), value.trim()))
}

/// The parts of a value. Rows of a matrix end in `;` or in brackets.
fn words(value: &str) -> impl Iterator<Item = &str> {
    value.split(|letter: char| letter.is_whitespace() || "[](),;".contains(letter)).filter(|word| !word.is_empty())
}

fn is_number(word: &str) -> bool {
    word.parse::<f64>().is_ok()
}

/// Writes a finished entry: a number, several, or text.
fn end(yaml: &mut String, indent: &str, entry: Option<(String, Vec<&str>)>) {
    let Some((name, value)) = entry else { return };
    let value = match &value[..] {
        [number] if is_number(number) => (*number).into(),
        numbers if !numbers.is_empty() && numbers.iter().all(|word| is_number(word)) => format!("[{}]", numbers.join(", ")),
        words => quoted(&words.join(" ")),
    };
    let _ = writeln!(yaml, "{indent}{}: {value}", quoted(&name));
}

fn quoted(text: &str) -> String {
    format!("'{}'", text.trim_matches(['"', '\'']).replace('\'', "''"))
}
