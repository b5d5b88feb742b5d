//! A captioned picture in a report.

use std::io::Cursor;

use base64::{display::Base64Display, engine::general_purpose::STANDARD};
use image::{DynamicImage, ImageFormat};
use maud::{Markup, Render, html};

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
    pub(super) fn url(&self) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use base64::Engine;
    use image::RgbImage;

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
}
