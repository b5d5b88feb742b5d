//! The result of each method on each scene, and the table of all of them and their means.

use multiscopic::evaluation::{ConfidenceMetrics, LightFieldMetrics, Metrics};
use serde::{Deserialize, Serialize};

/// The errors of one method on one scene, or whatever else of `M` was measured: a record of `evaluate --json`.
///
/// `serde_json` reads a record, but not real numbers in `M` if anything in the program turns on its `arbitrary_precision`, as
/// they are flattened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record<M = Metrics> {
    /// The name of the data set.
    pub dataset: String,
    /// The name of the scene.
    pub scene: String,
    /// The name of the method.
    pub method: String,
    /// The number of neighbours that were matched: 1 is stereo.
    pub views: usize,
    /// The layout of the views at the shortest baseline, if it is not that of `--views N`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<String>,
    /// The baselines of the views, if they are at several, the shortest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub baselines: Vec<u8>,
    /// The baseline in camera steps, if it is not the data set's default. Errors are in pixels at the default baseline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_steps: Option<u8>,
    /// The name of the rule that fused their costs.
    pub fusion: String,
    /// The errors.
    #[serde(flatten)]
    pub metrics: M,
    /// The quality of the confidences, if that was measured.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<ConfidenceMetrics>,
    /// The errors in the benchmark's own measures, of a light field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_field: Option<LightFieldMetrics>,
    /// The time that matching took, with the confidences. `None` in what several machines measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

impl<M> Record<M> {
    /// The name of the variant, such as `stereo bm` or `multiscopic bm (2 views, min)`.
    pub fn variant(&self) -> String {
        if self.views == 1 {
            return format!("stereo {}", self.method);
        }
        let layout = self.layout.as_ref().map(|layout| format!(", {layout}")).unwrap_or_default();
        let baselines: Vec<String> = self.baselines.iter().map(u8::to_string).collect();
        let baselines = if baselines.is_empty() { String::new() } else { format!(", baselines {}", baselines.join(" ")) };
        format!("multiscopic {} ({} views, {}{layout}{baselines})", self.method, self.views, self.fusion)
    }

    /// The same with other metrics.
    pub fn with_metrics<N>(self, metrics: N) -> Record<N> {
        let Record { dataset, scene, method, views, layout, baselines, camera_steps, fusion, metrics: _, .. } = self;
        let Record { confidence, light_field, seconds, .. } = self;
        Record {
            dataset,
            scene,
            method,
            views,
            layout,
            baselines,
            camera_steps,
            fusion,
            metrics,
            confidence,
            light_field,
            seconds,
        }
    }
}

impl Record {
    /// Returns the reduction of the errors from those of stereo. `records` must contain the record of stereo with
    /// the same method on the same scene; without it there is no reduction.
    pub fn reduction(&self, records: &[Record]) -> Option<Reduction> {
        let same = |other: &&Record| (&other.dataset, &other.scene, &other.method) == (&self.dataset, &self.scene, &self.method);
        let stereo = records.iter().filter(same).find(|other| other.views == 1)?.metrics;
        if self.views == 1 || stereo.rms == 0.0 || stereo.avg_err == 0.0 {
            return None;
        }
        Some(Reduction { rms: 1.0 - self.metrics.rms / stereo.rms, avg_err: 1.0 - self.metrics.avg_err / stereo.avg_err })
    }
}

/// The relative reduction of errors: 0.25 is a quarter less, and a negative value is an increase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// The reduction of the root mean square error.
    pub rms: f64,
    /// The reduction of the mean absolute error.
    pub avg_err: f64,
}

/// A row of the results: one variant of a method, on one scene or averaged over all.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultRow {
    /// The name of the scene, or what is averaged over how many scenes.
    pub scene: String,
    /// The name of the variant.
    pub variant: String,
    /// The numbers of the row.
    pub values: RowValues,
}

/// The numbers of a [`ResultRow`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowValues {
    /// The errors on a scene, and their reduction, which stereo does not have.
    Scene(Metrics, Option<Reduction>),
    /// The mean errors over several scenes.
    MeanErrors(Metrics),
    /// The mean reductions over several scenes. They differ from the reductions of the mean errors.
    MeanReduction(Reduction),
}

