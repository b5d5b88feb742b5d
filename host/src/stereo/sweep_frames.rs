//! The frames of a sweep, before they are matched.

use std::path::Path;

use image::GrayImage;
use multiscopic_core::{Frame, SearchSpace, SweepOffset, SweepParams, View};

use crate::{
    error::{Error, Result},
    files::SweepFrame,
    images::{Frames, Picture, noise},
};

/// The radius of the filter's blocks.
const RADIUS: u8 = 2;

/// The frames of a camera that slides, and their places, as [`dense_sweep`](super::dense_sweep) takes them.
#[derive(Clone, Debug)]
pub struct SweepFrames {
    /// The centre, and as its views the frames nearest to a baseline away: they show the range of disparities.
    pub frames: Frames,
    /// All frames but the centre in grey, in the order of [`push`](SweepFrames::push), and their places.
    pub placed: Vec<(SweepOffset, GrayImage)>,
    /// The distances of the views from a place one baseline away, in baselines.
    aside: [f64; 2],
}

impl SweepFrames {
    /// A sweep without frames but its centre.
    pub fn new(center: Picture) -> SweepFrames {
        SweepFrames { frames: Frames::of_picture(center), placed: Vec::new(), aside: [f64::INFINITY; 2] }
    }

    /// Adds the frame of a name that was taken so many baselines to the right of the centre. The filter takes frames in this order,
    /// best from the centre outwards.
    ///
    /// # Errors
    /// [`Error::Format`] with the name, if the frame has another size than the centre, or was taken beyond 16 baselines.
    pub fn push(&mut self, name: &Path, baselines: f64, frame: Picture) -> Result<()> {
        let ([width, height], (w, h)) = (self.frames.size(), frame.dimensions());
        if [w, h].map(|side| side as usize) != [width, height] {
            return Err(Error::format(name, format!("{w}x{h} pixels"), format!("{width}x{height} as in the centre")));
        }
        let bits = (baselines * f64::from(SweepOffset::STEPS)).round();
        let offset = SweepOffset::from_bits(bits as i32).filter(|_| baselines.is_finite());
        let offset = offset.ok_or_else(|| Error::format(name, format!("a place of {baselines} baselines"), "16 at most"))?;
        self.placed.push((offset, frame.to_gray()));
        for ((view, place), least) in [(View::LEFT, -1.0), (View::RIGHT, 1.0)].into_iter().zip(&mut self.aside) {
            let aside = (baselines - place).abs();
            if aside <= SweepFrame::TOLERANCE && aside < *least {
                *least = aside;
                self.frames = self.frames.clone().with_picture(view, frame.clone());
            }
        }
        Ok(())
    }

    /// The parameters of the filter for a search, with the noise that the centre shows.
    ///
    /// # Errors
    /// [`Error::Usage`] if there are more disparities than a sweep has.
    pub fn params(&self, search: SearchSpace) -> Result<SweepParams> {
        let center = self.frames.get(Frame::Center).expect("frames have a centre");
        let [least, most] = SweepParams::NOISE_RANGE;
        let noise_q4 = (16.0 * noise(center)).round().clamp(least.into(), most.into()) as u16;
        SweepParams::new(search, noise_q4, RADIUS).map_err(|error| Error::Usage(error.to_string()))
    }
}
