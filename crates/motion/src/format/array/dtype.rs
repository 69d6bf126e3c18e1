//! Element types of arrays.

use std::fmt;

/// The kind of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// One byte, 0 or not 0.
    Bool,
    /// Signed integer.
    Int,
    /// Unsigned integer.
    Uint,
    /// IEEE 754 floating point.
    Float,
    /// UTF-32, padded with zeros (`U`).
    Text,
    /// Bytes, padded with zeros (`S`).
    Bytes,
    /// Pickled Python objects; an [`Array`](super::Array) never holds them.
    Object,
}

/// An element's type and size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dtype {
    /// The kind.
    pub element: Element,
    /// Bytes of a number, or characters of a text.
    pub size: usize,
    /// Whether the byte order is big-endian.
    pub big: bool,
}

impl Dtype {
    /// Parses numpy's notation: `<f8`, `>f4`, `|S7`, `<U3`, `|b1`, `|O`. The byte order may be missing.
    ///
    /// `None` for types that no motion file needs (complex, dates, records, long doubles) and for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (big, rest) = match text.as_bytes().first()? {
            b'>' => (true, &text[1..]),
            b'<' | b'|' | b'=' => (false, &text[1..]),
            _ => (false, text),
        };
        let letter = *rest.as_bytes().first()?;
        let digits = rest.get(1..)?;
        // 9 digits at most, so that 4 bytes a character stay below 2^32
        if !digits.bytes().all(|b| b.is_ascii_digit()) || digits.len() > 9 {
            return None;
        }
        let size = if digits.is_empty() { None } else { Some(digits.parse::<usize>().ok()?) };
        let (element, size) = match (letter, size) {
            (b'?', None) | (b'b', Some(1)) => (Element::Bool, 1),
            (b'i', Some(n @ (1 | 2 | 4 | 8))) => (Element::Int, n),
            (b'u', Some(n @ (1 | 2 | 4 | 8))) => (Element::Uint, n),
            (b'f', Some(n @ (2 | 4 | 8))) => (Element::Float, n),
            (b'U', n) => (Element::Text, n.unwrap_or(0)),
            (b'S', n) => (Element::Bytes, n.unwrap_or(0)),
            (b'O', _) => (Element::Object, 0),
            _ => return None,
        };
        Some(Dtype { element, size, big })
    }

    /// Bytes of an element; 0 for objects, which are stored elsewhere.
    pub fn bytes(&self) -> usize {
        if self.element == Element::Text { self.size * 4 } else { self.size }
    }

    /// Decodes a number.
    pub(super) fn real(&self, b: &[u8]) -> f64 {
        match (self.element, self.size) {
            (Element::Float, 2) => half(self.bits(b) as u16),
            (Element::Float, 4) => f32::from_bits(self.bits(b) as u32) as f64,
            (Element::Float, _) => f64::from_bits(self.bits(b)),
            (Element::Uint, _) => self.bits(b) as f64,
            _ => self.integer(b) as f64,
        }
    }

    /// Decodes an integer.
    pub(super) fn integer(&self, b: &[u8]) -> i64 {
        let bits = self.bits(b);
        match self.element {
            Element::Bool => i64::from(bits != 0),
            Element::Int => {
                // shifted up and back down as i64, which repeats the sign bit
                let unused = 64 - 8 * self.size as u32;
                ((bits << unused) as i64) >> unused
            }
            _ => bits as i64,
        }
    }

    /// Decodes a text, without its zero padding.
    pub(super) fn text(&self, b: &[u8]) -> String {
        if self.element == Element::Text {
            let code = |c: &[u8]| self.bits(c) as u32;
            let text: String = b.chunks_exact(4).map(|c| char::from_u32(code(c)).unwrap_or('\u{fffd}')).collect();
            return text.trim_end_matches('\0').to_owned();
        }
        let end = b.iter().rposition(|&c| c != 0).map_or(0, |i| i + 1);
        match std::str::from_utf8(&b[..end]) {
            Ok(text) => text.to_owned(),
            Err(_) => b[..end].iter().map(|&c| c as char).collect(),
        }
    }

    /// Up to 8 bytes as an integer.
    fn bits(&self, b: &[u8]) -> u64 {
        let step = |n: u64, &byte: &u8| n << 8 | u64::from(byte);
        if self.big { b.iter().fold(0, step) } else { b.iter().rev().fold(0, step) }
    }
}

