//! The firmware's pipeline in the engine. The workspace's tests run every profile, and compare it with `multiscopic match`.
//!
//! Not a unit test, which would compile the kernels once more.

use multiscopic_core::{Frame, Fusion, View};
use multiscopic_edge::profile;
use multiscopic_engine::{Planes, SimulationError, simulate};

const SIZE: [usize; 2] = [160, 120];

#[test]
fn the_pipeline_runs_in_its_workspace() {
    let (profile, gray) = (profile::QQVGA, [9; SIZE[0] * SIZE[1]]);
    let frames = Planes::new(SIZE, &gray).with(View::LEFT, &gray).with(View::RIGHT, &gray);
    let simulation = simulate(&profile, Fusion::Min, &frames, &|| ()).unwrap();
    assert_eq!(simulation.workspace, profile.lengths().bytes());
    assert_eq!(simulation.passes, 1);
    let views = [View::LEFT, View::RIGHT].map(Frame::View);
    assert_eq!(simulation.lines_read, [(Frame::Center, 120), (views[0], 120), (views[1], 120)]);
}

#[test]
fn frames_that_do_not_fit_the_profile_are_refused() {
    let gray = [9; SIZE[0] * SIZE[1]];
    let refusal = |frames| simulate(&profile::QQVGA, Fusion::Min, &frames, &|| ()).unwrap_err();
    let missing = refusal(Planes::new(SIZE, &gray).with(View::RIGHT, &gray));
    assert_eq!(missing, SimulationError::MissingView { view: View::LEFT });
    let small = refusal(Planes::new([80, 120], &gray[..80 * 120]));
    let expected = SimulationError::FrameSize { profile: "qqvga", found: [80, 120], expected: SIZE };
    assert_eq!(small, expected);
    assert_eq!(small.to_string(), "found frames of 80x120 pixels, expected 160x120 for profile qqvga");
}
