//! Recordings for ROS 2, read back by their definitions.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use multiscopic_tests::program::{Invocation, make};

/// Reads a message of plain little-endian CDR: each number lies at a multiple of its size.
struct Fields<'a> {
    body: &'a [u8],
    place: usize,
}

impl<'a> Fields<'a> {
    fn new(message: &'a [u8]) -> Fields<'a> {
        assert_eq!(message[..4], [0, 1, 0, 0], "plain CDR, little-endian");
        Fields { body: &message[4..], place: 0 }
    }

    fn take(&mut self, length: usize) -> &'a [u8] {
        self.place += length;
        &self.body[self.place - length..self.place]
    }

    fn number<const SIZE: usize>(&mut self) -> [u8; SIZE] {
        self.place = self.place.div_ceil(SIZE) * SIZE;
        self.take(SIZE).try_into().expect("so many bytes")
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.number())
    }

    fn f32(&mut self) -> f32 {
        f32::from_le_bytes(self.number())
    }

    fn f64s(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| f64::from_le_bytes(self.number())).collect()
    }

    fn bytes(&mut self) -> &'a [u8] {
        let length = self.u32() as usize;
        self.take(length)
    }

    fn text(&mut self) -> &'a str {
        std::str::from_utf8(self.bytes()).expect("UTF-8").strip_suffix('\0').expect("a zero at the end")
    }

    /// The seconds of a header.
    fn header(&mut self) -> u32 {
        let seconds = self.u32();
        assert!(self.u32() < 1_000_000_000, "nanoseconds");
        assert_eq!(self.text(), "camera_optical_frame");
        seconds
    }

    /// The rest of an image message after its header: its size, encoding and data.
    fn image(&mut self) -> ([u32; 2], &'a str, &'a [u8]) {
        let [height, width] = [self.u32(), self.u32()];
        let encoding = self.text();
        assert_eq!(self.take(1), [0], "the lower byte comes first");
        let step = self.u32();
        let data = self.bytes();
        assert_eq!(data.len() as u32, step * height, "{encoding}");
        ([width, height], encoding, data)
    }

    /// The size of a region at the top left.
    fn region(&mut self) -> [u32; 2] {
        assert_eq!([self.u32(), self.u32()], [0, 0]);
        let [height, width] = [self.u32(), self.u32()];
        assert_eq!(self.take(1), [0]);
        [width, height]
    }

    fn end(&self) {
        assert_eq!(self.place, self.body.len(), "all fields were read");
    }
}

