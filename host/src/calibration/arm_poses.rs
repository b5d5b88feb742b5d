//! The poses of an arm's tool and their pictures, in CSV files.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::{
    error::{Error, Result},
    files::{input, output},
    images::Transform,
};

/// A picture and the pose of the tool, in the frame of the arm's base, when it was taken.
///
/// A file of them has a line for each, and names its columns, in any order, in its first line. Rotations are an axis times an
/// angle, as arms of Universal Robots tell them, or a quaternion `qx,qy,qz,qw`, as ROS does. Lines that begin with `#` are skipped.
///
/// ```csv
/// image,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg
/// 01.png,402.1,-198.4,510.0,172.3,4.1,-8.8
/// ```
///
/// Metres and radians are `x_m,y_m,z_m` and `rx_rad,ry_rad,rz_rad`.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmPose {
    /// The picture.
    pub picture: PathBuf,
    /// The pose of the tool.
    pub tool: Transform,
}

/// The expected first line.
const HEADER: &str = "image,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg";
/// The names of the columns in each unit, and what a millimetre or a degree is in it.
const LENGTHS: [([&str; 3], f64); 2] = [(["x_mm", "y_mm", "z_mm"], 1.0), (["x_m", "y_m", "z_m"], 1000.0)];
const ANGLES: [([&str; 3], f64); 2] =
    [(["rx_deg", "ry_deg", "rz_deg"], 1.0), (["rx_rad", "ry_rad", "rz_rad"], 180.0 / std::f64::consts::PI)];
const QUATERNION: [&str; 4] = ["qx", "qy", "qz", "qw"];
/// The farthest that the length of a quaternion may be from 1.
const UNIT: f64 = 0.01;

impl ArmPose {
    /// The name of the file in a folder of pictures.
    pub const FILE_NAME: &str = "poses.csv";

