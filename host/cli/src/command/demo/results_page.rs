//! The page with the results.

use multiscopic::files::FrameFiles;
use multiscopic_core::{BlockMatchingParams, Views};

use super::{
    results_folder::{TRUTH_PNG, errors_png, frames, map_png},
    variants::{caption, stem},
};
use crate::{
    command::{charts::Errors, variant::Variant},
    report::{Figure, Report, ViewedScene, error_map},
    results::{Record, ResultRow},
};

const ABOUT_THE_SCENE: &str = "The views are ray-traced: a still life on a brushed metal table, 0.4 m to 2.1 m from the camera. \
                               It contains what makes matching hard: stems thinner than a block, a blank canvas on the wall, \
                               reflections that move with the camera, repeated patterns, slanted and curved surfaces. The sensor \
                               is noisy, and the stage misses its positions by up to 0.1 mm. The truth is exact: the depth at \
                               which the ray through the middle of each pixel meets a surface.";

const REPRODUCE: &str = "The first command makes this page and its files. The second matches the captured folder, as it would a \
                         real one.";

/// The contents of the page.
pub struct ResultsPage<'a> {
    /// The commands that make the results again.
    pub commands: &'a str,
    /// All views of the capture.
    pub views: Views,
    /// The variants that are compared, and their accuracy.
    pub errors: &'a Errors<'a>,
    /// The parameters of the first variant; all variants share range and block.
    pub params: &'a BlockMatchingParams,
    /// The maps and pictures to look at.
    pub scene: &'a ViewedScene,
    /// The measurement with the fewest errors.
    pub best: &'a Record,
    /// The other methods that are shown.
    pub others: &'a [Variant],
    /// The rows of the table.
    pub rows: &'a [ResultRow],
}

impl ResultsPage<'_> {
    /// The page in HTML.
    pub fn to_html(&self) -> String {
        let ResultsPage { params, errors: Errors { variants, .. }, .. } = self;
        let map = |variant: &Variant| Figure::linked(caption(variant), map_png(&stem(variant)));
        let error_map = |variant: &Variant| Figure::linked(caption(variant), errors_png(&stem(variant)));
        let truth = Figure::linked("truth", TRUTH_PNG);
        let block_size = params.block_size();
        let pictures = frames(self.views).into_iter().map(|(frame, caption)| Figure::linked(caption, FrameFiles::name_of(frame)));
        let title = if self.views == Views::CROSS { "The five views".into() } else { format!("The {} views", pictures.len()) };
        let page = Report::new("Depth from one camera that moves")
            .paragraph(&self.summary())
            .viewer(self.commands.lines().next().unwrap_or_default(), std::slice::from_ref(self.scene))
            .heading("Errors")
            .table(ResultRow::HEADINGS, self.rows.iter().map(ResultRow::cells))
            .paragraph(&format!(
                "Disparities from {} to {}, blocks of {block_size} x {block_size}. RMS and AvgErr are in pixels, with the \
                 change from stereo in brackets; the other columns are percentages of pixels.",
                params.min_disparity(),
                params.max_disparity()
            ));
        self.errors
            .charts()
            .iter()
            .fold(page, Report::chart)
            .gallery(&title, pictures)
            .paragraph(ABOUT_THE_SCENE)
            .gallery("Disparities", std::iter::once(truth).chain(variants.iter().chain(self.others).map(map)))
            .paragraph("Red is near, blue is far, black has no disparity. All maps share one colour scale.")
            .gallery("Error maps", variants.iter().chain(self.others).map(error_map))
            .paragraph(&format!("Difference from the truth: {}.", error_map::LEGEND))
            .heading("Reproduce this")
            .paragraph(REPRODUCE)
            .code(self.commands)
            .to_html()
    }

    /// The first and the last record in words, and the best one.
    fn summary(&self) -> String {
        let [stereo, .., last] = self.errors.records else { unreachable!("there are several variants") };
        let accuracy = |record: &Record| {
            let (rms, bad) = (record.metrics.rms, record.metrics.bad_1);
            format!("an RMS error of {rms:.2} px, with {bad:.1} % of the pixels off by more than one")
        };
        let moves = if self.views == Views::CROSS {
            "A camera takes a picture, moves one baseline to the left, to the right, up and down, and takes another each time."
        } else {
            "A camera takes a picture, moves in its image plane by whole baselines, and takes another each time."
        };
        let all = if last.baselines.is_empty() { "at once" } else { "at several baselines" };
        let best = match self.best.method == last.method {
            true => String::new(),
            false => format!(" The best of the methods, {}, has {}.", self.best.method, accuracy(self.best)),
        };
        format!(
            "{moves} Block matching with one neighbour, as in stereo, has {}. With all {} {all}, it has {}.{best}",
            accuracy(stereo),
            last.views,
            accuracy(last)
        )
    }
}
