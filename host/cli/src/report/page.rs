//! A report as a single HTML file. It needs no network and no other file, and all but its viewer can be read
//! with scripts disabled.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::{
    chart::Chart,
    error_map::EpipolarMap,
    figure::Figure,
    viewer::{self, LivePanel, ViewedScene},
};

const STYLE: &str = concat!(include_str!("page.css"), include_str!("chart.css"));
/// The sources that a page may load: nothing but what is in it.
const POLICY: &str = "default-src 'none'; img-src data: file: 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline' data:; \
                      base-uri 'none'; form-action 'none'";
/// The source to which the page of a server may connect besides: the server.
const CONNECTION: &str = "; connect-src 'self'";

/// A report. It shows its parts in the order in which they were added.
#[derive(Clone, Debug)]
pub struct Report {
    title: String,
    parts: Vec<Markup>,
    has_viewer: bool,
    /// The style of what a server answers, if one does.
    panel_style: Option<&'static str>,
}

impl Report {
    /// An empty report with a title.
    pub fn new(title: impl Into<String>) -> Report {
        Report { title: title.into(), parts: Vec::new(), has_viewer: false, panel_style: None }
    }

    /// Starts a section.
    pub fn heading(self, text: &str) -> Report {
        self.part(html! { h2 { (text) } })
    }

    /// Adds a paragraph.
    pub fn paragraph(self, text: &str) -> Report {
        self.part(html! { p { (text) } })
    }

    /// Adds preformatted text, such as commands for a terminal.
    pub fn code(self, text: &str) -> Report {
        self.part(html! { pre tabindex="0" { code { (text) } } })
    }

    /// Adds a table. Columns that hold only numbers are aligned right.
    pub fn table<H, R, C>(self, headers: H, rows: R) -> Report
    where
        H: IntoIterator<Item: AsRef<str>>,
        R: IntoIterator<Item = C>,
        C: IntoIterator<Item: AsRef<str>>,
    {
        let rows: Vec<Vec<String>> =
            rows.into_iter().map(|row| row.into_iter().map(|cell| cell.as_ref().to_owned()).collect()).collect();
        let class = |column: usize| {
            let mut cells = rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty()).peekable();
            (cells.peek().is_some() && cells.all(|cell| is_number(cell))).then_some("number")
        };
        self.part(html! {
            div class="scroll" tabindex="0" {
                table {
                    thead {
                        tr {
                            @for (column, header) in headers.into_iter().enumerate() {
                                th scope="col" class=[class(column)] { (header.as_ref()) }
                            }
                        }
                    }
                    tbody {
                        @for row in &rows {
                            tr {
                                @for (column, cell) in row.iter().enumerate() {
                                    td class=[class(column)] { (cell) }
                                }
                            }
                        }
                    }
                }
            }
        })
    }

    /// Adds a chart.
    pub fn chart(self, chart: &Chart) -> Report {
        self.part(html! { div class="scroll" tabindex="0" { (chart) } })
    }

    /// Adds a picture of the errors of a view.
    pub fn epipolar_errors(self, map: &EpipolarMap<'_>) -> Report {
        self.part(html! { div class="scroll" tabindex="0" { (map) } })
    }

    /// Adds a picture of the errors of a lens calibration.
    #[cfg(feature = "calibration")]
    pub fn reprojections(self, map: &super::error_map::ReprojectionMap<'_>) -> Report {
        self.part(html! { div class="scroll" tabindex="0" { (map) } })
    }

    /// Adds a section of pictures side by side.
    pub fn gallery(self, title: &str, figures: impl IntoIterator<Item = Figure>) -> Report {
        self.heading(title).part(html! {
            div class="gallery" {
                @for figure in figures { (figure) }
            }
        })
    }

    /// Adds a viewer of scenes: their pictures, disparities, depths, confidences, errors, costs and points. A page has at most
    /// one. `command` is the command line that made it. Without scripts, the viewer is left out.
    pub fn viewer(mut self, command: &str, scenes: &[ViewedScene]) -> Report {
        if scenes.is_empty() {
            return self;
        }
        self.has_viewer = true;
        self.part(viewer::markup(command, scenes))
    }

    /// Adds a viewer that shows what a server tells it, beside controls. A page has at most one viewer. `command` started the
    /// server.
    pub fn live_viewer(mut self, command: &str, panel: LivePanel<'_>) -> Report {
        self.has_viewer = true;
        self.panel_style = Some(panel.style);
        self.part(viewer::live_markup(command, &panel))
    }

    /// The whole page.
    pub fn to_html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    meta http-equiv="Content-Security-Policy" content={ (POLICY) @if self.panel_style.is_some() { (CONNECTION) } };
                    title { (self.title) }
                    style {
                        (PreEscaped(STYLE))
                        @if self.has_viewer { (PreEscaped(viewer::STYLE)) }
                        @if let Some(style) = self.panel_style { (PreEscaped(style)) }
                    }
                }
                body {
                    main {
                        h1 { (self.title) }
                        @for part in &self.parts { (part) "\n" }
                    }
                }
            }
        };
        without_control_characters(page.into_string())
    }

    fn part(mut self, markup: Markup) -> Report {
        self.parts.push(markup);
        self
    }
}

