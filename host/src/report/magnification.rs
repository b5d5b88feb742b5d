//! How much longer errors are drawn than they are.

/// The largest of 1, 2 and 5 times powers of ten by which an error may be enlarged without being longer than `longest`; both are
/// lengths in one unit.
pub(super) fn magnification(error: f64, longest: f64) -> f64 {
    let most = longest / error.max(1e-6);
    let power = 10_f64.powf(most.log10().floor());
    [5.0, 2.0].into_iter().map(|factor| factor * power).find(|magnification| *magnification <= most).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_not_longer_than_allowed() {
        for (error, longest, expected) in
            [(1.0, 60.0, 50.0), (1.0, 49.9, 20.0), (3.0, 45.0, 10.0), (100.0, 40.0, 0.2), (0.1, 0.5, 5.0)]
        {
            assert!((magnification(error, longest) / expected - 1.0_f64).abs() < 1e-9, "{error} in {longest}");
        }
    }
}
