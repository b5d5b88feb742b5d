//! Synthetic scenes with known depth: a small ray tracer, with a camera on a stage that takes the frames.
//!
//! Every machine renders the same bytes. The code uses only operations that IEEE 754 rounds exactly
//! (`+ - * /` and square root, but no powers, logarithms or angles), every random number is a hash of its
//! place and the seed, and no sum depends on the order of threads.
//!
//! ```
//! use multiscopic::scene::{PinholeCamera, Scene, render};
//! let camera = PinholeCamera::new(64, 48);
//! let shot = render(&Scene::demo(), &camera, 1);
//! assert_eq!(shot.center.dimensions(), (64, 48));
//! assert!(shot.truth.pixels().iter().all(|d| (0.5..5.5).contains(d)));
//! ```

mod description;
mod made_up;
mod pinhole_camera;
mod random;
mod render;
mod shape;
mod texture;
mod vec3;

pub use description::{Finish, Lamp, Object, Scene, Shot};
pub use made_up::{Flaws, RandomScene, Setting};
pub use pinhole_camera::{PinholeCamera, PosedCamera};
pub use render::{render, render_at, render_views, trace};
pub use shape::Shape;
pub use texture::{Motif, Placement, Texture};
pub use vec3::{Pose, Ray, Vec3};
