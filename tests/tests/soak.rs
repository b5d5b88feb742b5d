//! Captures on simulated hardware that fails at random: `cargo xtask soak` does thousands. Alone in its process, which it
//! watches.

#![cfg(target_os = "linux")]

use multiscopic_tests::soak::{Soak, Usage};

#[test]
fn captures_with_random_faults_leave_nothing_behind() {
    let soak = Soak { captures: 192, rigs: 64, captures_per_round: 1, seed: std::process::id().into() };
    println!("{soak:?}");
    let mut looks: Vec<Usage> = Vec::new();
    let troubles = soak.run(|usage| looks.push(*usage));
    assert_eq!((looks.len(), troubles.values().sum::<usize>()), (3, 192), "{looks:?}, {troubles:?}");
}
