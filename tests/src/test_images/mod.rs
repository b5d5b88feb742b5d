//! Images for the tests: golden, random, drawn, misaligned, and real where they are available. Here are the images of one
//! capture, and disparities drawn in ASCII: `0` to `9`, `a` to `i` for -1 to -9, and `.` for an invalid pixel.

pub mod case;
pub mod core_match;
pub mod faults;
pub mod golden;
pub mod misaligned;
pub mod real_data;

use std::{fmt, fs, path::Path};

use image::GrayImage;
use multiscopic::Frames;
use multiscopic_core::View;
use multiscopic_reference::{
    Fusion, Match,
    semi_global::{Cost, PATHS, SemiGlobal},
    split_mix::Random,
};

/// A centre image and the views that exist.
#[derive(Clone, PartialEq, Eq)]
pub struct ViewSet {
    /// Pixels in a line.
    pub width: usize,
    /// Lines.
    pub height: usize,
    /// The reference image, line by line.
    pub center: Vec<u8>,
    /// Its neighbours: left, right, top, bottom.
    pub views: [Option<Vec<u8>>; 4],
    /// Views elsewhere, by their offsets: baselines to the right and down.
    pub others: Vec<((i32, i32), Vec<u8>)>,
}

impl ViewSet {
    /// These images as a match for the float reference.
    pub fn reference(&self, fusion: Fusion, min_disparity: i32, num_disparities: i32, block_size: i32) -> Match<'_> {
        Match {
            width: self.width,
            height: self.height,
            center: &self.center,
            views: self.views.each_ref().map(Option::as_deref),
            others: &self.others,
            fusion,
            min_disparity,
            num_disparities,
            block_size,
        }
    }

    /// These images as a match for the reference of semi-global matching: along the core's paths, with
    /// penalties P1 and P2, of which P2 is lowered at edges as it is by default.
    pub fn semi_global(
        &self,
        fusion: Fusion,
        min_disparity: i32,
        num_disparities: i32,
        cost: Cost,
        [p1, p2]: [i64; 2],
    ) -> SemiGlobal<'_> {
        SemiGlobal {
            width: self.width as i32,
            height: self.height as i32,
            center: &self.center,
            views: self.views.each_ref().map(Option::as_deref),
            others: &self.others,
            fusion,
            inliers: false,
            min_disparity,
            num_disparities,
            cost,
            paths: PATHS[..5].to_vec(),
            p1,
            p2,
            p2_edge: Some(10),
            left_right: None,
            equiangular: true,
        }
    }

    /// These images as the host's frames.
    pub fn frames(&self) -> Frames {
        let gray = |pixels: &[u8]| {
            GrayImage::from_raw(self.width as u32, self.height as u32, pixels.into()).expect("the size of the images")
        };
        let views = [View::LEFT, View::RIGHT, View::TOP, View::BOTTOM].into_iter().zip(&self.views);
        let nearest = views.filter_map(|(view, pixels)| Some((view, pixels.as_ref()?)));
        let others = self.others.iter().map(|(offset, pixels)| (view_at(*offset), pixels));
        nearest.chain(others).fold(Frames::new(gray(&self.center)), |frames, (view, pixels)| frames.with(view, gray(pixels)))
    }

    /// The image of a view.
    pub fn view(&self, view: View) -> Option<&[u8]> {
        match View::CROSS.into_iter().position(|other| other == view) {
            Some(place) => self.views[place].as_deref(),
            None => self.others.iter().find(|(offset, _)| view_at(*offset) == view).map(|(_, pixels)| &pixels[..]),
        }
    }

    /// The rectangle of `width` x `height` pixels at `(left, top)`.
    pub fn crop(&self, left: usize, top: usize, width: usize, height: usize) -> ViewSet {
        let cut = |image: &Vec<u8>| {
            let lines = image.chunks_exact(self.width).skip(top).take(height);
            lines.flat_map(|line| &line[left..left + width]).copied().collect()
        };
        let others = self.others.iter().map(|(offset, pixels)| (*offset, cut(pixels))).collect();
        let views = self.views.each_ref().map(|view| view.as_ref().map(cut));
        ViewSet { width, height, center: cut(&self.center), views, others }
    }

    /// These images with only the views that `keep` (left, right, top, bottom) selects.
    pub fn only(&self, keep: [bool; 4]) -> ViewSet {
        let mut images = self.clone();
        for (view, keep) in images.views.iter_mut().zip(keep) {
            if !keep {
                *view = None;
            }
        }
        images
    }

    /// Reads the centre image and the views from files of one size.
    pub fn read(center: &Path, views: [Option<&Path>; 4]) -> ViewSet {
        let (width, height, center) = read_grey(center);
        let views = views.map(|path| {
            path.map(|path| {
                let (w, h, pixels) = read_grey(path);
                assert_eq!((w, h), (width, height), "{}: the size of the centre image", path.display());
                pixels
            })
        });
        ViewSet { width, height, center, views, others: Vec::new() }
    }

    /// Writes `center.pgm`, `left.pgm` and so on, those elsewhere as `1,-1.pgm`, and a `rig.toml`, to a folder.
    pub fn write_rig(&self, folder: &Path) {
        let file = |name: &str, pixels: &[u8]| {
            let header = format!("P5 {} {} 255\n", self.width, self.height);
            fs::write(folder.join(format!("{name}.pgm")), [header.as_bytes(), pixels].concat()).expect("the folder is there");
        };
        file("center", &self.center);
        let mut toml =
            "baseline_mm = 20.0\nfocal_px = 500.0\nprincipal_point = [1.0, 2.0]\n[images]\ncenter = \"center.pgm\"\n".to_owned();
        for (name, view) in ["left", "right", "top", "bottom"].into_iter().zip(&self.views) {
            if let Some(pixels) = view {
                file(name, pixels);
                toml += &format!("{name} = \"{name}.pgm\"\n");
            }
        }
        toml += "[images.views]\n";
        for ((right, down), pixels) in &self.others {
            let name = format!("{right},{down}");
            file(&name, pixels);
            toml += &format!("\"{name}\" = \"{name}.pgm\"\n");
        }
        fs::write(folder.join("rig.toml"), toml).expect("the folder is there");
    }
}

