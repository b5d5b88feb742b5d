//! The outcome of `multiscopic calibrate lens`: a table, JSON and a page.

use multiscopic::calibration::{LensCalibration, PrintedBoard};
use serde::Serialize;

use crate::report::{Report, ReprojectionMap};

/// A share of the image with corners that calls for more pictures.
const LOW_COVERAGE: f64 = 0.8;
/// A number of pictures that calls for more.
const FEW_IMAGES: usize = 8;

/// A calibration, and what it is from.
pub struct LensOutcome<'a> {
    pub calibration: &'a LensCalibration,
    /// Of the images, in pixels.
    pub size: [usize; 2],
    pub board: &'a PrintedBoard,
}

/// The object that `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    model: &'static str,
    size: [usize; 2],
    parameters: Vec<Parameter>,
    rms_px: f64,
    max_px: f64,
    /// The share of the image's cells with a corner, 0 to 1.
    coverage: f64,
    images: Vec<ImageLine<'a>>,
    rejected: &'a [String],
}

/// A parameter of the camera and its standard deviation.
#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: f64,
    deviation: f64,
}

/// A line of the table.
#[derive(Debug, Serialize)]
struct ImageLine<'a> {
    image: &'a str,
    corners: usize,
    dropped: usize,
    rms_px: f64,
    max_px: f64,
    tilt_deg: f64,
    distance_mm: f64,
}

impl LensOutcome<'_> {
    fn summary(&self) -> Summary<'_> {
        let calibration = self.calibration;
        let images = calibration.images.iter().map(|image| ImageLine {
            image: &image.name,
            corners: image.corners.len(),
            dropped: image.dropped,
            rms_px: image.rms_px(),
            max_px: image.max_px(),
            tilt_deg: image.tilt_deg,
            distance_mm: image.distance_mm,
        });
        Summary {
            model: calibration.camera.lens.model().name(),
            size: self.size,
            parameters: self.parameters(),
            rms_px: calibration.rms_px(),
            max_px: calibration.max_px(),
            coverage: calibration.coverage.share(),
            images: images.collect(),
            rejected: &calibration.rejected,
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        let camera = &self.calibration.camera;
        let names = ["fx", "fy", "cx", "cy"].iter().chain(camera.lens.model().coefficient_names());
        let values = camera.focal_px.iter().chain(&camera.principal_point).chain(camera.lens.coefficients());
        let with_deviations = names.zip(values).zip(&self.calibration.deviations);
        with_deviations.map(|((&name, &value), &deviation)| Parameter { name, value, deviation }).collect()
    }

    /// Returns advice that would make the calibration better.
    pub fn warnings(&self) -> Vec<String> {
        let calibration = self.calibration;
        let mut warnings: Vec<String> = calibration
            .rejected
            .iter()
            .map(|name| format!("left out {name}: most of its corners disagree with the other images"))
            .collect();
        let missing = calibration.coverage.missing();
        if calibration.coverage.share() < LOW_COVERAGE && !missing.is_empty() {
            warnings.push(format!(
                "few corners in these parts of the image, where the lens is known less well: {}",
                missing.join(", ")
            ));
        }
        if calibration.images.len() < FEW_IMAGES {
            warnings.push(format!("{} images are few: 10 to 20 give a more certain result", calibration.images.len()));
        }
        let [right, bottom] = self.size.map(|side| side as f64 - 1.0);
        let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
        if corners.iter().any(|corner| calibration.camera.direction(*corner).is_none()) {
            let message =
                "the lens model ends before the corners of the image: photograph the board there, or try another --model";
            warnings.push(message.into());
        }
        warnings
    }

    /// One line of JSON.
    pub fn json(&self) -> String {
        serde_json::to_string(&self.summary()).expect("numbers and strings")
    }

    /// A table for people.
    pub fn table(&self) -> String {
        let Summary { model, parameters, rms_px, max_px, coverage, images, .. } = self.summary();
        let mut table = String::from("corners  dropped  rms px  max px  tilt deg  distance mm  image\n");
        for ImageLine { image, corners, dropped, rms_px, max_px, tilt_deg, distance_mm } in &images {
            table += &format!("{corners:>7}{dropped:>9}{rms_px:>8.3}{max_px:>8.3}{tilt_deg:>10.1}{distance_mm:>13.0}  {image}\n");
        }
        let corners: usize = images.iter().map(|image| image.corners).sum();
        table += &format!(
            "{corners} corners of {} images: {rms_px:.3} px RMS, {max_px:.3} px at most, in {:.0} % of the image\n{model}\n",
            images.len(),
            100.0 * coverage
        );
        for Parameter { name, value, deviation } in parameters {
            // Two digits of the deviation.
            let decimals = (1.0 - deviation.max(1e-12).log10().floor()).clamp(0.0, 9.0) as usize;
            table += &format!("{name}  {value:>12.decimals$} +- {deviation:.decimals$}\n");
        }
        table
    }

    /// A page with a picture of the errors and the coverage.
    pub fn page(&self) -> String {
        let Summary { model, parameters, rms_px, max_px, coverage, images, .. } = self.summary();
        let [width, height] = self.size;
        let text = format!(
            "A {}. {} images of {width}x{height} pixels, model {model}: the reprojection error is {rms_px:.3} pixels (RMS), {max_px:.3} at \
             most. Corners cover {:.0} % of the image.",
            self.board,
            images.len(),
            100.0 * coverage
        );
        let parameters = parameters
            .iter()
            .map(|Parameter { name, value, deviation }| [(*name).to_owned(), format!("{value:.6}"), format!("{deviation:.6}")]);
        let images = images.iter().map(|line| {
            let ImageLine { image, corners, dropped, rms_px, max_px, tilt_deg, distance_mm } = line;
            let numbers = [format!("{rms_px:.3}"), format!("{max_px:.3}"), format!("{tilt_deg:.1}"), format!("{distance_mm:.0}")];
            [vec![(*image).to_owned(), corners.to_string(), dropped.to_string()], numbers.to_vec()].concat()
        });
        Report::new("Calibration of a lens")
            .paragraph(&text)
            .reprojections(&ReprojectionMap { calibration: self.calibration, size: self.size })
            .heading("Parameters")
            .table(["parameter", "value", "standard deviation"], parameters)
            .heading("Images")
            .table(["image", "corners", "dropped", "RMS px", "max px", "tilt deg", "distance mm"], images)
            .to_html()
    }
}
