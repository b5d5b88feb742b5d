//! Reading disparity maps, and writing them and depths as 16-bit PNG.

use std::{fmt, ops::RangeInclusive, path::Path};

use image::{DynamicImage, ImageBuffer, Luma};
use multiscopic_core::Disparity;

use super::{
    Limits,
    decoded::{Decoded, Numbers},
    image_codec::{self, CodedFile},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, FloatImage, Geometry},
};

/// Writes a 16-bit PNG file: 64 times the disparity plus 32768, or 0 where invalid. This is lossless.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_raw16(map: &DisparityMap, path: &Path) -> Result<()> {
    let samples = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
    image_codec::write_png(path, &gray16(map.width(), map.height(), samples))
}

/// Writes the depths of a map as a 16-bit PNG file in millimetres, rounded; 0 where unknown or beyond 65.535 m, as depth
/// cameras do.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_depth_mm(map: &DisparityMap, geometry: &Geometry, path: &Path) -> Result<()> {
    let millimetres = |&metres: &f32| (1e3 * f64::from(metres)).round();
    let sample = |metres| Some(millimetres(metres)).filter(|mm| (1.0..=65535.0).contains(mm)).map_or(0, |mm| mm as u16);
    let samples = geometry.depths(map).pixels().iter().map(sample).collect();
    image_codec::write_png(path, &gray16(map.width(), map.height(), samples))
}

/// The numbers that a file has for disparities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DisparityEncoding {
    /// Disparities in pixels.
    Pixels,
    /// 64 times the disparity plus 32768, and 0 where invalid, as [`write_raw16`] writes.
    Raw16,
    /// 256 times the disparity, and 0 where invalid.
    Kitti,
    /// 16 times the disparity, and 0 or less where invalid.
    OpenCv,
}

impl DisparityEncoding {
    /// The disparity of a number, +inf where invalid.
    fn disparity(self, number: f32) -> f32 {
        let scaled = |number: f32, scale: f32| if number > 0.0 { number / scale } else { f32::INFINITY };
        match self {
            DisparityEncoding::Pixels => number,
            DisparityEncoding::Raw16 => Disparity::from_raw16(number as u16).map_or(f32::INFINITY, f32::from),
            DisparityEncoding::Kitti => scaled(number, 256.0),
            // Signed numbers may be stored as if they had no sign.
            DisparityEncoding::OpenCv => scaled(if number >= 32768.0 { number - 65536.0 } else { number }, 16.0),
        }
    }
}

impl fmt::Display for DisparityEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DisparityEncoding::Pixels => "pixels",
            DisparityEncoding::Raw16 => "64 d + 32768 of multiscopic",
            DisparityEncoding::Kitti => "256 d of KITTI",
            DisparityEncoding::OpenCv => "16 d of OpenCV",
        })
    }
}

/// The images that disparities should belong to.
#[derive(Clone, Debug)]
pub struct MatchedImages<'a> {
    /// The file of the centre.
    pub center: &'a Path,
    /// Width and height.
    pub size: [usize; 2],
    /// The disparities of their corners, if enough are found.
    pub seen: Option<CornerDisparities<'a>>,
}

/// Disparities at corners of a centre image, as [`Inspection`](crate::Inspection) finds them.
#[derive(Clone, Debug)]
pub struct CornerDisparities<'a> {
    /// Column and row of each corner, and its disparity in pixels.
    pub places: &'a [([usize; 2], f64)],
    /// By how much the disparities may be off, in pixels.
    pub error: f64,
    /// The range that they show, in pixels.
    pub range: RangeInclusive<i16>,
}

/// The least number of corners from which a correlation is concluded.
const MIN_CORNERS: usize = 20;
/// The share of disparities in the range that the images show, below which a map belongs to others, or is of other numbers.
const MIN_SHOWN: f64 = 0.25;
/// The correlation with the disparities of corners below which numbers are depths.
const MAX_DEPTH: f64 = -0.5;
/// The share of the corners' disparities by which a map in the encoding of another program may be off.
const MAX_OFF: f64 = 0.1;
/// The least median of disparities in [`DisparityEncoding::Raw16`], unless the images show others: cameras look ahead.
const MIN_MEDIAN: f32 = -64.0;

