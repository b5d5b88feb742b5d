//! Tables in plain text.

/// Rows under headings, with a line of dashes below the headings and wherever the first cell changes. The first `names` columns
/// are aligned left, the others, which are numbers, right.
pub fn text_table(headings: &[&str], rows: &[Vec<String>], names: usize) -> String {
    let headings: Vec<String> = headings.iter().map(|heading| (*heading).into()).collect();
    let width = |column: usize| {
        let widths = [&headings].into_iter().chain(rows).map(|cells| cells[column].chars().count());
        widths.max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..headings.len()).map(width).collect();
    let line = |cells: &[String]| {
        let padded = cells.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| match column < names {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    let dashes = "-".repeat(widths.iter().sum::<usize>() + 2 * (widths.len() - 1)) + "\n";
    let mut text = line(&headings);
    for (i, cells) in rows.iter().enumerate() {
        if i == 0 || cells[0] != rows[i - 1][0] {
            text += &dashes;
        }
        text += &line(cells);
    }
    text
}
