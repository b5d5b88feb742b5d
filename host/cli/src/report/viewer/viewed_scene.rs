//! A scene on a page.

use std::io::Cursor;

use base64::{Engine, engine::general_purpose::STANDARD};
use image::{GrayImage, RgbImage, codecs::jpeg::JpegEncoder};
use multiscopic_core::{Frame, SearchSpace, View};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};

use super::compact::{self, Aim};
use multiscopic::{
    evaluation::Metrics,
    images::{DisparityMap, FloatImage, Frames, Geometry, Raster},
};

use crate::{report::figure::percent_encoded, results::Reduction};

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
    /// The steps of a sweep, in the order in which its frames were taken in.
    sweep: Vec<EncodedStep>,
    /// The parts that [`fit`](ViewedScene::fit) has left out.
    left_out: Vec<Part>,
    #[serde(skip)]
    true_disparities: Option<FloatImage>,
    #[serde(skip)]
    aim: Aim,
}

/// A part that a page can do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Part {
    Confidences,
    /// The pictures of the neighbours, and with them the costs.
    Neighbors,
}

#[derive(Clone, Debug, Serialize)]
struct EncodedFrame {
    name: String,
    view: Option<[i8; 2]>,
    gray: String,
}

/// A frame of a sweep, and the disparities after it.
#[derive(Clone, Debug)]
pub struct SweepStep {
    /// The number of frames so far.
    pub frames: usize,
    /// The place of this one to the right of the centre, in baselines.
    pub place: f64,
    /// The frame.
    pub image: GrayImage,
    /// The disparities that are known by then.
    pub disparities: DisparityMap,
}

#[derive(Clone, Debug, Serialize)]
struct EncodedStep {
    frames: usize,
    place: f64,
    gray: String,
    disparities: String,
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
            sweep: Vec::new(),
            left_out: Vec::new(),
            true_disparities: None,
            aim: Aim::default(),
        }
    }

    /// The same scene for a page whose server is on the same machine: to be encoded soon matters more than to be short. It is
    /// the first thing to say of a scene.
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

    /// Adds the steps of a sweep.
    pub fn with_sweep(self, steps: &[SweepStep]) -> ViewedScene {
        let encoded = |SweepStep { frames, place, image, disparities }: &SweepStep| EncodedStep {
            frames: *frames,
            place: *place,
            gray: compact::gray(image, self.aim),
            disparities: compact::disparities(disparities, self.aim),
        };
        ViewedScene { sweep: steps.par_iter().map(encoded).collect(), ..self }
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
            // What is invalid counts as wrong, so that a filter that leaves out what is wrong looks like a loss.
            let truth = truth.filter(|_| metrics.coverage < 1.0);
            let left = truth.and_then(|truth| Metrics::new(disparities, &known_where_valid(truth, disparities)));
            if let Some(Metrics { avg_err, bad_1, .. }) = left {
                value["left"] = json!({ "avg_err": avg_err, "bad_1": bad_1 });
            }
            value
        });
        EncodedMap {
            name,
            disparities: compact::disparities(disparities, self.aim),
            confidences: confidences.map(|confidences| compact::bytes(confidences.pixels(), confidences.width(), self.aim)),
            metrics,
            parameters,
            costs: costs.filter(|costs| costs.views().iter().all(|view| self.shows(*view))),
            file: file.as_deref().map(percent_encoded),
        }
    }

    /// Returns true if the picture of a view is there.
    fn shows(&self, view: [i8; 2]) -> bool {
        self.frames.iter().any(|frame| frame.view == Some(view))
    }

    /// Leaves out parts of `scenes` until they take at most `limit` bytes on a page, if that is possible: confidences first,
    /// those of the last scene before others, then the neighbours. The page tells what is missing.
    pub fn fit(scenes: &mut [ViewedScene], limit: usize) {
        let mut bytes: usize = scenes.iter().map(ViewedScene::bytes).sum();
        for part in [Part::Confidences, Part::Neighbors] {
            for scene in scenes.iter_mut().rev() {
                if bytes <= limit {
                    return;
                }
                bytes -= scene.bytes();
                scene.leave_out(part);
                bytes += scene.bytes();
            }
        }
    }

    fn leave_out(&mut self, part: Part) {
        let before = self.bytes();
        match part {
            Part::Confidences => self.maps.iter_mut().for_each(|map| map.confidences = None),
            Part::Neighbors => {
                self.frames.retain(|frame| frame.view.is_none());
                self.maps.iter_mut().for_each(|map| map.costs = None);
            }
        }
        if self.bytes() < before {
            self.left_out.push(part);
        }
    }

    /// About how many bytes it takes on a page.
    fn bytes(&self) -> usize {
        let frames = self.frames.iter().map(|frame| &frame.gray);
        let maps = self.maps.iter().flat_map(|map| [&map.disparities].into_iter().chain(&map.confidences));
        frames.chain(maps).chain(&self.color).chain(&self.truth).map(String::len).sum()
    }
}