impl ResultRow {
    /// The headings of the [`cells`](ResultRow::cells).
    pub const HEADINGS: [&str; 8] = ["scene", "method", "RMS", "AvgErr", "Bad0.5", "Bad1", "Bad2", "coverage"];

    /// The row as text: errors in pixels with their change, bad pixels and coverage in percent.
    pub fn cells(&self) -> [String; 8] {
        let change = |reduction: f64| format!("{:+.1} %", 0.0 - 100.0 * reduction);
        let [rms, avg_err] = match self.values {
            RowValues::Scene(metrics, None) | RowValues::MeanErrors(metrics) => {
                [metrics.rms, metrics.avg_err].map(|error| format!("{error:.3}"))
            }
            RowValues::Scene(metrics, Some(reduction)) => [(metrics.rms, reduction.rms), (metrics.avg_err, reduction.avg_err)]
                .map(|(error, reduction)| format!("{error:.3} ({})", change(reduction))),
            RowValues::MeanReduction(reduction) => [reduction.rms, reduction.avg_err].map(change),
        };
        let shares = match self.values {
            RowValues::Scene(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }, _)
            | RowValues::MeanErrors(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }) => {
                [bad_0_5, bad_1, bad_2, 100.0 * coverage].map(|share| format!("{share:.2}"))
            }
            RowValues::MeanReduction(_) => Default::default(),
        };
        let [bad_0_5, bad_1, bad_2, coverage] = shares;
        [self.scene.clone(), self.variant.clone(), rms, avg_err, bad_0_5, bad_1, bad_2, coverage]
    }
}

/// The rows of an evaluation: one for each record and, if there are several scenes, the mean errors and mean
/// reductions of each variant.
pub fn rows(records: &[Record]) -> Vec<ResultRow> {
    let row = |record: &Record| ResultRow {
        scene: record.scene.clone(),
        variant: record.variant(),
        values: RowValues::Scene(record.metrics, record.reduction(records)),
    };
    let variants = variants(records);
    let of = |variant: &String| records.iter().filter(|record| record.variant() == *variant).collect::<Vec<_>>();
    let errors = variants.iter().filter_map(|variant| mean_errors(variant, &of(variant)));
    let reductions = variants.iter().filter_map(|variant| mean_reduction(variant, &of(variant), records));
    records.iter().map(row).chain(errors).chain(reductions).collect()
}

/// The mean errors of a variant, or `None` if it has a single scene.
fn mean_errors(variant: &str, scenes: &[&Record]) -> Option<ResultRow> {
    let metrics: Vec<Metrics> = scenes.iter().map(|record| record.metrics).collect();
    let mean = Metrics::mean(&metrics).filter(|_| scenes.len() > 1)?;
    let scene = format!("mean errors of {}", scenes.len());
    Some(ResultRow { scene, variant: variant.into(), values: RowValues::MeanErrors(mean) })
}

/// The mean reductions of a variant, or `None` if fewer than two scenes have one.
fn mean_reduction(variant: &str, scenes: &[&Record], records: &[Record]) -> Option<ResultRow> {
    let reductions: Vec<Reduction> = scenes.iter().filter_map(|record| record.reduction(records)).collect();
    let mean = |of: fn(&Reduction) -> f64| reductions.iter().map(of).sum::<f64>() / reductions.len() as f64;
    (reductions.len() > 1).then(|| ResultRow {
        scene: format!("mean reductions of {}", reductions.len()),
        variant: variant.into(),
        values: RowValues::MeanReduction(Reduction { rms: mean(|r| r.rms), avg_err: mean(|r| r.avg_err) }),
    })
}

/// The headings of [`confidence_rows`].
pub const CONFIDENCE_HEADINGS: [&str; 9] =
    ["scene", "method", "AUC", "optimum", "ROC-AUC", "ECE", "Bad1 at 90 %", "80 %", "70 %"];

