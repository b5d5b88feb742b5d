//! Results of captures for ROS 2: as a recording, and live.

use std::{
    path::Path,
    time::{Duration, UNIX_EPOCH},
};

use multiscopic::{
    Engine, Error, MatchSetup, RangeSource, Result,
    files::{
        Cloud, output,
        ros::{RosRecording, RosStream},
    },
    stereo::{Estimate, MethodName},
};
use multiscopic_core::Frame;

use super::recorder::Recorder;
use crate::command::{
    foxglove::{FoxgloveOptions, Publisher},
    options::{BitsOption, GeometryOptions, SearchOptions, Source},
    preparation::mask_unseen,
};

/// Matches captures by blocks, and writes or publishes the results one after the other.
pub struct LiveRecording<'a> {
    search: &'a SearchOptions,
    engine: Engine,
    publisher: Option<Publisher>,
}

impl<'a> LiveRecording<'a> {
    /// For captures whose focal length is known.
    pub fn new(recorder: &Recorder, search: &'a SearchOptions, foxglove: &FoxgloveOptions) -> Result<LiveRecording<'a>> {
        let has_depth = recorder.parts.focal_px.is_some();
        let publisher = foxglove.publisher(has_depth)?;
        if !has_depth {
            return Err(Error::Usage(
                "--mcap has depths, which need the focal length in pixels: give --focal-px or --lens".into(),
            ));
        }
        Ok(LiveRecording { search, engine: Engine::new(None, 0)?, publisher })
    }

    /// Publishes the results, and writes a recording of them if there is a path for it. `capture` takes captures, and tells the
    /// folder of each to the function that it is given. However it ends, the recording has all before.
    pub fn run(
        &self,
        path: Option<&Path>,
        capture: impl FnOnce(&mut dyn FnMut(&Path) -> Result<()>) -> Result<()>,
    ) -> Result<()> {
        let Some(path) = path else {
            return capture(&mut |folder| self.send(folder, &mut |_, _| Ok(())));
        };
        let mut captured = Ok(());
        output::write(path, |file| {
            let mut stream = RosStream::new(file)?;
            let mut write = |recording: &RosRecording, time| {
                stream.send(recording, time).map_err(|source| Error::Write { path: path.into(), source })
            };
            captured = capture(&mut |folder| self.send(folder, &mut write));
            stream.finish()
        })?;
        captured
    }

    /// Matches the capture in a folder, and publishes and writes the result.
    fn send(&self, folder: &Path, write: &mut dyn FnMut(&RosRecording, Duration) -> Result<()>) -> Result<()> {
        let mut source = Source::of_rig(folder, None, &BitsOption::default())?;
        let (mut frames, center, undistortion) = source.load()?;
        let geometry = GeometryOptions::default().geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        let geometry = geometry.expect("the recorder knows the focal length and the baseline");
        let views = frames.views();
        let size = frames.size();
        let search = |range| self.search.search(size, views, None, range);
        let preparation = MatchSetup::new(&mut frames, RangeSource::Paper, search)?;
        let center = match &undistortion {
            Some(undistortion) => undistortion.picture(Frame::Center, &center),
            None => center,
        };
        let search = preparation.search;
        let (method, frames) = preparation.suited(MethodName::Bm.method(self.search.block_size, views.len())?, frames);
        let Estimate { mut disparities, mut confidences, baselines } = method.estimate(&self.engine, &frames, &search, &())?;
        mask_unseen(undistortion.as_ref(), &mut disparities, Some(&mut confidences));
        let of_baseline = source.rig.as_ref().map_or(0.0, |rig| rig.baseline_deviation_mm(views));
        let deviations = method.deviations(&self.engine, &frames, views, &disparities, &confidences, &baselines);
        let deviations = deviations.map(|deviations| geometry.depth_deviations(&disparities, &deviations, of_baseline));
        let range = [search.min_disparity(), search.max_disparity()];
        let frames = source.frame_tree(undistortion.as_ref(), None, None)?;
        let cloud = Cloud {
            confidences: Some(&confidences),
            deviations: deviations.as_ref(),
            frames,
            ..Cloud::new(&disparities, &center, &geometry)
        };
        let recording = RosRecording { cloud, range };
        let exposed = source.exposed().duration_since(UNIX_EPOCH).unwrap_or_default();
        self.publisher.iter().try_for_each(|publisher| publisher.publish(&recording, exposed))?;
        write(&recording, exposed)
    }
}
