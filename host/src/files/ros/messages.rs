//! Messages of ROS 2: images, cameras, points and disparities.

use std::time::Duration;

use multiscopic_core::Disparity;

use crate::{
    files::cloud::CloudPoint,
    images::{FloatImage, Geometry, Picture, Transform},
};

/// When and where something was seen.
#[derive(Clone, Copy, Debug)]
pub struct Stamp<'a> {
    /// The time since 1970.
    pub time: Duration,
    /// The frame of coordinates.
    pub frame_id: &'a str,
}

impl Stamp<'_> {
    fn begin(self) -> Cdr {
        let mut cdr = Cdr::new();
        self.put(&mut cdr);
        cdr
    }

    fn put(self, cdr: &mut Cdr) {
        // Until 2038, as ROS 2 has it.
        cdr.i32(self.time.as_secs() as i32);
        cdr.u32(self.time.subsec_nanos());
        cdr.string(self.frame_id);
    }

    /// `sensor_msgs/msg/Image` of a picture: `mono8`, `rgb8`, `mono16` or `rgb16`.
    pub fn picture(self, picture: &Picture) -> Vec<u8> {
        let size = <[u32; 2]>::from(picture.dimensions());
        let wide = |samples: &[u16]| samples.iter().flat_map(|sample| sample.to_le_bytes()).collect::<Vec<u8>>();
        let mut cdr = self.begin();
        match picture {
            Picture::Gray(image) => put_image(&mut cdr, size, "mono8", image.as_raw()),
            Picture::Rgb(image) => put_image(&mut cdr, size, "rgb8", image.as_raw()),
            Picture::Gray16(image) => put_image(&mut cdr, size, "mono16", &wide(image.as_raw())),
            Picture::Rgb16(image) => put_image(&mut cdr, size, "rgb16", &wide(image.as_raw())),
        }
        cdr.into_bytes()
    }

    /// `sensor_msgs/msg/Image` of depths in metres, NaN where unknown (REP 118).
    pub fn depth(self, depth: &FloatImage) -> Vec<u8> {
        let mut cdr = self.begin();
        put_floats(&mut cdr, depth, |metres| if metres.is_finite() { metres } else { f32::NAN });
        cdr.into_bytes()
    }

    /// `sensor_msgs/msg/CameraInfo` of a camera whose images are rectified, and turned so from the camera's own frame.
    pub fn camera(self, geometry: &Geometry, rectification: &Transform, [width, height]: [usize; 2]) -> Vec<u8> {
        let Geometry { focal_px: f, principal_point: [cx, cy], .. } = *geometry;
        let mut cdr = self.begin();
        cdr.u32(height as u32);
        cdr.u32(width as u32);
        cdr.string("plumb_bob");
        cdr.length(5);
        cdr.f64s(&[0.0; 5]);
        cdr.f64s(&[f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0]);
        cdr.f64s(rectification.rotation_rows().as_flattened());
        cdr.f64s(&[f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        // No binning, and all of the image.
        [0; 2].into_iter().for_each(|binning| cdr.u32(binning));
        put_region(&mut cdr, [0; 2]);
        cdr.into_bytes()
    }

    /// `tf2_msgs/msg/TFMessage` of the poses of frames in their parents. It has stamps of its own.
    pub fn transforms(self, links: &[TransformStamped]) -> Vec<u8> {
        let mut cdr = Cdr::new();
        cdr.length(links.len());
        for TransformStamped { parent, child, transform } in links {
            Stamp { frame_id: parent, ..self }.put(&mut cdr);
            cdr.string(child);
            cdr.f64s(&transform.translation_mm.map(|mm| mm / 1000.0));
            cdr.f64s(&transform.quaternion());
        }
        cdr.into_bytes()
    }

    /// `stereo_msgs/msg/DisparityImage` of disparities in pixels, from `min` to `max`. Those that are not finite are a pixel
    /// below `min`.
    ///
    /// Depth is `f t / d`, so that disparities have the geometry's `doffs` in them.
    pub fn disparities(self, disparities: &FloatImage, geometry: &Geometry, [min, max]: [i16; 2]) -> Vec<u8> {
        let doffs = geometry.doffs as f32;
        let [min, max] = [min, max].map(|disparity| f32::from(disparity) + doffs);
        let mut cdr = self.begin();
        self.put(&mut cdr);
        put_floats(&mut cdr, disparities, |d| if d.is_finite() { d + doffs } else { min - 1.0 });
        cdr.f32(geometry.focal_px as f32);
        cdr.f32((geometry.baseline_mm / 1000.0) as f32);
        put_region(&mut cdr, [disparities.width(), disparities.height()]);
        [min, max, 1.0 / Disparity::STEPS as f32].into_iter().for_each(|value| cdr.f32(value));
        cdr.into_bytes()
    }

    /// `sensor_msgs/msg/PointCloud2` of points in a row: `x`, `y`, `z`, `rgb`, and if they have them `confidence` from 0 to 1 and
    /// `sigma`, the standard deviation of `z` in metres.
    pub fn points(self, points: &[CloudPoint]) -> Vec<u8> {
        let first = points.first();
        let has_confidences = first.is_some_and(|point| point.confidence.is_some());
        let has_deviations = first.is_some_and(|point| point.sigma.is_some());
        let names =
            [("x", true), ("y", true), ("z", true), ("rgb", true), ("confidence", has_confidences), ("sigma", has_deviations)];
        let names: Vec<&str> = names.into_iter().filter_map(|(name, is_there)| is_there.then_some(name)).collect();
        let mut data = Vec::with_capacity(points.len() * 4 * names.len());
        for &CloudPoint { metres, color: [red, green, blue], confidence, sigma } in points {
            metres.iter().for_each(|metres| data.extend(metres.to_le_bytes()));
            data.extend([blue, green, red, 0]);
            let probability = confidence.map(|confidence| f32::from(confidence) / 255.0);
            [probability, sigma].into_iter().flatten().for_each(|number| data.extend(number.to_le_bytes()));
        }
        let mut cdr = self.begin();
        cdr.u32(1);
        cdr.length(points.len());
        cdr.length(names.len());
        for (name, offset) in names.iter().zip((0..).step_by(4)) {
            const FLOAT32: u8 = 7;
            cdr.string(name);
            cdr.u32(offset);
            cdr.u8(FLOAT32);
            cdr.u32(1);
        }
        cdr.u8(false);
        cdr.length(4 * names.len());
        cdr.length(data.len());
        cdr.bytes(&data);
        // Without points that are not finite.
        cdr.u8(true);
        cdr.into_bytes()
    }
}

/// The pose of a frame in its parent.
#[derive(Clone, Copy, Debug)]
pub struct TransformStamped {
    /// The name of the parent.
    pub parent: &'static str,
    /// The name of the frame.
    pub child: &'static str,
    /// From the frame to its parent.
    pub transform: Transform,
}

/// Writes what follows the header of an image.
fn put_image(cdr: &mut Cdr, [width, height]: [u32; 2], encoding: &str, data: &[u8]) {
    cdr.u32(height);
    cdr.u32(width);
    cdr.string(encoding);
    cdr.u8(false);
    cdr.u32((data.len() / height.max(1) as usize) as u32);
    cdr.bytes(data);
}

fn put_floats(cdr: &mut Cdr, image: &FloatImage, value: impl Fn(f32) -> f32) {
    let data: Vec<u8> = image.pixels().iter().flat_map(|&pixel| value(pixel).to_le_bytes()).collect();
    put_image(cdr, [image.width() as u32, image.height() as u32], "32FC1", &data);
}

/// A region of this size at the top left; of no size for all of the image.
fn put_region(cdr: &mut Cdr, [width, height]: [usize; 2]) {
    [0, 0, height as u32, width as u32].into_iter().for_each(|value| cdr.u32(value));
    cdr.u8(false);
}

/// A message that is being written: little-endian, each number at a multiple of its size.
#[derive(Clone, Debug)]
pub struct Cdr {
    /// Numbers are aligned from here on.
    body: Vec<u8>,
}

impl Cdr {
    /// The bytes before the body: plain CDR, little-endian, no options.
    const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

    /// A message without fields yet.
    pub fn new() -> Cdr {
        Cdr { body: Vec::new() }
    }

    /// The message as it is sent.
    pub fn into_bytes(self) -> Vec<u8> {
        [&Self::ENCAPSULATION[..], &self.body].concat()
    }

    /// A byte, or a truth value.
    pub fn u8(&mut self, value: impl Into<u8>) {
        self.body.push(value.into());
    }

    pub fn u32(&mut self, value: u32) {
        self.aligned(value.to_le_bytes());
    }

    pub fn i32(&mut self, value: i32) {
        self.aligned(value.to_le_bytes());
    }

    pub fn f32(&mut self, value: f32) {
        self.aligned(value.to_le_bytes());
    }

    /// An array of a fixed length.
    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.aligned(value.to_le_bytes()));
    }

    /// The length of a sequence whose elements follow.
    pub fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).expect("messages are far shorter than 4 GiB"));
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.body.extend_from_slice(bytes);
    }

    /// A text, which ends in a zero.
    pub fn string(&mut self, text: &str) {
        self.bytes(&[text.as_bytes(), &[0]].concat());
    }

    fn aligned<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        self.body.resize(self.body.len().next_multiple_of(SIZE), 0);
        self.body.extend_from_slice(&bytes);
    }
}

