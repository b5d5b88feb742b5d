//! The commonest faults of a set of views: what each does to images that are right.

use image::{GrayImage, Luma, imageops};
use multiscopic::{
    Frames, Picture,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Frame, View};

/// A fault, named as its picture in `docs/faults/`.
pub struct Fault {
    /// The name of the picture, without its ending.
    pub name: &'static str,
    /// The frames with the fault, given right ones.
    pub spoil: fn(&Frames) -> Frames,
}

/// The twelve of `docs/faults.md`, in its order.
pub const FAULTS: [Fault; 12] = [
    Fault { name: "swapped", spoil: |frames| set(frames, [center, right, left]) },
    Fault { name: "other-axis", spoil: |frames| Frames::new(center(frames)).with(View::TOP, right(frames)) },
    Fault { name: "upside-down", spoil: |frames| with_right(frames, |image| imageops::rotate180(&image)) },
    Fault { name: "mirrored", spoil: |frames| with_right(frames, |image| imageops::flip_horizontal(&image)) },
    Fault { name: "rows", spoil: |frames| with_right(frames, |image| moved(image, |[u, v]| [u, v - 6.0])) },
    Fault { name: "turned", spoil: |frames| with_right(frames, |image| turned(image, 1.5)) },
    Fault { name: "rolled", spoil: |frames| frames.map(|picture| Picture::Gray(turned(picture.to_gray(), 8.0))) },
    Fault { name: "dark", spoil: |frames| with_right(frames, |image| scaled(image, 0.6)) },
    Fault { name: "overexposed", spoil: |frames| with_right(frames, |image| scaled(image, 1.8)) },
    Fault { name: "blurred", spoil: |frames| with_right(frames, |image| imageops::blur(&image, 5.0)) },
    Fault { name: "copy", spoil: |frames| set(frames, [center, left, center]) },
    Fault { name: "moved", spoil: |frames| with_right(frames, with_moved_object) },
];

/// The centre, the left and the right view of the demo's scene.
pub fn right_frames() -> Frames {
    let shot = render(&Scene::demo(), &PinholeCamera::new(480, 360), 3);
    let gray = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray();
    let frames = Frames::new(gray(Frame::Center)).with(View::LEFT, gray(Frame::View(View::LEFT)));
    frames.with(View::RIGHT, gray(Frame::View(View::RIGHT)))
}

/// Frames whose centre, left and right view are chosen.
fn set(frames: &Frames, [center, left, right]: [fn(&Frames) -> GrayImage; 3]) -> Frames {
    Frames::new(center(frames)).with(View::LEFT, left(frames)).with(View::RIGHT, right(frames))
}

fn center(frames: &Frames) -> GrayImage {
    frames.get(Frame::Center).expect("frames always have a centre").clone()
}

fn left(frames: &Frames) -> GrayImage {
    frames.get(Frame::View(View::LEFT)).expect("it has a left view").clone()
}

fn right(frames: &Frames) -> GrayImage {
    frames.get(Frame::View(View::RIGHT)).expect("it has a right view").clone()
}

fn with_right(frames: &Frames, spoil: impl Fn(GrayImage) -> GrayImage) -> Frames {
    frames.clone().with(View::RIGHT, spoil(right(frames)))
}

/// The image whose pixels lie where `place` leads to.
fn moved(image: GrayImage, place: impl Fn([f64; 2]) -> [f64; 2] + Sync) -> GrayImage {
    Picture::Gray(image).resampled(|pixel| Some(place(pixel.map(|at| at as f64))), 1.0).to_gray()
}

fn turned(image: GrayImage, degrees: f64) -> GrayImage {
    let [x, y] = [image.width(), image.height()].map(|side| f64::from(side - 1) / 2.0);
    let (sin, cos) = degrees.to_radians().sin_cos();
    moved(image, |[u, v]| [x + cos * (u - x) - sin * (v - y), y + sin * (u - x) + cos * (v - y)])
}

fn scaled(mut image: GrayImage, gain: f64) -> GrayImage {
    // The conversion clamps.
    image.iter_mut().for_each(|pixel| *pixel = (gain * f64::from(*pixel)).round() as u8);
    image
}

/// The image with a twentieth of it, in the middle, moved to the side.
fn with_moved_object(image: GrayImage) -> GrayImage {
    let (width, height) = image.dimensions();
    let columns = width * 2 / 5..width * 13 / 20;
    let rows = height * 2 / 5..height * 13 / 20;
    let by = width / 32;
    GrayImage::from_fn(width, height, |u, v| {
        let is_moved = rows.contains(&v) && (columns.start + by..columns.end + by).contains(&u);
        Luma([image.get_pixel(if is_moved { u - by } else { u }, v).0[0]])
    })
}
