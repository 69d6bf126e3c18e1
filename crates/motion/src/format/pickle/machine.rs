//! The stack machine with the opcodes of protocols 0 to 5.

use super::{ALLOWED, Id, MAX_MARKS, MAX_STACK, MAX_VALUES, Object, Stop};
use crate::error::FaultKind;
use std::borrow::Cow;
use std::collections::HashMap;

/// Executes a pickle. Returns its values and the index of the result.
pub(super) fn run(bytes: &[u8]) -> Result<(Vec<Object<'_>>, Id), Stop> {
    // a byte of text may become four; nothing else grows
    let owned_left = bytes.len().saturating_mul(4).saturating_add(1024);
    let mut machine = Machine { bytes, owned_left, ..Machine::default() };
    let top = machine.run()?;
    Ok((machine.values, top))
}

#[derive(Default)]
pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Byte offset of the current opcode.
    pub(super) opcode_at: usize,
    pub(super) values: Vec<Object<'a>>,
    stack: Vec<Id>,
    /// Stack heights at the open marks.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
    owned_left: usize,
}

type Step<T = ()> = Result<T, Stop>;

impl<'a> Machine<'a> {
    fn run(&mut self) -> Step<Id> {
        loop {
            self.opcode_at = self.at;
            let opcode = self.byte()?;
            if opcode == b'.' {
                return self.pop();
            }
            self.step(opcode)?;
        }
    }

    fn step(&mut self, opcode: u8) -> Step {
        match opcode {
            // framing and the header
            0x80 => match self.byte()? {
                0..=5 => Ok(()),
                n => Err(self.bad(format!("protocol {n}"), "0 to 5")),
            },
            0x95 => {
                let length = self.le(8)?;
                match length > (self.bytes.len() - self.at) as u64 {
                    true => Err(self.bad(format!("a frame of {length} bytes"), "as many bytes")),
                    false => Ok(()),
                }
            }
            // plain values
            b'N' => self.push(Object::None),
            0x88 => self.push(Object::Bool(true)),
            0x89 => self.push(Object::Bool(false)),
            b'J' | b'K' | b'M' | 0x8a | 0x8b | b'I' | b'L' => self.integer(opcode),
            b'F' | b'G' => self.float(opcode),
            b'U' | b'T' | b'B' | b'C' | 0x8e | 0x96 | b'S' => self.byte_string(opcode),
            b'X' | 0x8c | 0x8d | b'V' => self.text(opcode),
            // containers
            b']' => self.push(Object::List(vec![])),
            b'}' => self.push(Object::Dict(vec![])),
            b')' => self.push(Object::Tuple(vec![])),
            0x85..=0x87 => {
                let items = self.pop_many(usize::from(opcode - 0x84))?;
                self.push(Object::Tuple(items))
            }
            b't' | b'l' | b'd' | b'a' | b'e' | b's' | b'u' => self.container(opcode),
            // stack and memo
            b'(' if self.marks.len() < MAX_MARKS => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            b'(' => Err(self.large(format!("more than {MAX_MARKS} open marks"))),
            // POP on an open mark removes the mark, as in CPython
            b'0' if self.stack.len() == self.marks.last().copied().unwrap_or(0) => self.pop_mark().map(drop),
            b'0' => self.pop().map(drop),
            b'1' => self.pop_mark().map(drop),
            b'2' => {
                let top = self.pop()?;
                self.push_id(top)?;
                self.push_id(top)
            }
            b'p' | b'q' | b'r' | 0x94 => self.put(opcode),
            b'g' | b'h' | b'j' => self.get(opcode),
            // names and calls
            b'c' | 0x93 => self.global(opcode),
            b'R' => self.reduce(),
            b'b' => self.build(),
            b'i' => {
                let (module, name) = (self.line()?, self.line()?);
                Err(self.refuse(format!("the class {}.{}", lossy(module), lossy(name))))
            }
            b'o' | 0x81 | 0x92 => Err(self.refuse("the making of an object".into())),
            0x82..=0x84 => Err(self.refuse("a name from the extension registry".into())),
            b'P' | b'Q' => Err(self.refuse("a persistent id".into())),
            0x8f..=0x91 => Err(self.refuse("a set".into())),
            0x97 | 0x98 => Err(self.refuse("a buffer outside the file".into())),
            _ => Err(self.bad(format!("opcode {opcode:#04x}"), "a pickle")),
        }
    }