/// A type of message.
#[derive(Clone, Copy, Debug)]
pub struct Definition {
    /// The package and the name.
    name: &'static str,
    /// A field in each line.
    fields: &'static str,
    /// The types of fields that are messages, and those of theirs.
    types: &'static [&'static Definition],
}

const TIME: Definition = Definition { name: "builtin_interfaces/Time", fields: "int32 sec\nuint32 nanosec", types: &[] };
const HEADER: Definition =
    Definition { name: "std_msgs/Header", fields: "builtin_interfaces/Time stamp\nstring frame_id", types: &[&TIME] };
const REGION: Definition = Definition {
    name: "sensor_msgs/RegionOfInterest",
    fields: "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify",
    types: &[],
};
const POINT_FIELD: Definition =
    Definition { name: "sensor_msgs/PointField", fields: "string name\nuint32 offset\nuint8 datatype\nuint32 count", types: &[] };

const VECTOR: Definition = Definition { name: "geometry_msgs/Vector3", fields: "float64 x\nfloat64 y\nfloat64 z", types: &[] };
const QUATERNION: Definition =
    Definition { name: "geometry_msgs/Quaternion", fields: "float64 x\nfloat64 y\nfloat64 z\nfloat64 w", types: &[] };
const TRANSFORM: Definition = Definition {
    name: "geometry_msgs/Transform",
    fields: "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    types: &[&VECTOR, &QUATERNION],
};
const TRANSFORM_STAMPED: Definition = Definition {
    name: "geometry_msgs/TransformStamped",
    fields: "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
    types: &[&HEADER, &TIME, &TRANSFORM, &VECTOR, &QUATERNION],
};