/// Replaces control characters, which HTML does not allow, not even as character references.
fn without_control_characters(html: String) -> String {
    let is_forbidden = |c: char| c.is_control() && !c.is_ascii_whitespace();
    if html.contains(is_forbidden) { html.replace(is_forbidden, "\u{FFFD}") } else { html }
}

/// Returns true if a table cell is a number. It may have a sign, a unit written without letters, and a second number
/// in parentheses. A dash stands for a missing number.
fn is_number(cell: &str) -> bool {
    let number = |text: &str| text.trim().trim_end_matches(['%', '×', ' ']).replace('\u{2212}', "-").parse::<f64>().is_ok();
    match cell.trim().strip_suffix(')').and_then(|cell| cell.split_once(" (")) {
        Some((first, second)) => number(first) && number(second),
        None => number(cell) || ["–", "-"].contains(&cell.trim()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::ChartLine;
    use image::RgbImage;

    /// Asserts that every opening tag has its closing tag, properly nested.
    fn assert_balanced(html: &str) {
        const VOID: [&str; 4] = ["meta", "img", "input", "!DOCTYPE"];
        let (head, rest) = html.split_once("<style>").unwrap();
        let body = rest.split_once("</style>").unwrap().1;
        let mut open = Vec::new();
        for tag in [head, body].into_iter().flat_map(|part| part.split('<').skip(1)) {
            let name = tag.split([' ', '>']).next().unwrap();
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name), "at {tag:.60}"),
                None if VOID.contains(&name) => {}
                None => open.push(name),
            }
        }
        assert!(open.is_empty(), "{open:?}");
    }

    fn report_with_every_part() -> Report {
        let figure = || Figure::embedded("2 x 1", RgbImage::new(2, 1));
        Report::new("All parts")
            .paragraph("Text")
            .table(["scene", "RMS"], [["Art", "1.25"], ["Dolls", "-"]])
            .chart(&Chart {
                title: "Chart".into(),
                x: "views".into(),
                y: "pixels".into(),
                lines: vec![ChartLine { name: "Art".into(), points: vec![(1.0, 0.5), (2.0, 0.25)] }],
            })
            .gallery("Views", [figure(), Figure::linked("Left", "left.png")])
    }

    #[test]
    fn a_page_is_built_of_paragraphs_tables_and_galleries() {
        let page = Report::new("Five views")
            .paragraph("Matched with a block of 11 x 11.")
            .table(["method", "Bad1"], [["stereo", "17.0"], ["multiscopic", "8.7"]])
            .gallery("Input", [Figure::linked("The centre", "center.png")])
            .to_html();
        assert!(page.starts_with("<!DOCTYPE html>"));
    }

    #[test]
    fn the_page_is_well_formed_and_self_contained() {
        let html = report_with_every_part().to_html();
        assert_balanced(&html);
        assert!(!html.contains("http:") && !html.contains("https:") && !html.contains("<link"), "{html}");
        assert_eq!(html.matches("<h2>").count(), 1);
        assert_eq!(html.matches("<img ").count(), 2);
    }

    #[test]
    fn parts_keep_their_order() {
        let html = report_with_every_part().to_html();
        let places = ["<h1>All parts", "<p>Text", "<table>", ">Chart", ">Views"];
        assert!(places.map(|place| html.find(place).unwrap_or_else(|| panic!("no {place}"))).is_sorted());
    }

    #[test]
    fn text_cannot_become_markup() {
        let nasty = "<b>\"a\" & 'b'</b>\u{0}\n";
        // A single quote needs no escape: all attributes are in double quotes.
        let safe = "&lt;b&gt;&quot;a&quot; &amp; 'b'&lt;/b&gt;\u{FFFD}\n";
        let report = Report::new(nasty)
            .heading(nasty)
            .paragraph(nasty)
            .code(nasty)
            .table([nasty], [[nasty]])
            .gallery(nasty, [Figure::linked(nasty, "a.png")]);
        let html = report.to_html();
        assert_balanced(&html);
        assert!(!html.contains("<b>") && !html.contains('\u{0}'));
        assert_eq!(html.matches(safe).count(), 10);
    }

    #[test]
    fn columns_of_numbers_are_aligned_right() {
        for cell in ["1", "-0.25", "58.2 %", "1e-3", "\u{2212}4", "–", "2.4×", "3.636 (-45.5 %)"] {
            assert!(is_number(cell), "{cell}");
        }
        for cell in ["", "Art", "bm", "3 views", "1/2", "Art (2)", "2 (Art)"] {
            assert!(!is_number(cell), "{cell}");
        }
        let html = report_with_every_part().to_html();
        assert!(html.contains("<tr><td>Art</td><td class=\"number\">1.25</td></tr>"), "{html}");
        assert!(html.contains("<th scope=\"col\">scene</th><th scope=\"col\" class=\"number\">RMS</th>"), "{html}");
        // A single word makes it a column of words.
        let html = Report::new("").table(["x", "y"], [["1", "2"], ["", "none"]]).to_html();
        assert!(html.contains("<tr><td class=\"number\">1</td><td>2</td></tr>"), "{html}");
    }
}
