//! Numbers, checked as they are parsed.

use multiscopic::{Error, Geometry, Result};

/// Parses a finite number.
pub fn finite(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| Error::Usage("it must be a number".into()))
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64> {
    finite(text).ok().filter(|number| *number > 0.0).ok_or_else(|| Error::Usage("it must be a number above 0".into()))
}

/// Parses a length of a camera or its stage, in pixels or millimetres.
pub fn length(text: &str) -> Result<f64> {
    let most = Geometry::MAX_LENGTH;
    let length = positive(text).ok().filter(|length| *length <= most);
    length.ok_or_else(|| Error::Usage(format!("it must be a number above 0 and at most {most}")))
}

/// Parses two numbers, separated by a comma.
pub fn point(text: &str) -> Result<[f64; 2]> {
    match text.split_once(',').map(|(cx, cy)| (finite(cx), finite(cy))) {
        Some((Ok(cx), Ok(cy))) => Ok([cx, cy]),
        _ => Err(Error::Usage("it must be two numbers, as 319.5,239.5".into())),
    }
}

/// Parses a width and a height in pixels.
pub fn size(text: &str) -> Result<[u32; 2]> {
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    let sides = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| Error::Usage("it must be a width and a height, as 640x480".into()))
}

/// Parses a whole number above 0.
pub fn count(text: &str) -> Result<u64> {
    let number = text.trim().parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| Error::Usage("it must be a whole number above 0".into()))
}

/// Parses a probability.
pub fn probability(text: &str) -> Result<f64> {
    let probability = text.parse().ok().filter(|probability| (0.0..=1.0).contains(probability));
    probability.ok_or_else(|| Error::Usage("it must be a number from 0 to 1".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(point("319.5, -2").unwrap(), [319.5, -2.0]);
        assert_eq!(positive("1e3").unwrap(), 1000.0);
        assert_eq!([probability("0").unwrap(), probability("0.9").unwrap()], [0.0, 0.9]);
        assert!(["-0.1", "1.1", "nan", "90 %"].iter().all(|text| probability(text).is_err()));
        assert_eq!(size("640x480").unwrap(), [640, 480]);
        assert!(["640", "x", "0x1", "1x-1", "axb"].iter().all(|text| size(text).is_err()));
        assert_eq!(length("1e7").unwrap(), 1e7);
        assert!(["0", "1e300", "inf"].iter().all(|text| length(text).is_err()));
        assert!(["0", "-1", "inf", "nan", "", "1x"].iter().all(|text| positive(text).is_err()));
        assert!(["1", "1,", "1,2,3", "a,b", "inf,1"].iter().all(|text| point(text).is_err()));
    }
}
