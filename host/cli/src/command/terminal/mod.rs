//! Standard output, standard error, the terminal's width, progress bars, pictures, examples in the help, and signals.

pub mod examples;
pub mod signals;

use std::{
    borrow::Cow,
    env,
    ffi::OsStr,
    fmt::{Display, Write as _},
    io::{self, ErrorKind, IsTerminal, Write, stderr},
    process::{Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
};

use image::{RgbImage, imageops};
use indicatif::{ProgressBar, ProgressStyle};
use multiscopic::{Error, Progress, Result, stereo::confidence_map::SURE};
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
fn is_quiet() -> bool {
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
fn wrapped(text: &str, limit: usize) -> String {
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

/// A progress bar.
///
/// It does not pass on that the user presses Ctrl-C: a method would end early with what it has so far, which is not what was
/// asked for.
#[derive(Debug)]
pub struct Watch {
    bar: ProgressBar,
}

impl Watch {
    /// A bar without a stage yet.
    pub fn new() -> Watch {
        Watch { bar: progress(0, "") }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Watch {
    fn begin(&self, steps: u64, name: &str) {
        self.bar.reset();
        self.bar.set_length(steps);
        self.bar.set_style(style(name));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    fn say(&self, message: &str) {
        self.bar.set_message(message.to_owned());
    }
}

/// A progress bar on standard error for `length` `steps` (a plural noun). It is hidden unless standard error is a terminal,
/// and if notes are left out.
pub fn progress(length: u64, steps: &str) -> ProgressBar {
    let bar = if is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(length) };
    bar.with_style(style(steps))
}

/// The style of a bar that counts `steps`.
fn style(steps: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {steps}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is valid")
}

/// The width of a terminal that does not tell.
const COLUMNS: usize = 80;

/// A picture in half blocks, as wide as the terminal or as the picture if that is narrower, for people who are logged in from far
/// away: each character is two pixels, one above the other. Lines end with the colours reset.
pub fn preview(picture: &RgbImage) -> String {
    let columns = columns().unwrap_or(COLUMNS) as u32;
    let is_full = env::var("COLORTERM").is_ok_and(|kind| kind == "truecolor" || kind == "24bit");
    half_blocks(picture, columns, if is_full { Palette::Full } else { Palette::Cube })
}

fn half_blocks(picture: &RgbImage, columns: u32, palette: Palette) -> String {
    let (width, height) = picture.dimensions();
    let columns = columns.clamp(1, width);
    let rows = (height * columns).div_ceil(width).next_multiple_of(2);
    let small = imageops::thumbnail(picture, columns, rows);
    let mut text = String::new();
    for row in (0..rows).step_by(2) {
        for column in 0..columns {
            let [upper, lower] = [row, row + 1].map(|v| palette.code(small.get_pixel(column, v).0));
            let _ = write!(text, "\x1b[38;{upper};48;{lower}m\u{2580}");
        }
        text += "\x1b[0m\n";
    }
    text
}

/// The colours of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Palette {
    /// Red, green and blue of 8 bits.
    Full,
    /// A cube of six levels each, which all terminals with colours have.
    Cube,
}

impl Palette {
    /// The colour as a terminal takes it after `38;` or `48;`.
    fn code(self, color: [u8; 3]) -> String {
        match self {
            Palette::Full => format!("2;{};{};{}", color[0], color[1], color[2]),
            Palette::Cube => {
                // The levels are 0, 95, 135, 175, 215 and 255.
                let [r, g, b] = color.map(|c| match c {
                    0..48 => 0,
                    48..75 => 1,
                    _ => (u16::from(c) - 35) / 40,
                });
                format!("5;{}", 16 + 36 * r + 6 * g + b)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

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

    #[test]
    fn a_character_is_two_pixels() {
        let picture = RgbImage::from_fn(2, 4, |u, v| Rgb([u as u8 * 255, v as u8, 9]));
        let expected = "\x1b[38;2;0;0;9;48;2;0;1;9m\u{2580}\x1b[38;2;255;0;9;48;2;255;1;9m\u{2580}\x1b[0m\n\
                        \x1b[38;2;0;2;9;48;2;0;3;9m\u{2580}\x1b[38;2;255;2;9;48;2;255;3;9m\u{2580}\x1b[0m\n";
        assert_eq!(half_blocks(&picture, 80, Palette::Full), expected);
    }

    #[test]
    fn wide_pictures_are_made_smaller() {
        let text = half_blocks(&RgbImage::from_pixel(640, 480, Rgb([200, 100, 0])), 80, Palette::Full);
        assert_eq!(text.lines().count(), 30);
        assert!(text.lines().all(|line| line.matches('\u{2580}').count() == 80));
        assert_eq!(half_blocks(&RgbImage::new(1, 1), 80, Palette::Full).lines().count(), 1);
    }

    #[test]
    fn few_colours_are_the_nearest_of_the_cube() {
        let levels = [0, 95, 135, 175, 215, 255];
        for c in 0..=255_u8 {
            let code: usize = Palette::Cube.code([0, 0, c])[2..].parse().unwrap();
            let distance = |level: i32| (level - i32::from(c)).abs();
            let best = levels.iter().map(|&level| distance(level)).min().unwrap();
            assert!(distance(levels[code - 16]) <= best + 1, "{c}: {code}");
        }
        assert_eq!(Palette::Cube.code([255, 95, 0]), "5;202");
    }
}