fn encoded(frames: &Frames, frame: Frame, aim: Aim) -> Option<EncodedFrame> {
    let (name, view) = match frame {
        Frame::Center => ("centre".into(), None),
        Frame::View(view) => (view_name(view), Some([view.right(), view.down()])),
    };
    Some(EncodedFrame { name, view, gray: compact::gray(frames.get(frame)?, aim) })
}

/// The true disparities of valid pixels; those of others are unknown.
fn known_where_valid(truth: &FloatImage, disparities: &DisparityMap) -> FloatImage {
    let pixels = truth.pixels().iter().zip(disparities.pixels());
    let known = pixels.map(|(truth, disparity)| if disparity.is_some() { *truth } else { f32::INFINITY });
    FloatImage::new(truth.width(), truth.height(), known.collect())
}

fn view_name(view: View) -> String {
    view.name().map_or_else(|| view.to_string(), str::to_owned)
}

fn jpeg(image: &RgbImage) -> String {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(image).expect("memory takes any picture");
    format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes.into_inner()))
}

/// A disparity map, and what is known of it.
#[derive(Clone, Debug)]
pub struct ViewedMap<'a> {
    /// The name, such as that of its method.
    pub name: String,
    /// The disparities.
    pub disparities: &'a DisparityMap,
    /// The confidences: probabilities times 255.
    pub confidences: Option<&'a Raster<u8>>,
    /// The errors. The scene computes them if it has the truth.
    pub metrics: Option<Metrics>,
    /// The reduction of the errors from those of stereo.
    pub reduction: Option<Reduction>,
    /// Names and values of parameters.
    pub parameters: Vec<(String, String)>,
    /// The costs to show at a pixel.
    pub costs: Option<BlockCosts>,
    /// The file with the disparities, relative to the page.
    pub file: Option<String>,
}

/// The block matching whose costs the page computes at a pixel, from the pictures.
#[derive(Clone, Debug, Serialize)]
pub struct BlockCosts {
    block_size: u8,
    min_disparity: i16,
    num_disparities: usize,
    fusion: &'static str,
    /// Baselines to the right and down.
    views: Vec<[i8; 2]>,
    /// True if these are the costs by which the map was made.
    exact: bool,
}

impl BlockCosts {
    /// The costs of a search with blocks. `exact` tells whether the map was made by them.
    pub fn new(search: &SearchSpace, block_size: u8, exact: bool) -> BlockCosts {
        let search = search.for_any_costs();
        BlockCosts {
            block_size,
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            fusion: search.fusion().name(),
            views: search.views().iter().map(|view: View| [view.right(), view.down()]).collect(),
            exact,
        }
    }

