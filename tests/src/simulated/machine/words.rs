//! The words of a line of G-code.

/// Splits a line of G-code into letters and their numbers; `None` if it is not G-code.
pub(super) fn words(line: &str) -> Option<Vec<(char, f64)>> {
    let ends = line.char_indices().skip(1).filter(|(_, c)| c.is_ascii_uppercase()).map(|(i, _)| i).chain([line.len()]);
    let mut begin = 0;
    let words = ends.map(|end| {
        let word = &line[std::mem::replace(&mut begin, end)..end];
        let letter = word.chars().next().filter(char::is_ascii_uppercase)?;
        let number: f64 = word[1..].trim().parse().ok()?;
        Some((letter, number))
    });
    words.collect()
}

pub(super) fn value(words: &[(char, f64)], letter: char) -> Option<f64> {
    words.iter().find(|(found, _)| *found == letter).map(|(_, number)| *number)
}
