//! Point clouds in PLY files.

use std::path::Path;

use super::{
    cloud::{Cloud, CloudPoint},
    output,
};
use crate::{error::Result, images::PointFrame};

/// The form in which a PLY file stores its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Little-endian binary: small, and fast to read.
    #[default]
    Binary,
    /// Decimal text.
    Ascii,
}

/// Writes every point of a cloud with its colour, and if it has them with its confidence from 0 to 255 and with `sigma`, the
/// standard deviation of its depth in metres.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) if the centre and the disparities differ in size, and
/// [`Error::Write`](crate::Error::Write). Any previous version of the file is unchanged.
///
/// # Panics
/// If the confidences or deviations and the disparities differ in size.
pub fn write(path: &Path, cloud: &Cloud, encoding: Encoding) -> Result<()> {
    cloud.check()?;
    output::write(path, |writer| {
        let format = match encoding {
            Encoding::Binary => "binary_little_endian",
            Encoding::Ascii => "ascii",
        };
        let axes = match cloud.frame {
            PointFrame::Camera => "metres: x right, y down, z away from the camera",
            PointFrame::Tool => "metres, in the frame of the tool",
            PointFrame::Base => "metres, in the frame of the arm's base",
        };
        writeln!(writer, "ply\nformat {format} 1.0\ncomment {axes}\ncomment frame {}", cloud.frame.id())?;
        writeln!(writer, "element vertex {}", cloud.points().count())?;
        ["x", "y", "z"].iter().try_for_each(|axis| writeln!(writer, "property float {axis}"))?;
        ["red", "green", "blue"].iter().try_for_each(|color| writeln!(writer, "property uchar {color}"))?;
        cloud.confidences.iter().try_for_each(|_| writeln!(writer, "property uchar confidence"))?;
        cloud.deviations.iter().try_for_each(|_| writeln!(writer, "property float sigma"))?;
        writeln!(writer, "end_header")?;
        for CloudPoint { metres, color, confidence, sigma } in cloud.points() {
            match encoding {
                Encoding::Binary => {
                    writer.write_all(metres.map(f32::to_le_bytes).as_flattened())?;
                    writer.write_all(&color)?;
                    writer.write_all(confidence.as_slice())?;
                    writer.write_all(sigma.map(f32::to_le_bytes).as_ref().map_or(&[], |bytes| &bytes[..]))?;
                }
                Encoding::Ascii => {
                    let ([x, y, z], [red, green, blue]) = (metres, color);
                    write!(writer, "{x} {y} {z} {red} {green} {blue}")?;
                    confidence.iter().try_for_each(|confidence| write!(writer, " {confidence}"))?;
                    sigma.iter().try_for_each(|sigma| write!(writer, " {sigma}"))?;
                    writeln!(writer)?;
                }
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::{DisparityMap, FloatImage, Geometry, Picture, Raster};
    use image::{GrayImage, Rgb, RgbImage};
    use multiscopic_core::Disparity;

    const GEOMETRY: Geometry = Geometry { focal_px: 100.0, baseline_mm: 20.0, principal_point: [0.0; 2], doffs: 0.0 };

    fn map() -> DisparityMap {
        DisparityMap::new(2, 2, vec![None, Disparity::from_bits(64), Disparity::from_bits(128), Disparity::from_bits(-64)])
    }

    fn cloud<'a>(disparities: &'a DisparityMap, center: &'a Picture) -> Cloud<'a> {
        Cloud::new(disparities, center, &GEOMETRY)
    }

    fn written(center: &Picture, encoding: Encoding) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        write(&path, &cloud(&map(), center), encoding).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn confidences_follow_the_colour() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let (center, confidences) = (Picture::Gray(GrayImage::new(2, 2)), Raster::new(2, 2, vec![9, 255, 7, 8]));
        let map = map();
        let cloud = Cloud { confidences: Some(&confidences), ..cloud(&map, &center) };
        write(&path, &cloud, Encoding::Ascii).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let expected = "property uchar confidence\nend_header\n0.02 0 2 0 0 0 255\n0 0.01 1 0 0 0 7\n";
        assert!(text.ends_with(expected), "{text}");
        write(&path, &cloud, Encoding::Binary).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!((bytes[bytes.len() - 17], bytes[bytes.len() - 1]), (255, 7));
    }

    #[test]
    fn deviations_are_the_last_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let (center, deviations) = (Picture::Gray(GrayImage::new(2, 2)), FloatImage::new(2, 2, vec![9.0, 0.5, 0.25, 8.0]));
        let map = map();
        let cloud = Cloud { deviations: Some(&deviations), ..cloud(&map, &center) };
        write(&path, &cloud, Encoding::Ascii).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.ends_with("property float sigma\nend_header\n0.02 0 2 0 0 0 0.5\n0 0.01 1 0 0 0 0.25\n"), "{text}");
        write(&path, &cloud, Encoding::Binary).unwrap();
        assert!(std::fs::read(&path).unwrap().ends_with(&0.25f32.to_le_bytes()));
    }

    #[test]
    fn ascii_lists_points_and_colours() {
        let center = Picture::Rgb(RgbImage::from_fn(2, 2, |u, v| Rgb([u as u8, v as u8, 200])));
        let header = "ply\nformat ascii 1.0\ncomment metres: x right, y down, z away from the camera\n\
                      comment frame camera_optical_frame\nelement vertex 2\nproperty float x\n\
                      property float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        let expected = format!("{header}0.02 0 2 1 0 200\n0 0.01 1 0 1 200\n");
        assert_eq!(String::from_utf8(written(&center, Encoding::Ascii)).unwrap(), expected);
    }

    #[test]
    fn binary_holds_points_and_colours() {
        let center = Picture::Gray(GrayImage::from_raw(2, 2, vec![1, 2, 3, 4]).unwrap());
        let bytes = written(&center, Encoding::default());
        assert!(bytes.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
        let points = &bytes[bytes.len() - 30..];
        let expected = [
            &[0.02f32, 0.0, 2.0].map(f32::to_le_bytes).concat()[..],
            &[2; 3],
            &[0.0f32, 0.01, 1.0].map(f32::to_le_bytes).concat(),
            &[3; 3],
        ];
        assert_eq!(points, expected.concat());
        assert!(bytes[..bytes.len() - 30].ends_with(b"end_header\n"));
    }

    #[test]
    fn a_picture_of_another_size_is_refused() {
        let center = Picture::Gray(GrayImage::new(3, 2));
        let message = write(Path::new("a.ply"), &cloud(&map(), &center), Encoding::Binary).unwrap_err().to_string();
        assert!(message.starts_with("the centre image has 3x2 pixels, the disparities 2x2"), "{message}");
    }
}
