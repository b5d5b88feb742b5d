//! The alignment of all views of a capture.

use std::collections::BTreeMap;

use image::GrayImage;
use multiscopic_core::{Frame, Params, View};

use super::{baseline_scales::baseline_scales, correction::corrected, residual::Residual, track::Track};
use crate::{error::Result, images::Frames, stereo::Engine};

/// How far each view of a capture is from where it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    residuals: BTreeMap<View, Residual>,
}

impl Alignment {
    /// Estimates the misalignment of every view of `frames`. `params` give the disparity range to search.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if a view has too little texture in common with the centre, or `params` are for frames of another size.
    pub fn estimate(frames: &Frames, params: &Params, engine: &Engine) -> Result<Alignment> {
        let mut tracks = Vec::new();
        for (view, images) in pairs(frames) {
            tracks.push((view, Track::new(images, view, params, engine)?));
        }
        let scales = baseline_scales(&tracks.iter().map(|(_, track)| track).collect::<Vec<_>>());
        let mut residuals = BTreeMap::new();
        for ((view, track), baseline_scale) in tracks.iter().zip(scales) {
            let residual = Residual {
                across_px: track.across,
                baseline_scale,
                baseline_px: (baseline_scale - 1.0) * f64::from(params.max_disparity()),
                gain: track.gain,
                blocks: track.disparities.iter().filter(|disparity| disparity.is_some()).count(),
            };
            residuals.insert(*view, residual);
        }
        Ok(Alignment { residuals })
    }

    /// The misalignment of a view, or `None` if the capture does not have it.
    pub fn of(&self, view: View) -> Option<Residual> {
        self.residuals.get(&view).copied()
    }

    /// The frames, in grey, with shifts and brightness corrected. The lengths of the baselines are not.
    pub fn compensate(&self, frames: &Frames) -> Frames {
        let center = frames.get(Frame::Center).expect("frames always have a centre").clone();
        pairs(frames).fold(Frames::new(center), |compensated, (view, [_, neighbor])| {
            let neighbor = match self.of(view) {
                Some(Residual { across_px, gain, .. }) => corrected(neighbor, view, across_px, gain),
                None => neighbor.clone(),
            };
            compensated.with(view, neighbor)
        })
    }
}

/// Each view with the images of the centre and the neighbour.
fn pairs(frames: &Frames) -> impl Iterator<Item = (View, [&GrayImage; 2])> {
    frames.views().iter().filter_map(|view| Some((view, [frames.get(Frame::Center)?, frames.get(Frame::View(view))?])))
}
