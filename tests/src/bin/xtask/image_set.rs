//! The frames that the firmware is given.

use anyhow::{Context, Result};
use multiscopic_core::{Disparity, Frame, Matcher, Params, Region, View};
use multiscopic_edge::files;
use multiscopic_tests::{
    data::{self, Dataset},
    images::Images,
    source::StrictSource,
};
use std::{fs, path::Path};

/// Frames for some parameters, under a name.
pub struct ImageSet {
    /// How reports name it.
    pub name: &'static str,
    images: Images,
}

impl ImageSet {
    /// Random dots on four planes that face the camera, with some noise: the same at every run.
    pub fn random_dots(params: &Params) -> ImageSet {
        let (width, height) = (params.width(), params.height());
        let take = |frame| (0..width * height).map(|i| dot(frame, (i % width) as i32, (i / width) as i32)).collect();
        let views = View::ALL.map(|view| params.views().contains(view).then(|| take(Frame::View(view))));
        ImageSet { name: "random-dots", images: Images { width, height, center: take(Frame::Center), views } }
    }

    /// The middle of the Tsukuba head and lamp, if this machine has it.
    pub fn tsukuba(params: &Params) -> Option<ImageSet> {
        let root = data::root().filter(|root| root.join(Dataset::Tsukuba.name()).is_dir())?;
        let all = Dataset::Tsukuba.read(&root, "").images.only(View::ALL.map(|view| params.views().contains(view)));
        let (left, top) = ((all.width - params.width()) / 2, (all.height - params.height()) / 2);
        Some(ImageSet { name: Dataset::Tsukuba.name(), images: all.crop(left, top, params.width(), params.height()) })
    }

    /// Writes the frames as the firmware reads them.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let views = View::ALL.map(Frame::View).into_iter().zip(&self.images.views);
        let views = views.filter_map(|(frame, pixels)| Some((frame, pixels.as_ref()?)));
        for (frame, pixels) in [(Frame::Center, &self.images.center)].into_iter().chain(views) {
            let path = folder.join(files::frame(frame).to_str()?);
            fs::write(&path, pixels).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// The disparities that the core finds on this machine, line by line.
    pub fn disparities(&self, params: &Params) -> Result<Vec<Option<Disparity>>> {
        let mut source = StrictSource::new(&self.images, params, &Region::whole(params));
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = Matcher::new(params, &mut memory)?;
        let (mut line, mut disparities) = (vec![None; params.width()], Vec::new());
        while matcher.next_line(&mut source, &mut line)?.is_some() {
            source.line_done();
            disparities.extend_from_slice(&line);
        }
        Ok(disparities)
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_edge::profile::SMALL;

    /// A pixel well inside each plane, where no nearer one hides it.
    const INSIDE: [(usize, usize, f32); 4] = [(70, 60, 14.0), (40, 80, 9.0), (120, 50, 5.0), (150, 110, 2.0)];

    #[test]
    fn the_matcher_finds_the_planes() {
        let disparities = ImageSet::random_dots(&SMALL.params).disparities(&SMALL.params).unwrap();
        for (u, v, plane) in INSIDE {
            let found = f32::from(disparities[v * SMALL.params.width() + u].expect("a view has the match"));
            assert!((found - plane).abs() <= 0.25, "pixel ({u}, {v}): found {found}, expected {plane}");
        }
    }
}
