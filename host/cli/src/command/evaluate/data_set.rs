//! Evaluation of data sets.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    process::ExitCode,
};

use indicatif::ProgressBar;
use multiscopic::{
    Dataset, Engine, Error, Metrics, Result,
    evaluation::{CameraSteps, ConfidenceMetrics, DatasetScene, LightFieldMetrics, Sparsification},
    files::output,
};
use multiscopic_core::Views;
use serde::{Deserialize, Serialize};

use super::{Evaluate, PAGE_BYTES, comparison::MethodTable, print_tables};
use crate::{
    command::{
        batch::{Done, RunSettings},
        limits, terminal,
        variant::{Errors, Measured, Subject, Variant, sparsification},
        view::{command_line, matched_map},
    },
    report::{Chart, Report, ViewedMap, ViewedScene},
    results::{self, Record, ResultRow},
};

/// The comparison on the scenes of a data set.
struct Contest<'a> {
    dataset: Dataset,
    variants: &'a [Variant],
    methods: MethodTable<'a>,
    engine: Engine,
    bar: ProgressBar,
}

/// The measurements on a scene.
struct SceneResults {
    /// A record for each variant.
    records: Vec<Record>,
    /// A curve for each variant.
    curves: Vec<Sparsification>,
    /// The maps and pictures to look at, if there is a page.
    viewed: Option<ViewedScene>,
}

