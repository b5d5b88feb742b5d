//! The simulated sensor: noise and the tone curve.

use crate::scene::{pinhole_camera::PinholeCamera, random, vec3::Vec3};

/// The pixel that the camera makes of `light`. The hash `place` decides its noise.
pub fn develop(camera: &PinholeCamera, light: Vec3, place: u64) -> [u8; 3] {
    let mut channel = 0;
    [light.x, light.y, light.z].map(|light| {
        channel += 1;
        let read = camera.read_noise / camera.full_well;
        let deviation = (light / camera.full_well + read * read).sqrt();
        let signal = light + deviation * random::gaussian(random::hash(place ^ (channel << 56)));
        (tone(signal.max(0.0)) * 255.0 + 0.5) as u8
    })
}

/// Linear light to display brightness: a rational approximation of a film curve, which compresses highlights,
/// then a gamma of 2.
fn tone(light: f64) -> f64 {
    let film = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14);
    film.min(1.0).sqrt()
}
