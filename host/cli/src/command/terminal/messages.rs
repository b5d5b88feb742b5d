//! Results on standard output, messages on standard error, the width of the terminal, and pages opened in the browser.

use std::{
    borrow::Cow,
    env,
    ffi::OsStr,
    fmt::{Display, Write as _},
    io::{self, ErrorKind, IsTerminal, Write, stderr},
    process::{Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
};

use multiscopic::{Error, Result, stereo::confidence_map::SURE};
use serde::Serialize;
use terminal_size::{Width, terminal_size};

/// Writes text or JSON to standard output, as [`visible`] does. It is not an error if the reader has closed it, as `| head` does.
pub fn print(text: &str) -> Result<()> {
    print_bytes(visible(text).as_bytes())
}

/// Writes bytes to standard output as they are. A closed pipe is no error.
pub fn print_bytes(bytes: &[u8]) -> Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(Error::Write { path: "standard output".into(), source }),
        _ => Ok(()),
    }
}

/// Writes a report to standard output: as one line of JSON, or as text that fits the terminal.
pub fn print_report(report: &(impl Display + Serialize), json: bool) -> Result<()> {
    let text = match json {
        true => serde_json::to_string(report).expect("a report is numbers and strings") + "\n",
        false => columns().map_or_else(|| report.to_string(), |limit| wrapped(&report.to_string(), limit)),
    };
    print(&text)
}

/// True if notes are left out.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Leaves out notes and progress bars from now on.
pub fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// Returns true if notes and progress bars are left out.
pub fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Writes a note to standard error, unless notes are left out. Ignores failure.
pub fn say(note: &str) {
    if !is_quiet() {
        complain(note);
    }
}

/// Writes a warning to standard error, and ignores failure.
pub fn warn(message: &str) {
    complain(&format!("warning: {message}"));
}

/// Writes an error, or what leads to one, to standard error, and ignores failure.
pub fn complain(message: &str) {
    let _ = writeln!(io::stderr(), "multiscopic: {}", visible(message));
}

/// A text in which control characters are escaped as in JSON. Names and lines of files, cameras and arms may have some that are
/// commands to a terminal.
pub fn visible(text: &str) -> Cow<'_, str> {
    let is_hidden = |letter: char| letter.is_control() && !matches!(letter, '\n' | '\t');
    if !text.contains(is_hidden) {
        return text.into();
    }
    let mut escaped = String::new();
    for letter in text.chars() {
        match is_hidden(letter) {
            true => _ = write!(escaped, "\\u{:04x}", u32::from(letter)),
            false => escaped.push(letter),
        }
    }
    escaped.into()
}

/// Words for the share of confidences from [`SURE`] on, which end a summary of disparities.
pub fn sure(share: f64) -> String {
    format!(", {:.1} % sure (from {SURE} on)", 100.0 * share)
}

/// The characters in a line of the terminal, or `None` if standard output goes elsewhere.
pub fn columns() -> Option<usize> {
    let (Width(columns), _) = io::stdout().is_terminal().then(terminal_size).flatten()?;
    Some(columns.into())
}

/// Breaks lines of more than `limit` characters between words. What follows is indented as the last column of the line, before
/// which there are two spaces.
pub fn wrapped(text: &str, limit: usize) -> String {
    text.lines().map(|line| wrapped_line(line, limit) + "\n").collect()
}

fn wrapped_line(line: &str, limit: usize) -> String {
    let indent = line.rfind("  ").map_or(0, |at| at + 2);
    let (start, words) = line.split_at(indent);
    let mut text = start.to_owned();
    let mut used = start.chars().count();
    for (i, word) in words.split(' ').enumerate() {
        let length = word.chars().count();
        if i > 0 && used + 1 + length > limit {
            text += &format!("\n{:indent$}", "");
            used = indent;
        } else if i > 0 {
            text.push(' ');
            used += 1;
        }
        text += word;
        used += length;
    }
    text
}

/// Opens a page, a file or an address, with the program that the user has for it, if messages go to a terminal. If there is no
/// such program, a message has told where the page is.
pub fn open(page: &OsStr) {
    if !stderr().is_terminal() {
        return;
    }
    let (program, arguments): (_, &[&str]) = match env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/c", "start", ""]),
        _ if env::var_os("DISPLAY").is_none() && env::var_os("WAYLAND_DISPLAY").is_none() => return,
        _ => ("xdg-open", &[]),
    };
    let null = || Stdio::null();
    let _ = Command::new(program).args(arguments).arg(page).stdin(null()).stdout(null()).stderr(null()).spawn();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_to_terminals_are_escaped() {
        assert!(matches!(visible("1\u{301} \u{1f4f7}\n\tr\u{e9}sum\u{e9}"), Cow::Borrowed(_)));
        assert_eq!(
            visible("\u{1b}]0;a\u{7}b\r\u{8}\u{7f}\u{9b}2J\0\n"),
            "\\u001b]0;a\\u0007b\\u000d\\u0008\\u007f\\u009b2J\\u0000\n"
        );
    }

    #[test]
    fn json_stays_the_same_value() {
        let value = "a\u{7f}\u{9b}\u{1b}\n\"\\u001b";
        let json = serde_json::to_string(value).unwrap();
        assert_ne!(visible(&json), json);
        assert_eq!(serde_json::from_str::<String>(&visible(&json)).unwrap(), value);
    }

    #[test]
    fn long_lines_are_broken_below_their_last_column() {
        let text = "    12  sums   of the left and right views\n256 bytes\n";
        assert_eq!(wrapped(text, 80), text);
        let expected = "    12  sums   of the left\n               and right\n               views\n256 bytes\n";
        assert_eq!(wrapped(text, 26), expected);
        // A word that is wider than the terminal is not broken.
        assert_eq!(wrapped("one indivisible", 5), "one\nindivisible\n");
    }
}
