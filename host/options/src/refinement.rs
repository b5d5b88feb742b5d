//! The options of refinement: checks and filters of the selected disparities.

use clap::{Args, value_parser};
use multiscopic::{
    Result,
    stereo::{
        confidence_map,
        refinement::{
            BackgroundFill, Bilateral, LucasKanade, Median, OcclusionFill, Refinement, SearchMargin, Smoother, Speckles,
            TextureThreshold,
        },
    },
};

use crate::{
    page_entry::{Entry, Settings, Unset, method},
    value::{Named, named, point, probability},
};

/// The filters.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Filters")]
pub(crate) struct RefinementOptions {
    /// Search N disparities more beyond each end of the range, so as not to be sure of what the range cuts off [default: 0, 4 for
    /// net]
    #[arg(long, value_name = "N")]
    search_margin: Option<u16>,

    /// Keep a disparity only if a view confirms it to within this many pixels; not for gc (OpenCV: disp12MaxDiff)
    /// [default: keep all]
    #[arg(long, value_name = "N")]
    disp12_max_diff: Option<u16>,

    /// Keep a disparity only if every candidate more than a pixel away costs over N percent more; not for gc (OpenCV:
    /// uniquenessRatio of StereoBM) [default: keep all]
    #[arg(long, value_name = "N", value_parser = value_parser!(u8).range(0..=100))]
    uniqueness_ratio: Option<u8>,

    /// Keep a disparity only where the sum of the slopes of grey over the block, each up to 31, is at least this (OpenCV:
    /// textureThreshold) [default: keep all]
    #[arg(long, value_name = "N")]
    texture_threshold: Option<u32>,

    /// Remove patches of up to this many pixels that stand alone in what --min-confidence keeps (OpenCV: speckleWindowSize)
    /// [default: none]
    #[arg(long, value_name = "N")]
    speckle_window_size: Option<u32>,

    /// By how many pixels neighbouring disparities of a patch may differ (OpenCV: speckleRange of StereoSGBM)
    #[arg(long, value_name = "N", default_value_t = Speckles::DEFAULT_RANGE, requires = "speckle_window_size")]
    speckle_range: u16,

    /// Median filter with a window of this size, odd, from 3 to 31 pixels [default: none]
    #[arg(long, value_name = "N")]
    median: Option<u8>,

    /// Bilateral filter: mean of the disparities that differ by less than THRESHOLD, weighted by a Gaussian of SIGMA pixels
    /// [default: none]
    #[arg(long, value_name = "SIGMA,THRESHOLD", value_parser = point)]
    bilateral: Option<[f64; 2]>,

    /// Sharpen disparities by up to half a pixel, after the filters above [default: none, lucas-kanade for net]
    #[arg(long, value_name = "STEP", value_parser = named::<SubPixelName>())]
    sub_pixel: Option<SubPixelName>,

    /// Replace disparities that are more probably wrong than right by what is sure around them, within the edges of the centre
    /// image; others move by up to half a pixel [default: none, smooth for net]
    #[arg(long, value_name = "STEP", value_parser = named::<RepairName>())]
    repair: Option<RepairName>,

    /// Fill what the only neighbour does not see [default: none, background for net with one neighbour]
    #[arg(long, value_name = "STEP", value_parser = named::<HiddenName>())]
    hidden: Option<HiddenName>,

    /// Keep a disparity only if it is at most one pixel off with this probability, from 0 to 1: 0.9 for few mistakes [default:
    /// keep all]
    #[arg(long, value_name = "P", value_parser = probability)]
    min_confidence: Option<f64>,

    /// Smooth disparities within the edges of the centre image, the less sure the more, so that all pixels get one: a dense map
    /// from what is sure
    #[arg(long)]
    smooth: bool,

    /// Fill invalid pixels, after all other filters
    #[arg(long, value_parser = named::<FillName>())]
    fill: Option<FillName>,
}

/// The filling of invalid pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FillName {
    /// From the farther side.
    Background,
}

impl Named for FillName {
    const ALL: &'static [FillName] = &[FillName::Background];

    fn name(&self) -> &'static str {
        BackgroundFill::NAME
    }

    fn about(&self) -> &'static str {
        "With the smaller of the nearest disparities to the left and to the right"
    }
}

/// The step that makes disparities more precise after matching.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SubPixelName {
    /// By the gradients of all views.
    LucasKanade,
    /// Not at all.
    None,
}

impl Named for SubPixelName {
    const ALL: &'static [SubPixelName] = &[SubPixelName::LucasKanade, SubPixelName::None];

    fn name(&self) -> &'static str {
        match self {
            SubPixelName::LucasKanade => LucasKanade::NAME,
            SubPixelName::None => "none",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            SubPixelName::LucasKanade => "To where the grey values of all views fit those of the centre best, by their gradients",
            SubPixelName::None => "Not at all",
        }
    }
}

