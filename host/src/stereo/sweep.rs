//! The filter over the frames of a sweep, with frames in memory.

use std::convert::Infallible;

use image::GrayImage;
use multiscopic_core::{
    ConfidenceLines, ConfidenceTable, Disparity, Frame, MatchError, ScanlineSource, SweepFilter, SweepOffset, SweepParams,
    SweepReport, kernel::Kernel,
};

use super::{
    Engine, Method, Simd, Task,
    confidence_map::{self, ConfidenceMap},
    method::Estimate,
};
use crate::{
    error,
    images::{DisparityMap, Frames, Raster},
    progress::Progress,
};

/// Disparities at the unit baseline, and what led to them.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The disparities of the centre.
    pub disparities: DisparityMap,
    /// The probabilities that they are at most one pixel off.
    pub confidences: ConfidenceMap,
    /// The reports of the frames, in their order.
    pub reports: Vec<SweepReport>,
}

/// Refines the disparities of `center` with `frames` in their order, on this thread: the messages of a line need all lines above.
///
/// ```
/// use image::{GrayImage, Luma};
/// use multiscopic::stereo::sweep;
/// use multiscopic_core::{SearchConfig, SweepOffset, SweepParams};
///
/// // A texture at disparity 4.
/// let gray = |u: f32, v: f32| 128.0 + 50.0 * (0.8 * u + v).sin() + 40.0 * (0.3 * u - 0.6 * v).cos();
/// let picture = |b: f32| GrayImage::from_fn(64, 48, |u, v| Luma([gray(u as f32 + 4.0 * b, v as f32) as u8]));
/// let search = SearchConfig { min_disparity: 0, num_disparities: 12, ..SearchConfig::of_size(64, 48) }.checked()?;
/// let params = SweepParams::new(search, 16, 2)?;
/// let frames: Vec<_> = [2, -2, 4, -4, 6, -6, 8, -8].map(|eighths| (eighths, picture(eighths as f32 / 8.0))).into();
/// let frames: Vec<_> =
///     frames.iter().map(|(eighths, image)| (SweepOffset::from_bits(eighths * 512).unwrap(), image)).collect();
/// let found = sweep(&params, &picture(0.0), &frames);
/// assert!((f32::from(found.disparities.get(32, 24).unwrap()) - 4.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Panics
/// If a picture has another size than `params`.
pub fn sweep(params: &SweepParams, center: &GrayImage, frames: &[(SweepOffset, &GrayImage)]) -> Sweep {
    let (width, height) = (params.search().width(), params.search().height());
    for (picture, name) in frames.iter().map(|(_, image)| (*image, "frame")).chain([(center, "centre")]) {
        assert_eq!(picture.dimensions(), (width as u32, height as u32), "the size of a {name}");
    }
    let simd = Simd::available().into_iter().next().unwrap_or(Simd::BASELINE);
    simd.run(Sliding { params, center, frames })
}

/// A sweep with an instruction set.
struct Sliding<'a> {
    params: &'a SweepParams,
    center: &'a GrayImage,
    frames: &'a [(SweepOffset, &'a GrayImage)],
}

impl Task for Sliding<'_> {
    type Output = Sweep;

    fn run<I: Kernel>(self, isa: I) -> Sweep {
        let Sliding { params, center, frames } = self;
        let (width, height) = (params.search().width(), params.search().height());
        let mut memory = vec![0; params.memory_words()];
        let mut filter = infallible(SweepFilter::with_isa(isa, params, &mut memory));
        let refine = |(offset, image): &(SweepOffset, &GrayImage)| {
            infallible(filter.refine(*offset, &mut Lines(center), &mut Lines(image)))
        };
        let reports = frames.iter().map(refine).collect();
        let mut lines_memory = vec![0; ConfidenceLines::memory_words(width)];
        let mut lines = infallible(ConfidenceLines::with_isa(isa, params.search(), &ConfidenceTable::SWEEP, &mut lines_memory));
        let mut disparities: Raster<Option<Disparity>> = Raster::filled(width, height, None);
        let mut confidences = Raster::filled(width, height, 0);
        let (mut reader, mut source) = (filter.reader(), Lines(center));
        for (disparities, confidences) in disparities.rows_mut().zip(confidences.rows_mut()) {
            let next = |disparities: &mut [Option<Disparity>], evidence: &mut [u8]| -> Result<_, MatchError<Infallible>> {
                reader.next_line_and_evidence(&mut source, disparities, evidence)
            };
            infallible(lines.next_line(next, disparities, confidences));
        }
        Sweep { disparities, confidences, reports }
    }
}

/// The difference up to which the filter confirms a disparity, in pixels of the unit baseline.
const SAME: f32 = 0.5;

/// Estimates the disparities of a sweep everywhere: by `method` from `frames`, the centre and the views at the unit baseline, and by
/// the filter from all of the `swept`, in their order.
///
/// The filter is precise where there is texture, and the method, the network by default, knows better what lies beside an edge and
/// on blank walls. So the mean of both counts where they agree, each weighted by its confidence, and the method's disparity
/// elsewhere. Its confidence rises where both agree. The refinements of the method by confidence follow.
///
/// # Errors
/// Those of [`Method::estimate`].
///
/// # Panics
/// As [`fn@sweep`].
pub fn dense_sweep(
    engine: &Engine,
    method: &Method,
    frames: &Frames,
    params: &SweepParams,
    swept: &[(SweepOffset, &GrayImage)],
    progress: &dyn Progress,
) -> error::Result<Estimate> {
    let center = frames.get(Frame::Center).expect("frames have a centre");
    let Sweep { disparities: filtered, confidences: confirmed, .. } = sweep(params, center, swept);
    method.estimate_with(engine, frames, params.search(), progress, |map, confidences| {
        confirm((map, confidences), (&filtered, &confirmed));
    })
}

/// Confirms disparities of a method by those of the filter.
fn confirm((map, confidences): (&mut DisparityMap, &mut ConfidenceMap), (filtered, confirmed): (&DisparityMap, &ConfidenceMap)) {
    let own = map.pixels_mut().iter_mut().zip(confidences.pixels_mut());
    for ((disparity, sure), (other, other_sure)) in own.zip(filtered.pixels().iter().zip(confirmed.pixels())) {
        let (Some(d), Some(other)) = (disparity.map(f32::from), other.map(f32::from)) else { continue };
        if (d - other).abs() > SAME {
            continue;
        }
        let [p, q] = [*sure, *other_sure].map(|sure| f64::from(sure) / 255.0);
        let [own, weight] = [p, q].map(|p| p.powi(4) as f32);
        let mean = if own + weight > 0.0 { (own * d + weight * other) / (own + weight) } else { d };
        *disparity = Disparity::from_bits((mean * Disparity::STEPS as f32).round() as i16);
        // Both err in the same places: the filter counts as half a witness.
        *sure = confidence_map::of_probability(1.0 - (1.0 - p) * (1.0 - q).sqrt());
    }
}

/// The result of what cannot fail here: memory is as large as asked for, and pictures have all their lines.
fn infallible<T, E: std::fmt::Debug>(result: Result<T, E>) -> T {
    result.expect("memory and lines are there")
}

/// The lines of a picture.
struct Lines<'a>(&'a GrayImage);

impl ScanlineSource for Lines<'_> {
    type Error = Infallible;

    fn read_line(&mut self, _: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        line.copy_from_slice(&self.0.as_raw()[v * line.len()..][..line.len()]);
        Ok(())
    }
}
