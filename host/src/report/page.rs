//! A report as one HTML file that needs nothing else: no network, no style sheet, no script that must run.
//!
//! ```
//! use multiscopic::report::{Figure, Report};
//! let page = Report::new("Five views")
//!     .paragraph("Matched with a block of 11 x 11.")
//!     .table(["method", "Bad1"], [["stereo", "17.0"], ["multiscopic", "8.7"]])
//!     .gallery("Input", [Figure::linked("The centre", "center.png")])
//!     .to_html();
//! assert!(page.starts_with("<!DOCTYPE html>"));
//! ```

use base64::{display::Base64Display, engine::general_purpose::STANDARD};
use image::{DynamicImage, ImageFormat};
use std::{
    fmt::{self, Display, Formatter, Write},
    io::Cursor,
};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("compare.js");

/// A picture with what it shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    caption: String,
    source: Source,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    /// A file, by its name relative to the report.
    Link(String),
    /// A PNG file's bytes.
    Png(Vec<u8>),
}

impl Figure {
    /// A picture in a file beside the report, by its relative name with `/` between folders.
    pub fn linked(caption: impl Into<String>, file: impl Into<String>) -> Figure {
        Figure { caption: caption.into(), source: Source::Link(file.into()) }
    }

    /// A picture inside the report, from the bytes of a PNG file.
    pub fn png(caption: impl Into<String>, bytes: Vec<u8>) -> Figure {
        Figure { caption: caption.into(), source: Source::Png(bytes) }
    }

    /// A picture inside the report.
    ///
    /// # Panics
    /// If the image is empty or of a kind that PNG does not have (float).
    pub fn embedded(caption: impl Into<String>, image: impl Into<DynamicImage>) -> Figure {
        let mut bytes = Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, ImageFormat::Png).expect("memory takes any image that PNG can hold");
        Figure::png(caption, bytes.into_inner())
    }
}

impl Display for Source {
    /// The address for `src`, already escaped.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Source::Png(bytes) => write!(f, "data:image/png;base64,{}", Base64Display::new(bytes, &STANDARD)),
            Source::Link(file) => file.bytes().try_for_each(|byte| match byte {
                b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => f.write_char(byte.into()),
                _ => write!(f, "%{byte:02X}"),
            }),
        }
    }
}

impl Display for Figure {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let caption = Escaped(&self.caption);
        write!(f, r#"<figure><img src="{}" alt="{caption}"><figcaption>{caption}</figcaption></figure>"#, self.source)
    }
}

/// Text in HTML, in an element or a quoted attribute.
struct Escaped<'a>(&'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|c| match c {
            '&' => f.write_str("&amp;"),
            '<' => f.write_str("&lt;"),
            '>' => f.write_str("&gt;"),
            '"' => f.write_str("&quot;"),
            '\'' => f.write_str("&#39;"),
            // Not allowed in HTML, and without meaning in a report.
            c if c.is_control() && !c.is_ascii_whitespace() => f.write_char('\u{FFFD}'),
            c => f.write_char(c),
        })
    }
}

/// A report: parts are shown in the order in which they are added.
#[derive(Clone, Debug)]
pub struct Report {
    title: String,
    body: String,
    /// Groups of radio buttons need names of their own.
    flips: usize,
}

impl Report {
    /// A report with nothing but a title.
    pub fn new(title: impl Into<String>) -> Report {
        Report { title: title.into(), body: String::new(), flips: 0 }
    }

    /// Starts a section.
    pub fn heading(self, text: &str) -> Report {
        self.part(format_args!("<h2>{}</h2>", Escaped(text)))
    }

    /// Adds a paragraph of text.
    pub fn paragraph(self, text: &str) -> Report {
        self.part(format_args!("<p>{}</p>", Escaped(text)))
    }

    /// Adds lines of code, as what to type in a terminal.
    pub fn code(self, text: &str) -> Report {
        self.part(format_args!("<pre><code>{}</code></pre>", Escaped(text)))
    }

