//! Times in files, as RFC 3339 has them in UTC: `2026-03-14T09:26:53.589Z`.

use std::time::SystemTime;

use jiff::{Timestamp, Unit};
use serde::{Deserialize, Deserializer, Serializer, de::Error as _};

/// Writes a time to the microsecond.
pub fn serialize<S: Serializer>(time: &Option<SystemTime>, serializer: S) -> Result<S::Ok, S::Error> {
    let time = time.and_then(|time| Timestamp::try_from(time).ok()?.round(Unit::Microsecond).ok());
    match time {
        Some(time) => serializer.serialize_some(&time.to_string()),
        None => serializer.serialize_none(),
    }
}

/// Reads a time.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<SystemTime>, D::Error> {
    let Some(text) = Option::<String>::deserialize(deserializer)? else { return Ok(None) };
    let time: Timestamp =
        text.parse().map_err(|_| D::Error::custom(format!("{text:?} is no time in UTC such as \"2026-03-14T09:26:53.589Z\"")))?;
    Ok(Some(time.into()))
}