/// Returns a table of the confidences' quality.
pub fn confidence_rows(records: &[Record]) -> Vec<Vec<String>> {
    measured_rows(
        records,
        |record| record.confidence,
        ConfidenceMetrics::mean,
        |metrics| {
            let ConfidenceMetrics { auc, auc_optimal, roc_auc, ece, bad_1_at_90, bad_1_at_80, bad_1_at_70 } = *metrics;
            let areas = [auc, auc_optimal].map(|area| format!("{area:.4}"));
            let shares = [roc_auc, ece].map(|share| format!("{share:.3}"));
            let percents = [bad_1_at_90, bad_1_at_80, bad_1_at_70].map(|percent| format!("{percent:.2}"));
            areas.into_iter().chain(shares).chain(percents).collect()
        },
    )
}

/// The headings of [`light_field_rows`].
pub const LIGHT_FIELD_HEADINGS: [&str; 6] = ["scene", "method", "BadPix 0.07", "0.03", "0.01", "MSE x 100"];

/// Returns a table of the errors of light fields in the benchmark's own measures.
pub fn light_field_rows(records: &[Record]) -> Vec<Vec<String>> {
    measured_rows(
        records,
        |record| record.light_field,
        LightFieldMetrics::mean,
        |metrics| {
            let LightFieldMetrics { bad_pix_0_07, bad_pix_0_03, bad_pix_0_01, mse_x100 } = *metrics;
            let percents = [bad_pix_0_07, bad_pix_0_03, bad_pix_0_01].map(|percent| format!("{percent:.2}"));
            percents.into_iter().chain([format!("{mse_x100:.3}")]).collect()
        },
    )
}

/// One row for each record that has what was measured and, if there are several scenes, the means of each variant: the scene, the
/// variant, and the cells.
fn measured_rows<M>(
    records: &[Record],
    of: impl Fn(&Record) -> Option<M>,
    mean: impl Fn(&[M]) -> Option<M>,
    cells: impl Fn(&M) -> Vec<String>,
) -> Vec<Vec<String>> {
    let row = |scene: &str, variant: &str, metrics: &M| {
        [scene, variant].map(String::from).into_iter().chain(cells(metrics)).collect::<Vec<String>>()
    };
    let of_scene = |record: &Record| Some(row(&record.scene, &record.variant(), &of(record)?));
    let mean = |variant: &String| {
        let metrics: Vec<M> = records.iter().filter(|record| record.variant() == *variant).filter_map(&of).collect();
        let mean = mean(&metrics).filter(|_| metrics.len() > 1)?;
        Some(row(&format!("mean of {}", metrics.len()), variant, &mean))
    };
    records.iter().filter_map(of_scene).chain(variants(records).iter().filter_map(mean)).collect()
}

/// The names of all variants, in the order of first appearance.
fn variants(records: &[Record]) -> Vec<String> {
    let mut variants: Vec<String> = Vec::new();
    for variant in records.iter().map(Record::variant) {
        if !variants.contains(&variant) {
            variants.push(variant);
        }
    }
    variants
}

/// The rows as a table in plain text, with a line of dashes between scenes. It is cut to a width of `limit` characters.
pub fn to_text(rows: &[ResultRow], limit: Option<usize>) -> String {
    let cells: Vec<Vec<String>> = rows.iter().map(|row| row.cells().into()).collect();
    text_table(&ResultRow::HEADINGS, &cells, 2, limit)
}

/// Rows under headings, with a line of dashes below the headings and wherever the first cell changes. The first `names` columns
/// are aligned left, the others, which are numbers, right.
///
/// A table that is wider than `limit` is cut: of several names, the first one gets a line of its own, and the columns that do not
/// fit follow below, beside the other names again.
pub fn text_table(headings: &[&str], rows: &[Vec<String>], names: usize, limit: Option<usize>) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|cells| cells[column].as_str());
        cells.chain([headings[column]]).map(|cell| cell.chars().count()).max().unwrap_or_default()
    };
    let table = TextTable { headings, rows, names, widths: (0..headings.len()).map(width).collect() };
    let all: Vec<usize> = (0..headings.len()).collect();
    match limit {
        Some(limit) if table.width(&all) > limit => table.cut(limit),
        _ => table.part(&all),
    }
}

