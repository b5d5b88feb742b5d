//! Evaluation of captured folders: the measurements of a rig, and their tables.

use multiscopic::{
    DisparityMap, Error, FloatImage, Geometry, Metrics, Result,
    evaluation::{DepthErrors, PlaneFit, TemporalNoise, WallMetrics},
    files::output,
    images::ImageRegion,
};
use serde::Serialize;

use super::{Evaluate, PAGE_BYTES, PreparedRig, RigFiles, comparison::MethodTable};
use crate::{
    command::{
        advice,
        options::Source,
        preparation::mask_unseen,
        terminal,
        variant::Variant,
        view::{command_line, matched_map},
    },
    report::{Figure, Report, ViewedScene, error_map},
    results::{self, Record, ResultRow, text_table},
};

/// The share of outliers in percent above which a region may be no wall.
const NO_WALL: f64 = 20.0;

impl Evaluate {
    /// Matches all captures by all variants, and compares the results with the truth, a plane and each other.
    pub(super) fn run_rigs(&self) -> Result<()> {
        let mut rigs = self.directories.iter().map(|directory| self.rig.files(directory)).collect::<Result<Vec<_>>>()?;
        self.check_rigs(&rigs)?;
        let views = rigs[0].source.images.views();
        let variants = self.comparison.variants_of_rig(views, &self.options, &self.long_baselines)?;
        let methods = MethodTable::new(&variants, &self.options, self.search.block_size, &self.long_baselines)?;
        output::check(&self.outputs(), &rigs.iter().flat_map(RigFiles::paths).collect::<Vec<_>>())?;
        let engine = self.engine.engine()?;

        let bar = terminal::progress((rigs.len() * variants.len()) as u64, "maps");
        let (mut records, mut viewed, mut planes, mut warnings) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut maps: Vec<Vec<DisparityMap>> = vec![Vec::new(); variants.len()];
        let mut first: Option<([usize; 2], Option<Geometry>)> = None;
        for files in &mut rigs {
            let name = files.directory.display().to_string();
            bar.set_message(terminal::visible(&name).into_owned());
            let rig = files.load(&self.geometry, &self.preparation, &self.search, &self.engine.memory)?;
            let size = rig.frames.size();
            check_same(&name, size, rig.geometry, *first.get_or_insert((size, rig.geometry)))?;
            let mut seen = self.report.as_ref().map(|_| {
                ViewedScene::new(&*name, size)
                    .with_geometry(rig.geometry.as_ref())
                    .with_truth(rig.truth.as_ref())
                    .with_frames(&rig.frames, None)
            });
            for (variant, maps) in variants.iter().zip(&mut maps) {
                let search = self.search.search(size, variant.views, Some(variant.fusion), rig.preparation.range)?;
                let method = methods.get(variant);
                let gray = (!method.needs_color()).then(|| rig.frames.clone().without_color());
                let (mut disparities, mut confidences, seconds) =
                    variant.timed(method, &engine, gray.as_ref().unwrap_or(&rig.frames), &search)?;
                mask_unseen(rig.undistortion.as_ref(), &mut disparities, Some(&mut confidences));
                let (metrics, plane) = self.measure(&rig, &disparities, variant).map_err(|error| match error {
                    Error::Usage(message) => Error::Usage(format!("{name}: {message}")),
                    Error::Plane(error) => Error::Usage(format!("{name}: {error}")),
                    other => other,
                })?;
                let record = variant.record("rig", &name, metrics, seconds);
                if let Some(seen) = &mut seen {
                    seen.add(matched_map(
                        record.variant(),
                        (variant.method.name(), method),
                        &search,
                        (&disparities, Some(&confidences)),
                        Some(seconds),
                    ));
                    planes.extend(plane.map(|plane| {
                        let estimates = disparities.pixels().iter().map(|d| d.map(f32::from));
                        let errors = error_map::draw(estimates, &plane_map(&plane, size, self.rig.region(size)));
                        Figure::embedded(format!("{name}, {}", record.variant()), errors)
                    }));
                }
                for warning in advice::warnings(&rig.preparation, &disparities, &search).into_iter().chain(no_wall(&metrics)) {
                    let warning = format!("{name}: {warning}");
                    if !warnings.contains(&warning) {
                        warnings.push(warning);
                    }
                }
                records.push(record);
                maps.push(disparities);
                bar.inc(1);
            }
            viewed.extend(seen);
        }
        bar.finish_and_clear();
        let (size, geometry) = first.unwrap_or_default();
        for (k, record) in records.iter_mut().enumerate() {
            record.metrics.noise = TemporalNoise::new(&maps[k % variants.len()], geometry.as_ref(), self.rig.region(size));
        }
        ViewedScene::fit(&mut viewed, PAGE_BYTES);
        self.write_rigs(&records, &viewed, planes)?;
        warnings.iter().for_each(|warning| terminal::warn(warning));
        Ok(())
    }

