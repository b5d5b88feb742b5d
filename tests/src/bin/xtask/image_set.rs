//! The frames that the firmware is given.

use anyhow::{Context, Result, ensure};
use image::{GrayImage, Luma, imageops};
use multiscopic::{Frames, Picture};
use multiscopic_core::{Frame, Params, View};
use multiscopic_edge::files;
use std::{fs, path::Path};

/// Frames for some parameters, under a name.
pub struct ImageSet {
    /// How reports name it.
    pub name: &'static str,
    /// The centre and its neighbours.
    pub frames: Frames,
}

impl ImageSet {
    /// Random dots on four planes that face the camera, with some noise: the same at every run.
    pub fn random_dots(params: &Params) -> ImageSet {
        let (width, height) = (params.width() as u32, params.height() as u32);
        let take = |frame| GrayImage::from_fn(width, height, |u, v| Luma([dot(frame, u as i32, v as i32)]));
        ImageSet { name: "random-dots", frames: gather(params, |frame| Ok(take(frame))).expect("nothing is read") }
    }

    /// The middle of the Tsukuba head and lamp, five cameras of the grid, from `folder`.
    pub fn tsukuba(params: &Params, folder: &Path) -> Result<ImageSet> {
        let read = |frame| read_middle(&folder.join(tsukuba_file(frame)), params);
        Ok(ImageSet { name: "tsukuba", frames: gather(params, read)? })
    }

    /// Writes the frames as the firmware reads them.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for frame in [Frame::Center].into_iter().chain(self.frames.views().iter().map(Frame::View)) {
            let path = folder.join(files::frame(frame).to_str()?);
            let image = self.frames.get(frame).context("the frame is one of them")?;
            fs::write(&path, image.as_raw()).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }
}

/// The frames that `params` need, each of which `take` makes.
fn gather(params: &Params, mut take: impl FnMut(Frame) -> Result<GrayImage>) -> Result<Frames> {
    let center = Frames::new(take(Frame::Center)?);
    params.views().iter().try_fold(center, |frames, view| Ok(frames.with(view, take(Frame::View(view))?)))
}

/// Disparity, and left, top, right and bottom in the centre frame, of each plane, the nearest first.
const PLANES: [(i32, [i32; 4]); 4] =
    [(14, [60, 50, 80, 70]), (9, [20, 20, 60, 100]), (5, [80, 10, 140, 90]), (2, [i32::MIN, i32::MIN, i32::MAX, i32::MAX])];

/// A pixel of `frame`: the dot of the nearest plane there, and noise.
fn dot(frame: Frame, u: i32, v: i32) -> u8 {
    let seen = |(disparity, [left, top, right, bottom]): (i32, [i32; 4])| {
        let (x, y) = in_center(frame, disparity, u, v);
        ((left..right).contains(&x) && (top..bottom).contains(&y)).then(|| hash([x, y, disparity]) % 240)
    };
    let dot = PLANES.into_iter().find_map(seen).expect("the last plane is everywhere");
    let noise = hash([u, v, -1 - frame_number(frame)]) % 16;
    (dot + noise) as u8
}

/// Where in the centre frame the pixel `(u, v)` of `frame` is, at `disparity`.
fn in_center(frame: Frame, disparity: i32, u: i32, v: i32) -> (i32, i32) {
    match frame {
        Frame::Center => (u, v),
        Frame::View(view) if view.is_horizontal() => (u - view.sign() * disparity, v),
        Frame::View(view) => (u, v - view.sign() * disparity),
    }
}

fn frame_number(frame: Frame) -> i32 {
    match frame {
        Frame::Center => 0,
        Frame::View(view) => 1 + view as i32,
    }
}

/// Well mixed bits of `values`.
fn hash(values: [i32; 3]) -> u32 {
    values.into_iter().fold(0x9e37_79b9, |hash, value| {
        let hash = (hash ^ value as u32).wrapping_mul(0x85eb_ca6b);
        (hash ^ hash >> 15).wrapping_mul(0xc2b2_ae35) ^ hash >> 13
    })
}

const fn tsukuba_file(frame: Frame) -> &'static str {
    match frame {
        Frame::Center => "scene1.row3.col3.ppm",
        Frame::View(View::Left) => "scene1.row3.col2.ppm",
        Frame::View(View::Right) => "scene1.row3.col4.ppm",
        Frame::View(View::Top) => "scene1.row2.col3.ppm",
        Frame::View(View::Bottom) => "scene1.row4.col3.ppm",
    }
}

/// The middle of the image at `path`.
fn read_middle(path: &Path, params: &Params) -> Result<GrayImage> {
    let image = Picture::read(path)?.to_gray();
    let (width, height) = (params.width() as u32, params.height() as u32);
    let found = image.dimensions();
    ensure!(width <= found.0 && height <= found.1, "{}: found {found:?}, expected {width}x{height} or more", path.display());
    Ok(imageops::crop_imm(&image, (found.0 - width) / 2, (found.1 - height) / 2, width, height).to_image())
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Matcher;
    use multiscopic_edge::profile::SMALL;

    /// A pixel well inside each plane, where no nearer one hides it.
    const INSIDE: [(usize, usize, f32); 4] = [(70, 60, 14.0), (40, 80, 9.0), (120, 50, 5.0), (150, 110, 2.0)];

    #[test]
    fn the_matcher_finds_the_planes() {
        let (params, set) = (SMALL.params, ImageSet::random_dots(&SMALL.params));
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = Matcher::new(&params, &mut memory).unwrap();
        let mut line = vec![None; params.width()];
        while let Some(v) = matcher.next_line(&mut &set.frames, &mut line).unwrap() {
            for (u, _, plane) in INSIDE.into_iter().filter(|inside| inside.1 == v) {
                let found = f32::from(line[u].expect("a view has the match"));
                assert!((found - plane).abs() <= 0.25, "pixel ({u}, {v}): found {found}, expected {plane}");
            }
        }
    }
}