struct TextTable<'a> {
    headings: &'a [&'a str],
    rows: &'a [Vec<String>],
    names: usize,
    widths: Vec<usize>,
}

impl TextTable<'_> {
    /// The width of some columns beside each other.
    fn width(&self, columns: &[usize]) -> usize {
        columns.iter().map(|&column| self.widths[column] + 2).sum::<usize>().saturating_sub(2)
    }

    /// Parts of at most `limit` characters, if names and a number fit.
    fn cut(&self, limit: usize) -> String {
        let first = usize::from(self.names > 1);
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for column in self.names..self.headings.len() {
            match parts.last_mut() {
                Some(part) if self.width(part) + 2 + self.widths[column] <= limit => part.push(column),
                _ => parts.push((first..self.names).chain([column]).collect()),
            }
        }
        parts.iter().map(|part| self.part(part)).collect::<Vec<_>>().join("\n")
    }

    /// Some of the columns. Without the first one, its cells stand above the rows that share them.
    fn part(&self, columns: &[usize]) -> String {
        let has_first = columns.contains(&0);
        let dashes = "-".repeat(self.width(columns)) + "\n";
        let mut text = self.line(columns, |column| self.headings[column]);
        for (i, cells) in self.rows.iter().enumerate() {
            if i == 0 || cells[0] != self.rows[i - 1][0] {
                text += &dashes;
                if !has_first {
                    text += &format!("{}\n", cells[0]);
                }
            }
            text += &self.line(columns, |column| &cells[column]);
        }
        text
    }

    fn line<'a>(&self, columns: &[usize], cell: impl Fn(usize) -> &'a str) -> String {
        let padded = columns.iter().map(|&column| {
            let (cell, width) = (cell(column), self.widths[column]);
            if column < self.names { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(scene: &str, views: usize, rms: f64, avg_err: f64) -> Record {
        let metrics = Metrics { rms, avg_err, bad_0_5: 30.0, bad_1: 20.0, bad_2: 10.0, coverage: 0.98765 };
        let [dataset, method, fusion] = ["made", "bm", "min"].map(String::from);
        Record {
            dataset,
            scene: scene.into(),
            method,
            views,
            layout: None,
            baselines: Vec::new(),
            camera_steps: None,
            fusion,
            metrics,
            confidence: None,
            light_field: None,
            seconds: Some(0.25),
        }
    }

    /// Two scenes, each with stereo and two views.
    fn records() -> Vec<Record> {
        vec![record("A", 1, 2.0, 1.0), record("A", 2, 1.5, 0.5), record("B", 1, 4.0, 2.0), record("B", 2, 5.0, 0.5)]
    }

    #[test]
    fn reductions_are_relative_to_stereo() {
        let records = records();
        assert_eq!(records[0].reduction(&records), None);
        assert_eq!(records[1].reduction(&records), Some(Reduction { rms: 0.25, avg_err: 0.5 }));
        assert_eq!(records[3].reduction(&records), Some(Reduction { rms: -0.25, avg_err: 0.75 }));
        assert_eq!(records[1].reduction(&records[1..]), None, "without stereo");
    }

    #[test]
    fn a_variant_has_a_name_of_its_own() {
        let cross = record("A", 4, 2.0, 1.0);
        assert_eq!(cross.variant(), "multiscopic bm (4 views, min)");
        let column = Record { layout: Some("9x1".into()), baselines: vec![1, 2, 3, 4], ..record("A", 8, 2.0, 1.0) };
        assert_eq!(column.variant(), "multiscopic bm (8 views, min, 9x1, baselines 1 2 3 4)");
        assert_eq!(record("A", 1, 2.0, 1.0).variant(), "stereo bm");
    }

    #[test]
    fn a_record_in_json_is_flat() {
        let json = serde_json::to_string(&records()[..1]).unwrap();
        let expected = r#"[{"dataset":"made","scene":"A","method":"bm","views":1,"fusion":"min","rms":2.0,"avg_err":1.0,"bad_0_5":30.0,"bad_1":20.0,"bad_2":10.0,"coverage":0.98765,"seconds":0.25}]"#;
        assert_eq!(json, expected);
        let unmeasured = Record { confidence: None, ..records().remove(0).with_metrics(()) };
        assert_eq!(serde_json::from_str::<Vec<Record<()>>>(&json).unwrap(), [unmeasured]);
    }

    #[test]
    fn means_are_over_scenes() {
        let rows = rows(&records());
        let [stereo, multiscopic, reductions] = &rows[4..] else { panic!("{rows:?}") };
        assert_eq!((stereo.scene.as_str(), stereo.variant.as_str()), ("mean errors of 2", "stereo bm"));
        let RowValues::MeanErrors(Metrics { rms: 3.0, .. }) = stereo.values else { panic!("{stereo:?}") };
        let RowValues::MeanErrors(Metrics { rms: 3.25, avg_err: 0.5, .. }) = multiscopic.values else {
            panic!("{multiscopic:?}")
        };
        // The mean of the reductions, not the reduction of the means.
        assert_eq!((&*reductions.scene, &reductions.variant), ("mean reductions of 2", &multiscopic.variant));
        assert_eq!(reductions.values, RowValues::MeanReduction(Reduction { rms: 0.0, avg_err: 0.625 }));
        assert_eq!(super::rows(&records()[..2]).len(), 2, "one scene is its own mean");
    }

    #[test]
    fn columns_are_aligned() {
        let expected = "\
scene                 method                                     RMS           AvgErr  Bad0.5   Bad1   Bad2  coverage
---------------------------------------------------------------------------------------------------------------------
A                     stereo bm                                2.000            1.000   30.00  20.00  10.00     98.77
A                     multiscopic bm (2 views, min)  1.500 (-25.0 %)  0.500 (-50.0 %)   30.00  20.00  10.00     98.77
---------------------------------------------------------------------------------------------------------------------
B                     stereo bm                                4.000            2.000   30.00  20.00  10.00     98.77
B                     multiscopic bm (2 views, min)  5.000 (+25.0 %)  0.500 (-75.0 %)   30.00  20.00  10.00     98.77
---------------------------------------------------------------------------------------------------------------------
mean errors of 2      stereo bm                                3.000            1.500   30.00  20.00  10.00     98.77
mean errors of 2      multiscopic bm (2 views, min)            3.250            0.500   30.00  20.00  10.00     98.77
---------------------------------------------------------------------------------------------------------------------
mean reductions of 2  multiscopic bm (2 views, min)           +0.0 %          -62.5 %
";
        let table = to_text(&rows(&records()), None);
        assert_eq!(table, expected, "\n{table}");
    }

    #[test]
    fn wide_tables_are_cut() {
        let rows = [["Art", "bm", "1.00", "2.00"], ["Art", "sgm", "0.50", "1.00"], ["Dolls", "bm", "3.00", "4.00"]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        let table = |names, limit| text_table(&["scene", "method", "RMS", "Bad1"], &rows, names, limit);
        let whole = table(2, None);
        assert_eq!(whole.lines().next(), Some("scene  method   RMS  Bad1"));
        assert_eq!(table(2, Some(25)), whole);
        let expected = "\
method   RMS
------------
Art
bm      1.00
sgm     0.50
------------
Dolls
bm      3.00

method  Bad1
------------
Art
bm      2.00
sgm     1.00
------------
Dolls
bm      4.00
";
        assert_eq!(table(2, Some(13)), expected);
        assert_eq!(table(2, Some(18)).lines().next(), Some("method   RMS  Bad1"));
        // A column that does not fit is there all the same.
        assert_eq!(table(2, Some(3)), expected);
    }

    #[test]
    fn a_single_name_stays_in_its_column() {
        let rows = [["bm", "1.00", "2.00"]].map(|row| row.map(str::to_owned).to_vec());
        let expected = "method   RMS\n------------\nbm      1.00\n\nmethod  Bad1\n------------\nbm      2.00\n";
        assert_eq!(text_table(&["method", "RMS", "Bad1"], &rows, 1, Some(14)), expected);
    }
}
