//! The stack machine of pickles, as far as `torch.save` makes use of it for a dictionary of tensors.
//!
//! What one byte of input can make is bounded, and so is everything that is copied.

use std::collections::HashMap;

use super::value::{Id, Value};

/// Longest text in bytes.
const MAX_TEXT_BYTES: usize = 4096;
/// The version of pickles that `torch.save` writes.
const PROTOCOL: u8 = 2;
/// What a pickle made.
pub(super) struct Pickle {
    /// Every value.
    pub values: Vec<Value>,
    /// The value that is the result.
    pub root: Id,
    /// Bytes that it took.
    pub n_bytes: usize,
}

impl Pickle {
    /// Runs the pickle that `bytes` begin with.
    ///
    /// # Errors
    /// What was found that should not be there.
    pub(super) fn load(bytes: &[u8]) -> Result<Self, String> {
        let mut machine = Machine {
            bytes,
            position: 0,
            values: Vec::new(),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: HashMap::new(),
            copied: 0,
        };
        loop {
            let at = machine.position;
            let code = machine.byte()?;
            if code == b'.' {
                let root = machine.pop()?;
                return Ok(Self {
                    values: machine.values,
                    root,
                    n_bytes: machine.position,
                });
            }
            machine
                .step(code)
                .map_err(|found| format!("{found} (byte {at} of the pickle)"))?;
        }
    }

    /// The result.
    pub(super) fn root(&self) -> &Value {
        &self.values[self.root]
    }
}

/// A pickle being run.
pub(super) struct Machine<'a> {
    pub(super) bytes: &'a [u8],
    position: usize,
    pub(super) values: Vec<Value>,
    pub(super) stack: Vec<Id>,
    /// Heights of the stack at its marks.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
    /// References copied from one value into another.
    pub(super) copied: usize,
}

impl<'a> Machine<'a> {
    fn step(&mut self, code: u8) -> Result<(), String> {
        match code {
            0x80 => match self.byte()? {
                PROTOCOL => Ok(()),
                other => Err(format!(
                    "a pickle of protocol {other} instead of {PROTOCOL}"
                )),
            },
            b'N' => self.push(Value::None),
            0x88 => self.push(Value::Bool(true)),
            0x89 => self.push(Value::Bool(false)),
            b'J' => {
                let value = i32::from_le_bytes(self.array()?);
                self.push(Value::Int(i64::from(value)))
            }
            b'K' => {
                let value = self.byte()?;
                self.push(Value::Int(i64::from(value)))
            }
            b'M' => {
                let value = u16::from_le_bytes(self.array()?);
                self.push(Value::Int(i64::from(value)))
            }
            0x8a => self.long(),
            b'G' => {
                self.take(size_of::<f64>())?;
                self.push(Value::Other)
            }
            b'U' => {
                let length = self.byte()?;
                self.text(usize::from(length))
            }
            b'T' | b'X' => {
                let length = u32::from_le_bytes(self.array()?);
                self.text(length as usize)
            }
            b'(' => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            b')' => self.push(Value::Tuple(Vec::new())),
            b']' => self.push(Value::List(Vec::new())),
            b'}' => self.push(Value::Dict(Vec::new())),
            b't' => {
                let items = self.pop_to_mark()?;
                self.push(Value::Tuple(items))
            }
            0x85..=0x87 => {
                let items = self.pop_many(usize::from(code - 0x84))?;
                self.push(Value::Tuple(items))
            }
            b'a' => {
                let item = self.pop()?;
                self.append(&[item])
            }
            b'e' => {
                let items = self.pop_to_mark()?;
                self.append(&items)
            }
            b's' => {
                let items = self.pop_many(2)?;
                self.set(&items)
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set(&items)
            }
            b'q' => {
                let index = self.byte()?;
                self.remember(u32::from(index))
            }
            b'r' => {
                let index = u32::from_le_bytes(self.array()?);
                self.remember(index)
            }
            b'h' => {
                let index = self.byte()?;
                self.recall(u32::from(index))
            }
            b'j' => {
                let index = u32::from_le_bytes(self.array()?);
                self.recall(index)
            }
            b'c' => self.name(),
            b'Q' => self.storage(),
            b'R' => self.reduce(),
            // State that is set on a dictionary or a parameter beside what they hold.
            b'b' => self.pop().map(|_| ()),
            other => Err(format!(
                "the instruction 0x{other:02x}, which no weight file needs"
            )),
        }
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let rest = &self.bytes[self.position..];
        let taken = rest.get(..n).ok_or("its end in the middle of a pickle")?;
        self.position += n;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn byte(&mut self) -> Result<u8, String> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// Adds a value and puts it on the stack.
    pub(super) fn push(&mut self, value: Value) -> Result<(), String> {
        self.values.push(value);
        self.stack.push(self.values.len() - 1);
        Ok(())
    }

    /// Takes the topmost value above the last mark.
    pub(super) fn pop(&mut self) -> Result<Id, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() > floor {
            self.stack.pop().ok_or_else(empty)
        } else {
            Err(empty())
        }
    }