pub const TF: Definition = Definition {
    name: "tf2_msgs/TFMessage",
    fields: "geometry_msgs/TransformStamped[] transforms",
    types: &[&TRANSFORM_STAMPED, &HEADER, &TIME, &TRANSFORM, &VECTOR, &QUATERNION],
};

pub const IMAGE: Definition = Definition {
    name: "sensor_msgs/Image",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data",
    types: &[&HEADER, &TIME],
};

pub const CAMERA_INFO: Definition = Definition {
    name: "sensor_msgs/CameraInfo",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\n\
             float64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi",
    types: &[&HEADER, &TIME, &REGION],
};

pub const POINT_CLOUD: Definition = Definition {
    name: "sensor_msgs/PointCloud2",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
             uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
    types: &[&HEADER, &TIME, &POINT_FIELD],
};

pub const DISPARITY_IMAGE: Definition = Definition {
    name: "stereo_msgs/DisparityImage",
    fields: "std_msgs/Header header\nsensor_msgs/Image image\nfloat32 f\nfloat32 t\nsensor_msgs/RegionOfInterest valid_window\n\
             float32 min_disparity\nfloat32 max_disparity\nfloat32 delta_d",
    types: &[&HEADER, &TIME, &IMAGE, &REGION],
};

impl Definition {
    /// The name of the schema.
    pub fn full_name(&self) -> String {
        self.name.replacen('/', "/msg/", 1)
    }

    /// The text of the schema: the fields, then those of the types that they have.
    pub fn text(&self) -> String {
        let line = "=".repeat(80);
        let types = self.types.iter().map(|Definition { name, fields, .. }| format!("\n{line}\nMSG: {name}\n{fields}"));
        self.fields.to_owned() + &types.collect::<String>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_lie_at_multiples_of_their_size() {
        let mut cdr = Cdr::new();
        cdr.string("ab");
        cdr.u8(true);
        cdr.u32(7);
        cdr.f64s(&[1.0]);
        cdr.bytes(&[9]);
        let text = [3, 0, 0, 0, b'a', b'b', 0, 1];
        let rest = [7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 1, 0, 0, 0, 9];
        // From the body's beginning: the text at 0, the truth value at 7, 7 at 8, padding to 16, 1.0, the sequence at 24.
        assert_eq!(cdr.into_bytes(), [&[0, 1, 0, 0][..], &text, &rest].concat());
    }
}
