//! Recordings for ROS 2: MCAP files, which `ros2 bag`, Foxglove and others read. Nothing of ROS is needed to write them.
//!
//! Files for Rerun are made of recordings by its own program, so that they have the format of the installed version.
//!
//! The module `messages` has the messages, the fields of each type of them, and their encoding.

mod messages;

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Write},
    path::Path,
    process::{Command, Stdio},
    time::Duration,
};

use mcap::{WriteOptions, records::MessageHeader, write::NoSeek};

use super::{cloud::Cloud, output};
use crate::{
    error::{Error, Result},
    images::{Picture, PointFrame, Transform},
};

use messages::{Definition, Stamp, TransformStamped};

/// The findings of a scene, for ROS 2.
///
/// | topic | type | what |
/// | --- | --- | --- |
/// | `/camera/image` | `sensor_msgs/msg/Image` | the centre, as it was matched |
/// | `/camera/camera_info`, `/depth/camera_info` | `sensor_msgs/msg/CameraInfo` | the camera, of rectified images |
/// | `/depth/image` | `sensor_msgs/msg/Image` | metres as `32FC1`, NaN where unknown (REP 118) |
/// | `/confidence/image` | `sensor_msgs/msg/Image` | confidences, if there are any, 255 is certain |
/// | `/disparity` | `stereo_msgs/msg/DisparityImage` | pixels as `32FC1`, below `min_disparity` where unknown |
/// | `/points` | `sensor_msgs/msg/PointCloud2` | metres in the frame of the cloud; `confidence` and `sigma` if there are any |
/// | `/tf_static`, `/tf` | `tf2_msgs/msg/TFMessage` | where the camera is on the tool, and the tool in the base, as far as it is known |
#[derive(Clone, Copy, Debug)]
pub struct RosRecording<'a> {
    /// The points, and the maps that they are made of.
    pub cloud: Cloud<'a>,
    /// The smallest and the largest disparity of the search, in pixels.
    pub range: [i16; 2],
}

impl RosRecording<'_> {
    /// The frame of rectified images that are turned against the camera's own.
    pub const RECTIFIED_FRAME_ID: &'static str = "camera_rectified_optical_frame";

    /// Writes an MCAP file with one message on each topic, all from a `time` since 1970.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size, and
    /// [`Error::Write`]. Any previous version of the file is unchanged.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn write(&self, path: &Path, time: Duration) -> Result<()> {
        self.cloud.check()?;
        output::write(path, |file| {
            let mut stream = RosStream::new(file)?;
            stream.send(self, time)?;
            stream.finish()
        })
    }

    /// Encodes one message for each topic, all from a `time` since 1970.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn messages(&self, time: Duration) -> Result<Vec<RosMessage>> {
        let RosRecording { cloud, range } = *self;
        cloud.check()?;
        let Cloud { disparities, confidences, center, geometry, frame, frames, .. } = cloud;
        let (camera_id, is_turned) = (PointFrame::Camera.id(), frames.rectified_in_camera != Transform::IDENTITY);
        let stamp = Stamp { time, frame_id: if is_turned { RosRecording::RECTIFIED_FRAME_ID } else { camera_id } };
        let size = [disparities.width(), disparities.height()];
        let points: Vec<_> = cloud.points().collect();
        let camera = stamp.camera(geometry, &frames.rectified_in_camera.inverse(), size);
        let mut messages = vec![
            ("/camera/image", &messages::IMAGE, stamp.picture(center)),
            ("/camera/camera_info", &messages::CAMERA_INFO, camera.clone()),
            ("/depth/image", &messages::IMAGE, stamp.depth(&geometry.depths(disparities))),
            ("/depth/camera_info", &messages::CAMERA_INFO, camera),
            ("/disparity", &messages::DISPARITY_IMAGE, stamp.disparities(&disparities.to_float(), geometry, range)),
            ("/points", &messages::POINT_CLOUD, Stamp { frame_id: frame.id(), ..stamp }.points(&points)),
        ];
        let link = |parent: &'static str, child, transform| TransformStamped { parent, child, transform };
        let rectified = is_turned.then(|| link(camera_id, RosRecording::RECTIFIED_FRAME_ID, frames.rectified_in_camera));
        let on_tool = frames.camera_in_tool.map(|transform| link(PointFrame::Tool.id(), camera_id, transform));
        // Without the camera on it, the tool would hang in a tree of its own.
        let in_base =
            on_tool.and(frames.tool_in_base).map(|transform| link(PointFrame::Base.id(), PointFrame::Tool.id(), transform));
        for (topic, links) in [("/tf_static", [rectified, on_tool]), ("/tf", [in_base, None])] {
            let links: Vec<TransformStamped> = links.into_iter().flatten().collect();
            if !links.is_empty() {
                messages.push((topic, &messages::TF, stamp.transforms(&links)));
            }
        }
        if let Some(confidences) = confidences {
            messages.push(("/confidence/image", &messages::IMAGE, stamp.picture(&Picture::from(confidences))));
        }
        Ok(messages.into_iter().map(|(topic, definition, cdr)| RosMessage { topic, definition, cdr }).collect())
    }
}