impl Evaluate {
    /// Matches the scenes by all variants, and compares the results with the truth: all scenes, or those of the share of this
    /// machine.
    pub(super) fn run_dataset(&self, dataset: Dataset, directory: &Path, settings: &RunSettings) -> Result<ExitCode> {
        let dataset = self.comparison.dataset(dataset)?;
        let options = self.options.clone().for_dataset(dataset);
        let variants = self.comparison.variants(dataset, &options, &self.long_baselines)?;
        let methods = MethodTable::new(&variants, &options, self.search.block_size, &self.long_baselines)?;
        let scenes = self.selected_scenes(dataset, directory)?;
        let inputs = |scene: &DatasetScene| -> BTreeSet<PathBuf> {
            let images = variants.iter().map(|variant| scene.images(variant.views));
            images.flat_map(|images| images.paths().map(PathBuf::from).collect::<Vec<_>>()).chain([scene.truth()]).collect()
        };
        let batch = self.batch.batch(settings, scenes.iter().map(|scene| scene.name.clone()))?;
        let all: Vec<PathBuf> = scenes.iter().flat_map(inputs).collect();
        output::check(&self.outputs(), &all.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let bar = match &batch {
            Some(_) => ProgressBar::hidden(),
            None => terminal::progress((scenes.len() * variants.len()) as u64, "maps"),
        };
        let contest = Contest { dataset, variants: &variants, methods, engine: self.engine.engine()?, bar };
        match batch {
            Some(batch) => Ok(batch.run(
                |index| Ok(inputs(&scenes[index]).into_iter().collect()),
                |index, _| {
                    let SceneResults { records, .. } = self.measure_scene(&contest, &scenes[index])?;
                    let name = &scenes[index].name;
                    terminal::say(&format!("{name}: {} maps compared with the truth", records.len()));
                    let results: Vec<SceneRecord> = records.into_iter().map(SceneRecord::from).collect();
                    Ok(Done { results, outputs: Vec::new() })
                },
            )),
            None => {
                let scenes = scenes.iter().map(|scene| self.measure_scene(&contest, scene)).collect::<Result<Vec<_>>>()?;
                contest.bar.finish_and_clear();
                self.write_scenes(&contest, scenes)?;
                Ok(ExitCode::SUCCESS)
            }
        }
    }

    fn measure_scene(&self, contest: &Contest, scene: &DatasetScene) -> Result<SceneResults> {
        let Contest { dataset, variants, methods, engine, bar } = contest;
        bar.set_message(terminal::visible(&scene.name).into_owned());
        // As many as fit a set, which is all but for large arrays at several baselines.
        let most: Views = variants.iter().flat_map(|variant| variant.views.iter()).collect();
        let (mut frames, center, truth) = scene.load(most, limits())?;
        let mut viewed = self.report.as_ref().map(|_| {
            ViewedScene::new(&*scene.name, frames.size()).with_frames(&frames, Some(&center.to_rgb())).with_truth(Some(&truth))
        });
        let (mut records, mut curves) = (Vec::new(), Vec::new());
        for variant in *variants {
            if !variant.views.iter().all(|view| frames.views().contains(view)) {
                (frames, ..) = scene.load(variant.views, limits())?;
            }
            let subject = Subject {
                dataset: dataset.name(),
                scene: &scene.name,
                camera_steps: dataset.camera_steps(),
                frames: &frames,
                truth: &truth,
            };
            let search = self.search.search(frames.size(), variant.views, Some(variant.fusion), dataset.range())?;
            let method = methods.get(variant);
            let Measured { disparities, confidences, curve, record } = variant.measure(method, engine, &subject, &search)?;
            curves.push(curve);
            // The disparities, and the truth, are those at four camera steps.
            let light_field = matches!(dataset, Dataset::Hci4d(_))
                .then(|| LightFieldMetrics::new(&disparities, &truth, CameraSteps::Four.count().into()));
            records.push(Record { light_field: light_field.flatten(), ..record });
            let record = records.last().expect("it has just been added");
            if let Some(viewed) = &mut viewed {
                let results = (&disparities, Some(&confidences));
                let map = matched_map(record.variant(), (variant.method.name(), method), &search, results, record.seconds);
                let costs = map.costs.filter(|_| dataset.camera_steps().is_none());
                let (metrics, reduction) = (Some(record.metrics), record.reduction(&records));
                viewed.add(ViewedMap { metrics, reduction, costs, ..map });
            }
            bar.inc(1);
        }
        Ok(SceneResults { records, curves, viewed })
    }

    /// Writes what was measured, and prints the tables.
    fn write_scenes(&self, contest: &Contest, scenes: Vec<SceneResults>) -> Result<()> {
        let (mut records, mut curves, mut viewed) = (Vec::new(), Vec::new(), Vec::new());
        for scene in scenes {
            records.extend(scene.records);
            curves.extend(scene.curves);
            viewed.extend(scene.viewed);
        }
        ViewedScene::fit(&mut viewed, PAGE_BYTES);
        let report = self.report.as_ref().map(|_| self.page(contest, &records, &curves, &viewed));
        self.write(&records, report)?;
        print_tables(&records)
    }

    fn page(&self, contest: &Contest, records: &[Record], curves: &[Sparsification], scenes: &[ViewedScene]) -> Report {
        let Contest { dataset, variants, .. } = contest;
        let baselines = match dataset.camera_steps() {
            None => "baselines".to_owned(),
            Some(CameraSteps::One) => "camera steps".into(),
            Some(steps) => format!("baselines of {steps} camera steps"),
        };
        let has_default_fusion = self.comparison.has_default_fusion();
        let errors = Errors { variants, records, has_default_fusion, baselines: &baselines };
        let curves = sparsification(variants, records, curves);
        let charts: Vec<Chart> = errors.charts().into_iter().chain([curves]).collect();
        let page = Report::new(format!("Errors on {dataset}"))
            .viewer(&command_line(), scenes)
            .paragraph(
                "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages.",
            )
            .table(ResultRow::HEADINGS, results::rows(records).iter().map(ResultRow::cells))
            .paragraph(
                "Confidences: AUC is the mean share of wrong pixels, those with an error above 1 pixel, as the least sure are taken \
                 away, and the optimum what is possible; ECE is by how much confidences differ from the share that is right; Bad1 is in \
                 percent of the surest.",
            )
            .table(results::CONFIDENCE_HEADINGS, results::confidence_rows(records));
        let page = match &results::light_field_rows(records)[..] {
            [] => page,
            rows => page
                .paragraph(
                    "The light field benchmark's measures: the percentage of pixels with an error above 0.07, 0.03 and 0.01 pixels from \
                     camera to camera, and the mean square error, without 15 pixels at the border.",
                )
                .table(results::LIGHT_FIELD_HEADINGS, rows),
        };
        charts.iter().fold(page, Report::chart)
    }

    /// The scenes that `--scenes` selects.
    fn selected_scenes(&self, dataset: Dataset, directory: &Path) -> Result<Vec<DatasetScene>> {
        let mut scenes = dataset.scenes(directory)?;
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if let Some(unknown) = self.scenes.iter().find(|name| !names.contains(&name.as_str())) {
            let (directory, names) = (directory.display(), names.join(", "));
            return Err(Error::Usage(format!("--scenes includes {unknown}, which is not in {directory}: choose from {names}")));
        }
        scenes.retain(|scene| self.scenes.is_empty() || self.scenes.contains(&scene.name));
        Ok(scenes)
    }
}

/// A result of a variant. In its parts, since `serde_json` does not read real numbers that are flattened if anything in the
/// program turns on its arbitrary precision.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneRecord {
    variant: Record<()>,
    metrics: Metrics,
    confidence: Option<ConfidenceMetrics>,
    light_field: Option<LightFieldMetrics>,
}

impl From<Record> for SceneRecord {
    /// Without the time, which is another on each machine.
    fn from(record: Record) -> SceneRecord {
        let Record { metrics, confidence, light_field, .. } = record;
        let variant = Record { confidence: None, light_field: None, seconds: None, ..record.with_metrics(()) };
        SceneRecord { variant, metrics, confidence, light_field }
    }
}

impl From<SceneRecord> for Record {
    fn from(SceneRecord { variant, metrics, confidence, light_field }: SceneRecord) -> Record {
        Record { confidence, light_field, ..variant.with_metrics(metrics) }
    }
}