    fn integer(&mut self, opcode: u8) -> Step {
        let n = match opcode {
            b'K' => i64::from(self.byte()?),
            b'M' => self.le(2)? as i64,
            b'J' => i64::from(self.le(4)? as u32 as i32),
            b'I' | b'L' => {
                let line = self.line()?;
                let line = if opcode == b'L' { line.strip_suffix(b"L").unwrap_or(line) } else { line };
                match (opcode, line) {
                    (b'I', b"00") => return self.push(Object::Bool(false)),
                    (b'I', b"01") => return self.push(Object::Bool(true)),
                    _ => self.parsed(line, "an integer of 64 bits")?,
                }
            }
            _ => {
                let size = if opcode == 0x8a { usize::from(self.byte()?) } else { self.le(4)? as usize };
                let digits = self.take(size)?;
                if size > 8 {
                    return Err(self.bad(format!("an integer of {size} bytes"), "at most 8"));
                }
                // two's complement, little-endian
                let sign = if digits.last().is_some_and(|b| b & 0x80 != 0) { 0xff } else { 0 };
                let mut wide = [sign; 8];
                wide[..size].copy_from_slice(digits);
                i64::from_le_bytes(wide)
            }
        };
        self.push(Object::Int(n))
    }

    fn float(&mut self, opcode: u8) -> Step {
        let x = match opcode {
            b'G' => f64::from_be_bytes(self.take(8)?.try_into().expect("8 bytes")),
            _ => {
                let line = self.line()?;
                self.parsed(line, "a number")?
            }
        };
        self.push(Object::Float(x))
    }

    fn byte_string(&mut self, opcode: u8) -> Step {
        let size = match opcode {
            b'U' | b'C' => u64::from(self.byte()?),
            b'T' | b'B' => self.le(4)?,
            b'S' => {
                let line = self.line()?;
                let Some(value) = quoted(line) else {
                    return Err(self.bad("a string without quotes".into(), "Python 2's way to write a string"));
                };
                self.pay(value.len())?;
                return self.push(Object::Bytes(value.into()));
            }
            _ => self.le(8)?,
        };
        let value = self.take_u64(size)?;
        self.push(Object::Bytes(Cow::Borrowed(value)))
    }

    fn text(&mut self, opcode: u8) -> Step {
        let size = match opcode {
            0x8c => u64::from(self.byte()?),
            b'X' => self.le(4)?,
            0x8d => self.le(8)?,
            _ => {
                let value = unescaped(self.line()?);
                self.pay(value.len())?;
                return self.push(Object::Text(value.into()));
            }
        };
        let value = String::from_utf8_lossy(self.take_u64(size)?);
        if let Cow::Owned(value) = &value {
            self.pay(value.len())?;
        }
        self.push(Object::Text(value))
    }

    fn container(&mut self, opcode: u8) -> Step {
        let items = match opcode {
            b'a' => self.pop_many(1)?,
            b's' => self.pop_many(2)?,
            _ => self.pop_mark()?,
        };
        let odd = !items.len().is_multiple_of(2);
        if matches!(opcode, b'd' | b's' | b'u') && odd {
            return Err(self.bad("a key without a value".into(), "pairs"));
        }
        let pairs = items.chunks_exact(2).map(|p| (p[0], p[1]));
        match opcode {
            b't' => return self.push(Object::Tuple(items)),
            b'l' => return self.push(Object::List(items)),
            b'd' => return self.push(Object::Dict(pairs.collect())),
            _ => {}
        }
        let target = self.peek()?;
        match &mut self.values[target as usize] {
            Object::List(list) if matches!(opcode, b'a' | b'e') => list.extend(items),
            Object::Dict(dict) if matches!(opcode, b's' | b'u') => dict.extend(pairs),
            _ => return Err(self.bad("items for what is no container of them".into(), "a list or a dict")),
        }
        Ok(())
    }

