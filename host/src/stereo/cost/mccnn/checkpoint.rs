//! Files of PyTorch in its format before version 1.6: pickles, followed by the values of the tensors.

use std::collections::BTreeMap;

use super::{
    pickle::{Reader, Value},
    weights::Tensor,
};

/// The pickle of the format's magic number, 0x1950a86a20f9469cfc6c.
const MAGIC: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
/// The pickle of the format's version, 1001.
const VERSION: &[u8] = b"\x80\x02M\xe9\x03.";

/// The tensors of the state dictionary `model` in a file with the contents `bytes`.
///
/// # Errors
/// A description of what was found instead.
pub fn model(bytes: &[u8]) -> Result<BTreeMap<String, Tensor>, String> {
    let bytes =
        bytes.strip_prefix(MAGIC).and_then(|bytes| bytes.strip_prefix(VERSION)).ok_or("no file of PyTorch's old format")?;
    let mut reader = Reader::new(bytes);
    let system = reader.pickle()?;
    if !matches!(system.get("little_endian")?, Value::Bool(true)) {
        return Err("values that are not little-endian".into());
    }
    let state = reader.pickle()?;
    let Value::Sequence(keys) = reader.pickle()? else {
        return Err("no list of storages".into());
    };

    // The values of the storages follow in the order of their keys.
    let mut storages = BTreeMap::new();
    for key in &keys {
        let Value::Text(key) = key else { return Err("a storage without a name".into()) };
        let count = usize::try_from(u64::from_le_bytes(reader.array()?)).ok().and_then(|count| count.checked_mul(4));
        let values = reader.take(count.ok_or("a storage of absurd size")?)?;
        storages.insert(key.clone(), values);
    }
    if reader.remaining() > 0 {
        return Err(format!("{} bytes behind the last storage", reader.remaining()));
    }

    let Value::Dictionary(model) = state.get("model")? else {
        return Err("a model that is no dictionary".into());
    };
    let mut tensor = |(name, value): &(Value, Value)| {
        let (Value::Text(name), Value::Tensor { storage, shape }) = (name, value) else {
            return Err("a model of more than tensors".to_string());
        };
        // Each storage is for one tensor: a short file that names a long one often would take memory without end.
        let values = storages.remove(storage).ok_or_else(|| format!("no storage {storage}, or a second use of it"))?;
        let values: Vec<f32> = values.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        let count = shape.iter().try_fold(1usize, |count, &side| count.checked_mul(side));
        if count != Some(values.len()) {
            return Err(format!("{} values in {name} of shape {shape:?}", values.len()));
        }
        Ok((name.to_string(), Tensor { shape: shape.clone(), values }))
    };
    model.iter().map(&mut tensor).collect()
}
