//! Files of PyTorch in its format before version 1.6: pickles, followed by the values of the tensors.
//!
//! A pickle of Python is a program for a stack machine. This one understands as much as state dictionaries need, and cannot run
//! anything: a pickle may name no function but those that make dictionaries and tensors, and what is not understood is an error.

use std::{collections::BTreeMap, rc::Rc};

use super::weights::Tensor;

/// The pickle of the format's magic number, 0x1950a86a20f9469cfc6c.
const MAGIC: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
/// The pickle of the format's version, 1001.
const VERSION: &[u8] = b"\x80\x02M\xe9\x03.";
/// The most operations of a pickle: several times what a network needs, and so few that values cannot be
/// nested too deeply.
const MAX_OPERATIONS: usize = 8192;

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

/// A value that a pickle makes.
#[derive(Clone, Debug)]
enum Value {
    /// A value that no tensor depends on.
    Other,
    Bool(bool),
    Number(i64),
    Text(Rc<str>),
    /// A tuple or a list.
    Sequence(Vec<Value>),
    Dictionary(Vec<(Value, Value)>),
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2`.
    RebuildTensor,
    /// `torch.FloatStorage`.
    FloatStorage,
    /// The storage of a tensor's values: its name, and the number of values.
    Storage(Rc<str>, usize),
    /// A tensor that uses all values of a storage, in order.
    Tensor {
        storage: Rc<str>,
        shape: Vec<usize>,
    },
}

impl Value {
    /// The value of `key` in a dictionary.
    fn get(&self, key: &str) -> Result<&Value, String> {
        let Value::Dictionary(items) = self else { return Err(format!("no dictionary with {key:?}")) };
        let is_key = |name: &Value| matches!(name, Value::Text(name) if **name == *key);
        items.iter().find(|(name, _)| is_key(name)).map(|(_, value)| value).ok_or_else(|| format!("no {key:?}"))
    }

    /// The numbers of a tuple, if they are sizes.
    fn sizes(&self) -> Option<Vec<usize>> {
        let Value::Sequence(sizes) = self else { return None };
        sizes.iter().map(|size| if let Value::Number(size) = size { usize::try_from(*size).ok() } else { None }).collect()
    }
}

/// The unread rest of a file.
struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Reader<'a> {
        Reader { bytes }
    }

    /// The number of unread bytes.
    fn remaining(&self) -> usize {
        self.bytes.len()
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or("an end too early")?;
        self.bytes = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        Ok(self.take(N)?.try_into().expect("as many as were asked for"))
    }

    fn byte(&mut self) -> Result<u8, String> {
        Ok(self.array::<1>()?[0])
    }

    /// A length or a memo index in four bytes.
    fn index(&mut self) -> Result<usize, String> {
        Ok(u32::from_le_bytes(self.array()?) as usize)
    }

    fn line(&mut self) -> Result<&'a [u8], String> {
        let end = self.bytes.iter().position(|&byte| byte == b'\n').ok_or("an end too early")?;
        let line = self.take(end)?;
        self.byte()?;
        Ok(line)
    }

    /// Runs a pickle of protocol 2 and returns the value that it makes. Operations are named as in Python's
    /// `pickletools`.
    fn pickle(&mut self) -> Result<Value, String> {
        if self.take(2)? != b"\x80\x02" {
            return Err("no pickle of protocol 2".into());
        }
        let mut machine = Machine::default();
        for _ in 0..MAX_OPERATIONS {
            match self.byte()? {
                // EMPTY_DICT, EMPTY_LIST, EMPTY_TUPLE
                b'}' => machine.push(Value::Dictionary(Vec::new())),
                b']' | b')' => machine.push(Value::Sequence(Vec::new())),
                // NONE, NEWFALSE, NEWTRUE
                b'N' => machine.push(Value::Other),
                b'\x89' => machine.push(Value::Bool(false)),
                b'\x88' => machine.push(Value::Bool(true)),
                // BININT1, BININT2, BININT
                b'K' => machine.push(Value::Number(self.byte()?.into())),
                b'M' => machine.push(Value::Number(u16::from_le_bytes(self.array()?).into())),
                b'J' => machine.push(Value::Number(i32::from_le_bytes(self.array()?).into())),
                // LONG1, BINFLOAT
                b'\x8a' => {
                    let count = self.byte()?.into();
                    self.take(count)?;
                    machine.push(Value::Other);
                }
                b'G' => {
                    self.take(8)?;
                    machine.push(Value::Other);
                }
                // BINUNICODE
                b'X' => {
                    let count = self.index()?;
                    let text = std::str::from_utf8(self.take(count)?).map_err(|_| "text that is no UTF-8")?;
                    machine.push(Value::Text(text.into()));
                }
                // GLOBAL
                b'c' => {
                    let value = match (self.line()?, self.line()?) {
                        (b"collections", b"OrderedDict") => Value::OrderedDict,
                        (b"torch._utils", b"_rebuild_tensor_v2") => Value::RebuildTensor,
                        (b"torch", b"FloatStorage") => Value::FloatStorage,
                        (module, name) => {
                            let [module, name] = [module, name].map(String::from_utf8_lossy);
                            return Err(format!("{module}.{name}, which is not for tensors"));
                        }
                    };
                    machine.push(value);
                }
                // BINPUT, LONG_BINPUT, BINGET, LONG_BINGET
                b'q' => machine.memoize(self.byte()?.into())?,
                b'r' => machine.memoize(self.index()?)?,
                b'h' => machine.recall(self.byte()?.into())?,
                b'j' => machine.recall(self.index()?)?,
                // MARK, TUPLE, TUPLE1, TUPLE2
                b'(' => machine.mark(),
                b't' => {
                    let items = machine.since_mark()?;
                    machine.push(Value::Sequence(items));
                }
                b'\x85' => machine.tuple(1)?,
                b'\x86' => machine.tuple(2)?,
                // APPEND, APPENDS, SETITEM, SETITEMS
                b'a' => {
                    let item = machine.pop()?;
                    machine.append(vec![item])?;
                }
                b'e' => {
                    let items = machine.since_mark()?;
                    machine.append(items)?;
                }
                b's' => {
                    let (value, key) = (machine.pop()?, machine.pop()?);
                    machine.insert(vec![key, value])?;
                }
                b'u' => {
                    let items = machine.since_mark()?;
                    machine.insert(items)?;
                }
                // BUILD: attributes, which no tensor depends on.
                b'b' => drop(machine.pop()?),
                // BINPERSID, REDUCE
                b'Q' => machine.storage()?,
                b'R' => machine.call()?,
                // STOP
                b'.' => return machine.pop(),
                other => return Err(format!("operation {other:#04x}, which no state dictionary needs")),
            }
        }
        Err(format!("a pickle of more than {MAX_OPERATIONS} operations"))
    }
}

/// The stack machine.
#[derive(Default)]
struct Machine {
    /// The values since the last mark.
    stack: Vec<Value>,
    /// The values before each mark, the last mark on top.
    frames: Vec<Vec<Value>>,
    /// The memo. `None` stands for values that may change after they were stored, which cannot be recalled.
    memo: BTreeMap<usize, Option<Value>>,
}

impl Machine {
    fn push(&mut self, value: Value) {
        self.stack.push(value);
    }

    fn pop(&mut self) -> Result<Value, String> {
        self.stack.pop().ok_or_else(|| "an empty stack".into())
    }

    fn mark(&mut self) {
        self.frames.push(std::mem::take(&mut self.stack));
    }

    /// Pops the values since the last mark.
    fn since_mark(&mut self) -> Result<Vec<Value>, String> {
        let below = self.frames.pop().ok_or("no mark")?;
        Ok(std::mem::replace(&mut self.stack, below))
    }

    /// Stores the top of the stack in the memo.
    fn memoize(&mut self, index: usize) -> Result<(), String> {
        let top = self.stack.last().ok_or("an empty stack")?;
        let constant = !matches!(top, Value::Sequence(_) | Value::Dictionary(_));
        self.memo.insert(index, constant.then(|| top.clone()));
        Ok(())
    }

    /// Pushes a value of the memo.
    fn recall(&mut self, index: usize) -> Result<(), String> {
        let value = self.memo.get(&index).cloned().flatten().ok_or_else(|| format!("nothing constant at {index}"))?;
        self.push(value);
        Ok(())
    }

    fn tuple(&mut self, count: usize) -> Result<(), String> {
        let start = self.stack.len().checked_sub(count).ok_or("an empty stack")?;
        let items = self.stack.split_off(start);
        self.push(Value::Sequence(items));
        Ok(())
    }

    fn append(&mut self, items: Vec<Value>) -> Result<(), String> {
        let Some(Value::Sequence(list)) = self.stack.last_mut() else { return Err("items for no list".into()) };
        list.extend(items);
        Ok(())
    }

    fn insert(&mut self, items: Vec<Value>) -> Result<(), String> {
        let Some(Value::Dictionary(dictionary)) = self.stack.last_mut() else { return Err("items for no dictionary".into()) };
        let mut items = items.into_iter();
        while let Some(key) = items.next() {
            dictionary.push((key, items.next().ok_or("a key without a value")?));
        }
        Ok(())
    }

    /// Replaces the tuple `("storage", FloatStorage, name, device, count, None)` by the storage that it
    /// describes.
    fn storage(&mut self) -> Result<(), String> {
        let Value::Sequence(parts) = self.pop()? else { return Err("a storage that is no tuple".into()) };
        let [_, Value::FloatStorage, Value::Text(name), _, Value::Number(count), _] = parts.as_slice() else {
            return Err("a storage of other than f32 values".into());
        };
        let count = usize::try_from(*count).map_err(|_| "a storage of absurd size")?;
        self.push(Value::Storage(name.clone(), count));
        Ok(())
    }

    /// Calls a function: makes an empty dictionary, or a tensor of `(storage, offset, shape, strides,
    /// requires_grad, hooks)`.
    fn call(&mut self) -> Result<(), String> {
        let (Value::Sequence(arguments), function) = (self.pop()?, self.pop()?) else {
            return Err("arguments that are no tuple".into());
        };
        let value = match (function, arguments.as_slice()) {
            (Value::OrderedDict, []) => Value::Dictionary(Vec::new()),
            (Value::RebuildTensor, [Value::Storage(storage, count), Value::Number(0), shape, strides, ..]) => {
                let (Some(shape), Some(strides)) = (shape.sizes(), strides.sizes()) else {
                    return Err("a tensor without a shape".into());
                };
                let mut next = Some(1usize);
                let mut in_order = shape.len() == strides.len();
                for (&side, &stride) in shape.iter().zip(&strides).rev() {
                    in_order &= next == Some(stride);
                    next = next.and_then(|next| next.checked_mul(side));
                }
                if !in_order || next != Some(*count) {
                    return Err(format!("a tensor of shape {shape:?} with the strides {strides:?} in {count} values"));
                }
                Value::Tensor { storage: storage.clone(), shape }
            }
            _ => return Err("a call of other than a dictionary or a tensor of all of a storage".into()),
        };
        self.push(value);
        Ok(())
    }
}
