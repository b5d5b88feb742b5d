//! The frames that the firmware reads.

use anyhow::{Context, Result};
use image::GrayImage;
use multiscopic::{
    Frames, Picture,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Disparity, Frame, Matcher, Region, Search, SemiGlobalMatcher, View, Views};
use multiscopic_edge::{Matching, frame_file::FrameFile};
use multiscopic_tests::test_images::{
    real_data::{self, Dataset},
    strict_source::StrictSource,
    view_set::ViewSet,
};
use std::{fs, path::Path};

/// A named set of frames.
pub struct ImageSet {
    /// Its name in reports.
    pub name: &'static str,
    images: ViewSet,
}

impl ImageSet {
    /// The synthetic scene of `multiscopic demo`, which is the same on every machine.
    pub fn demo(search: &Search) -> ImageSet {
        let (width, height) = (search.width(), search.height());
        let shot = render(&Scene::demo(), &PinholeCamera::new(width as u32, height as u32), 1);
        let gray = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray().into_raw();
        let views = View::CROSS.map(|view| search.views().contains(view).then(|| gray(Frame::View(view))));
        ImageSet { name: "demo", images: ViewSet { width, height, center: gray(Frame::Center), views, others: Vec::new() } }
    }

    /// The central `[width, height]` pixels of the demo's scene rendered at `[w, h]` pixels, with all views.
    pub fn demo_middle([w, h]: [usize; 2], [width, height]: [usize; 2]) -> ImageSet {
        let frames = render(&Scene::demo(), &PinholeCamera::new(w as u32, h as u32), 1)
            .frames(Views::CROSS)
            .middle([width, height], Views::CROSS);
        let gray = |frame| frames.get(frame).map(|image| image.as_raw().clone());
        let views = View::CROSS.map(|view| gray(Frame::View(view)));
        ImageSet {
            name: "demo",
            images: ViewSet { width, height, center: gray(Frame::Center).unwrap_or_default(), views, others: Vec::new() },
        }
    }

    /// The centre of the Tsukuba scene, if it is available and large enough.
    pub fn tsukuba(search: &Search) -> Option<ImageSet> {
        let root = real_data::root().filter(|root| root.join(Dataset::Tsukuba.name()).is_dir())?;
        let all = Dataset::Tsukuba.read(&root, "").images.only(View::CROSS.map(|view| search.views().contains(view)));
        let (left, top) = (all.width.checked_sub(search.width())? / 2, all.height.checked_sub(search.height())? / 2);
        Some(ImageSet { name: Dataset::Tsukuba.name(), images: all.crop(left, top, search.width(), search.height()) })
    }

    /// Writes the frames as files that the firmware reads.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let views = View::CROSS.map(Frame::View).into_iter().zip(&self.images.views);
        let views = views.filter_map(|(frame, pixels)| Some((frame, pixels.as_ref()?)));
        for (frame, pixels) in [(Frame::Center, &self.images.center)].into_iter().chain(views) {
            let path = folder.join(FrameFile::new(frame).name().to_str()?);
            fs::write(&path, pixels).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// The frames in the host's type.
    pub fn frames(&self) -> Result<Frames> {
        let ViewSet { width, height, center, views, .. } = &self.images;
        let image = |pixels: &Vec<u8>| {
            let image = GrayImage::from_raw(*width as u32, *height as u32, pixels.clone());
            image.context("there are as many pixels as width and height say")
        };
        let views = View::CROSS.into_iter().zip(views).filter_map(|(view, pixels)| Some((view, pixels.as_ref()?)));
        views.into_iter().try_fold(Frames::new(image(center)?), |frames, (view, pixels)| Ok(frames.with(view, image(pixels)?)))
    }

    /// The disparities that the core computes on this machine, line by line.
    pub fn disparities(&self, matching: &Matching) -> Result<Vec<Option<Disparity>>> {
        let (mut line, mut disparities) = (vec![None; matching.search().width()], Vec::new());
        match matching {
            Matching::Blocks { params, .. } => {
                let mut source = StrictSource::new(&self.images, params, &Region::whole(params.search()));
                let mut memory = vec![0; params.memory_words()];
                let mut matcher = Matcher::new(params, &mut memory)?;
                while matcher.next_line(&mut source, &mut line)?.is_some() {
                    source.line_done();
                    disparities.extend_from_slice(&line);
                }
            }
            Matching::SemiGlobal(params) => {
                let mut source = StrictSource::semi_global(&self.images, params);
                let mut memory = vec![0; params.memory_words()];
                let mut matcher = SemiGlobalMatcher::new(params, &mut memory)?;
                while matcher.next_line(&mut source, &mut line)?.is_some() {
                    source.line_done();
                    disparities.extend_from_slice(&line);
                }
            }
        }
        Ok(disparities)
    }
}