/// Disparities from a file.
#[derive(Clone, Debug)]
pub struct StoredDisparities {
    /// Disparities in pixels, not finite where unknown.
    pub map: FloatImage,
    /// The numbers that the file has for them.
    pub encoding: DisparityEncoding,
    /// The reason why they may belong to other images, or be no disparities. It completes the sentence "the file has ...".
    pub doubt: Option<String>,
}

/// Reads disparities: a PFM, NPY, NPZ or TIFF file of real numbers, or whole ones of 16 bits in a PNG, PGM, TIFF or NPY file. Of
/// these, the numbers tell the encoding: the one that agrees with what is seen in `images`, or the only one with plausible
/// disparities.
///
/// # Errors
/// [`Error::Read`], [`Error::PictureSize`], and [`Error::Format`] if the file has other contents or is damaged, the size is not
/// that of the images, no pixel has a disparity, they are depths, or the encoding is not clear.
pub fn read_disparities(path: &Path, images: Option<&MatchedImages<'_>>, limits: Limits) -> Result<StoredDisparities> {
    use DisparityEncoding::{Kitti, OpenCv, Pixels, Raw16};
    let (numbers, own, others): (FloatImage, Option<_>, &[_]) =
        match CodedFile::new(path, &limits.read(path)?, limits)?.decode()? {
            Decoded::Numbers(Numbers { map, is_whole: false }) => (map, Some(Pixels), &[]),
            Decoded::Numbers(Numbers { map, is_whole: true }) => (map, None, &[Pixels, OpenCv, Kitti]),
            Decoded::Samples(DynamicImage::ImageLuma16(image)) => {
                let numbers = image.as_raw().iter().map(|&sample| sample.into()).collect();
                (FloatImage::new(image.width() as usize, image.height() as usize, numbers), Some(Raw16), &[Kitti, OpenCv])
            }
            Decoded::Samples(other) => {
                let found = format!("an image of {:?}", other.color());
                let expected = "disparities: in pixels as PFM, NPY or TIFF of real numbers, or in a 16-bit grey image (L16)";
                return Err(Error::format(path, found, expected));
            }
        };
    if let Some(images) = images {
        images.check_size(path, &numbers)?;
    }
    let seen = images.and_then(|images| images.seen.as_ref());
    let decoded = |encoding: DisparityEncoding| numbers.map(|&number| encoding.disparity(number));
    let own = own.map(|encoding| (encoding, decoded(encoding)));
    let own_median = own.as_ref().and_then(|(_, map)| median(map));
    let stored = |(encoding, map)| StoredDisparities { doubt: seen.and_then(|seen| doubt(&map, seen)), map, encoding };
    if own.is_some() && own_median.is_none() {
        // A map may be empty, but cannot be compared.
        let none = || Error::format(path, "no pixel with a disparity", "the disparities of the centre image");
        return own.filter(|_| images.is_none()).map(stored).ok_or_else(none);
    }
    // All encodings rise with disparity.
    let rising = own.as_ref().map_or(&numbers, |(_, map)| map);
    if seen.is_some_and(|seen| falls(rising, seen)) {
        let found = "numbers that fall where the disparities of the images rise, as depths and negated disparities do";
        return Err(Error::format(path, found, "disparities: those that a match writes by -o"));
    }
    let width = numbers.width() as f32;
    let is_plausible = own_median.is_some_and(|median| (MIN_MEDIAN..=width).contains(&median));
    let doubtful = match own.filter(|(encoding, _)| *encoding == Pixels || is_plausible).map(stored) {
        Some(own) if own.doubt.is_none() => return Ok(own),
        own => own,
    };
    let is_agreed = |map: &FloatImage| match seen {
        Some(seen) => agrees(map, seen),
        None => median(map).is_some_and(|median| median <= width / 4.0),
    };
    let agreed = others.iter().map(|&encoding| (encoding, decoded(encoding))).filter(|(_, map)| is_agreed(map));
    if let Ok([other]) = <[_; 1]>::try_from(agreed.collect::<Vec<_>>()) {
        return Ok(stored(other));
    }
    doubtful.ok_or_else(|| {
        // Real numbers have been taken by now.
        let own = own_median.map(|median| (median, Raw16));
        let others = others.iter().filter_map(|&encoding| Some((median(&decoded(encoding))?, encoding)));
        let found = own.into_iter().chain(others).map(|(median, encoding)| format!("{median:.1} ({encoding})"));
        let found = format!("disparities near {}", found.collect::<Vec<_>>().join(" or "));
        let expected = match seen {
            Some(seen) => format!("some from {} to {}, as the images show", seen.range.start(), seen.range.end()),
            None => "one of them alone to be plausible".into(),
        };
        Error::format(path, found, format!("{expected}: store disparities in pixels, as PFM or NPY"))
    })
}