impl fmt::Display for Dtype {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = match self.element {
            Element::Bool => 'b',
            Element::Int => 'i',
            Element::Uint => 'u',
            Element::Float => 'f',
            Element::Text => 'U',
            Element::Bytes => 'S',
            Element::Object => return f.write_str("|O"),
        };
        let single = matches!(self.element, Element::Bytes) || (self.size == 1 && self.element != Element::Text);
        let sign = match (single, self.big) {
            (true, _) => '|',
            (_, true) => '>',
            _ => '<',
        };
        write!(f, "{sign}{letter}{}", self.size)
    }
}

/// IEEE 754 half precision.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    sign * match exponent {
        // subnormal: no implied leading 1
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        // less the bias of 15 and the 10 bits of the fraction
        e => (1024.0 + fraction) * 2f64.powi(e - 25),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_read_and_printed() {
        for text in ["<f8", ">f4", "<f2", "|S7", "<U3", ">U3", "|b1", "|O", "<i8", ">u2", "|u1", "<U1", "|S1"] {
            assert_eq!(Dtype::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Dtype::parse("f8"), Dtype::parse("<f8"));
        assert_eq!(Dtype::parse("=f8"), Dtype::parse("<f8"));
        for text in ["", "<", "<f", "<f3", "<f16", "<c16", "<M8[ns]", "<f-8", "|V4", "<é8", "<U99999999999", "é"] {
            assert_eq!(Dtype::parse(text), None, "{text}");
        }
    }

    #[test]
    fn numbers() {
        let d = |t: &str| Dtype::parse(t).unwrap();
        assert_eq!(d("<f8").real(&1.5f64.to_le_bytes()), 1.5);
        assert_eq!(d(">f4").real(&(-2.25f32).to_be_bytes()), -2.25);
        assert_eq!(d("<i2").real(&(-3i16).to_le_bytes()), -3.0);
        assert_eq!(d(">i4").integer(&i32::MIN.to_be_bytes()), i64::from(i32::MIN));
        assert_eq!(d("<u4").integer(&u32::MAX.to_le_bytes()), i64::from(u32::MAX));
        assert_eq!(d("<u8").real(&u64::MAX.to_le_bytes()), u64::MAX as f64);
        assert_eq!(d("<u8").integer(&u64::MAX.to_le_bytes()), -1);
        assert_eq!(d("|b1").real(&[2]), 1.0);
    }

    #[test]
    fn halves() {
        let d = Dtype::parse("<f2").unwrap();
        let of = |bits: u16| d.real(&bits.to_le_bytes());
        assert_eq!([of(0x3c00), of(0xc000), of(0x7bff), of(0x0001)], [1.0, -2.0, 65504.0, 2f64.powi(-24)]);
        assert!(of(0x7e00).is_nan() && of(0xfc00) == f64::NEG_INFINITY && of(0x8000).is_sign_negative());
    }

    #[test]
    fn texts() {
        let d = |t: &str| Dtype::parse(t).unwrap();
        assert_eq!(d("|S6").text(b"male\0\0"), "male");
        assert_eq!(d("|S2").text(b"\xe9\0"), "é");
        assert_eq!(d(">U2").text(&[0, 0, 0, 233, 0, 0, 0, 0]), "é");
        assert_eq!(d("<U1").text(&[0xff; 4]), "\u{fffd}");
    }
}
