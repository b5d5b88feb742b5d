//! Columns of small pictures, with text above and below each, as SVG.

use image::RgbImage;
use maud::{PreEscaped, html};
use multiscopic::images::montage;

use super::{chart, figure::Figure};

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
pub fn to_svg(columns: &[PictureColumn], max_width: u32) -> String {
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
    use super::*;

    #[test]
    fn a_column_becomes_svg() {
        let column = PictureColumn { heading: "stereo".into(), pictures: vec![RgbImage::new(8, 6)], note: "AvgErr 0.761".into() };
        assert!(to_svg(&[column], 200).starts_with("<svg"));
    }

    #[test]
    fn every_picture_has_its_place() {
        let column = |heading: &str| PictureColumn {
            heading: heading.into(),
            pictures: vec![RgbImage::new(40, 30), RgbImage::new(40, 30)],
            note: "a < b".into(),
        };
        let svg = to_svg(&[column("stereo"), column("2 views")], 20);
        assert_eq!(svg.matches("<image").count(), 4);
        assert!(svg.contains(r#"viewBox="0 0 48 98""#), "{svg:.300}");
        assert!(svg.contains(r#"x="28" y="49" width="20" height="15""#) && svg.contains("a &lt; b"), "{svg}");
    }
}
