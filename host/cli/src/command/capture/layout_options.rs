//! The options of where frames are taken.

use clap::Args;
use multiscopic::{Error, Result, capture::Accuracy};
use multiscopic_core::{View, Views};

use crate::command::options::{NeighborOptions, micrometres, value::positive};

/// The layout of the frames.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Layout")]
pub struct LayoutOptions {
    /// Distance from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true, required_unless_present = "baselines")]
    baseline: Option<f64>,

    /// Several baselines in millimetres, such as 5,20,80: whole multiples of the first, up to 16. At the first one the whole
    /// layout is taken, at the others the views in the centre's row and column; `match` goes from short to long
    #[arg(
        long,
        value_name = "MM,MM",
        value_parser = positive,
        allow_negative_numbers = true,
        value_delimiter = ',',
        conflicts_with = "baseline"
    )]
    baselines: Vec<f64>,

    #[command(flatten)]
    neighbors: NeighborOptions,

    /// Depth accuracy in millimetres out to a distance in millimetres, such as 0.5@600: the frames are matched, and if they are
    /// not accurate enough, views at a longer baseline that gives it are taken as well; needs the focal length
    #[arg(long, value_name = "MM@DISTANCE", conflicts_with = "baselines")]
    pub accuracy: Option<Accuracy>,
}

impl LayoutOptions {
    /// The shortest baseline in millimetres.
    pub fn baseline_mm(&self) -> f64 {
        self.baseline.or(self.baselines.first().copied()).unwrap_or_default()
    }

    /// The shortest baseline in micrometres.
    pub fn baseline_um(&self) -> Result<u32> {
        micrometres(if self.baselines.is_empty() { "--baseline" } else { "--baselines" }, self.baseline_mm())
    }

    /// The neighbours at the shortest baseline.
    pub fn nearest(&self) -> Result<Views> {
        self.neighbors.views()
    }

    /// All neighbours, at all baselines.
    pub fn views(&self) -> Result<Views> {
        let (nearest, baseline_um) = (self.nearest()?, self.baseline_um()?);
        let mut views: Vec<View> = nearest.iter().collect();
        for baseline in self.baselines.iter().skip(1) {
            let um = micrometres("--baselines", *baseline)?;
            let multiple = um / baseline_um;
            if !um.is_multiple_of(baseline_um) || !(2..=View::MAX_OFFSET as u32).contains(&multiple) {
                return Err(Error::Usage(format!(
                    "--baselines includes {baseline} mm, it must be a whole multiple of the first, {} mm, from 2 to {}",
                    self.baseline_mm(),
                    View::MAX_OFFSET
                )));
            }
            views.extend(at_multiple(nearest, multiple as u8).iter());
        }
        let (count, views) = (views.len(), views.into_iter().collect::<Views>());
        match views.len() == count {
            true => Ok(views),
            false => Err(Error::Usage(format!(
                "there are {count} views, some of them at the same place or more than {}: choose fewer, or longer baselines",
                Views::MAX
            ))),
        }
    }
}

/// The nearest neighbours among `views` in the row and the column of the centre, at `multiple` baselines.
pub fn at_multiple(views: Views, multiple: u8) -> Views {
    View::CROSS.into_iter().filter(|view| views.contains(*view)).filter_map(|view| view.times(multiple)).collect()
}
