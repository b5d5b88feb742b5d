//! ROS's `camera_info`.

use std::{fmt::Write, path::Path};

use crate::{
    error::Result,
    files::output,
    lens::{CameraModel, LensModel},
};

/// Writes the YAML that `camera_calibration_parsers` of ROS writes. The projection is that of undistorted images with the
/// horizontal focal length, as [`Undistortion`](crate::lens::Undistortion) makes them.
pub fn write(camera: &CameraModel, path: &Path) -> Result<()> {
    let CameraModel { size, focal_px: [fx, fy], principal_point: [cx, cy], lens } = *camera;
    let mut yaml = String::new();
    if let Some([width, height]) = size {
        let _ = writeln!(yaml, "image_width: {width}\nimage_height: {height}");
    }
    yaml += "camera_name: camera\n";
    yaml += &matrix("camera_matrix", 3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    let model = match lens.model() {
        LensModel::PlumbBob => "plumb_bob",
        LensModel::Rational => "rational_polynomial",
        LensModel::Equidistant => "equidistant",
    };
    let _ = writeln!(yaml, "distortion_model: {model}");
    yaml += &matrix("distortion_coefficients", 1, lens.coefficients().len(), lens.coefficients());
    yaml += &matrix("rectification_matrix", 3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    yaml += &matrix("projection_matrix", 3, 4, &[fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    output::write(path, |writer| writer.write_all(yaml.as_bytes()))
}

fn matrix(name: &str, rows: usize, columns: usize, data: &[f64]) -> String {
    let data: Vec<String> = data.iter().map(|number| format!("{number:?}")).collect();
    format!("{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{}]\n", data.join(", "))
}
