//! Line charts, as SVG.

use maud::{Markup, PreEscaped, Render, html};

/// The style of charts and of other SVG files.
pub(super) const STYLE: &str = include_str!("chart.css");

/// The size of a chart, which is higher for many lines, and the place of its plot, in pixels.
const WIDTH: f64 = 760.0;
const LEAST_HEIGHT: f64 = 340.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 450.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 290.0;
/// The distance between two rows of the legend.
const LEGEND_ROW: f64 = 22.0;
/// The colours and dashes of lines, which repeat after their product.
const COLORS: usize = 6;
const DASHES: [&str; 3] = ["none", "7 4", "2 3"];

/// A chart of lines over one axis. Its vertical axis starts at 0, and the horizontal one has a tick for each value.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The title.
    pub title: String,
    /// The label of the horizontal axis.
    pub x: String,
    /// The label of the vertical axis.
    pub y: String,
    /// The lines, at least one of which has a point.
    pub lines: Vec<ChartLine>,
}

/// A line of a [`Chart`].
#[derive(Clone, Debug, PartialEq)]
pub struct ChartLine {
    /// Its name in the legend.
    pub name: String,
    /// Its points, finite and in ascending order of the first number.
    pub points: Vec<(f64, f64)>,
}

impl Chart {
    /// The chart as a file of its own.
    pub fn to_svg(&self) -> String {
        let head = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{}" "#, self.height());
        let style = html! { style { (PreEscaped(STYLE)) } }.into_string();
        let svg = self.render().into_string().replacen("<svg ", &head, 1);
        svg.replacen('>', &format!(">{style}"), 1) + "\n"
    }

    /// The height in pixels, which has room for the legend.
    fn height(&self) -> f64 {
        LEAST_HEIGHT.max(TOP + LEGEND_ROW * (self.lines.len() as f64 + 1.0))
    }

    /// The ticks of the horizontal axis: every value that a line has, in ascending order.
    fn columns(&self) -> Vec<f64> {
        let mut columns: Vec<f64> = self.lines.iter().flat_map(|line| &line.points).map(|(x, _)| *x).collect();
        columns.sort_by(f64::total_cmp);
        columns.dedup();
        columns
    }

    /// The ticks of the vertical axis: from 0 to at least the greatest value, at steps of 1, 2 or 5 times a power of ten.
    fn rows(&self) -> Vec<Tick> {
        let most = self.lines.iter().flat_map(|line| &line.points).map(|(_, y)| *y).fold(1e-6, f64::max);
        let power = 10_f64.powf((most / 5.0).log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| 5.0 * step >= most);
        let step = step.unwrap_or(most);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let count = (most / step - 1e-9).ceil() as usize;
        (0..=count).map(|row| row as f64 * step).map(|y| Tick { value: y, label: format!("{y:.decimals$}") }).collect()
    }
}

/// A tick of an axis.
struct Tick {
    value: f64,
    label: String,
}