    /// Reads a file. Relative paths of pictures are relative to its folder.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a column is missing or a number is none. The message has the line.
    pub fn read_all(path: &Path) -> Result<Vec<ArmPose>> {
        let text = input::read_text(path)?;
        let rows = text.lines().enumerate().map(|(number, line)| (number + 1, line.trim()));
        let mut rows = rows.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let wrong = |found: String, expected: &str| Error::format(path, found, expected);
        let Some((_, header)) = rows.next() else { return Err(wrong("no line".into(), HEADER)) };
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let columns =
            |wanted: &[&str]| wanted.iter().map(|name| names.iter().position(|found| found == name)).collect::<Option<Vec<_>>>();
        let in_unit = |units: [([&str; 3], f64); 2]| units.into_iter().find_map(|(names, unit)| Some((columns(&names)?, unit)));
        let image = columns(&["image"]);
        let (angles, quaternion) = (in_unit(ANGLES), columns(&QUATERNION));
        let (Some(image), Some((lengths, unit)), true) = (image, in_unit(LENGTHS), angles.is_some() || quaternion.is_some())
        else {
            let expected = format!("the columns {HEADER}, or metres (x_m), radians (rx_rad), or a quaternion qx,qy,qz,qw");
            return Err(Error::format(path, format!("the columns `{header:.80}`"), expected));
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        rows.map(|(number, line)| {
            let fields: Vec<&str> = line.split(',').map(str::trim).collect();
            if fields.len() != names.len() {
                return Err(wrong(
                    format!("{} fields in line {number}", fields.len()),
                    &format!("{} as in the first", names.len()),
                ));
            }
            let value = |column: usize| {
                let value: Option<f64> = fields[column].parse().ok().filter(|value: &f64| value.is_finite());
                value.ok_or_else(|| wrong(format!("`{:.40}` in line {number}", fields[column]), "a number"))
            };
            let values = |columns: &[usize]| columns.iter().map(|column| value(*column)).collect::<Result<Vec<f64>>>();
            let translation = Vector3::from_vec(values(&lengths)?) * unit;
            let rotation = match (&angles, &quaternion) {
                (Some((columns, unit)), _) => {
                    UnitQuaternion::new(Vector3::from_vec(values(columns)?).map(|angle| (angle * unit).to_radians()))
                }
                (None, columns) => {
                    let parts = values(columns.as_deref().unwrap_or_default())?;
                    let quaternion = Quaternion::new(parts[3], parts[0], parts[1], parts[2]);
                    if (quaternion.norm() - 1.0).abs() > UNIT {
                        let found = format!("a quaternion of length {} in line {number}", quaternion.norm());
                        return Err(wrong(found, "one of length 1"));
                    }
                    UnitQuaternion::from_quaternion(quaternion)
                }
            };
            let tool = Transform::from(Isometry3::from_parts(Translation3::from(translation), rotation));
            match tool.is_plausible() {
                true => Ok(ArmPose { picture: folder.join(fields[image[0]]), tool }),
                false => Err(wrong(format!("a translation of {:.0} mm in line {number}", translation.norm()), "at most 100 m")),
            }
        })
        .collect()
    }

    /// Writes a file, with the names of the pictures alone.
    ///
    /// # Errors
    /// [`Error::Write`]. Any previous version of the file is unchanged.
    pub fn write_all(poses: &[ArmPose], path: &Path) -> Result<()> {
        let mut text = format!("{HEADER}\n");
        for ArmPose { picture, tool: Transform { translation_mm: [x, y, z], rotation_deg: [rx, ry, rz] } } in poses {
            let name = picture.file_name().unwrap_or_default().to_string_lossy();
            let _ = writeln!(text, "{name},{x},{y},{z},{rx},{ry},{rz}");
        }
        output::write(path, |writer| writer.write_all(text.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_units_mean_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            ArmPose::read_all(&path)
        };
        let tool = Transform { translation_mm: [400.0, -200.5, 510.0], rotation_deg: [0.0, 0.0, 90.0] };
        let expected = ArmPose { picture: dir.path().join("a.png"), tool };
        for text in [
            "image,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n# a line\na.png,400,-200.5,510,0,0,90\n",
            "x_m, y_m, z_m, rx_rad, ry_rad, rz_rad, image, note\n0.4,-0.2005,0.51,0,0,1.5707963267948966,a.png,x\n",
            "image,x_m,y_m,z_m,qx,qy,qz,qw\n\na.png,0.4,-0.2005,0.51,0,0,0.7071067811865476,0.7071067811865476\n",
        ] {
            let [found] = &read(text).unwrap()[..] else { panic!("one pose") };
            assert_eq!(found.picture, expected.picture);
            let off = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>();
            let far = off(found.tool.translation_mm, tool.translation_mm) + off(found.tool.rotation_deg, tool.rotation_deg);
            assert!(far < 1e-9, "{found:?}");
        }
        ArmPose::write_all(std::slice::from_ref(&expected), &path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), format!("{HEADER}\na.png,400,-200.5,510,0,0,90\n"));
        for (text, words) in [
            (
                "image,x,y,z,rx,ry,rz\na.png,1,2,3,4,5,6\n",
                "found the columns `image,x,y,z,rx,ry,rz`, expected the columns image,x_mm",
            ),
            ("image,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\na.png,1,2,3\n", "found 4 fields in line 2, expected 7 as in the first"),
            ("image,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\n\na.png,1,2,up,4,5,6\n", "found `up` in line 3, expected a number"),
            ("image,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\na.png,400,2,3,0,0,0\n", "found a translation of 400016 mm in line 2"),
            ("image,x_m,y_m,z_m,qx,qy,qz,qw\na.png,1,2,3,0,0,0,2\n", "found a quaternion of length 2 in line 2"),
            ("# nothing\n", "found no line, expected image,x_mm"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains("poses.csv: ") && message.contains(words), "{message}");
        }
    }
}