    /// Refuses folders that are no captures of one rig, and those with nothing to compare them with.
    fn check_rigs(&self, rigs: &[RigFiles]) -> Result<()> {
        let views = |files: &RigFiles| files.source.images.views();
        if let Some(other) = rigs.iter().find(|other| views(other) != views(&rigs[0])) {
            let [first, other] = [&rigs[0], other].map(|files| files.directory.display());
            return Err(Error::Usage(format!("{other} has other views than {first}: give captures of one rig")));
        }
        if self.rig.plane.is_none() && rigs.len() < 2 && rigs[0].truth.is_none() {
            return Err(Error::Usage(format!(
                "there is nothing to compare {} with: give --truth, --plane, or several captures of the same scene",
                rigs[0].directory.display()
            )));
        }
        if let Some(Some(_)) = self.rig.plane {
            for files in rigs {
                let Source { rig, lens, .. } = &files.source;
                self.geometry.refuse_missing("--plane with a distance", rig.as_ref(), lens.as_ref())?;
            }
        }
        Ok(())
    }

    fn measure(
        &self,
        rig: &PreparedRig,
        disparities: &DisparityMap,
        variant: &Variant,
    ) -> Result<(RigMetrics, Option<PlaneFit>)> {
        let (geometry, truth) = (rig.geometry.as_ref(), rig.truth.as_ref());
        let fit = |distance_mm| {
            let region = self.rig.region([disparities.width(), disparities.height()]);
            WallMetrics::new(disparities, geometry, region, distance_mm)
        };
        let (plane, fitted) = self.rig.plane.map(fit).transpose()?.unzip();
        let valid = disparities.pixels().iter().flatten().count();
        let errors = |truth| {
            let hint =
                || Error::Usage(format!("no pixel of the truth is in the rectified centre, with {} views", variant.views.len()));
            Metrics::new(disparities, truth).ok_or_else(hint)
        };
        let metrics = RigMetrics {
            truth: truth.map(errors).transpose()?,
            fill_rate: 100.0 * valid as f64 / disparities.pixels().len() as f64,
            depth: truth.zip(geometry).and_then(|(truth, geometry)| DepthErrors::new(disparities, truth, geometry)),
            plane,
            noise: None,
        };
        Ok((metrics, fitted))
    }

    fn write_rigs(&self, records: &[Record<RigMetrics>], scenes: &[ViewedScene], planes: Vec<Figure>) -> Result<()> {
        let tables = RigTable::all(records);
        let report = self.report.as_ref().map(|_| {
            let page = Report::new("How good the rig is").viewer(&command_line(), scenes);
            let page = tables.iter().fold(page, |page, table| table.add_to(page));
            if planes.is_empty() { page } else { page.gallery("Distance from the plane", planes).paragraph(error_map::LEGEND) }
        });
        self.write(records, report)?;
        terminal::print(&tables.iter().map(RigTable::to_text).collect::<Vec<_>>().join("\n"))
    }
}

/// Refuses a capture that is not of the rig of the first one.
fn check_same(
    name: &str,
    [width, height]: [usize; 2],
    geometry: Option<Geometry>,
    (first, first_geometry): ([usize; 2], Option<Geometry>),
) -> Result<()> {
    if first != [width, height] {
        let [first_width, first_height] = first;
        return Err(Error::Usage(format!(
            "{name} has images of {width}x{height} pixels, those before it {first_width}x{first_height}: give captures of one rig"
        )));
    }
    // The principal points of rectified captures differ a little.
    let lengths = |geometry: Geometry| (geometry.focal_px, geometry.baseline_mm, geometry.doffs);
    match geometry.map(lengths) == first_geometry.map(lengths) {
        true => Ok(()),
        false => Err(Error::Usage(format!(
            "{name} has another focal length, baseline or doffs than those before it: give captures of one rig"
        ))),
    }
}

/// The disparities of a plane in a region, unknown elsewhere.
fn plane_map(plane: &PlaneFit, [width, height]: [usize; 2], region: ImageRegion) -> FloatImage {
    let mut map = FloatImage::filled(width, height, f32::INFINITY);
    for [u, v] in region.pixels() {
        map.row_mut(v)[u] = plane.disparity([u as f64, v as f64]) as f32;
    }
    map
}

fn no_wall(metrics: &RigMetrics) -> Option<String> {
    let outliers = metrics.plane.map(|plane| plane.outliers).filter(|outliers| *outliers > NO_WALL)?;
    Some(format!(
        "{outliers:.0} % of the disparities are off the plane by more than a pixel: give a --region that shows nothing but a flat wall"
    ))
}

/// The measurements of a capture that a variant matched.
#[derive(Clone, Copy, Debug, Serialize)]
struct RigMetrics {
    /// The errors of disparities, if the truth is known.
    #[serde(flatten)]
    truth: Option<Metrics>,
    /// The share of valid pixels, in percent.
    fill_rate: f64,
    /// The errors of depth, if the truth and the geometry are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<DepthErrors>,
    /// The errors of a wall, if the scene is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    plane: Option<WallMetrics>,
    /// The noise over all captures, if there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<TemporalNoise>,
}

/// A table of results.
struct RigTable {
    title: &'static str,
    explanation: &'static str,
    headings: Vec<&'static str>,
    /// The number of columns with names.
    names: usize,
    rows: Vec<Vec<String>>,
}