/// A message, encoded.
#[derive(Clone, Debug)]
pub struct RosMessage {
    /// The topic, such as `/points`.
    pub topic: &'static str,
    definition: &'static Definition,
    /// The message in CDR, as ROS 2 encodes it.
    pub cdr: Vec<u8>,
}

impl RosMessage {
    /// The encoding of messages, as MCAP and Foxglove name it.
    pub const ENCODING: &'static str = "cdr";
    /// The language of [`schema_text`](RosMessage::schema_text), as MCAP and Foxglove name it.
    pub const SCHEMA_ENCODING: &'static str = "ros2msg";

    /// The name of its type, such as `sensor_msgs/msg/PointCloud2`.
    pub fn schema_name(&self) -> String {
        self.definition.full_name()
    }

    /// The definition of its type and of those in it.
    pub fn schema_text(&self) -> String {
        self.definition.text()
    }
}

/// Recordings one after the other, as MCAP, to anything that takes bytes: a file, or a pipe.
pub struct RosStream<W: Write> {
    writer: mcap::Writer<NoSeek<W>>,
    sent: u32,
}

impl<W: Write> RosStream<W> {
    /// Begins a stream.
    ///
    /// # Errors
    /// Those of writing.
    pub fn new(to: W) -> io::Result<RosStream<W>> {
        let library = concat!("multiscopic ", env!("CARGO_PKG_VERSION"));
        // A chunk has a capture, which `send` closes. Readers such as Rerun's find nothing that is outside of chunks.
        let options = WriteOptions::new().compression(None).chunk_size(None).disable_seeking(true);
        let writer = options.profile("ros2").library(library).create(NoSeek::new(to)).map_err(io::Error::other)?;
        Ok(RosStream { writer, sent: 0 })
    }

    /// Writes one message on each topic, all from a `time` since 1970.
    ///
    /// # Errors
    /// If the centre and the disparities differ in size, and those of writing.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn send(&mut self, recording: &RosRecording, time: Duration) -> io::Result<()> {
        for message in recording.messages(time).map_err(io::Error::other)? {
            self.write(&message, time.as_nanos() as u64).map_err(io::Error::other)?;
        }
        self.sent += 1;
        self.writer.flush().map_err(io::Error::other)
    }

    fn write(&mut self, message: &RosMessage, time: u64) -> mcap::McapResult<()> {
        // A schema or channel that is there already is not written again.
        let text = message.schema_text();
        let schema = self.writer.add_schema(&message.schema_name(), RosMessage::SCHEMA_ENCODING, text.as_bytes())?;
        let channel_id = self.writer.add_channel(schema, message.topic, RosMessage::ENCODING, &channel_metadata())?;
        let header = MessageHeader { channel_id, sequence: self.sent, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, &message.cdr)
    }

    /// Ends the stream with an index of what it has.
    ///
    /// # Errors
    /// Those of writing.
    pub fn finish(mut self) -> io::Result<()> {
        self.writer.finish().map(drop).map_err(io::Error::other)
    }
}

/// Metadata that the profile `ros2` requires of channels: the qualities of service that publishers offered, as a list in YAML.
/// There was no publisher, and `ros2 bag` takes its own.
fn channel_metadata() -> BTreeMap<String, String> {
    [("offered_qos_profiles".into(), "[]".into())].into()
}

/// Rerun's program.
const PROGRAM: &str = "rerun";

impl RosRecording<'_> {
    /// Writes a file for Rerun with one message on each topic, all from a `time` since 1970.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size, and [`Error::Write`], also if Rerun
    /// is not installed or fails. Any previous version of the file is unchanged.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn write_rerun(&self, path: &Path, time: Duration) -> Result<()> {
        self.cloud.check()?;
        output::write(path, |file| {
            let folder = tempfile::tempdir()?;
            let [recording, converted] = ["recording.mcap", "recording.rrd"].map(|name| folder.path().join(name));
            let mut stream = RosStream::new(File::create(&recording)?)?;
            stream.send(self, time)?;
            stream.finish()?;
            let convert = ["mcap", "convert", "--application-id", "multiscopic", "-o"];
            run(Command::new(PROGRAM).args(convert).arg(&converted).arg(&recording))?;
            io::copy(&mut File::open(&converted)?, file).map(drop)
        })
    }
}

/// Checks that Rerun is installed.
///
/// # Errors
/// [`Error::Usage`] if its program cannot be run.
pub fn check_rerun() -> Result<()> {
    run(Command::new(PROGRAM).arg("--version")).map_err(|error| Error::Usage(error.to_string()))
}

/// Runs Rerun's program. What it says is shown if it fails.
fn run(command: &mut Command) -> io::Result<()> {
    let missing = |error| io::Error::other(format!("`{PROGRAM}` cannot be run, which `pip install rerun-sdk` brings: {error}"));
    let output = command.stdin(Stdio::null()).output().map_err(missing)?;
    if output.status.success() {
        return Ok(());
    }
    io::stderr().write_all(&output.stderr)?;
    Err(io::Error::other(format!("`{PROGRAM}` failed ({})", output.status)))
}
