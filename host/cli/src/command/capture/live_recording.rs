//! Results of captures, as a stream for ROS 2.

use std::{
    path::Path,
    time::{SystemTime, UNIX_EPOCH},
};

use multiscopic::{
    Engine, Error, MatchSetup, RangeSource, Result,
    files::{
        Cloud, output,
        ros::{RosRecording, RosStream},
    },
    stereo::MethodName,
};

use super::recorder::Recorder;
use crate::command::{
    options::{BitsOption, GeometryOptions, SearchOptions, Source},
    preparation::mask_unseen,
};

/// Matches captures by blocks, and writes the results one after the other.
pub struct LiveRecording<'a> {
    search: &'a SearchOptions,
    engine: Engine,
}

impl<'a> LiveRecording<'a> {
    /// For captures whose focal length is known.
    pub fn new(recorder: &Recorder, search: &'a SearchOptions) -> Result<LiveRecording<'a>> {
        if recorder.focal_px.is_none() {
            return Err(Error::Usage(
                "--mcap has depths, which need the focal length in pixels: give --focal-px or --lens".into(),
            ));
        }
        Ok(LiveRecording { search, engine: Engine::new(None, 0)? })
    }

    /// Writes a recording. `capture` takes captures, and tells the folder of each to the function that it is given. However it
    /// ends, the recording has all before.
    pub fn write(&self, path: &Path, capture: impl FnOnce(&mut dyn FnMut(&Path) -> Result<()>) -> Result<()>) -> Result<()> {
        let mut captured = Ok(());
        output::write(path, |file| {
            let mut stream = RosStream::new(file)?;
            captured = capture(&mut |folder| self.send(folder, path, &mut stream));
            stream.finish()
        })?;
        captured
    }

    /// Matches the capture in a folder, and writes the result.
    fn send(&self, folder: &Path, path: &Path, stream: &mut RosStream<&mut dyn std::io::Write>) -> Result<()> {
        let mut source = Source::of_rig(folder, None, &BitsOption::default())?;
        let (mut frames, center, undistortion) = source.load()?;
        let geometry = GeometryOptions::default().geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        let geometry = geometry.expect("the recorder knows the focal length and the baseline");
        let views = frames.views();
        let size = frames.size();
        let search = |range| self.search.search(size, views, None, range);
        let preparation = MatchSetup::new(&mut frames, RangeSource::Paper, search)?;
        let center = match &undistortion {
            Some(undistortion) => undistortion.picture(&center),
            None => center,
        };
        let search = preparation.search;
        let (method, frames) = preparation.suited(MethodName::Bm.method(self.search.block_size, views.len())?, frames);
        let (mut disparities, mut confidences) = method.disparities_and_confidences(&self.engine, &frames, &search, &())?;
        mask_unseen(undistortion.as_ref(), &mut disparities, Some(&mut confidences));
        let range = [search.min_disparity(), search.max_disparity()];
        let cloud = Cloud { disparities: &disparities, confidences: Some(&confidences), center: &center, geometry: &geometry };
        let recording = RosRecording { cloud, range };
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        stream.send(&recording, now).map_err(|source| Error::Write { path: path.into(), source })
    }
}
