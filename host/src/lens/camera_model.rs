//! A camera with a lens.

use super::distortion::Lens;

/// The camera that a calibration finds. Pixel `(u, v)` has its centre at whole coordinates, as in OpenCV, ROS and Kalibr.
///
/// ```
/// use multiscopic::{CameraModel, Lens};
/// let camera = CameraModel { size: None, focal_px: [800.0; 2], principal_point: [319.5, 239.5], lens: Lens::IDEAL };
/// assert_eq!(camera.pixel([0.1, 0.0]), Some([399.5, 239.5]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Width and height of the images in pixels, if known. A calibration holds for images of this size only.
    pub size: Option<[usize; 2]>,
    /// The focal lengths `[fx, fy]` in pixels, above 0. They differ if pixels are not square.
    pub focal_px: [f64; 2],
    /// The pixel at which the optical axis meets the image, `[cx, cy]` in pixels.
    pub principal_point: [f64; 2],
    /// The distortion.
    pub lens: Lens,
}

impl CameraModel {
    /// The pixel that sees the direction `(x, y, 1)`: x to the right, y down, z along the optical axis. It may lie outside
    /// the image. `None` beyond the range of the lens model.
    pub fn pixel(&self, direction: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y] = self.lens.distort(direction)?;
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point);
        Some([fx * x + cx, fy * y + cy])
    }

    /// The direction `(x, y, 1)` that a pixel sees. `None` if the lens model has none for it.
    pub fn direction(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point);
        self.lens.undistort([(u - cx) / fx, (v - cy) / fy])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensModel;

    #[test]
    fn pixels_see_directions() {
        let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.0012, -0.0007, -0.01]).unwrap();
        let camera = CameraModel { size: None, focal_px: [300.0, 303.0], principal_point: [161.5, 118.25], lens };
        assert_eq!(camera.pixel([0.0, 0.0]), Some([161.5, 118.25]));
        // cv2.projectPoints maps [0.3, -0.2] to [0.290288009, -0.193430006] without a camera matrix.
        let [u, v] = camera.pixel([0.3, -0.2]).unwrap();
        assert!((u - (161.5 + 300.0 * 0.290_288_009)).abs() < 1e-9 && (v - (118.25 - 303.0 * 0.193_430_006)).abs() < 1e-9);
        let [x, y] = camera.direction([u, v]).unwrap();
        assert!((x - 0.3).abs() < 1e-11 && (y + 0.2).abs() < 1e-11);
        assert_eq!(camera.direction([5000.0, 0.0]), None);
    }
}