fn floats(data: &[u8]) -> Vec<f32> {
    data.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

#[test]
fn every_field_and_pixel_is_that_of_the_other_files() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    make("scene --random --seed 7 --views 2 --size 160x120", &dir.path().join("scenes"));
    let rig = path("scenes/0000");
    let outputs = [
        ("-o", "d.pfm"),
        ("--depth", "z.pfm"),
        ("--confidence", "c.png"),
        ("--ply", "p.ply"),
        ("--mcap", "r.mcap"),
        ("--sigma", "s.pfm"),
    ];
    let mut words: Vec<String> = [
        "match",
        &rig,
        "--method",
        "bm",
        "--num-disparities",
        "24",
        "--uniqueness-ratio",
        "10",
        "--doffs",
        "2",
        "--edges",
        "keep",
    ]
    .map(Into::into)
    .into();
    outputs.iter().for_each(|(option, name)| words.extend([(*option).into(), path(name)]));
    Invocation::new(words).assert_done();

    let bag = fs::read(path("r.mcap")).expect("a recording");
    // Many readers look for messages in chunks alone.
    let summary = mcap::Summary::read(&bag).expect("a recording").expect("an index");
    assert_eq!(summary.chunk_indexes.len(), 1);
    let mut messages = BTreeMap::new();
    for message in mcap::MessageStream::new(&bag).expect("an MCAP file") {
        let message = message.expect("a message");
        let schema = message.channel.schema.clone().expect("a definition");
        assert_eq!((&*message.channel.message_encoding, &*schema.encoding), ("cdr", "ros2msg"));
        // The profile `ros2` of the specification requires it.
        assert_eq!(message.channel.metadata.get("offered_qos_profiles").map(String::as_str), Some("[]"));
        let seconds = Fields::new(&message.data).header();
        assert_eq!(u64::from(seconds), message.log_time / 1_000_000_000);
        messages.insert(message.channel.topic.clone(), (schema.name.clone(), message.data.into_owned()));
    }
    assert_eq!(messages.len(), 7, "{:?}", messages.keys());
    let message = |topic: &str, name: &str| {
        let (found, data) = &messages[topic];
        assert_eq!(found, name, "{topic}");
        let mut fields = Fields::new(data);
        fields.header();
        fields
    };
    let size = [160, 120];
    let map = |name: &str| multiscopic::files::read_pfm(Path::new(&path(name))).expect("a map");

    let mut center = message("/camera/image", "sensor_msgs/msg/Image");
    let picture = image::open(Path::new(&rig).join("center.png")).expect("the centre").into_rgb8();
    assert_eq!(center.image(), (size, "rgb8", &picture.as_raw()[..]));
    center.end();

    let mut depth = message("/depth/image", "sensor_msgs/msg/Image");
    let (found, encoding, data) = depth.image();
    assert_eq!((found, encoding), (size, "32FC1"));
    let known = |(found, metres): (f32, &f32)| if metres.is_finite() { found == *metres } else { found.is_nan() };
    assert!(floats(data).into_iter().zip(map("z.pfm").pixels()).all(known), "depths");
    depth.end();

    let mut confidence = message("/confidence/image", "sensor_msgs/msg/Image");
    let picture = image::open(path("c.png")).expect("confidences").into_luma8();
    assert_eq!(confidence.image(), (size, "mono8", &picture.as_raw()[..]));

    let mut disparity = message("/disparity", "stereo_msgs/msg/DisparityImage");
    disparity.header();
    let (found, encoding, data) = disparity.image();
    assert_eq!((found, encoding), (size, "32FC1"));
    let [focal_px, baseline] = [disparity.f32(), disparity.f32()];
    assert_eq!(disparity.region(), size);
    let [min, max, step] = [disparity.f32(), disparity.f32(), disparity.f32()];
    disparity.end();
    assert_eq!((max - min, step), (23.0, 1.0 / 64.0));
    let (disparities, depths) = (floats(data), map("z.pfm"));
    assert!(disparities.iter().any(|d| *d < min) && disparities.iter().any(|d| *d >= min));
    for ((&found, &d), &metres) in disparities.iter().zip(map("d.pfm").pixels()).zip(depths.pixels()) {
        assert!(if d.is_finite() { found == d + 2.0 } else { found < min }, "{found} for {d}");
        // Depth as readers compute it.
        assert!(!metres.is_finite() || (focal_px * baseline / found - metres).abs() < 1e-5 * metres, "{found}: {metres} m");
    }

    for topic in ["/camera/camera_info", "/depth/camera_info"] {
        let mut camera = message(topic, "sensor_msgs/msg/CameraInfo");
        assert_eq!([camera.u32(), camera.u32()], [120, 160]);
        assert_eq!((camera.text(), camera.u32()), ("plumb_bob", 5));
        assert_eq!(camera.f64s(5), [0.0; 5]);
        let [k, r, p] = [9, 9, 12].map(|count| camera.f64s(count));
        assert_eq!((k[0] as f32, k[4], k[8]), (focal_px, k[0], 1.0));
        assert_eq!(r, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!((p[0], p[2], p[3], p[6], p[10]), (k[0], k[2], 0.0, k[5], 1.0));
        assert_eq!([camera.u32(), camera.u32()], [0, 0]);
        assert_eq!(camera.region(), [0, 0]);
        camera.end();
    }

    let mut cloud = message("/points", "sensor_msgs/msg/PointCloud2");
    assert_eq!(cloud.u32(), 1, "a row of points");
    let count = cloud.u32();
    let names: Vec<&str> = (0..cloud.u32())
        .map(|index| {
            let name = cloud.text();
            assert_eq!((cloud.u32(), cloud.take(1), cloud.u32()), (4 * index, &[7][..], 1), "{name} is one float32");
            name
        })
        .collect();
    assert_eq!(names, ["x", "y", "z", "rgb", "confidence", "sigma"]);
    assert_eq!((cloud.take(1), cloud.u32(), cloud.u32()), (&[0][..], 24, 24 * count));
    let points = cloud.bytes();
    assert_eq!(cloud.take(1), [1], "all are finite");
    cloud.end();
    let ply = fs::read(path("p.ply")).expect("points");
    let start = ply.windows(11).position(|text| text == b"end_header\n").expect("a header") + 11;
    let (vertices, rest) = ply[start..].as_chunks::<20>();
    assert_eq!((vertices.len(), rest.len()), (count as usize, 0));
    let sigmas = map("s.pfm").into_pixels().into_iter().filter(|millimetres| millimetres.is_finite());
    assert_eq!(sigmas.clone().count(), vertices.len());
    for ((point, vertex), millimetres) in points.as_chunks::<24>().0.iter().zip(vertices).zip(sigmas) {
        assert_eq!(point[..12], vertex[..12], "coordinates");
        assert_eq!([point[14], point[13], point[12]], vertex[12..15], "red, green, blue");
        assert_eq!(floats(&point[16..20]), [f32::from(vertex[15]) / 255.0], "confidence");
        assert_eq!(point[20..], vertex[16..], "standard deviation");
        assert!((1000.0 * floats(&point[20..])[0] - millimetres).abs() < 1e-4 * millimetres, "{millimetres} mm");
    }
}

/// The messages of a recording by topic, without the times that they were written at.
fn timeless(path: &str) -> BTreeMap<String, Vec<Vec<u8>>> {
    let bag = fs::read(path).expect("a recording");
    let mut messages = BTreeMap::<_, Vec<_>>::new();
    for message in mcap::MessageStream::new(&bag).expect("an MCAP file") {
        let message = message.expect("a message");
        let mut data = message.data.into_owned();
        let (second, rest) = (message.log_time / 1_000_000_000, message.log_time % 1_000_000_000);
        let stamp = [(second as u32).to_le_bytes(), (rest as u32).to_le_bytes()].concat();
        while let Some(place) = data.windows(8).position(|bytes| bytes == stamp) {
            data[place..place + 8].fill(0);
        }
        messages.entry(message.channel.topic.clone()).or_default().push(data);
    }
    messages
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_live_recording_has_what_match_finds_in_each_capture() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let capture = "capture --camera sim --stage sim --baseline 20 --speed 250 --acceleration 1200 --settle 0 --size 160x120 --views 2 --live --count 3 \
                   --num-disparities 24";
    let outputs = ["-o", &path("live"), "--mcap", &path("live.mcap")];
    Invocation::new(capture.split(' ').chain(outputs)).assert_done();
    let live = timeless(&path("live.mcap"));
    assert_eq!(live.len(), 7, "{:?}", live.keys());
    for (i, folder) in ["0001", "0002", "0003"].into_iter().enumerate() {
        let rig = path(&format!("live/{folder}"));
        Invocation::new(["match", &rig, "--method", "bm", "--num-disparities", "24", "--mcap", &path("r.mcap")]).assert_done();
        for (topic, expected) in timeless(&path("r.mcap")) {
            assert_eq!(live[&topic].len(), 3, "{topic}");
            assert!(live[&topic][i] == expected[0], "{topic} of {folder}");
        }
    }
}

#[test]
fn a_recording_needs_a_baseline() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    make("scene --random --seed 7 --size 48x36", &dir.path().join("scenes"));
    let frame = |name: &str| path(&format!("scenes/0000/{name}.png"));
    let words = ["match", "--center", &frame("center"), "--right", &frame("right"), "--mcap", &path("r.mcap")];
    Invocation::new(words).assert_refused(&["--mcap", "baseline"]);
    Invocation::new(["match", &path("scenes/0000"), "--mcap", "r.bag"]).assert_refused(&["r.bag", ".mcap"]);
}

