//! Medians and quantiles.

/// The median; NaN of nothing.
pub fn median(values: Vec<f64>) -> f64 {
    quantile(values, 0.5)
}

/// The least value that a share of all, below 1, does not reach; NaN of nothing.
pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let below = (share * values.len() as f64) as usize;
    *values.select_nth_unstable_by(below, f64::total_cmp).1
}
