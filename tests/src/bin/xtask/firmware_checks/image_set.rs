//! The frames that the firmware reads.

use anyhow::{Context, Result, bail};
use multiscopic::{
    DisparityMap, Engine, Frames, Method,
    scene::{PinholeCamera, Scene, render_views},
    stereo::{CostFunction, Pipeline, SemiGlobal, confidence_map::ConfidenceMap},
};
use multiscopic_core::{
    BlockMatchingParams, Disparity, Frame, Matcher, Region, SemiGlobalCost, SemiGlobalMatcher, View, Views,
    network::NetworkParams,
};
use multiscopic_edge::{Matching, WholeLines, frame_file::FrameFile};
use multiscopic_tests::test_images::{
    core_match::StrictSource,
    real_data::{self, Dataset},
    view_set::{ViewSet, read_grey, view_at},
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
    pub fn demo(matching: &Matching) -> ImageSet {
        let (width, height, wanted) = (matching.search().width(), matching.search().height(), matching.views());
        ImageSet::demo_middle([width, height], [width, height], wanted)
    }

    /// The central `[width, height]` pixels of the demo's scene rendered at `[w, h]` pixels, with these views.
    pub fn demo_middle([w, h]: [usize; 2], [width, height]: [usize; 2], views: Views) -> ImageSet {
        let shot = render_views(&Scene::demo(), &PinholeCamera::new(w as u32, h as u32), views, 1);
        let frames = shot.frames(views).middle([width, height], views);
        let gray = |frame| frames.get(frame).map(|image| image.as_raw().clone());
        let cross = View::CROSS.map(|view| gray(Frame::View(view)));
        let others = views.iter().filter(|view| !View::CROSS.contains(view));
        let others = others.filter_map(|view| Some((offset(view), gray(Frame::View(view))?))).collect();
        let center = gray(Frame::Center).unwrap_or_default();
        ImageSet { name: "demo", images: ViewSet { width, height, center, views: cross, others } }
    }

    /// The centre of the Tsukuba scene, if it is available, large enough, and has all views.
    pub fn tsukuba(matching: &Matching) -> Option<ImageSet> {
        let (width, height, wanted) = (matching.search().width(), matching.search().height(), matching.views());
        let root = real_data::root().filter(|root| root.join(Dataset::Tsukuba.name()).is_dir())?;
        let mut all = Dataset::Tsukuba.read(&root, "").images.only(View::CROSS.map(|view| wanted.contains(view)));
        for (right, down) in wanted.iter().filter(|view| !View::CROSS.contains(view)).map(offset) {
            let name = format!("scene1.row{}.col{}.ppm", 3 + down, 3 + right);
            let path = Some(root.join(Dataset::Tsukuba.name()).join(name)).filter(|path| path.is_file())?;
            all.others.push(((right, down), read_grey(&path).2));
        }
        let (left, top) = (all.width.checked_sub(width)? / 2, all.height.checked_sub(height)? / 2);
        Some(ImageSet { name: Dataset::Tsukuba.name(), images: all.crop(left, top, width, height) })
    }

    /// Writes the frames as files that the firmware reads.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let views = View::CROSS.map(Frame::View).into_iter().zip(&self.images.views);
        let views = views.filter_map(|(frame, pixels)| Some((frame, pixels.as_ref()?)));
        let others = self.images.others.iter().map(|(offset, pixels)| (Frame::View(view_at(*offset)), pixels));
        for (frame, pixels) in [(Frame::Center, &self.images.center)].into_iter().chain(views).chain(others) {
            let path = folder.join(FrameFile::new(frame).name().to_str()?);
            fs::write(&path, pixels).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// The frames in the host's type.
    pub fn frames(&self) -> Frames {
        self.images.frames()
    }

    /// The disparities that the core computes on this machine, line by line. From short baselines to long ones, it
    /// stores those of the whole short match before the long match begins.
    pub fn disparities(&self, matching: &Matching) -> Result<Vec<Option<Disparity>>> {
        match matching {
            Matching::Blocks { params, .. } => self.matched_blocks(params),
            Matching::WithConfidences(lines) => self.disparities(&lines.alone()),
            Matching::Network(params) => Ok(self.by_network(params)?.0.pixels().to_vec()),
            Matching::AroundPrior { short, long } => {
                let prior = DisparityMap::new(short.width(), short.height(), self.matched_blocks(short)?);
                let long = long.around(short.search());
                let refined = Engine::new(None, 1)?.disparities_around(&self.frames().planes(), &prior, &long, &|| ())?;
                Ok(refined.pixels().to_vec())
            }
            Matching::SemiGlobal(params) => {
                let (mut line, mut disparities) = (vec![None; params.search().width()], Vec::new());
                let mut source = StrictSource::semi_global(&self.images, params);
                let mut memory = vec![0; params.memory_words()];
                let mut matcher = SemiGlobalMatcher::new(params, &mut memory)?;
                while matcher.next_line(&mut source, &mut line)?.is_some() {
                    source.line_done();
                    disparities.extend_from_slice(&line);
                }
                Ok(disparities)
            }
        }
    }

    /// The confidences that the host's methods compute, if `matching` has any.
    pub fn confidences(&self, matching: &Matching) -> Result<Option<ConfidenceMap>> {
        let lines = match matching {
            Matching::WithConfidences(lines) => lines,
            Matching::Network(params) => return Ok(Some(self.by_network(params)?.1)),
            _ => return Ok(None),
        };
        let method = match lines {
            WholeLines::Blocks(params) => Method::block_matching(params.block_size() as u8),
            WholeLines::SemiGlobal(params) => {
                let SemiGlobalCost::Sad { block_size } = params.cost() else { bail!("profiles match sums of differences") };
                let paths = SemiGlobal::default_for(params.cost(), params.search().views().len());
                Method::new(Pipeline::SemiGlobal { cost: CostFunction::Sad { block_size }, paths })
            }
        };
        Ok(Some(method.disparities_and_confidences(&Engine::new(None, 2)?, &self.frames(), lines.search(), &())?.1))
    }

    /// Computes disparities and confidences with the host's network.
    fn by_network(&self, params: &NetworkParams) -> Result<(DisparityMap, ConfidenceMap)> {
        let method = Method { long_baselines: None, ..Method::net() };
        Ok(method.disparities_and_confidences(&Engine::new(None, 2)?, &self.frames(), params.search(), &())?)
    }

    fn matched_blocks(&self, params: &BlockMatchingParams) -> Result<Vec<Option<Disparity>>> {
        let (mut line, mut disparities) = (vec![None; params.width()], Vec::new());
        let mut source = StrictSource::new(&self.images, params, &Region::whole(params.search()));
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = Matcher::new(params, &mut memory)?;
        while matcher.next_line(&mut source, &mut line)?.is_some() {
            source.line_done();
            disparities.extend_from_slice(&line);
        }
        Ok(disparities)
    }
}

/// The baselines of a view to the right and down.
fn offset(view: View) -> (i32, i32) {
    (view.right().into(), view.down().into())
}