impl fmt::Debug for ViewSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let others: Vec<(i32, i32)> = self.others.iter().map(|(offset, _)| *offset).collect();
        write!(f, "{}x{} with {:?} and {others:?}", self.width, self.height, self.views.each_ref().map(Option::is_some))
    }
}

/// The core's view at an offset.
pub fn view_at((right, down): (i32, i32)) -> View {
    View::new(right as i8, down as i8).expect("the offset of a view")
}

/// Reads a PNG, PGM or PPM as 8-bit grey: width, height and pixels.
pub fn read_grey(path: &Path) -> (usize, usize, Vec<u8>) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = match image {
        image::DynamicImage::ImageLuma8(grey) => grey.into_raw(),
        other => {
            let grey = |p: &image::Rgb<u8>| (77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2]) + 128) >> 8;
            other.to_rgb8().pixels().map(|p| grey(p) as u8).collect()
        }
    };
    (width, height, pixels)
}

/// Reads a 16-bit grey PNG: width, height and pixels.
pub fn read_raw16(path: &Path) -> (usize, usize, Vec<u16>) {
    match image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())) {
        image::DynamicImage::ImageLuma16(image) => (image.width() as usize, image.height() as usize, image.into_raw()),
        other => panic!("{}: {:?} instead of 16-bit grey", path.display(), other.color()),
    }
}

/// Reads a little-endian PFM of one channel: width, height and pixels, top row first.
pub fn read_pfm(path: &Path) -> (usize, usize, Vec<f32>) {
    let bytes = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut fields = Vec::new();
    let mut rest = &bytes[..];
    while fields.len() < 4 {
        let end = rest.iter().position(u8::is_ascii_whitespace).expect("a PFM's header has four fields");
        fields.push(std::str::from_utf8(&rest[..end]).expect("a PFM's header is ASCII"));
        rest = &rest[end + 1..];
    }
    assert_eq!(fields[0], "Pf", "{}: one channel", path.display());
    let [width, height] = [fields[1], fields[2]].map(|field| field.parse::<usize>().expect("a PFM's size"));
    assert!(fields[3].parse::<f64>().expect("a PFM's scale") < 0.0, "{}: little-endian", path.display());
    assert_eq!(rest.len(), 4 * width * height, "{}: bytes of {width}x{height} pixels", path.display());
    let values = rest.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect::<Vec<_>>();
    (width, height, values.chunks_exact(width).rev().flatten().copied().collect())
}

/// The lines of a drawing, without indentation and empty lines.
fn lines(drawing: &str) -> Vec<&str> {
    drawing.lines().map(str::trim).filter(|line| !line.is_empty()).collect()
}