    /// Baselines to the right and down of the views whose costs these are.
    pub(super) fn views(&self) -> &[[i8; 2]] {
        &self.views
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic::images::Raster;
    use multiscopic_core::{Disparity, Fusion, SearchConfig, Views};

    const SIZE: [usize; 2] = [40, 30];

    /// A scene with a neighbour, and a map with confidences and costs.
    fn scene() -> ViewedScene {
        let picture = |seed: u32| GrayImage::from_fn(40, 30, |u, v| image::Luma([((u * 31 + v * 17 + seed) % 251) as u8]));
        let frames = Frames::new(picture(0)).with(View::RIGHT, picture(5));
        let mut scene = ViewedScene::new("scene", SIZE).with_frames(&frames, None);
        let disparities = DisparityMap::new(40, 30, vec![Disparity::from_bits(64); 1200]);
        let confidences = Raster::new(40, 30, (0..1200).map(|i| (i * 7 % 256) as u8).collect());
        let search = SearchConfig {
            width: 40,
            height: 30,
            views: Views::STEREO,
            fusion: Fusion::Min,
            min_disparity: 0,
            num_disparities: 4,
        }
        .checked()
        .expect("a search");
        scene.add(ViewedMap {
            name: "map".into(),
            disparities: &disparities,
            confidences: Some(&confidences),
            metrics: None,
            reduction: None,
            parameters: Vec::new(),
            costs: Some(BlockCosts::new(&search, 3, true)),
            file: None,
        });
        scene
    }

    #[test]
    fn filters_that_leave_out_what_is_wrong_lower_the_errors_of_what_is_left() {
        // A third of the pixels is invalid; of the others, a half is right, and a half is 2 pixels off.
        let disparity = |at: usize| [None, Disparity::from_bits(64), Disparity::from_bits(3 * 64)][at % 3];
        let disparities = DisparityMap::new(40, 30, (0..1200).map(disparity).collect());
        let truth = FloatImage::new(40, 30, vec![1.0; 1200]);
        let scene = ViewedScene::new("scene", SIZE).with_truth(Some(&truth));
        let map = |disparities| ViewedMap {
            name: "map".into(),
            disparities,
            confidences: None,
            metrics: None,
            reduction: None,
            parameters: Vec::new(),
            costs: None,
            file: None,
        };
        let metrics = scene.encoded(map(&disparities)).metrics.expect("the truth is known");
        assert_eq!(metrics["left"], json!({ "avg_err": 1.0, "bad_1": 50.0 }));
        assert!(metrics["bad_1"].as_f64() > Some(60.0), "{metrics}");
        let whole = DisparityMap::new(40, 30, vec![Disparity::from_bits(64); 1200]);
        assert_eq!(scene.encoded(map(&whole)).metrics.expect("the truth is known").get("left"), None);
    }

    #[test]
    fn what_does_not_fit_is_left_out_and_named() {
        let whole = scene();
        let bytes = whole.bytes();
        assert!(whole.maps[0].costs.is_some());
        let left_out = |limit: usize| {
            let mut scenes = [whole.clone(), whole.clone()];
            ViewedScene::fit(&mut scenes, limit);
            for ViewedScene { frames, maps, left_out, .. } in &scenes {
                let map = &maps[0];
                assert_eq!(map.confidences.is_none(), left_out.contains(&Part::Confidences));
                assert_eq!([frames.len() == 1, map.costs.is_none()], [left_out.contains(&Part::Neighbors); 2]);
            }
            scenes.map(|scene| scene.left_out)
        };
        assert_eq!(left_out(2 * bytes), [vec![], vec![]]);
        assert_eq!(left_out(2 * bytes - 1), [vec![], vec![Part::Confidences]]);
        assert_eq!(left_out(0), [[Part::Confidences, Part::Neighbors]; 2].map(Vec::from));
    }

    #[test]
    fn costs_need_the_pictures_of_their_views() {
        let mut scene = scene();
        scene.frames.truncate(1);
        let map = scene.encoded(ViewedMap {
            name: "map".into(),
            disparities: &DisparityMap::new(40, 30, vec![None; 1200]),
            confidences: None,
            metrics: None,
            reduction: None,
            parameters: Vec::new(),
            costs: scene.maps[0].costs.clone(),
            file: None,
        });
        assert!(map.costs.is_none());
    }
}
