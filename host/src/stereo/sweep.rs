//! The filter over the frames of a sweep, with frames in memory.

use std::convert::Infallible;

use image::GrayImage;
use multiscopic_core::{
    ConfidenceLines, ConfidenceTable, Disparity, Frame, Fusion, MatchError, ScanlineSource, SearchConfig, SweepFilter,
    SweepOffset, SweepParams, SweepReport, View, kernel::Kernel,
};

use super::{
    Engine, Method, Simd, Task,
    confidence_map::{self, ConfidenceMap},
    method::Estimate,
};
use crate::{
    error,
    images::{DisparityMap, Frames, Picture, Raster, nearest_disparity},
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
    growing_sweep(params, center, frames, &[]).0
}

/// [`fn@sweep`], and the disparities `after` each of these numbers of frames.
///
/// # Panics
/// As [`fn@sweep`].
pub fn growing_sweep(
    params: &SweepParams,
    center: &GrayImage,
    frames: &[(SweepOffset, &GrayImage)],
    after: &[usize],
) -> (Sweep, Vec<DisparityMap>) {
    let (width, height) = (params.search().width(), params.search().height());
    for (picture, name) in frames.iter().map(|(_, image)| (*image, "frame")).chain([(center, "centre")]) {
        assert_eq!(picture.dimensions(), (width as u32, height as u32), "the size of a {name}");
    }
    let simd = Simd::available().into_iter().next().unwrap_or(Simd::BASELINE);
    simd.run(Sliding { params, center, frames, after })
}

/// A sweep with an instruction set.
struct Sliding<'a> {
    params: &'a SweepParams,
    center: &'a GrayImage,
    frames: &'a [(SweepOffset, &'a GrayImage)],
    after: &'a [usize],
}

impl Task for Sliding<'_> {
    type Output = (Sweep, Vec<DisparityMap>);

    fn run<I: Kernel>(self, isa: I) -> (Sweep, Vec<DisparityMap>) {
        let Sliding { params, center, frames, after } = self;
        let mut memory = vec![0; params.memory_words()];
        let mut filter = infallible(SweepFilter::with_isa(isa, params, &mut memory));
        let (mut reports, mut growth) = (Vec::new(), Vec::new());
        for (n, (offset, image)) in frames.iter().enumerate() {
            reports.push(infallible(filter.refine(*offset, &mut Lines(center), &mut Lines(image))));
            growth.extend(after.contains(&(n + 1)).then(|| findings(isa, params, &mut filter, center).0));
        }
        let (disparities, confidences) = findings(isa, params, &mut filter, center);
        (Sweep { disparities, confidences, reports }, growth)
    }
}

/// The disparities that a filter has found so far, and their confidences.
fn findings<I: Kernel>(
    isa: I,
    params: &SweepParams,
    filter: &mut SweepFilter<'_, I>,
    center: &GrayImage,
) -> (DisparityMap, ConfidenceMap) {
    let (width, height) = (params.search().width(), params.search().height());
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
    (disparities, confidences)
}

/// The difference up to which the filter confirms a disparity, in pixels.
const SAME: f32 = 0.5;
/// The least offset of the pair that a method matches, in unit baselines.
const LEAST_OFFSET: f64 = 0.75;
/// The most by which the matches in both frames of the pair may be off, in pixels.
const MOST_UNEVEN: f64 = 0.2;

/// Estimates the disparities of a sweep everywhere: by the filter from all of the `swept`, in their order, and by `method` from the
/// centre of `frames` and two of the `swept`, one of each side, nearly as far from the centre as each other.
///
/// The filter is precise where there is texture, and the method, best the network, knows better what lies beside an edge and
/// on blank walls. So the mean of both counts where they agree, each weighted by its confidence, and the method's disparity
/// elsewhere. Its confidence rises where both agree. The refinements of the method by confidence follow. If no two frames are
/// three quarters of the baseline from the centre or more, at places that move matches by a fifth of a pixel at most, the
/// result is the filter's. The disparities are those at the unit baseline.
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
    let Sweep { disparities, confidences, .. } = sweep(params, center, swept);
    let search = params.search();
    let Some(([left, right], offset)) = pair(params, swept) else {
        let baselines = Raster::filled(search.width(), search.height(), 1.0);
        return Ok(Estimate { disparities, confidences, baselines });
    };
    let mut pictures = vec![(Frame::Center, frames.picture(Frame::Center).expect("frames have a centre"))];
    let has_color = frames.color(Frame::Center).is_some();
    pictures.extend([(View::LEFT, left), (View::RIGHT, right)].map(|(view, image)| {
        let gray = Picture::Gray(image.clone());
        (Frame::View(view), if has_color { Picture::Rgb(gray.to_rgb()) } else { gray })
    }));
    let pair = Frames::of_pictures(pictures).expect("the centre is among them");
    let [least, most] = [search.min_disparity(), search.max_disparity()].map(|d| f64::from(d) * offset);
    let search = SearchConfig {
        views: pair.views(),
        fusion: Fusion::default_for(2),
        min_disparity: least.floor() as i16,
        num_disparities: (most.ceil() - least.floor()) as u16 + 1,
        ..search.config()
    };
    let offset = offset as f32;
    let mut estimate = method.estimate_with(engine, &pair, &search.checked()?, progress, |map, sure| {
        confirm((map, sure), (&disparities, &confidences), offset);
    })?;
    for disparity in estimate.disparities.pixels_mut() {
        *disparity = disparity.and_then(|d| nearest_disparity(f32::from(d) / offset));
    }
    Ok(estimate)
}