    fn top(&self) -> Result<Id, String> {
        self.stack.last().copied().ok_or_else(empty)
    }

    fn pop_many(&mut self, n: usize) -> Result<Vec<Id>, String> {
        let mut items = (0..n).map(|_| self.pop()).collect::<Result<Vec<_>, _>>()?;
        items.reverse();
        Ok(items)
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, String> {
        let mark = self.marks.pop().ok_or_else(empty)?;
        Ok(self.stack.split_off(mark))
    }

    fn long(&mut self) -> Result<(), String> {
        let length = self.byte()?;
        let bytes = self.take(usize::from(length))?;
        let value = if bytes.len() <= size_of::<i64>() {
            // The sign is that of the last byte.
            let fill = if bytes.last().is_some_and(|&b| b >= 0x80) {
                0xff
            } else {
                0
            };
            let mut wide = [fill; size_of::<i64>()];
            wide[..bytes.len()].copy_from_slice(bytes);
            Value::Int(i64::from_le_bytes(wide))
        } else {
            Value::Other
        };
        self.push(value)
    }

    fn text(&mut self, length: usize) -> Result<(), String> {
        if length > MAX_TEXT_BYTES {
            return Err(format!("a text of {length} bytes"));
        }
        let text = str::from_utf8(self.take(length)?).map_err(|_| "a text that is not UTF-8")?;
        let text = Value::Text(text.to_string());
        self.push(text)
    }

    fn append(&mut self, items: &[Id]) -> Result<(), String> {
        let list = self.top()?;
        match &mut self.values[list] {
            Value::List(list) => {
                list.extend(items);
                Ok(())
            }
            other => Err(format!("items for {}", other.kind())),
        }
    }

    fn set(&mut self, items: &[Id]) -> Result<(), String> {
        let dict = self.top()?;
        match &mut self.values[dict] {
            Value::Dict(dict) if items.len().is_multiple_of(2) => {
                dict.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1])));
                Ok(())
            }
            other => Err(format!(
                "{} keys and values for {}",
                items.len(),
                other.kind()
            )),
        }
    }

    fn remember(&mut self, index: u32) -> Result<(), String> {
        let top = self.top()?;
        self.memo.insert(index, top);
        Ok(())
    }

    fn recall(&mut self, index: u32) -> Result<(), String> {
        let known = self.memo.get(&index).copied();
        self.stack
            .push(known.ok_or("a reference to what it does not hold")?);
        Ok(())
    }

    /// The text up to the end of a line.
    pub(super) fn line(&mut self) -> Result<String, String> {
        let rest = &self.bytes[self.position..];
        let rest = &rest[..rest.len().min(MAX_TEXT_BYTES)];
        let end = rest.iter().position(|&b| b == b'\n');
        let line = rest[..end.ok_or("its end in the middle of a name")?].to_vec();
        self.position += line.len() + 1;
        Ok(String::from_utf8_lossy(&line).into_owned())
    }
}

fn empty() -> String {
    "an instruction without the values it needs".into()
}