    /// Adds a table. Columns of numbers are set flush right, so that they can be compared.
    pub fn table<H, R, C>(self, headers: H, rows: R) -> Report
    where
        H: IntoIterator<Item: AsRef<str>>,
        R: IntoIterator<Item = C>,
        C: IntoIterator<Item: AsRef<str>>,
    {
        let text = |cell: &dyn AsRef<str>| cell.as_ref().to_owned();
        let rows: Vec<Vec<String>> = rows.into_iter().map(|row| row.into_iter().map(|cell| text(&cell)).collect()).collect();
        let class = |column: usize| {
            let mut cells = rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty()).peekable();
            if cells.peek().is_some() && cells.all(|cell| is_number(cell)) { " class=\"number\"" } else { "" }
        };
        let mut table = String::from("<div class=\"scroll\"><table>\n<thead><tr>");
        for (column, header) in headers.into_iter().enumerate() {
            put(&mut table, format_args!("<th scope=\"col\"{}>{}</th>", class(column), Escaped(header.as_ref())));
        }
        table.push_str("</tr></thead>\n<tbody>\n");
        for row in &rows {
            table.push_str("<tr>");
            for (column, cell) in row.iter().enumerate() {
                put(&mut table, format_args!("<td{}>{}</td>", class(column), Escaped(cell)));
            }
            table.push_str("</tr>\n");
        }
        table.push_str("</tbody>\n</table></div>");
        self.part(format_args!("{table}"))
    }

    /// Adds a section of pictures side by side.
    pub fn gallery(self, title: &str, figures: impl IntoIterator<Item = Figure>) -> Report {
        let mut gallery = String::from("<div class=\"gallery\">\n");
        for figure in figures {
            put(&mut gallery, format_args!("{figure}\n"));
        }
        self.heading(title).part(format_args!("{gallery}</div>"))
    }

    /// Adds a section of pictures of the same size in one place, each shown by its button: what differs is seen to move.
    pub fn flip(mut self, title: &str, figures: impl IntoIterator<Item = Figure>) -> Report {
        let group = self.flips;
        self.flips += 1;
        let mut flip = String::from("<div class=\"flip\">\n");
        for (number, figure) in figures.into_iter().enumerate() {
            let id = format!("flip-{group}-{number}");
            let checked = if number == 0 { " checked" } else { "" };
            let caption = Escaped(&figure.caption);
            put(
                &mut flip,
                format_args!(
                    "<input type=\"radio\" name=\"flip-{group}\" id=\"{id}\"{checked}><label for=\"{id}\">{caption}</label>{figure}\n"
                ),
            );
        }
        self.heading(title).part(format_args!("{flip}</div>"))
    }

    /// Adds a section of two pictures of the same size with a slider that uncovers one over the other. Without scripts they
    /// are side by side.
    pub fn compare(self, title: &str, before: Figure, after: Figure) -> Report {
        self.heading(title).part(format_args!("<div class=\"gallery compare\">\n{before}\n{after}\n</div>"))
    }

    /// The page.
    pub fn to_html(&self) -> String {
        let (title, body) = (Escaped(&self.title), &self.body);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n\
             <body>\n<main>\n<h1>{title}</h1>\n{body}</main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
        )
    }

    fn part(mut self, html: fmt::Arguments) -> Report {
        put(&mut self.body, format_args!("{html}\n"));
        self
    }
}

fn put(html: &mut String, text: fmt::Arguments) {
    html.write_fmt(text).expect("a string takes everything");
}

