//! `rig.toml`: the file that describes the images, camera and stage of a captured folder.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{
    error::{Error, Result},
    files::{frame_files::FrameFiles, input, output, provenance::Provenance},
    images::Geometry,
};

/// The contents of `rig.toml`.
///
/// ```toml
/// baseline_mm = 20.0              # from the centre to each neighbour
/// focal_px = 1180.5               # optional: without it there are disparities, but no depth
/// principal_point = [319.5, 239.5]
/// doffs = 0.0                     # optional
///
/// [images]                        # relative to this folder; at least one neighbour
/// center = "center.png"
/// left = "left.png"
/// right = "right.png"
///
/// [images.views]                  # optional: neighbours elsewhere, by their baselines to the right and down
/// "1,-1" = "top-right.png"
///
/// [capture]                       # optional, like each of its lines
/// camera = "/dev/video0"
/// stage = "gcode:/dev/ttyUSB0"
/// date = "2026-03-14"
/// repeatability_mm = 0.02
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: f64,
    /// Focal length in pixels, if known. Depth needs it.
    pub focal_px: Option<f64>,
    /// Where the optical axis meets the image, `[cx, cy]` in pixels. The centre of the top left pixel is at
    /// `[0, 0]`.
    pub principal_point: [f64; 2],
    /// The negated disparity of a point at infinity, in pixels.
    #[serde(default)]
    pub doffs: f64,
    /// The image files.
    pub images: FrameFiles,
    /// How the images were captured.
    #[serde(default)]
    pub capture: Provenance,
}

impl Rig {
    /// The name of the file in a captured folder.
    pub const FILE_NAME: &str = "rig.toml";

    /// Reads the `rig.toml` in `directory`.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a key is missing or unknown or a value is out of range. The
    /// message names the key.
    pub fn load(directory: &Path) -> Result<Rig> {
        let path = directory.join(Rig::FILE_NAME);
        let bytes = input::read(&path)?;
        let text = str::from_utf8(&bytes).map_err(|_| Error::format(&path, "bytes that are not text", "UTF-8 text"))?;
        let rig: Rig = toml::from_str(text).map_err(|error| Error::format(&path, with_line(&error, text), "a rig.toml"))?;
        rig.check(&path)?;
        Ok(rig)
    }

    /// Writes `rig.toml` into `directory`.
    ///
    /// # Errors
    /// [`Error::Format`] if a value is out of range, and [`Error::Write`]. Any previous version of the file
    /// is unchanged.
    pub fn save(&self, directory: &Path) -> Result<()> {
        let path = directory.join(Rig::FILE_NAME);
        self.check(&path)?;
        // This fails only for a path that is not Unicode.
        let text = toml::to_string(self).map_err(|error| Error::format(&path, error.to_string(), "file names in UTF-8"))?;
        output::write(&path, |writer| writer.write_all(text.as_bytes()))
    }

    /// The geometry that turns disparities into depth, or `None` if the focal length is unknown.
    pub fn geometry(&self) -> Option<Geometry> {
        let Rig { focal_px, baseline_mm, principal_point, doffs, .. } = *self;
        Some(Geometry { focal_px: focal_px?, baseline_mm, principal_point, doffs })
    }

    fn check(&self, path: &Path) -> Result<()> {
        let [cx, cy] = self.principal_point;
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let numbers = [
            ("baseline_mm", self.baseline_mm, positive(self.baseline_mm), "a length above 0"),
            ("focal_px", self.focal_px.unwrap_or_default(), self.focal_px.is_none_or(positive), "a length above 0"),
            ("principal_point", cx, cx.is_finite(), "a finite number"),
            ("principal_point", cy, cy.is_finite(), "a finite number"),
            ("doffs", self.doffs, self.doffs.is_finite(), "a finite number"),
        ];
        if let Some((key, value, _, expected)) = numbers.into_iter().find(|(_, _, valid, _)| !valid) {
            return Err(Error::format(path, format!("{key} = {value}"), expected));
        }
        if let Some(value) = self.capture.repeatability_mm.filter(|value| !(0.0..f64::INFINITY).contains(value)) {
            return Err(Error::format(path, format!("capture.repeatability_mm = {value}"), "a length of 0 or more"));
        }
        if self.images.views().is_empty() {
            return Err(Error::format(path, "no neighbour in [images]", "at least one of left, right, top or bottom"));
        }
        Ok(())
    }
}

