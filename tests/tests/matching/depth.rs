//! Fixed-point depth against the formula in f64.

use multiscopic_core::{
    Disparity, Triangulation,
    fixed::types::{I16F16, U16F16},
};
use proptest::prelude::*;

proptest! {
    #[test]
    fn depth_is_rounded_to_the_nearest_micrometre(focal in 1u32.., baseline_um in 0u32..2_000_000, doffs in -(300 << 16)..300 << 16, bits in -32767i16..) {
        let triangulation = Triangulation { focal_px: U16F16::from_bits(focal), baseline_um, doffs_px: I16F16::from_bits(doffs) };
        let d = Disparity::from_bits(bits).expect("not the one that is invalid");
        let shift = f64::from(bits) / 64.0 + f64::from(doffs) / 65536.0;
        let exact = f64::from(focal) / 65536.0 * f64::from(baseline_um) / shift;
        match triangulation.depth(d) {
            // Half a micrometre, and two roundings of `f64`.
            Some(depth) => prop_assert!((f64::from(depth.micrometres()) - exact).abs() <= 0.5 + exact * 1e-15, "{depth}, {exact}"),
            None => prop_assert!(shift <= 0.0 || exact >= f64::from(u32::MAX), "{exact} at {shift} px"),
        }
    }
}

#[test]
fn there_is_no_depth_at_infinity() {
    let triangulation = Triangulation { focal_px: U16F16::from_num(800), baseline_um: 20_000, doffs_px: I16F16::from_num(-2) };
    let depth = |pixels: i16| triangulation.depth(Disparity::from_bits(64 * pixels).expect("in range"));
    assert_eq!(depth(2), None);
    assert_eq!(depth(1), None);
    assert_eq!(depth(10).map(|depth| depth.to_string()), Some("2.000000 m".into()));
    assert_eq!(depth(10).and_then(|depth| depth.millimetres()), Some(2000));
}