/// The farthest frames to the left and to the right whose places are alike, and the mean of their distances in baselines.
fn pair<'a>(params: &SweepParams, swept: &[(SweepOffset, &'a GrayImage)]) -> Option<([&'a GrayImage; 2], f64)> {
    let search = params.search();
    let greatest = f64::from(search.max_disparity().unsigned_abs().max(search.min_disparity().unsigned_abs()));
    let placed = swept.iter().map(|(offset, image)| (f64::from(offset.to_bits()) / f64::from(SweepOffset::STEPS), *image));
    let (left, right): (Vec<_>, Vec<_>) =
        placed.filter(|(offset, _)| offset.abs() >= LEAST_OFFSET).partition(|(offset, _)| *offset < 0.0);
    let pairs = left.iter().flat_map(|left| right.iter().map(move |right| (left, right)));
    let is_even = |left: f64, right: f64| (left + right).abs() / 2.0 * greatest <= MOST_UNEVEN;
    let even = pairs.filter(|(left, right)| is_even(left.0, right.0));
    let (left, right) = even.max_by(|a, b| (a.1.0 - a.0.0).total_cmp(&(b.1.0 - b.0.0)))?;
    Some(([left.1, right.1], (right.0 - left.0) / 2.0))
}

/// Confirms disparities of a method at an offset, in unit baselines, by those of the filter.
fn confirm(
    (map, confidences): (&mut DisparityMap, &mut ConfidenceMap),
    (filtered, confirmed): (&DisparityMap, &ConfidenceMap),
    offset: f32,
) {
    let own = map.pixels_mut().iter_mut().zip(confidences.pixels_mut());
    for ((disparity, sure), (other, other_sure)) in own.zip(filtered.pixels().iter().zip(confirmed.pixels())) {
        let (Some(d), Some(other)) = (disparity.map(f32::from), other.map(|d| offset * f32::from(d))) else { continue };
        if (d - other).abs() > SAME {
            continue;
        }
        let [p, q] = [*sure, *other_sure].map(|sure| f64::from(sure) / 255.0);
        let [own, weight] = [p, q].map(|p| p.powi(4) as f32);
        let mean = if own + weight > 0.0 { (own * d + weight * other) / (own + weight) } else { d };
        *disparity = nearest_disparity(mean);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn place(baselines: f64) -> SweepOffset {
        SweepOffset::from_bits((baselines * 4096.0).round() as i32).unwrap()
    }

    #[test]
    fn the_farthest_pair_of_even_places_is_matched() {
        let search = SearchConfig { min_disparity: 0, num_disparities: 33, ..SearchConfig::of_size(8, 8) }.checked().unwrap();
        let params = SweepParams::new(search, 16, 1).unwrap();
        let image = GrayImage::new(8, 8);
        let chosen = |places: &[f64]| {
            let swept: Vec<_> = places.iter().map(|at| (place(*at), &image)).collect();
            pair(&params, &swept).map(|(_, offset)| (offset * 100.0).round())
        };
        // A hundredth of a baseline moves matches by a third of a pixel, half of it on either side.
        assert_eq!(chosen(&[-1.0, 0.96, -0.9, 0.905, 0.5]), Some(90.0));
        assert_eq!(chosen(&[-1.0, 0.99]), Some(99.0));
        assert_eq!(chosen(&[-1.0, 0.96]), None);
        assert_eq!(chosen(&[-0.5, 0.5]), None);
        assert_eq!(chosen(&[0.8, 1.0]), None);
    }

    #[test]
    fn what_the_filter_confirms_is_surer() {
        let map = |d: [f32; 3]| DisparityMap::new(3, 1, d.map(nearest_disparity).to_vec());
        let (mut disparities, mut sure) = (map([4.0, 4.0, 4.0]), ConfidenceMap::new(3, 1, vec![200; 3]));
        // At half the baseline: 4.25, 8 and nothing sure.
        let (filtered, confirmed) = (map([8.5, 16.0, 8.0]), ConfidenceMap::new(3, 1, vec![200, 250, 0]));
        confirm((&mut disparities, &mut sure), (&filtered, &confirmed), 0.5);
        assert_eq!(disparities, map([4.125, 4.0, 4.0]));
        assert!(sure.pixels()[0] > 220 && sure.pixels()[1..] == [200; 2], "{sure:?}");
    }
}