/// A folder with a program `rerun` in its place that runs a script.
#[cfg(unix)]
fn folder_of_rerun(dir: &Path, script: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;

    let folder = dir.join("bin");
    fs::create_dir_all(&folder).expect("a folder");
    let program = folder.join("rerun");
    fs::write(&program, format!("#!/bin/sh\n{script}\n")).expect("a script");
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("permissions");
    folder
}

#[cfg(unix)]
#[test]
fn rerun_converts_the_same_recording() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    make("scene --random --seed 7 --size 48x36", &dir.path().join("scenes"));
    let words = ["match", &path("scenes/0000"), "--num-disparities", "8", "--mcap", &path("r.mcap"), "--rerun", &path("r.rrd")];
    let run = |folder: PathBuf| Invocation::with(words, [("PATH", folder)]);
    let names = || fs::read_dir(dir.path()).expect("a folder").count();

    run(dir.path().join("nowhere")).assert_refused(&["rerun", "pip install rerun-sdk"]);
    let failing = run(folder_of_rerun(dir.path(), r#"[ "$1" = --version ] || { echo "no such version" >&2; exit 3; }"#));
    failing.assert_refused(&["no such version", "r.rrd", "3"]);
    assert_eq!(names(), 2, "the scenes and the programs");

    // Its inputs, for comparison.
    let copying = r#"[ "$1" = --version ] || { [ "$1 $2 $5" = "mcap convert -o" ] && /bin/cp "$7" "$6"; }"#;
    run(folder_of_rerun(dir.path(), copying)).assert_done();
    assert_eq!(timeless(&path("r.rrd")), timeless(&path("r.mcap")));
    assert_eq!(names(), 4);
}
