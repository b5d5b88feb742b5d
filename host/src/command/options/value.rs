//! Numbers on the command line, checked as they are parsed.

use multiscopic::{Error, Result};

/// Parses a finite number.
pub fn finite(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| Error::Usage("it must be a number".into()))
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64> {
    finite(text).ok().filter(|number| *number > 0.0).ok_or_else(|| Error::Usage("it must be a number above 0".into()))
}

/// Parses two numbers, separated by a comma.
pub fn point(text: &str) -> Result<[f64; 2]> {
    match text.split_once(',').map(|(cx, cy)| (finite(cx), finite(cy))) {
        Some((Ok(cx), Ok(cy))) => Ok([cx, cy]),
        _ => Err(Error::Usage("it must be two numbers, as 319.5,239.5".into())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(point("319.5, -2").unwrap(), [319.5, -2.0]);
        assert_eq!(positive("1e3").unwrap(), 1000.0);
        assert!(["0", "-1", "inf", "nan", "", "1x"].iter().all(|text| positive(text).is_err()));
        assert!(["1", "1,", "1,2,3", "a,b", "inf,1"].iter().all(|text| point(text).is_err()));
    }
}
