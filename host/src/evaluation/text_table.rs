//! Tables in plain text.

/// Rows under headings, with a line of dashes below the headings and wherever the first cell changes. The first `names` columns
/// are aligned left, the others, which are numbers, right.
///
/// A table that is wider than `limit` is cut: of several names, the first one gets a line of its own, and the columns that do not
/// fit follow below, beside the other names again.
pub fn text_table(headings: &[&str], rows: &[Vec<String>], names: usize, limit: Option<usize>) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|cells| cells[column].as_str());
        cells.chain([headings[column]]).map(|cell| cell.chars().count()).max().unwrap_or_default()
    };
    let table = TextTable { headings, rows, names, widths: (0..headings.len()).map(width).collect() };
    let all: Vec<usize> = (0..headings.len()).collect();
    match limit {
        Some(limit) if table.width(&all) > limit => table.cut(limit),
        _ => table.part(&all),
    }
}

struct TextTable<'a> {
    headings: &'a [&'a str],
    rows: &'a [Vec<String>],
    names: usize,
    widths: Vec<usize>,
}

impl TextTable<'_> {
    /// The width of some columns beside each other.
    fn width(&self, columns: &[usize]) -> usize {
        columns.iter().map(|&column| self.widths[column] + 2).sum::<usize>().saturating_sub(2)
    }

    /// Parts of at most `limit` characters, if names and a number fit.
    fn cut(&self, limit: usize) -> String {
        let first = usize::from(self.names > 1);
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for column in self.names..self.headings.len() {
            match parts.last_mut() {
                Some(part) if self.width(part) + 2 + self.widths[column] <= limit => part.push(column),
                _ => parts.push((first..self.names).chain([column]).collect()),
            }
        }
        parts.iter().map(|part| self.part(part)).collect::<Vec<_>>().join("\n")
    }

    /// Some of the columns. Without the first one, its cells stand above the rows that share them.
    fn part(&self, columns: &[usize]) -> String {
        let has_first = columns.contains(&0);
        let dashes = "-".repeat(self.width(columns)) + "\n";
        let mut text = self.line(columns, |column| self.headings[column]);
        for (i, cells) in self.rows.iter().enumerate() {
            if i == 0 || cells[0] != self.rows[i - 1][0] {
                text += &dashes;
                if !has_first {
                    text += &format!("{}\n", cells[0]);
                }
            }
            text += &self.line(columns, |column| &cells[column]);
        }
        text
    }

    fn line<'a>(&self, columns: &[usize], cell: impl Fn(usize) -> &'a str) -> String {
        let padded = columns.iter().map(|&column| {
            let (cell, width) = (cell(column), self.widths[column]);
            if column < self.names { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_tables_are_cut() {
        let rows = [["Art", "bm", "1.00", "2.00"], ["Art", "sgm", "0.50", "1.00"], ["Dolls", "bm", "3.00", "4.00"]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        let table = |names, limit| text_table(&["scene", "method", "RMS", "Bad1"], &rows, names, limit);
        let whole = table(2, None);
        assert_eq!(whole.lines().next(), Some("scene  method   RMS  Bad1"));
        assert_eq!(table(2, Some(25)), whole);
        let expected = "\
method   RMS
------------
Art
bm      1.00
sgm     0.50
------------
Dolls
bm      3.00

method  Bad1
------------
Art
bm      2.00
sgm     1.00
------------
Dolls
bm      4.00
";
        assert_eq!(table(2, Some(13)), expected);
        assert_eq!(table(2, Some(18)).lines().next(), Some("method   RMS  Bad1"));
        // A column that does not fit is there all the same.
        assert_eq!(table(2, Some(3)), expected);
    }

    #[test]
    fn a_single_name_stays_in_its_column() {
        let rows = [["bm", "1.00", "2.00"]].map(|row| row.map(str::to_owned).to_vec());
        let expected = "method   RMS\n------------\nbm      1.00\n\nmethod  Bad1\n------------\nbm      2.00\n";
        assert_eq!(text_table(&["method", "RMS", "Bad1"], &rows, 1, Some(14)), expected);
    }
}