/// The error's message with the line it refers to, as the message often does not name the key.
fn with_line(error: &toml::de::Error, text: &str) -> String {
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else {
        return error.message().into();
    };
    let number = before.matches('\n').count();
    let line = text.lines().nth(number).unwrap_or_default().trim();
    format!("line {} ({line}): {}", number + 1, error.message())
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Frame, View, Views};

    const TEXT: &str = r#"
        baseline_mm = 20
        focal_px = 1180.5
        principal_point = [319.5, 239.5]
        [images]
        center = "center.png"
        right = "/data/right.png"
        [capture]
        stage = "manual"
    "#;

    fn load(text: &str) -> Result<Rig> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("rig.toml"), text).unwrap();
        Rig::load(dir.path())
    }

    fn message(from: &str, to: &str) -> String {
        assert!(TEXT.contains(from));
        let message = load(&TEXT.replace(from, to)).unwrap_err().to_string();
        assert!(message.contains("rig.toml: found ") && !message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn loads_a_file_written_by_hand() {
        let rig = load(TEXT).unwrap();
        let geometry = Geometry { focal_px: 1180.5, baseline_mm: 20.0, principal_point: [319.5, 239.5], doffs: 0.0 };
        assert_eq!(rig.geometry(), Some(geometry));
        assert_eq!(load(&TEXT.replace("focal_px = 1180.5", "")).unwrap().geometry(), None);
        assert_eq!(rig.images.views(), Views::STEREO);
        assert_eq!(rig.capture.stage.as_deref(), Some("manual"));
        let images = rig.images.within(Path::new("rig"));
        assert!(images.paths().eq(["rig/center.png", "/data/right.png"].map(Path::new)));
        assert_eq!(images.get(Frame::View(View::TOP)), None);
    }

    #[test]
    fn loads_a_file_it_saved() {
        let dir = tempfile::tempdir().unwrap();
        let mut rig = load(TEXT).unwrap();
        rig.doffs = -3.25;
        rig.images.bottom = Some("bottom.png".into());
        rig.capture = Provenance {
            camera: Some("/dev/video0, 640x480".into()),
            date: Some("2026-03-14".into()),
            repeatability_mm: Some(0.02),
            notes: Some("a \"quoted\"\nline".into()),
            ..Provenance::default()
        };
        rig.save(dir.path()).unwrap();
        assert_eq!(Rig::load(dir.path()).unwrap(), rig);
        rig.focal_px = Some(0.0);
        assert!(rig.save(dir.path()).unwrap_err().to_string().contains("found focal_px = 0, expected a length above 0"));
    }

    #[test]
    fn the_example_in_the_documentation_loads() {
        let source = include_str!("rig.rs");
        let (_, rest) = source.split_once("/// ```toml\n").unwrap();
        let (example, _) = rest.split_once("/// ```\n").unwrap();
        let rig = load(&example.replace("/// ", "").replace("///", "")).unwrap();
        assert_eq!(rig.images.views(), Views::HORIZONTAL.with(View::new(1, -1).unwrap()));
        assert_eq!(rig.capture.repeatability_mm, Some(0.02));
    }

    #[test]
    fn errors_name_the_line_and_the_key() {
        assert!(message("focal_px", "focal").contains("line 3 (focal = 1180.5): unknown field `focal`"));
        assert!(message("baseline_mm = 20", "").contains("missing field `baseline_mm`"));
        assert!(message("center = ", "middle = ").contains("unknown field `middle`"));
        assert!(message("center = \"center.png\"", "").contains("missing field `center`"));
        assert!(message("stage", "stadium").contains("unknown field `stadium`"));
        assert!(message("1180.5", "\"long\"").contains("line 3 (focal_px = \"long\"): invalid type"));
        assert!(message("[319.5, 239.5]", "[1]").contains("line 4 (principal_point"));
        assert!(message("[images]", "[images").contains("line 5"));
        assert!(message("20", "0").contains("found baseline_mm = 0, expected a length above 0"));
        assert!(message("20", "-1").contains("baseline_mm = -1"));
        assert!(message("1180.5", "inf").contains("focal_px = inf"));
        assert!(message("239.5", "nan").contains("principal_point = NaN"));
        assert!(message("focal_px", "doffs = inf\nfocal_px").contains("doffs = inf"));
        assert!(message("stage = \"manual\"", "repeatability_mm = -1.0").contains("capture.repeatability_mm = -1"));
        assert!(message("right = \"/data/right.png\"", "").contains("no neighbour in [images]"));
    }

    #[test]
    fn a_folder_without_a_rig() {
        let dir = tempfile::tempdir().unwrap();
        let message = Rig::load(dir.path()).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot read {}: ", dir.path().join("rig.toml").display())), "{message}");
    }
}
