//! A machine's share of the items.

use std::{
    fmt::{self, Display},
    str::FromStr,
};

/// Every N-th item from the I-th on, counted from 1: `I/N`, as in Jest, Playwright and cargo-nextest.
///
/// The order of the items alone decides which these are. Items that are appended move none to another share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    count: usize,
}

impl Shard {
    /// All items.
    pub const WHOLE: Shard = Shard { number: 1, count: 1 };

    /// Returns true if the item at an index, from 0, belongs to it.
    pub fn has(self, index: usize) -> bool {
        index % self.count == self.number - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Shard, String> {
        let parts = text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        match parts {
            Some((number, count)) if (1..=count).contains(&number) => Ok(Shard { number, count }),
            _ => Err("it must be I/N, with I from 1 to N: 2/8 is the second of eight shares".into()),
        }
    }
}

impl Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_in_one_shard() {
        for count in 1..6 {
            let shards: Vec<Shard> = (1..=count).map(|number| format!("{number}/{count}").parse().unwrap()).collect();
            for index in 0..13 {
                assert_eq!(shards.iter().filter(|shard| shard.has(index)).count(), 1, "{index} of {count}");
            }
            let sizes: Vec<usize> = shards.iter().map(|shard| (0..13).filter(|&index| shard.has(index)).count()).collect();
            assert!(sizes.iter().all(|&size| size == 13 / count || size == 13 / count + 1), "{sizes:?}");
        }
        assert!((0..9).all(|index| Shard::WHOLE.has(index)));
    }

    #[test]
    fn shards_are_counted_from_one() {
        for text in ["0/2", "3/2", "1/0", "1", "/", "1/2/3", "-1/2", "a/b", " 1/2"] {
            assert!(text.parse::<Shard>().unwrap_err().contains("with I from 1 to N"), "{text}");
        }
        assert_eq!("2/8".parse::<Shard>().unwrap().to_string(), "2/8");
    }
}
