//! A scene on a page.

use std::io::Cursor;

use base64::{Engine, engine::general_purpose::STANDARD};
use image::{RgbImage, codecs::jpeg::JpegEncoder};
use multiscopic_core::{Frame, View};
use serde::Serialize;
use serde_json::{Value, json};

use super::{
    block_costs::BlockCosts,
    compact::{self, Aim},
    viewed_map::ViewedMap,
};
use crate::{
    evaluation::{Metrics, Reduction},
    images::{DisparityMap, FloatImage, Frames, Geometry},
    report::figure::percent_encoded,
};

/// The quality of the centre in colour. Its grey values are stored without loss besides.
const JPEG_QUALITY: u8 = 88;

/// A scene with its disparity maps, which all have one size.
#[derive(Clone, Debug, Serialize)]
pub struct ViewedScene {
    name: String,
    size: [usize; 2],
    geometry: Option<Value>,
    /// The centre comes first.
    frames: Vec<EncodedFrame>,
    color: Option<String>,
    truth: Option<String>,
    maps: Vec<EncodedMap>,
    #[serde(skip)]
    true_disparities: Option<FloatImage>,
    #[serde(skip)]
    aim: Aim,
}

#[derive(Clone, Debug, Serialize)]
struct EncodedFrame {
    name: String,
    view: Option<[i8; 2]>,
    gray: String,
}

/// A map as the page takes it: see [`ViewedScene::encoded`].
#[derive(Clone, Debug, Serialize)]
pub struct EncodedMap {
    name: String,
    disparities: String,
    confidences: Option<String>,
    metrics: Option<Value>,
    parameters: Vec<(String, String)>,
    costs: Option<BlockCosts>,
    file: Option<String>,
}

impl ViewedScene {
    /// A scene of a size, without anything to see.
    pub fn new(name: impl Into<String>, size: [usize; 2]) -> ViewedScene {
        let name = name.into();
        ViewedScene {
            name,
            size,
            geometry: None,
            frames: Vec::new(),
            color: None,
            truth: None,
            maps: Vec::new(),
            true_disparities: None,
            aim: Aim::default(),
        }
    }

    /// The same scene for a page whose server is on the same machine: to be encoded soon matters more than to be short. It is the
    /// first thing to say of a scene.
    pub fn served(self) -> ViewedScene {
        ViewedScene { aim: Aim::Time, ..self }
    }

    /// Adds the geometry, without which there is neither depth nor a point cloud.
    pub fn with_geometry(self, geometry: Option<&Geometry>) -> ViewedScene {
        let geometry = geometry.map(|&Geometry { focal_px, baseline_mm, principal_point, doffs }| {
            json!({ "focal_px": focal_px, "baseline_mm": baseline_mm, "principal_point": principal_point, "doffs": doffs })
        });
        ViewedScene { geometry, ..self }
    }

    /// Adds the centre alone, in grey and in colour.
    pub fn with_center(self, frames: &Frames, color: Option<&RgbImage>) -> ViewedScene {
        let color = color.or_else(|| frames.color(Frame::Center)).map(jpeg);
        ViewedScene { frames: encoded(frames, Frame::Center, self.aim).into_iter().collect(), color, ..self }
    }

    /// Adds the centre and all neighbours, from which the page computes costs.
    pub fn with_frames(self, frames: &Frames, color: Option<&RgbImage>) -> ViewedScene {
        let mut scene = self.with_center(frames, color);
        let aim = scene.aim;
        scene.frames.extend(frames.views().iter().filter_map(|view| encoded(frames, Frame::View(view), aim)));
        scene
    }

    /// Adds the true disparities, not finite where unknown.
    ///
    /// # Panics
    /// If they have another size.
    pub fn with_truth(self, truth: Option<&FloatImage>) -> ViewedScene {
        assert!(truth.is_none_or(|truth| [truth.width(), truth.height()] == self.size), "the size of the truth");
        let encoded = truth.map(|truth| compact::disparities(&DisparityMap::from_float(truth), self.aim));
        ViewedScene { truth: encoded, true_disparities: truth.cloned(), ..self }
    }

    /// Adds a map.
    ///
    /// # Panics
    /// If it has another size.
    pub fn add(&mut self, map: ViewedMap<'_>) {
        let map = self.encoded(map);
        self.maps.push(map);
    }

    /// A map as the page takes it, for [`LivePanel`](super::LivePanel).
    ///
    /// # Panics
    /// If it has another size.
    pub fn encoded(&self, map: ViewedMap<'_>) -> EncodedMap {
        let ViewedMap { name, disparities, confidences, metrics, reduction, parameters, costs, file } = map;
        assert_eq!([disparities.width(), disparities.height()], self.size, "the size of {name}");
        let truth = self.true_disparities.as_ref();
        let metrics = metrics.or_else(|| Metrics::new(disparities, truth?)).map(|metrics| {
            let mut value = serde_json::to_value(metrics).expect("numbers");
            if let Some(Reduction { rms, avg_err }) = reduction {
                value["reduction"] = json!({ "rms": rms, "avg_err": avg_err });
            }
            value
        });
        EncodedMap {
            name,
            disparities: compact::disparities(disparities, self.aim),
            confidences: confidences.map(|confidences| compact::bytes(confidences.pixels(), confidences.width(), self.aim)),
            metrics,
            parameters,
            // Costs need the pictures of all views.
            costs: costs.filter(|_| self.frames.len() > 1),
            file: file.as_deref().map(percent_encoded),
        }
    }
}

fn encoded(frames: &Frames, frame: Frame, aim: Aim) -> Option<EncodedFrame> {
    let (name, view) = match frame {
        Frame::Center => ("centre".into(), None),
        Frame::View(view) => (view_name(view), Some([view.right(), view.down()])),
    };
    Some(EncodedFrame { name, view, gray: compact::gray(frames.get(frame)?, aim) })
}

fn view_name(view: View) -> String {
    view.name().map_or_else(|| view.to_string(), str::to_owned)
}

fn jpeg(image: &RgbImage) -> String {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(image).expect("memory takes any picture");
    format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes.into_inner()))
}
