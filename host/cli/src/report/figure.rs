//! Captioned pictures in a report, and columns of small pictures as SVG.

use std::io::Cursor;

use base64::{display::Base64Display, engine::general_purpose::STANDARD};
use image::{DynamicImage, ImageFormat, RgbImage};
use maud::{Markup, PreEscaped, Render, html};
use multiscopic::images::montage;

use super::chart;

/// A picture and its caption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    caption: String,
    source: Source,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    /// The name of a file, relative to the report.
    File(String),
    /// The contents of a PNG file.
    Png(Vec<u8>),
}

impl Figure {
    /// A picture in a file. `file` is relative to the report, with `/` between folders.
    pub fn linked(caption: impl Into<String>, file: impl Into<String>) -> Figure {
        Figure { caption: caption.into(), source: Source::File(file.into()) }
    }

    /// A picture stored in the report itself. `bytes` are the contents of a PNG file.
    pub fn png(caption: impl Into<String>, bytes: Vec<u8>) -> Figure {
        Figure { caption: caption.into(), source: Source::Png(bytes) }
    }

    /// A picture stored in the report itself.
    ///
    /// # Panics
    /// If the image is empty, or its pixels are floating-point numbers, which PNG cannot hold.
    pub fn embedded(caption: impl Into<String>, image: impl Into<DynamicImage>) -> Figure {
        let mut bytes = Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, ImageFormat::Png).expect("memory takes any image that PNG can hold");
        Figure::png(caption, bytes.into_inner())
    }

    /// The picture's URL, which holds the picture if it is embedded.
    fn url(&self) -> String {
        self.source.url()
    }
}

impl Source {
    /// The value of the `src` attribute.
    fn url(&self) -> String {
        match self {
            Source::Png(bytes) => format!("data:image/png;base64,{}", Base64Display::new(bytes, &STANDARD)),
            Source::File(name) => percent_encoded(name),
        }
    }
}

/// The relative URL of a file. Everything but unreserved characters and `/` is encoded, so a name cannot
/// start a scheme or a query.
pub(super) fn percent_encoded(name: &str) -> String {
    let mut url = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => url.push(byte.into()),
            _ => url += &format!("%{byte:02X}"),
        }
    }
    url
}

impl Render for Figure {
    fn render(&self) -> Markup {
        html! {
            figure {
                img src=(self.url()) alt=(self.caption);
                figcaption { (self.caption) }
            }
        }
    }
}

/// The height of the text above and below a column, in pixels.
const TEXT: u32 = 26;

/// A column of pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureColumn {
    /// The text above the pictures.
    pub heading: String,
    /// The pictures, from top to bottom, all of the same size.
    pub pictures: Vec<RgbImage>,
    /// The text below the pictures.
    pub note: String,
}

/// Puts columns side by side, scaling down pictures wider than `max_width` pixels. Text is dark on light pages and light on dark
/// ones.
///
/// # Panics
/// If there is no column, or a picture is empty.
pub fn contact_sheet(columns: &[PictureColumn], max_width: u32) -> String {
    let scaled: Vec<Vec<RgbImage>> = columns
        .iter()
        .map(|column| column.pictures.iter().map(|picture| montage::scaled_down(picture, max_width)).collect())
        .collect();
    let first = scaled.first().and_then(|pictures| pictures.first()).expect("a contact sheet needs a picture");
    let (width, height) = first.dimensions();
    let (across, down) = (width + montage::GAP, height + montage::GAP);
    let rows = scaled.iter().map(Vec::len).max().unwrap_or_default() as u32;
    let (all_width, all_height) = (columns.len() as u32 * across - montage::GAP, 2 * TEXT + rows * down);
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" class="chart" width=(all_width) height=(all_height)
            viewBox=(format!("0 0 {all_width} {all_height}")) {
            style { (PreEscaped(chart::STYLE)) }
            @for (index, (column, pictures)) in (0..).zip(columns.iter().zip(&scaled)) {
                text x=(index * across) y=(TEXT - 9) font-weight="600" { (column.heading) }
                @for (row, picture) in (0..).zip(pictures) {
                    image x=(index * across) y=(TEXT + row * down) width=(picture.width()) height=(picture.height())
                        href=(Figure::embedded("", picture.clone()).url()) {}
                }
                text x=(index * across) y=(TEXT + rows * down + 12) { (column.note) }
            }
        }
    };
    svg.into_string() + "\n"
}

#[cfg(test)]
mod tests {
    use base64::Engine;

    use super::*;

    #[test]
    fn file_names_become_relative_urls() {
        let html = Figure::linked("x", "out 1/50% \"ä\"?#.png").render().into_string();
        assert!(html.contains(r#"src="out%201/50%25%20%22%C3%A4%22%3F%23.png""#), "{html}");
        let html = Figure::linked("x", "javascript:x").render().into_string();
        assert!(html.contains(r#"src="javascript%3Ax""#), "a file name must not start a scheme: {html}");
    }

    #[test]
    fn an_embedded_image_keeps_its_pixels() {
        let image = RgbImage::from_fn(5, 3, |x, y| image::Rgb([x as u8 * 50, y as u8 * 90, 7]));
        let html = Figure::embedded("x", image.clone()).render().into_string();
        let data = html.split_once("base64,").unwrap().1.split_once('"').unwrap().0;
        let bytes = STANDARD.decode(data).unwrap();
        assert_eq!(image::load_from_memory(&bytes).unwrap().into_rgb8(), image);
    }

    #[test]
    fn a_column_becomes_svg() {
        let column = PictureColumn { heading: "stereo".into(), pictures: vec![RgbImage::new(8, 6)], note: "AvgErr 0.761".into() };
        assert!(contact_sheet(&[column], 200).starts_with("<svg"));
    }

    #[test]
    fn every_picture_has_its_place() {
        let column = |heading: &str| PictureColumn {
            heading: heading.into(),
            pictures: vec![RgbImage::new(40, 30), RgbImage::new(40, 30)],
            note: "a < b".into(),
        };
        let svg = contact_sheet(&[column("stereo"), column("2 views")], 20);
        assert_eq!(svg.matches("<image").count(), 4);
        assert!(svg.contains(r#"viewBox="0 0 48 98""#), "{svg:.300}");
        assert!(svg.contains(r#"x="28" y="49" width="20" height="15""#) && svg.contains("a &lt; b"), "{svg}");
    }
}
