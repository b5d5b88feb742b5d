//! What an evaluation finds, scene by scene, and how much the views reduce the errors.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::evaluation::Metrics;

/// The result of a method on a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
    /// The data set's name.
    pub dataset: String,
    /// The scene's name.
    pub scene: String,
    /// The method's name.
    pub method: String,
    /// How many neighbours were matched: one is stereo.
    pub views: usize,
    /// The name of the rule that fused them.
    pub fusion: String,
    /// How far it is from the truth.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// How long matching took.
    pub seconds: f64,
}

impl Record {
    /// The variant of the method: `stereo bm`, or `multiscopic bm (2 views, min)`.
    pub fn variant(&self) -> String {
        match self.views {
            1 => format!("stereo {}", self.method),
            views => format!("multiscopic {} ({views} views, {})", self.method, self.fusion),
        }
    }

    /// By how much the errors are less than those of stereo with the same method on the same scene, which is among `records`.
    pub fn reduction(&self, records: &[Record]) -> Option<Reduction> {
        let same = |other: &&Record| (&other.dataset, &other.scene, &other.method) == (&self.dataset, &self.scene, &self.method);
        let stereo = records.iter().filter(same).find(|other| other.views == 1)?.metrics;
        if self.views == 1 || stereo.rms == 0.0 || stereo.avg_err == 0.0 {
            return None;
        }
        Some(Reduction { rms: 1.0 - self.metrics.rms / stereo.rms, avg_err: 1.0 - self.metrics.avg_err / stereo.avg_err })
    }
}

/// By what share errors are reduced: 0.25 is a quarter less, below 0 is more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// Of the root mean square.
    pub rms: f64,
    /// Of the mean.
    pub avg_err: f64,
}

/// A line of the table of an evaluation: a variant of a method, on one scene or over all.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The scene's name, or what is the mean over how many scenes.
    pub scene: String,
    /// The variant of the method.
    pub variant: String,
    /// What the line says of it.
    pub values: Values,
}

/// What a line of the table says of a variant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values {
    /// Its errors on a scene, and their reduction, which stereo does not have.
    Scene(Metrics, Option<Reduction>),
    /// The means of its errors.
    MeanErrors(Metrics),
    /// The means of its reductions, which are not the reductions of the means.
    MeanReduction(Reduction),
}

impl Row {
    /// What heads the [`cells`](Row::cells).
    pub const HEADS: [&str; 8] = ["scene", "method", "RMS", "AvgErr", "Bad0.5", "Bad1", "Bad2", "coverage"];

    /// The line as text: errors in pixels with their reduction, bad pixels and coverage in percent.
    pub fn cells(&self) -> [String; 8] {
        let change = |reduction: f64| format!("{:+.1} %", 0.0 - 100.0 * reduction);
        let [rms, avg_err] = match self.values {
            Values::Scene(metrics, None) | Values::MeanErrors(metrics) => {
                [metrics.rms, metrics.avg_err].map(|error| format!("{error:.3}"))
            }
            Values::Scene(metrics, Some(reduction)) => [(metrics.rms, reduction.rms), (metrics.avg_err, reduction.avg_err)]
                .map(|(error, reduction)| format!("{error:.3} ({})", change(reduction))),
            Values::MeanReduction(reduction) => [reduction.rms, reduction.avg_err].map(change),
        };
        let shares = match self.values {
            Values::Scene(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }, _)
            | Values::MeanErrors(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }) => {
                [bad_0_5, bad_1, bad_2, 100.0 * coverage].map(|share| format!("{share:.2}"))
            }
            Values::MeanReduction(_) => Default::default(),
        };
        let [bad_0_5, bad_1, bad_2, coverage] = shares;
        [self.scene.clone(), self.variant.clone(), rms, avg_err, bad_0_5, bad_1, bad_2, coverage]
    }
}

/// The table of an evaluation: a row for every record and, if there are several scenes, for each variant the means over them of
/// its errors and of their reductions.
pub fn rows(records: &[Record]) -> Vec<Row> {
    let row = |record: &Record| Row {
        scene: record.scene.clone(),
        variant: record.variant(),
        values: Values::Scene(record.metrics, record.reduction(records)),
    };
    let mut variants: Vec<String> = Vec::new();
    for variant in records.iter().map(Record::variant) {
        if !variants.contains(&variant) {
            variants.push(variant);
        }
    }
    let of = |variant: &String| records.iter().filter(|record| record.variant() == *variant).collect::<Vec<_>>();
    let errors = variants.iter().filter_map(|variant| mean_errors(variant, &of(variant)));
    let reductions = variants.iter().filter_map(|variant| mean_reduction(variant, &of(variant), records));
    records.iter().map(row).chain(errors).chain(reductions).collect()
}