/// Returns true if the numbers of a map clearly fall where the disparities that are seen rise.
fn falls(map: &FloatImage, seen: &CornerDisparities<'_>) -> bool {
    correlation(map, seen).is_some_and(|correlation| correlation < MAX_DEPTH)
}

/// The reason why a map does not seem to have the disparities that are seen.
fn doubt(map: &FloatImage, seen: &CornerDisparities<'_>) -> Option<String> {
    let middle = median(map)?;
    let (start, end) = (seen.range.start(), seen.range.end());
    (share_shown(map, seen) < MIN_SHOWN).then(|| format!("disparities near {middle:.1}, but the images show {start} to {end}"))
}

impl MatchedImages<'_> {
    /// Refuses a map of another size.
    pub(crate) fn check_size(&self, path: &Path, map: &FloatImage) -> Result<()> {
        let ([w, h], [width, height]) = ([map.width(), map.height()], self.size);
        if [w, h] == self.size {
            return Ok(());
        }
        let expected = format!("{width}x{height} as in {}", self.center.display());
        Err(Error::format(path, format!("disparities of {w}x{h} pixels"), expected))
    }
}

/// The known disparities of a map at corners, and those that are seen there.
fn pairs<'a>(map: &'a FloatImage, seen: &'a CornerDisparities<'_>) -> impl Iterator<Item = [f64; 2]> + 'a {
    let is_inside = |[u, v]: [usize; 2]| u < map.width() && v < map.height();
    let pair = move |&([u, v], expected): &([usize; 2], f64)| is_inside([u, v]).then(|| [map.get(u, v).into(), expected]);
    seen.places.iter().filter_map(pair).filter(|[found, _]| found.is_finite())
}

/// Returns true if most disparities of a map are those of corners.
fn agrees(map: &FloatImage, seen: &CornerDisparities<'_>) -> bool {
    let is_near = |[found, expected]: &[f64; 2]| (found - expected).abs() <= seen.error.max(MAX_OFF * expected.abs());
    let (count, near) = (pairs(map, seen).count(), pairs(map, seen).filter(is_near).count());
    2 * near > count
}

/// The correlation of a map with the disparities of corners. `None` if it is known at few of them.
fn correlation(map: &FloatImage, seen: &CornerDisparities<'_>) -> Option<f64> {
    let count = pairs(map, seen).count();
    if count < MIN_CORNERS {
        return None;
    }
    let mean = [0, 1].map(|i| pairs(map, seen).map(|pair| pair[i]).sum::<f64>() / count as f64);
    let moment = |i: usize, j: usize| pairs(map, seen).map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>();
    Some(moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt())
}

