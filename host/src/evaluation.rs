//! What an evaluation finds, scene by scene, and how much the views reduce the errors.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::Metrics;

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
    /// The scene's name, or over how many scenes the means are.
    pub scene: String,
    /// The variant of the method.
    pub variant: String,
    /// The errors, or their means.
    pub metrics: Metrics,
    /// The reduction of the errors, or the mean of those of the scenes; stereo has none.
    pub reduction: Option<Reduction>,
}

impl Row {
    /// What heads the [`cells`](Row::cells).
    pub const HEADS: [&str; 8] = ["scene", "method", "RMS", "AvgErr", "Bad0.5", "Bad1", "Bad2", "coverage"];

    /// The line as text: errors in pixels with their reduction, bad pixels and coverage in percent.
    pub fn cells(&self) -> [String; 8] {
        let Metrics { rms, avg_err, bad_0_5, bad_1, bad_2, coverage } = self.metrics;
        let reduced = |error: f64, of: fn(Reduction) -> f64| match self.reduction {
            Some(reduction) => format!("{error:.3} ({:+.1} %)", -100.0 * of(reduction)),
            None => format!("{error:.3}"),
        };
        let percent = |share: f64| format!("{share:.2}");
        [
            self.scene.clone(),
            self.variant.clone(),
            reduced(rms, |reduction| reduction.rms),
            reduced(avg_err, |reduction| reduction.avg_err),
            percent(bad_0_5),
            percent(bad_1),
            percent(bad_2),
            percent(100.0 * coverage),
        ]
    }
}

/// The table of an evaluation: a row for every record and, if there are several scenes, the means of each variant over them.
pub fn rows(records: &[Record]) -> Vec<Row> {
    let row = |record: &Record| Row {
        scene: record.scene.clone(),
        variant: record.variant(),
        metrics: record.metrics,
        reduction: record.reduction(records),
    };
    let scenes: Vec<Row> = records.iter().map(row).collect();
    let mut variants: Vec<&str> = Vec::new();
    for row in &scenes {
        if !variants.contains(&row.variant.as_str()) {
            variants.push(&row.variant);
        }
    }
    let means = variants.iter().filter_map(|variant| mean(scenes.iter().filter(|row| row.variant == *variant))).collect();
    [scenes, means].concat()
}

/// The mean of one variant's rows, if there are several.
fn mean<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Option<Row> {
    let first = rows.clone().next()?;
    let count = rows.clone().count();
    let metrics: Vec<Metrics> = rows.clone().map(|row| row.metrics).collect();
    let reductions: Vec<Reduction> = rows.filter_map(|row| row.reduction).collect();
    let mean = |of: fn(&Reduction) -> f64| reductions.iter().map(of).sum::<f64>() / reductions.len() as f64;
    (count > 1).then(|| Row {
        scene: format!("mean of {count}"),
        variant: first.variant.clone(),
        metrics: Metrics::mean(&metrics).unwrap_or_default(),
        reduction: (!reductions.is_empty()).then(|| Reduction { rms: mean(|r| r.rms), avg_err: mean(|r| r.avg_err) }),
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
        let [stereo, multiscopic] = &rows[4..] else { panic!("{rows:?}") };
        assert_eq!((stereo.scene.as_str(), stereo.variant.as_str(), stereo.metrics.rms), ("mean of 2", "stereo bm", 3.0));
        assert_eq!(stereo.reduction, None);
        assert_eq!((multiscopic.metrics.rms, multiscopic.metrics.avg_err), (3.25, 0.5));
        // The mean of the reductions, not the reduction of the means.
        assert_eq!(multiscopic.reduction, Some(Reduction { rms: 0.0, avg_err: 0.625 }));
        assert_eq!(super::rows(&records()[..2]).len(), 2, "one scene is its own mean");
    }

    #[test]
    fn the_table() {
        let expected = "\
scene  method                                     RMS           AvgErr  Bad0.5   Bad1   Bad2  coverage
------------------------------------------------------------------------------------------------------
A      stereo bm                                2.000            1.000   30.00  20.00  10.00     98.77
A      multiscopic bm (2 views, min)  1.500 (-25.0 %)  0.500 (-50.0 %)   30.00  20.00  10.00     98.77
";
        let table = text(&rows(&records()[..2]));
        assert_eq!(table, expected, "\n{table}");
    }

    #[test]
    fn records_in_json() {
        let json = serde_json::to_string(&records()[..1]).unwrap();
        let expected = r#"[{"dataset":"made","scene":"A","method":"bm","views":1,"fusion":"min","rms":2.0,"avg_err":1.0,"bad_0_5":30.0,"bad_1":20.0,"bad_2":10.0,"coverage":0.98765,"seconds":0.25}]"#;
        assert_eq!(json, expected);
    }
}
