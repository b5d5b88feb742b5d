//! The width of the terminal, and text that fits it.

use std::io::{self, IsTerminal};

use terminal_size::{Width, terminal_size};

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

#[cfg(test)]
mod tests {
    use super::*;

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