/// The mean errors of a variant over its scenes, if there are several.
fn mean_errors(variant: &str, scenes: &[&Record]) -> Option<Row> {
    let metrics: Vec<Metrics> = scenes.iter().map(|record| record.metrics).collect();
    let mean = Metrics::mean(&metrics).filter(|_| scenes.len() > 1)?;
    let scene = format!("mean errors of {}", scenes.len());
    Some(Row { scene, variant: variant.into(), values: Values::MeanErrors(mean) })
}

/// The mean reduction of a variant's errors over its scenes, if there are several that have one.
fn mean_reduction(variant: &str, scenes: &[&Record], records: &[Record]) -> Option<Row> {
    let reductions: Vec<Reduction> = scenes.iter().filter_map(|record| record.reduction(records)).collect();
    let mean = |of: fn(&Reduction) -> f64| reductions.iter().map(of).sum::<f64>() / reductions.len() as f64;
    (reductions.len() > 1).then(|| Row {
        scene: format!("mean reductions of {}", reductions.len()),
        variant: variant.into(),
        values: Values::MeanReduction(Reduction { rms: mean(|r| r.rms), avg_err: mean(|r| r.avg_err) }),
    })
}

/// The table in columns of text, a line of dashes between scenes.
pub fn text(rows: &[Row]) -> String {
    /// Names are aligned to the left, numbers to the right.
    const NAMES: RangeInclusive<usize> = 0..=1;
    let heads = Row::HEADS.map(String::from);
    let cells: Vec<[String; 8]> = rows.iter().map(Row::cells).collect();
    let width = |column: usize| {
        let widths = [&heads].into_iter().chain(&cells).map(|cells| cells[column].chars().count());
        widths.max().unwrap_or_default()
    };
    let widths: [usize; 8] = std::array::from_fn(width);
    let line = |cells: &[String; 8]| {
        let padded = cells.iter().zip(widths).enumerate().map(|(column, (cell, width))| match NAMES.contains(&column) {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    let dashes = "-".repeat(widths.iter().sum::<usize>() + 2 * (widths.len() - 1)) + "\n";
    let mut text = line(&heads);
    for (i, cells) in cells.iter().enumerate() {
        if i == 0 || rows[i].scene != rows[i - 1].scene {
            text += &dashes;
        }
        text += &line(cells);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(scene: &str, views: usize, rms: f64, avg_err: f64) -> Record {
        let metrics = Metrics { rms, avg_err, bad_0_5: 30.0, bad_1: 20.0, bad_2: 10.0, coverage: 0.98765 };
        let [dataset, method, fusion] = ["made", "bm", "min"].map(String::from);
        Record { dataset, scene: scene.into(), method, views, fusion, metrics, seconds: 0.25 }
    }

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
    fn means_are_over_scenes() {
        let rows = rows(&records());
        let [stereo, multiscopic, reductions] = &rows[4..] else { panic!("{rows:?}") };
        assert_eq!((stereo.scene.as_str(), stereo.variant.as_str()), ("mean errors of 2", "stereo bm"));
        let Values::MeanErrors(Metrics { rms: 3.0, .. }) = stereo.values else { panic!("{stereo:?}") };
        let Values::MeanErrors(Metrics { rms: 3.25, avg_err: 0.5, .. }) = multiscopic.values else { panic!("{multiscopic:?}") };
        // The mean of the reductions, not the reduction of the means.
        assert_eq!((&*reductions.scene, &reductions.variant), ("mean reductions of 2", &multiscopic.variant));
        assert_eq!(reductions.values, Values::MeanReduction(Reduction { rms: 0.0, avg_err: 0.625 }));
        assert_eq!(super::rows(&records()[..2]).len(), 2, "one scene is its own mean");
    }

    #[test]
    fn the_table() {
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
        let table = text(&rows(&records()));
        assert_eq!(table, expected, "\n{table}");
    }

    #[test]
    fn records_in_json() {
        let json = serde_json::to_string(&records()[..1]).unwrap();
        let expected = r#"[{"dataset":"made","scene":"A","method":"bm","views":1,"fusion":"min","rms":2.0,"avg_err":1.0,"bad_0_5":30.0,"bad_1":20.0,"bad_2":10.0,"coverage":0.98765,"seconds":0.25}]"#;
        assert_eq!(json, expected);
    }
}
