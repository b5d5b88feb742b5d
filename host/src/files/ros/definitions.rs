//! The definitions of messages, as readers of MCAP files expect them beside the data.

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
