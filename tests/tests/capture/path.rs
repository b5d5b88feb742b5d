//! The order in which positions are visited, against the shortest of all orders.

use multiscopic_core::{
    Frame, View, Views,
    capture::{Plan, Position},
};
use multiscopic_reference::split_mix::Random;

const BASELINE_UM: u32 = 10_000;

/// The length of the way over `positions` and back to the centre, each approached from `backlash` to its left and above.
fn way(positions: &[Position], backlash: f64) -> f64 {
    let (mut at, mut way) = ([0.0; 2], 0.0);
    for position in positions {
        let to = [position.x_um, position.y_um].map(f64::from);
        let before = to.map(|x| x - backlash);
        way += (before[0] - at[0]).hypot(before[1] - at[1]) + (to[0] - before[0]).hypot(to[1] - before[1]);
        at = to;
    }
    way + at[0].hypot(at[1])
}

/// The length of the shortest way over `left`, in any order, after `visited`.
fn shortest(visited: &mut Vec<Position>, left: &mut Vec<Position>, backlash: f64) -> f64 {
    if left.is_empty() {
        return way(visited, backlash);
    }
    let mut least = f64::INFINITY;
    for k in 0..left.len() {
        visited.push(left.swap_remove(k));
        least = least.min(shortest(visited, left, backlash));
        let position = visited.pop().expect("it was pushed");
        left.push(position);
        let last = left.len() - 1;
        left.swap(k, last);
    }
    least
}

/// Checks that the short path has the plan's frames at their positions, and returns its length.
fn checked(views: Views, backlash_um: u32) -> f64 {
    let plan = Plan::new(views, BASELINE_UM);
    let short = plan.shortened(backlash_um);
    assert_eq!(plan.frames().len(), 1 + views.len(), "the centre and all neighbours");
    assert_eq!((short.frames()[0], short.positions()[0]), (Frame::Center, Position::CENTER));
    let of = |plan: &Plan| {
        let mut pairs: Vec<_> = plan.frames().iter().zip(plan.positions()).map(|(f, p)| (f.to_string(), *p)).collect();
        pairs.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        pairs
    };
    assert_eq!(of(&short), of(&plan));
    let length = way(short.positions(), backlash_um.into());
    assert!(length <= way(plan.positions(), backlash_um.into()) + 1.0);
    // Each of the distances is rounded down.
    assert!((length - short.travel_um(backlash_um) as f64).abs() <= 2.0 * short.frames().len() as f64);
    length
}

fn least(views: Views, backlash: f64) -> f64 {
    let plan = Plan::new(views, BASELINE_UM);
    shortest(&mut vec![Position::CENTER], &mut plan.positions()[1..].to_vec(), backlash)
}

#[test]
fn common_layouts_take_the_shortest_way() {
    for views in [Views::STEREO, Views::HORIZONTAL, Views::CROSS, Views::ARRAY] {
        for backlash_um in [0, 500, 4000] {
            let (length, least) = (checked(views, backlash_um), least(views, backlash_um.into()));
            assert!(length <= least + 1.0, "{views:?} with a backlash of {backlash_um}: {length}, shortest {least}");
        }
    }
}

#[test]
fn any_views_take_a_short_way() {
    let mut random = Random(17);
    let mut sum = [0.0; 2];
    for _ in 0..100 {
        let view = |random: &mut Random| View::new(random.below(33) as i8 - 16, random.below(33) as i8 - 16).ok();
        let views: Views = (0..1 + random.below(7)).filter_map(|_| view(&mut random)).collect();
        let backlash_um = [0, 500, 20_000][random.below(3)];
        let (length, least) = (checked(views, backlash_um), least(views, backlash_um.into()));
        assert!(length <= 1.1 * least, "{views:?} with a backlash of {backlash_um}: {length}, shortest {least}");
        sum = [sum[0] + length, sum[1] + least];
    }
    assert!(sum[0] <= 1.005 * sum[1], "{sum:?}");
}

#[test]
fn an_array_of_five_by_five_takes_a_short_way() {
    let array: Views = (-2..=2).flat_map(|j| (-2..=2).filter_map(move |i| View::new(i, j).ok())).collect();
    assert_eq!(array.len(), 24);
    // All positions are at least a baseline apart, and with an odd number of them one step at least is diagonal.
    let least = (24.0 + f64::sqrt(2.0)) * f64::from(BASELINE_UM);
    let length = checked(array, 0);
    assert!(length <= 1.05 * least, "{length}, at least {least}");
}