/// The part of an HTML page.
impl Render for Chart {
    fn render(&self) -> Markup {
        let (columns, rows) = (self.columns(), self.rows());
        let most = columns.last().copied().unwrap_or(1.0).max(1e-6);
        let highest = rows.last().map_or(1.0, |tick| tick.value);
        let across = |x: f64| format!("{:.1}", LEFT + (RIGHT - LEFT) * x / most);
        let up = |y: f64| format!("{:.1}", BOTTOM - (BOTTOM - TOP) * y / highest);
        let class = |part: &str, line: usize| format!("{part} s{}", line % COLORS);
        let dash = |line: usize| DASHES[line / COLORS % DASHES.len()];
        let path = |points: &[(f64, f64)]| {
            let points: Vec<String> = points.iter().map(|&(x, y)| format!("{},{}", across(x), up(y))).collect();
            points.join(" ")
        };
        let (middle, center) = ((LEFT + RIGHT) / 2.0, (TOP + BOTTOM) / 2.0);
        html! {
            svg class="chart" viewBox=(format!("0 0 {WIDTH} {}", self.height())) role="img" {
                title { (self.title) }
                text x=(LEFT) y="18" font-weight="600" { (self.title) }
                @for Tick { value, label } in &rows {
                    line class="grid" x1=(LEFT) x2=(RIGHT) y1=(up(*value)) y2=(up(*value)) {}
                    text class="tick" x=(LEFT - 8.0) y=(up(*value)) dy="4" text-anchor="end" { (label) }
                }
                @for &x in &columns {
                    line class="axis" x1=(across(x)) x2=(across(x)) y1=(BOTTOM) y2=(BOTTOM + 5.0) {}
                    text class="tick" x=(across(x)) y=(BOTTOM + 18.0) text-anchor="middle" { (x) }
                }
                line class="axis" x1=(LEFT) x2=(RIGHT) y1=(BOTTOM) y2=(BOTTOM) {}
                text x=(middle) y=(BOTTOM + 40.0) text-anchor="middle" { (self.x) }
                text x="16" y=(center) text-anchor="middle" transform=(format!("rotate(-90 16 {center})")) { (self.y) }
                @for (index, line) in self.lines.iter().enumerate() {
                    polyline class=(class("series", index)) stroke-dasharray=(dash(index)) points=(path(&line.points)) {}
                    @for &(x, y) in &line.points {
                        circle class=(class("marker", index)) cx=(across(x)) cy=(up(y)) r="4" {
                            title { (line.name) ": " (format!("{y:.3}")) " at " (x) }
                        }
                    }
                    @let row = TOP + 8.0 + LEGEND_ROW * index as f64;
                    line class=(class("series", index)) stroke-dasharray=(dash(index)) x1=(RIGHT + 24.0) x2=(RIGHT + 50.0) y1=(row) y2=(row) {}
                    circle class=(class("marker", index)) cx=(RIGHT + 37.0) cy=(row) r="4" {}
                    text x=(RIGHT + 58.0) y=(row) dy="4" { (line.name) }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(lines: &[&[(f64, f64)]]) -> Chart {
        let line =
            |(index, points): (usize, &&[(f64, f64)])| ChartLine { name: format!("line {index}"), points: points.to_vec() };
        let [title, x, y] = ["Errors", "views", "pixels"].map(String::from);
        Chart { title, x, y, lines: lines.iter().enumerate().map(line).collect() }
    }

    #[test]
    fn lines_become_svg() {
        let line = ChartLine { name: "bm".into(), points: vec![(1.0, 0.76), (2.0, 0.7), (4.0, 0.62)] };
        let chart = Chart { title: "Tsukuba".into(), x: "views".into(), y: "AvgErr in pixels".into(), lines: vec![line] };
        assert!(chart.to_svg().starts_with("<svg xmlns="));
    }

    #[test]
    fn axes_hold_all_points() {
        let chart = chart(&[&[(1.0, 0.25), (4.0, 0.1)], &[(1.0, 0.3), (8.0, 0.42)]]);
        assert_eq!(chart.columns(), [1.0, 4.0, 8.0]);
        let labels: Vec<String> = chart.rows().into_iter().map(|tick| tick.label).collect();
        assert_eq!(labels, ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5"]);
        let svg = chart.to_svg();
        // The point furthest to the right and the lowest row.
        assert!(svg.contains(&format!("{RIGHT:.1},")) && svg.contains(&format!("y1=\"{BOTTOM:.1}\"")), "{svg}");
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert_eq!(svg.matches("<circle").count(), 4 + 2, "points, and the legend's");
    }

    #[test]
    fn rows_fit_small_and_large_values() {
        for most in [1e-3, 0.019, 0.5, 1.0, 7.3, 99.0, 12_345.0] {
            let rows = chart(&[&[(1.0, most)]]).rows();
            let last = rows.last().unwrap().value;
            assert!((most - 1e-9..2.0 * most).contains(&last) && (3..=6).contains(&rows.len()), "{most}: up to {last}");
            let labels: Vec<&String> = rows.iter().map(|tick| &tick.label).collect();
            assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{labels:?}");
        }
    }

    #[test]
    fn names_cannot_become_markup() {
        let mut chart = chart(&[&[(1.0, 1.0)]]);
        chart.lines[0].name = "<b>".into();
        assert!(!chart.to_svg().contains("<b>"));
    }
}