    fn put(&mut self, opcode: u8) -> Step {
        let index = match opcode {
            // MEMOIZE numbers entries by their count, which all writers of protocol 4 and later rely on
            0x94 => self.memo.len() as u32,
            _ => self.memo_index(opcode == b'p', opcode == b'q')?,
        };
        let top = self.peek()?;
        if self.memo.len() >= MAX_STACK {
            return Err(self.large(format!("more than {MAX_STACK} memo entries")));
        }
        self.memo.insert(index, top);
        Ok(())
    }

    fn get(&mut self, opcode: u8) -> Step {
        let index = self.memo_index(opcode == b'g', opcode == b'h')?;
        match self.memo.get(&index) {
            Some(&id) => self.push_id(id),
            None => Err(self.bad(format!("memo index {index}, which is empty"), "one that was filled")),
        }
    }

    fn memo_index(&mut self, line: bool, short: bool) -> Step<u32> {
        match (line, short) {
            (true, _) => {
                let line = self.line()?;
                self.parsed(line, "a memo index")
            }
            (_, true) => self.byte().map(u32::from),
            _ => self.le(4).map(|n| n as u32),
        }
    }

    fn global(&mut self, opcode: u8) -> Step {
        let (module, name) = if opcode == b'c' {
            (lossy(self.line()?), lossy(self.line()?))
        } else {
            let (name, module) = (self.pop()?, self.pop()?);
            match (&self.values[module as usize], &self.values[name as usize]) {
                (Object::Text(m), Object::Text(n)) => (m.to_string(), n.to_string()),
                _ => return Err(self.bad("a name that is no text".into(), "text")),
            }
        };
        match ALLOWED.iter().find(|(m, n)| (*m, *n) == (&module, &name)) {
            Some((_, name)) => self.push(Object::Global(name)),
            None => {
                let shown: String = format!("{module}.{name}").chars().take(200).collect();
                Err(self.refuse(format!("the name {shown}")))
            }
        }
    }

    // the stack

    pub(super) fn push(&mut self, value: Object<'a>) -> Step {
        if self.values.len() >= MAX_VALUES {
            return Err(self.large(format!("more than {MAX_VALUES} values")));
        }
        self.values.push(value);
        self.push_id((self.values.len() - 1) as Id)
    }

    fn push_id(&mut self, id: Id) -> Step {
        if self.stack.len() >= MAX_STACK {
            return Err(self.large(format!("more than {MAX_STACK} values on the stack")));
        }
        self.stack.push(id);
        Ok(())
    }