/// The median of the known disparities.
fn median(map: &FloatImage) -> Option<f32> {
    let mut known: Vec<f32> = map.pixels().iter().copied().filter(|d| d.is_finite()).collect();
    let middle = known.len() / 2;
    (!known.is_empty()).then(|| *known.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// The share of the known disparities in the range that images show, or beyond it by half of it: they show it at corners alone.
fn share_shown(map: &FloatImage, seen: &CornerDisparities<'_>) -> f64 {
    let [start, end] = [*seen.range.start(), *seen.range.end()].map(f32::from);
    let margin = (0.5 * (end - start)).max(2.0);
    let known = map.pixels().iter().filter(|d| d.is_finite());
    let within = known.clone().filter(|&&d| (start - margin..=end + margin).contains(&d)).count();
    within as f64 / known.count() as f64
}

fn gray16(width: usize, height: usize, samples: Vec<u16>) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    ImageBuffer::from_raw(width as u32, height as u32, samples).expect("a sample for every pixel")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Picture;

    fn disparity(pixels: f32) -> Option<Disparity> {
        Disparity::from_bits((pixels * 64.0) as i16)
    }

    fn map() -> DisparityMap {
        DisparityMap::new(
            3,
            2,
            vec![disparity(-2.5), None, disparity(60.0), disparity(0.0), disparity(511.984_4), disparity(-511.984_4)],
        )
    }

    #[test]
    fn raw16_is_lossless() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("raw.png");
        write_raw16(&map(), &path).unwrap();
        let read = read_disparities(&path, None, Limits::DEFAULT).unwrap();
        assert_eq!((DisparityMap::from_float(&read.map), read.encoding), (map(), DisparityEncoding::Raw16));
        let image = image::open(&path).unwrap().into_luma16();
        assert_eq!(image.into_raw(), [32768 - 160, 0, 32768 + 3840, 32768, 65535, 1]);
    }

    #[test]
    fn the_images_tell_the_encoding_of_whole_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("d.png");
        let disparity = |u: u32, v: u32| 4.0 + 0.125 * f64::from(u) + 0.25 * f64::from(v);
        let write = |number: &dyn Fn(f64) -> f64| {
            let image = ImageBuffer::from_fn(40, 30, |u, v| Luma([number(disparity(u, v)) as u16]));
            image_codec::write_png(&path, &image).unwrap();
        };
        let places: Vec<_> = (0..30).map(|i| ([i as usize, i as usize], disparity(i, i))).collect();
        let seen = CornerDisparities { places: &places, error: 1.5, range: 2..=17 };
        let images = MatchedImages { center: Path::new("c.png"), size: [40, 30], seen: Some(seen) };
        let read = || read_disparities(&path, Some(&images), Limits::DEFAULT);
        for (scale, offset, expected) in [
            (64.0, 32768.0, DisparityEncoding::Raw16),
            (256.0, 0.0, DisparityEncoding::Kitti),
            (16.0, 0.0, DisparityEncoding::OpenCv),
        ] {
            write(&|d| scale * d + offset);
            let StoredDisparities { map, encoding, doubt } = read().unwrap();
            assert_eq!((encoding, map.get(8, 4), doubt), (expected, 6.0, None));
        }
        let message = |number: &dyn Fn(f64) -> f64| {
            write(number);
            read().unwrap_err().to_string()
        };
        assert!(message(&|d| 1000.0 * d).contains("expected some from 2 to 17, as the images show"));
        // Depth in millimetres.
        assert!(message(&|d| 8000.0 / d).contains("numbers that fall where the disparities of the images rise"));
        assert!(message(&|_| 0.0).contains("no pixel with a disparity"));
    }

    #[test]
    fn disparities_of_other_images_are_doubted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("d.pfm");
        let places: Vec<_> = (0..30).map(|i| ([i, i], 4.0 + 0.5 * i as f64)).collect();
        let seen = CornerDisparities { places: &places, error: 1.5, range: 2..=20 };
        let images = MatchedImages { center: Path::new("c.png"), size: [40, 30], seen: Some(seen) };
        let doubt = |disparity: fn(f32) -> f32| {
            let map = (0..30 * 40).map(|i| disparity(4.0 + 0.5 * (i % 40) as f32)).collect();
            crate::files::write_pfm(&FloatImage::new(40, 30, map), &path).unwrap();
            read_disparities(&path, Some(&images), Limits::DEFAULT)
                .map_or_else(|error| error.to_string(), |stored| stored.doubt.unwrap_or_default())
        };
        assert_eq!(doubt(|d| d), "");
        assert_eq!(doubt(|d| d + 100.0), "disparities near 114.0, but the images show 2 to 20");
        assert!(doubt(|d| 1000.0 / d).contains("as depths and negated disparities do"));
    }

    #[test]
    fn a_colour_image_is_not_raw16() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("color.png");
        Picture::Rgb(crate::images::turbo(&map(), None)).write_png(&path).unwrap();
        let message = read_disparities(&path, None, Limits::DEFAULT).unwrap_err().to_string();
        assert!(message.contains("found an image of Rgb8, expected disparities"), "{message}");
    }

    #[test]
    fn invalid_pixels_are_infinite_in_a_pfm() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("d.pfm");
        crate::files::write_pfm(&map().to_float(), &path).unwrap();
        let read = crate::files::read_pfm(&path).unwrap();
        assert_eq!(read.pixels()[..4], [-2.5, f32::INFINITY, 60.0, 0.0]);
    }
}