/// Draws disparities, rounded to whole pixels.
pub fn draw(width: usize, disparities: &[Option<f64>]) -> String {
    let letter = |disparity: &Option<f64>| match disparity.map(|d| d.round() as i32) {
        None => '.',
        Some(d @ 0..=9) => char::from(b'0' + d as u8),
        Some(d @ -9..=-1) => char::from(b'`' + d.unsigned_abs() as u8),
        Some(_) => '*',
    };
    disparities.chunks(width).map(|line| line.iter().map(letter).collect::<String>()).collect::<Vec<_>>().join("\n")
}

/// Renders a drawn scene without invalid pixels: a random texture in the centre, and what each of the four
/// views sees of it.
///
/// Near pixels occlude far ones. What the centre does not see is noise.
pub fn synthesise(drawing: &str, seed: u64) -> ViewSet {
    let lines = lines(drawing);
    let (width, height) = (lines[0].len(), lines.len());
    let mut random = Random(seed);
    let mut noise = || (0..width * height).map(|_| random.byte()).collect::<Vec<_>>();
    let center = noise();
    let views = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(du, dv)| {
        let mut view = noise();
        let mut pixels: Vec<(i32, usize, usize)> = Vec::new();
        for (v, line) in lines.iter().enumerate() {
            assert_eq!(line.len(), width, "line {v} of the drawing is as long as the others");
            pixels.extend(line.bytes().enumerate().map(|(u, letter)| (disparity(letter), u, v)));
        }
        pixels.sort();
        for (d, u, v) in pixels {
            let (x, y) = (u as i32 + du * d, v as i32 + dv * d);
            if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                view[y as usize * width + x as usize] = center[v * width + u];
            }
        }
        Some(view)
    });
    ViewSet { width, height, center, views, others: Vec::new() }
}

fn disparity(letter: u8) -> i32 {
    match letter {
        b'0'..=b'9' => i32::from(letter - b'0'),
        b'a'..=b'i' => -i32::from(letter - b'`'),
        _ => panic!("`{}` does not draw a disparity", char::from(letter)),
    }
}

/// Panics with both drawings and their difference side by side if they differ.
#[track_caller]
pub fn assert_drawn(what: &str, expected: &str, found: &str) {
    if let Some(table) = difference(expected, found) {
        panic!("{what}: the drawings differ\n{table}");
    }
}

/// Both drawings and an `x` where they differ, side by side; `None` if they are equal.
pub fn difference(expected: &str, found: &str) -> Option<String> {
    let (expected, found) = (lines(expected), lines(found));
    if expected == found {
        return None;
    }
    let width = expected.iter().chain(&found).map(|line| line.len()).chain(["expected".len()]).max().unwrap_or(0);
    let mut table = format!("{:width$}   {:width$}   difference\n", "expected", "found");
    for row in 0..expected.len().max(found.len()) {
        let [e, f] = [&expected, &found].map(|drawing| drawing.get(row).copied().unwrap_or(""));
        let letters = (0..e.len().max(f.len())).map(|i| if e.as_bytes().get(i) == f.as_bytes().get(i) { ' ' } else { 'x' });
        let line = format!("{e:width$}   {f:width$}   {}", letters.collect::<String>());
        table += line.trim_end();
        table += "\n";
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disparities_are_drawn_as_letters() {
        let row = [None, Some(-9.2), Some(-1.0), Some(-0.4), Some(0.4), Some(9.4), Some(9.6)];
        assert_eq!(draw(7, &row), ".ia009*");
        assert_eq!(draw(1, &row[..3]), ".\ni\na");
    }

    #[test]
    fn near_pixels_occlude_far_ones() {
        let images = synthesise("0010", 1);
        let c = &images.center;
        let right = images.views[1].as_ref().expect("the right view");
        assert_eq!((right[0], right[1], right[3]), (c[0], c[2], c[3]));
        let left = images.views[0].as_ref().expect("the left view");
        assert_eq!((left[0], left[1], left[3]), (c[0], c[1], c[2]));
        assert_eq!(images.views[2].as_ref().expect("the top view")[..2], c[..2]);
    }

    #[test]
    fn a_difference_is_shown() {
        assert_eq!(difference("  12\n  34", "12\n34\n"), None);
        let table = difference("12\n34", "12\n35\n6").expect("they differ");
        let rows: Vec<&str> = table.lines().collect();
        assert_eq!(
            rows,
            ["expected   found      difference", "12         12", "34         35          x", "           6          x"]
        );
    }
}