/// Whether a table's cell is a number, perhaps with a sign and a unit that is written without letters, and with another one in
/// brackets after it. A dash stands for a number that is not there.
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
    use base64::Engine;
    use image::RgbImage;

    /// Every opening tag has its closing one, in the right order.
    fn assert_balanced(html: &str) {
        const VOID: [&str; 4] = ["meta", "img", "input", "!DOCTYPE"];
        let (head, rest) = html.split_once("<style>").unwrap();
        let (body, _) = rest.split_once("</style>").unwrap().1.split_once("<script>").unwrap();
        let mut open = Vec::new();
        for tag in [head, body].into_iter().flat_map(|part| part.split('<').skip(1)) {
            let name = tag.split([' ', '>']).next().unwrap();
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name), "at {tag:.60}"),
                None if VOID.contains(&name) => {}
                None => open.push(name),
            }
        }
        assert_eq!(open, ["html", "body"], "both stay open where the script starts");
    }

    fn everything() -> Report {
        let figure = || Figure::embedded("2 x 1", RgbImage::new(2, 1));
        Report::new("All parts")
            .paragraph("Text")
            .table(["scene", "RMS"], [["Art", "1.25"], ["Dolls", "-"]])
            .gallery("Views", [figure(), Figure::linked("Left", "left.png")])
            .flip("Flip", [figure(), figure()])
            .flip("Flip again", [figure()])
            .compare("Compare", figure(), figure())
    }

    #[test]
    fn the_page_is_well_formed_and_needs_nothing_else() {
        let html = everything().to_html();
        assert_balanced(&html);
        assert!(!html.contains("http:") && !html.contains("https:") && !html.contains("<link"), "{html}");
        assert_eq!(html.matches("<h2>").count(), 4);
        assert_eq!(html.matches("<img ").count(), 7);
    }

    #[test]
    fn parts_keep_their_order() {
        let html = everything().to_html();
        let places = ["<h1>All parts", "<p>Text", "<table>", ">Views", ">Flip<", ">Flip again", ">Compare"];
        assert!(places.map(|place| html.find(place).unwrap_or_else(|| panic!("no {place}"))).is_sorted());
    }

    #[test]
    fn text_cannot_become_markup() {
        let nasty = "<b>\"a\" & 'b'</b>\u{0}\n";
        let safe = "&lt;b&gt;&quot;a&quot; &amp; &#39;b&#39;&lt;/b&gt;\u{FFFD}\n";
        let report = Report::new(nasty)
            .heading(nasty)
            .paragraph(nasty)
            .code(nasty)
            .table([nasty], [[nasty]])
            .gallery(nasty, [Figure::linked(nasty, "a.png")])
            .flip(nasty, [Figure::linked(nasty, "a.png")]);
        let html = report.to_html();
        assert_balanced(&html);
        assert!(!html.contains("<b>") && !html.contains('\u{0}'));
        assert_eq!(html.matches(safe).count(), 14);
    }

    #[test]
    fn file_names_become_addresses() {
        let html = Figure::linked("x", "out 1/50% \"ä\"?#.png").to_string();
        assert!(html.contains(r#"src="out%201/50%25%20%22%C3%A4%22%3F%23.png""#), "{html}");
        // A name cannot pick a scheme.
        assert!(Figure::linked("x", "javascript:x").to_string().contains(r#"src="javascript%3Ax""#));
    }

    #[test]
    fn an_embedded_image_is_the_same_when_read_back() {
        let image = RgbImage::from_fn(5, 3, |x, y| image::Rgb([x as u8 * 50, y as u8 * 90, 7]));
        let html = Figure::embedded("x", image.clone()).to_string();
        let data = html.split_once("base64,").unwrap().1.split_once('"').unwrap().0;
        let bytes = STANDARD.decode(data).unwrap();
        assert_eq!(image::load_from_memory(&bytes).unwrap().into_rgb8(), image);
    }

    #[test]
    fn numbers_are_flush_right_and_words_are_not() {
        for cell in ["1", "-0.25", "58.2 %", "1e-3", "\u{2212}4", "–", "2.4×", "3.636 (-45.5 %)"] {
            assert!(is_number(cell), "{cell}");
        }
        for cell in ["", "Art", "bm", "3 views", "1/2", "Art (2)", "2 (Art)"] {
            assert!(!is_number(cell), "{cell}");
        }
        let html = everything().to_html();
        assert!(html.contains("<tr><td>Art</td><td class=\"number\">1.25</td></tr>"), "{html}");
        assert!(html.contains("<th scope=\"col\">scene</th><th scope=\"col\" class=\"number\">RMS</th>"), "{html}");
        // One word makes a column one of words.
        let html = Report::new("").table(["x", "y"], [["1", "2"], ["", "none"]]).to_html();
        assert!(html.contains("<tr><td class=\"number\">1</td><td>2</td></tr>"), "{html}");
    }

    #[test]
    fn each_flip_has_one_picture_chosen() {
        let html = everything().to_html();
        assert_eq!(html.matches("name=\"flip-0\"").count(), 2);
        assert_eq!(html.matches("name=\"flip-1\"").count(), 1);
        assert_eq!(html.matches(" checked>").count(), 2);
    }
}
