//! A rig in memory that is matched again and again.

use std::{
    path::{Path, PathBuf},
    sync::OnceLock,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use multiscopic::{
    Engine, FloatImage, Frames, Geometry, Inspection, MatchSetup, Method, Picture, Progress, RangeSource, Result,
    files::{Cloud, MatchedImages, ros::RosRecording},
    images::FrameTree,
    lens::Undistortion,
    stereo::{Estimate, MethodName, confidence_map},
};
use multiscopic_core::{Frame, SearchSpace};

use crate::{
    command::{
        advice,
        options::{BitsOption, GeometryOptions, MatchingOptions, SearchOptions, Source},
        preparation::mask_unseen,
        terminal,
        view::{matched_map, title, truth},
    },
    report::{EncodedMap, ViewedScene},
};

/// A captured folder, read once.
pub struct TunedRig {
    folder: PathBuf,
    frames: Frames,
    /// The frames as methods take them, which compare brightness or do not, and need colours or do not.
    suited: [OnceLock<Frames>; 4],
    /// The centre image as it is matched, in its colours.
    center: Picture,
    geometry: Option<Geometry>,
    undistortion: Option<Undistortion>,
    frame_tree: FrameTree,
    /// The standard deviation of the baseline, in millimetres.
    baseline_deviation_mm: f64,
    /// The time at which the centre was exposed.
    exposed: SystemTime,
    inspection: Inspection,
    scene: ViewedScene,
}

/// The method and the search that match a rig.
pub struct TunedMatch {
    pub name: &'static str,
    pub method: Method,
    pub search: SearchSpace,
}

/// A match, and the seconds that it took.
pub struct Matched {
    found: Estimate,
    seconds: f64,
}

/// A match as the page takes it.
pub struct Tuned {
    pub map: EncodedMap,
    /// One line about it.
    pub summary: String,
    /// The reasons to doubt it.
    pub warnings: Vec<String>,
}

impl TunedMatch {
    /// Block matching in the same search.
    pub fn by_blocks(&self) -> TunedMatch {
        let method = Method::block_matching(Method::DEFAULT_BLOCK_SIZE).with_share_beyond(self.method.share_beyond);
        TunedMatch { name: MethodName::Bm.name(), method, search: self.search.for_any_costs() }
    }
}

impl TunedRig {
    /// Reads a captured folder.
    pub fn open(folder: &Path) -> Result<TunedRig> {
        let mut source = Source::of_rig(folder, None, &BitsOption::default())?;
        let (mut frames, center, undistortion) = source.load()?;
        let geometry = GeometryOptions::default().geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        let folder = source.folder().unwrap_or(folder);
        let inspection = Inspection::of(&frames);
        inspection.even(&mut frames);
        let images = MatchedImages { center: &source.images.center, size: frames.size(), seen: inspection.corner_disparities() };
        let truth = truth(folder, &images)?;
        let scene = ViewedScene::new(title(folder), frames.size())
            .served()
            .with_geometry(geometry.as_ref())
            .with_frames(&frames, frames.color(Frame::Center))
            .with_truth(truth.as_ref());
        let center = match &undistortion {
            Some(undistortion) => undistortion.picture(Frame::Center, &center),
            None => center,
        };
        let frame_tree = source.frame_tree(undistortion.as_ref(), None, None)?;
        let baseline_deviation_mm = source.rig.as_ref().map_or(0.0, |rig| rig.baseline_deviation_mm(frames.views()));
        Ok(TunedRig {
            folder: folder.into(),
            frames,
            suited: Default::default(),
            center,
            geometry,
            undistortion,
            frame_tree,
            baseline_deviation_mm,
            exposed: source.exposed(),
            inspection,
            scene,
        })
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns true if the focal length and the baseline are known, so that disparities have depths.
    pub fn has_geometry(&self) -> bool {
        self.geometry.is_some()
    }

    /// The time at which the centre was exposed, since 1970.
    pub fn exposed(&self) -> Duration {
        self.exposed.duration_since(UNIX_EPOCH).unwrap_or_default()
    }

    /// Returns what the page shows of it, without maps.
    pub fn scene(&self) -> &ViewedScene {
        &self.scene
    }

    /// The range of disparities that the images tell: the smallest one and their number.
    pub fn found_range(&self) -> Option<(i16, u16)> {
        self.inspection.found_range().ok()
    }

    /// Returns how `match` would match it with these options.
    pub fn plan(&self, options: &MatchingOptions) -> Result<TunedMatch> {
        let (size, views) = (self.frames.size(), self.frames.views());
        let search = options.search(size, views, self.inspection.range.unwrap_or(SearchOptions::DEFAULT_RANGE))?;
        let method = options.method(views)?.with_share_beyond(self.inspection.share_beyond(&search));
        Ok(TunedMatch { name: options.method.name(), method, search })
    }

    /// Its frames as a method takes them.
    fn suited(&self, method: &Method) -> &Frames {
        let suited = &self.suited[2 * usize::from(method.compares_brightness()) + usize::from(method.needs_color())];
        suited.get_or_init(|| self.inspection.frames_for(method, self.frames.clone()))
    }

    /// Matches it.
    pub fn run(&self, plan: &TunedMatch, engine: &Engine, progress: &dyn Progress) -> Result<Matched> {
        let start = Instant::now();
        let mut found = plan.method.estimate(engine, self.suited(&plan.method), &plan.search, progress)?;
        mask_unseen(self.undistortion.as_ref(), &mut found.disparities, Some(&mut found.confidences));
        Ok(Matched { found, seconds: start.elapsed().as_secs_f64() })
    }

    /// The standard deviations of the depths of a match in metres. `None` if they are not known.
    pub fn deviations(&self, plan: &TunedMatch, engine: &Engine, Matched { found, .. }: &Matched) -> Option<FloatImage> {
        let (Estimate { disparities, confidences, baselines }, geometry) = (found, self.geometry.as_ref()?);
        let frames = self.suited(&plan.method);
        let deviations = plan.method.deviations(engine, frames, frames.views(), disparities, confidences, baselines)?;
        Some(geometry.depth_deviations(disparities, &deviations, self.baseline_deviation_mm))
    }

    /// A match as ROS 2 takes it, with the deviations of its depths. `None` without the focal length or the baseline.
    pub fn recording<'a>(
        &'a self,
        plan: &TunedMatch,
        Matched { found, .. }: &'a Matched,
        deviations: Option<&'a FloatImage>,
    ) -> Option<RosRecording<'a>> {
        let cloud = Cloud {
            confidences: Some(&found.confidences),
            deviations,
            frames: self.frame_tree,
            ..Cloud::new(&found.disparities, &self.center, self.geometry.as_ref()?)
        };
        Some(RosRecording { cloud, range: [plan.search.min_disparity(), plan.search.max_disparity()] })
    }

    /// A match as the page takes it.
    pub fn tuned(&self, plan: &TunedMatch, Matched { found, seconds }: Matched) -> Tuned {
        let Estimate { disparities, confidences, .. } = found;
        let TunedMatch { name, method, search } = plan;
        let results = (&disparities, Some(&confidences));
        let map = self.scene.encoded(matched_map((*name).into(), (name, method), search, results, Some(seconds)));
        let valid = disparities.pixels().iter().flatten().count() as f64 / disparities.pixels().len() as f64;
        let summary = format!(
            "{name}, {:.0} ms, {:.1} % valid{}",
            1e3 * seconds,
            100.0 * valid,
            terminal::sure(confidence_map::sure_share(&confidences))
        );
        let preparation = MatchSetup {
            inspection: self.inspection.clone(),
            alignment: None,
            range: SearchOptions::DEFAULT_RANGE,
            range_source: RangeSource::Paper,
            search: *search,
        };
        Tuned { map, summary, warnings: advice::warnings(&preparation, &disparities, search) }
    }
}
