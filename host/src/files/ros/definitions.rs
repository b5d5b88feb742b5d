//! The definitions of messages, as readers of MCAP files expect them beside the data.

/// A type of message: its name, and its fields followed by the definitions of the types that they have.
pub type Definition = (&'static str, &'static [&'static str]);

const TIME: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec";
const HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id";
const REGION: &str =
    "MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify";
const POINT_FIELD: &str = "MSG: sensor_msgs/PointField\nstring name\nuint32 offset\nuint8 datatype\nuint32 count";

macro_rules! image_fields {
    () => {
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data"
    };
}

pub const IMAGE: Definition = ("sensor_msgs/msg/Image", &[image_fields!(), HEADER, TIME]);

pub const CAMERA_INFO: Definition = (
    "sensor_msgs/msg/CameraInfo",
    &[
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\n\
         float64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi",
        HEADER,
        TIME,
        REGION,
    ],
);

pub const POINT_CLOUD: Definition = (
    "sensor_msgs/msg/PointCloud2",
    &[
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
         uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
        HEADER,
        TIME,
        POINT_FIELD,
    ],
);

pub const DISPARITY_IMAGE: Definition = (
    "stereo_msgs/msg/DisparityImage",
    &[
        "std_msgs/Header header\nsensor_msgs/Image image\nfloat32 f\nfloat32 t\nsensor_msgs/RegionOfInterest valid_window\n\
         float32 min_disparity\nfloat32 max_disparity\nfloat32 delta_d",
        HEADER,
        TIME,
        concat!("MSG: sensor_msgs/Image\n", image_fields!()),
        REGION,
    ],
);

/// The text of a definition.
pub fn text((_, parts): Definition) -> String {
    parts.join(&format!("\n{}\n", "=".repeat(80)))
}