impl RigTable {
    /// The tables of what was measured.
    fn all(records: &[Record<RigMetrics>]) -> Vec<RigTable> {
        let tables = [RigTable::truth(records), RigTable::depth(records), RigTable::plane(records), RigTable::noise(records)];
        tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
    }

    /// The table in plain text.
    fn to_text(&self) -> String {
        format!("{}\n\n{}", self.title, text_table(&self.headings, &self.rows, self.names, terminal::columns()))
    }

    /// A page with the table.
    fn add_to(&self, page: Report) -> Report {
        page.heading(self.title).paragraph(self.explanation).table(&self.headings, &self.rows)
    }

    fn truth(records: &[Record<RigMetrics>]) -> RigTable {
        let with = |record: &Record<RigMetrics>| Some(record.clone().with_metrics(record.metrics.truth?));
        let records: Vec<Record> = records.iter().filter_map(with).collect();
        RigTable {
            title: "Disparities against the truth",
            explanation: "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages. \
                          Invalid pixels count as bad, and as a disparity of 0.",
            headings: ResultRow::HEADINGS.into(),
            names: 2,
            rows: results::rows(&records).iter().map(|row| row.cells().into()).collect(),
        }
    }

    fn depth(records: &[Record<RigMetrics>]) -> RigTable {
        let cells = |record: &Record<RigMetrics>| {
            let DepthErrors { median_mm, median_percent, rms_percent, bias_percent } = record.metrics.depth?;
            let percent = [format!("{median_percent:.3}"), format!("{rms_percent:.3}"), format!("{bias_percent:+.3}")];
            Some([names(record).to_vec(), vec![format!("{median_mm:.2}")], percent.to_vec()].concat())
        };
        RigTable {
            title: "Depth against the truth",
            explanation: "Medians of the absolute error, in millimetres and in percent of the true depth, the root mean square and the \
                          median of the error in percent, over the pixels that have a depth.",
            headings: vec!["scene", "method", "median mm", "median %", "RMS %", "bias %"],
            names: 2,
            rows: records.iter().filter_map(cells).collect(),
        }
    }

    fn plane(records: &[Record<RigMetrics>]) -> RigTable {
        let cells = |record: &Record<RigMetrics>| {
            let WallMetrics { fill_rate, rms_px, outliers, place } = record.metrics.plane?;
            let or_dash = |number: Option<String>| number.unwrap_or("-".into());
            let place = [
                place.map(|place| format!("{:.2}", place.rms_mm)),
                place.map(|place| format!("{:.3}", place.rms_percent)),
                place.map(|place| format!("{:.1}", place.distance_mm)),
                place.and_then(|place| place.z_accuracy_percent).map(|percent| format!("{percent:+.3}")),
                place.map(|place| format!("{:.2}", place.tilt_deg)),
                place.map(|place| format!("{:+.2}", place.recedes_right_deg)),
                place.map(|place| format!("{:+.2}", place.recedes_down_deg)),
            ];
            let pixels = [format!("{fill_rate:.2}"), format!("{outliers:.2}"), format!("{rms_px:.4}")];
            Some([names(record).to_vec(), pixels.to_vec(), place.map(or_dash).to_vec()].concat())
        };
        RigTable {
            title: "A flat wall",
            explanation: "The share of valid pixels in the region, that of outliers by more than a pixel, the root mean square distance \
                          from the plane in pixels, millimetres and percent of the distance, the distance along the optical axis, the \
                          signed error of it in percent, and by how much the wall recedes in all, to the right and downwards.",
            headings: vec![
                "scene",
                "method",
                "fill %",
                "outliers %",
                "RMS px",
                "RMS mm",
                "RMS %",
                "distance mm",
                "Z accuracy %",
                "tilt deg",
                "right deg",
                "down deg",
            ],
            names: 2,
            rows: records.iter().filter_map(cells).collect(),
        }
    }

    fn noise(records: &[Record<RigMetrics>]) -> RigTable {
        let mut rows: Vec<Vec<String>> = Vec::new();
        for record in records {
            let Some(TemporalNoise { captures, valid, px, mm, percent }) = record.metrics.noise else { continue };
            let number = |number: Option<f64>| number.map_or("-".into(), |number| format!("{number:.3}"));
            let numbers = [captures.to_string(), format!("{valid:.2}"), format!("{px:.4}"), number(mm), number(percent)];
            let row = [vec![record.variant()], numbers.to_vec()].concat();
            // All captures of a variant share the noise.
            if !rows.contains(&row) {
                rows.push(row);
            }
        }
        RigTable {
            title: "Noise over the captures",
            explanation: "The median over the pixels of the standard deviation over the captures, in pixels, millimetres and percent of \
                          the depth, over the pixels that are valid in all captures.",
            headings: vec!["method", "captures", "valid %", "px", "mm", "%"],
            names: 1,
            rows,
        }
    }
}

fn names(record: &Record<RigMetrics>) -> [String; 2] {
    [record.scene.clone(), record.variant()]
}