/// The fate of disparities that are more probably wrong than right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RepairName {
    /// They follow what is sure around them.
    Smooth,
    /// They stay.
    None,
}

impl Named for RepairName {
    const ALL: &'static [RepairName] = &[RepairName::Smooth, RepairName::None];

    fn name(&self) -> &'static str {
        match self {
            RepairName::Smooth => "smooth",
            RepairName::None => "none",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            RepairName::Smooth => "By what --smooth gives there",
            RepairName::None => "Not at all",
        }
    }
}

/// The fate of disparities where the only neighbour sees nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HiddenName {
    /// They become those of the background.
    Background,
    /// They stay.
    None,
}

impl Named for HiddenName {
    const ALL: &'static [HiddenName] = &[HiddenName::Background, HiddenName::None];

    fn name(&self) -> &'static str {
        match self {
            HiddenName::Background => OcclusionFill::NAME,
            HiddenName::None => "none",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            HiddenName::Background => "From the farther surface beside it; no effect with more neighbours",
            HiddenName::None => "Not at all",
        }
    }
}

/// Returns true if the method has costs that checks can look at.
fn has_costs(settings: &Settings) -> bool {
    !matches!(method(settings), "gc" | "net")
}

impl RefinementOptions {
    /// The controls of the page.
    pub(crate) const ON_PAGE: [Entry; 12] = [
        Entry::slider("uniqueness-ratio", "Uniqueness ratio, %", [0.0, 60.0, 1.0], 10.0, Unset::Off).if_(has_costs),
        Entry::slider("disp12-max-diff", "Left-right check, px", [0.0, 16.0, 1.0], 1.0, Unset::Off).if_(has_costs),
        Entry::slider("texture-threshold", "Texture threshold", [0.0, 4000.0, 10.0], 200.0, Unset::Off).if_(has_costs),
        Entry::slider("median", "Median, px", [3.0, 31.0, 2.0], 5.0, Unset::Off),
        Entry::slider("speckle-window-size", "Speckles up to, pixels", [10.0, 3000.0, 10.0], 200.0, Unset::Off),
        Entry::slider("speckle-range", "Speckle range, px", [0.0, 16.0, 1.0], 1.0, Unset::Default)
            .if_(|settings| settings.contains_key("speckle-window-size")),
        Entry::list("sub-pixel", "Sub-pixel step"),
        Entry::list("repair", "Repair"),
        Entry::list("hidden", "Hidden from the only neighbour"),
        Entry::slider("min-confidence", "Least confidence", [0.0, 1.0, 0.01], 0.9, Unset::Off),
        Entry::list("smooth", "Smooth"),
        Entry::list("fill", "Fill from the background"),
    ];

    /// Returns true if a filter counts in blocks.
    pub(crate) fn has_blocks(&self) -> bool {
        self.texture_threshold.is_some()
    }

    /// Returns the refinement of a method, which has these `defaults` and smooths with `smoother`. Texture counts in blocks of
    /// `block_size`.
    pub(crate) fn refinement(&self, defaults: &Refinement, smoother: Smoother, block_size: u8) -> Result<Refinement> {
        let sharpens = defaults.sub_pixel.is_some();
        let repairs = defaults.repair.is_some();
        let fills = defaults.occlusions.is_some();
        let speckles = |window_size| Speckles { window_size, range: self.speckle_range };
        Ok(Refinement {
            margin: self.search_margin.map_or(defaults.margin, SearchMargin::of),
            uniqueness: self.uniqueness_ratio,
            texture: self.texture_threshold.map(|threshold| TextureThreshold { threshold, block_size }),
            speckles: self.speckle_window_size.map(speckles),
            left_right: self.disp12_max_diff,
            sub_pixel: self.sub_pixel.map_or(sharpens, |name| name == SubPixelName::LucasKanade).then_some(LucasKanade),
            repair: self.repair.map_or(repairs, |name| name == RepairName::Smooth).then_some(smoother),
            occlusions: self
                .hidden
                .map_or(fills, |name| name == HiddenName::Background)
                .then(|| defaults.occlusions.unwrap_or_default()),
            median: self.median.map(Median::new).transpose()?,
            bilateral: self.bilateral.map(|[sigma, threshold]| Bilateral::new(sigma, threshold)).transpose()?,
            smoother: self.smooth.then_some(smoother),
            fill: self.fill.map(|FillName::Background| BackgroundFill),
            min_confidence: self.min_confidence(),
        })
    }

    /// The least confidence of a disparity that is kept, if one was asked for.
    pub(crate) fn min_confidence(&self) -> Option<u8> {
        self.min_confidence.map(confidence_map::of_probability)
    }
}