    pub(super) fn pop(&mut self) -> Step<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() > floor {
            return Ok(self.stack.pop().expect("not empty"));
        }
        Err(self.bad("an empty stack".into(), "a value"))
    }

    /// The top of the stack, without popping it.
    pub(super) fn peek(&self) -> Step<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack.last() {
            Some(&id) if self.stack.len() > floor => Ok(id),
            _ => Err(self.bad("an empty stack".into(), "a value")),
        }
    }

    fn pop_many(&mut self, n: usize) -> Step<Vec<Id>> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack.len().checked_sub(n) {
            Some(rest) if rest >= floor => Ok(self.stack.split_off(rest)),
            _ => Err(self.bad("too few values on the stack".into(), "more")),
        }
    }

    fn pop_mark(&mut self) -> Step<Vec<Id>> {
        match self.marks.pop() {
            Some(height) => Ok(self.stack.split_off(height.min(self.stack.len()))),
            None => Err(self.bad("no open mark".into(), "one")),
        }
    }

    // the bytes

    fn take(&mut self, n: usize) -> Step<&'a [u8]> {
        self.take_u64(n as u64)
    }

    fn take_u64(&mut self, n: u64) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        match usize::try_from(n).ok().and_then(|n| rest.get(..n)) {
            Some(taken) => {
                self.at += taken.len();
                Ok(taken)
            }
            None => Err(self.bad(format!("{} bytes, the last of the file,", rest.len()), "more: it is cut")),
        }
    }

    fn byte(&mut self) -> Step<u8> {
        Ok(self.take(1)?[0])
    }

    /// An unsigned little-endian integer of `n` bytes.
    fn le(&mut self, n: usize) -> Step<u64> {
        Ok(self.take(n)?.iter().rev().fold(0, |v, &b| v << 8 | u64::from(b)))
    }

    /// The bytes up to the next line feed.
    fn line(&mut self) -> Step<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(end) = rest.iter().position(|&b| b == b'\n') else {
            return Err(self.bad("a line without an end".into(), "more: it is cut"));
        };
        self.at += end + 1;
        Ok(rest[..end].strip_suffix(b"\r").unwrap_or(&rest[..end]))
    }

    fn parsed<T: std::str::FromStr>(&self, line: &[u8], expected: &'static str) -> Step<T> {
        let text = std::str::from_utf8(line).ok().map(str::trim);
        let shown = || lossy(&line[..line.len().min(40)]);
        text.and_then(|t| t.parse().ok()).ok_or_else(|| self.bad(format!("{:?}", shown()), expected))
    }

    /// Subtracts `n` bytes from the budget for decoded values.
    pub(super) fn pay(&mut self, n: usize) -> Step {
        match self.owned_left.checked_sub(n) {
            Some(left) => {
                self.owned_left = left;
                Ok(())
            }
            None => Err(self.large("values far larger than the file".into())),
        }
    }

    pub(super) fn bad(&self, found: String, expected: &'static str) -> Stop {
        Stop { kind: FaultKind::PickleBad, at: self.opcode_at, found, expected }
    }

    pub(super) fn refuse(&self, found: String) -> Stop {
        let expected = "plain values and numpy arrays";
        Stop { kind: FaultKind::PickleRefused, at: self.opcode_at, found, expected }
    }

    fn large(&self, found: String) -> Stop {
        Stop { kind: FaultKind::TooLarge, at: self.opcode_at, found, expected: "a smaller pickle" }
    }
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Protocol 0's text: `\uXXXX` and `\UXXXXXXXX`, other bytes as Latin-1.
fn unescaped(line: &[u8]) -> String {
    let mut text = String::new();
    let mut at = 0;
    while at < line.len() {
        let digits = match line[at..] {
            [b'\\', b'u', ..] => 4,
            [b'\\', b'U', ..] => 8,
            _ => 0,
        };
        let code = line.get(at + 2..at + 2 + digits).and_then(hex).and_then(char::from_u32);
        match code.filter(|_| digits > 0) {
            Some(c) => {
                text.push(c);
                at += 2 + digits;
            }
            None => {
                text.push(line[at] as char);
                at += 1;
            }
        }
    }
    text
}

fn hex(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0, |n, &b| Some(n << 4 | (b as char).to_digit(16)?))
}

/// Protocol 0's string of Python 2: a quoted literal with `\n \r \t \\ \' \" \xXX`.
fn quoted(line: &[u8]) -> Option<Vec<u8>> {
    let line = line.trim_ascii();
    let (&first, &last) = (line.first()?, line.last()?);
    if line.len() < 2 || first != last || !matches!(first, b'\'' | b'"') {
        return None;
    }
    let inner = &line[1..line.len() - 1];
    let mut value = Vec::new();
    let mut at = 0;
    while at < inner.len() {
        let (byte, step) = match inner[at..] {
            [b'\\', b'x', ..] => (hex(inner.get(at + 2..at + 4)?)? as u8, 4),
            [b'\\', b'n', ..] => (b'\n', 2),
            [b'\\', b'r', ..] => (b'\r', 2),
            [b'\\', b't', ..] => (b'\t', 2),
            [b'\\', c @ (b'\\' | b'\'' | b'"'), ..] => (c, 2),
            [b'\\', ..] => return None,
            [c, ..] => (c, 1),
            [] => break,
        };
        value.push(byte);
        at += step;
    }
    Some(value)
}
