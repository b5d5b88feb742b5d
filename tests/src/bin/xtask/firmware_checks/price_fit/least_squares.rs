//! Non-negative least squares.

/// The non-negative `x` that minimises the relative error of `rows * x` against `measured`, where `rows[i]`
/// has the counts of measurement `i`.
///
/// Projected coordinate descent: optimises one price at a time until nothing changes.
pub fn prices(rows: &[Vec<f64>], measured: &[f64]) -> Vec<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    // Normalise the columns, so that small and large counts weigh alike.
    let relative: Vec<Vec<f64>> = rows.iter().zip(measured).map(|(row, m)| row.iter().map(|count| count / m).collect()).collect();
    let scales: Vec<f64> = (0..columns).map(|j| relative.iter().map(|row| row[j] * row[j]).sum::<f64>().sqrt()).collect();
    let column = |j: usize| relative.iter().map(move |row| row[j]);
    let mut x = vec![0.0; columns];
    let mut rest = vec![1.0; relative.len()];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for j in (0..columns).filter(|&j| scales[j] > 0.0) {
            let slope: f64 = column(j).zip(&rest).map(|(count, rest)| count * rest).sum();
            let moved = (x[j] + slope / (scales[j] * scales[j])).max(0.0) - x[j];
            x[j] += moved;
            rest.iter_mut().zip(column(j)).for_each(|(rest, count)| *rest -= moved * count);
            change = change.max((moved * scales[j]).abs());
        }
        if change < 1e-12 {
            break;
        }
    }
    x
}

/// The most rounds of descent.
const SWEEPS: usize = 200_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_prices_are_found() {
        let rows: Vec<Vec<f64>> = (1..9).map(|i| vec![f64::from(i), f64::from(i * i % 7), 1000.0]).collect();
        let measured: Vec<f64> = rows.iter().map(|row| 3.0 * row[0] + 50.0 * row[1] + 0.25 * row[2]).collect();
        let found = prices(&rows, &measured);
        for (found, expected) in found.iter().zip([3.0, 50.0, 0.25]) {
            assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
    }

    #[test]
    fn no_price_is_negative() {
        let rows = [[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]].map(|row| row.to_vec());
        let found = prices(&rows, &[1.0, 3.0, 5.0]);
        assert!(found.iter().all(|price| *price >= 0.0), "{found:?}");
        assert_eq!(found[1], 0.0);
    }
}
