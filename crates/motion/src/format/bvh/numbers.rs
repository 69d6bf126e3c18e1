//! Fast parsing of numbers, with exactly the results of `str::parse`.
//!
//! If the digits make an integer below 2^53 and the power of ten is at most 22, the number is that integer times or over an
//! exact power of ten: one rounding, hence the nearest double (Clinger, "How to read floating point numbers accurately",
//! 1990). Eight digits at a time are parsed from a 64-bit word. Everything else goes to `str::parse`.

use super::text::{number, word_at};

/// 10^0 to 10^22, the powers that a double holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];
/// 10^0 to 10^8 as integers.
const INTEGERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
/// Bytes of the longest number that the fast path parses: sign, 8 digits, point, 8 digits, e, sign, 7 digits, and the
/// character after it; the last load begins at 20.
const WINDOW: usize = 32;

/// The high bit of each of eight bytes.
const HIGH: u64 = 0x8080_8080_8080_8080;

/// Fills `out` with the numbers of one line. Returns the position after them, or `None` if the line doesn't match.
pub(crate) fn row(bytes: &[u8], mut at: usize, out: &mut [f64]) -> Option<usize> {
    for value in out {
        while matches!(bytes.get(at), Some(b' ' | b'\t')) {
            at += 1;
        }
        let window = bytes.get(at..at + WINDOW).and_then(|w| <&[u8; WINDOW]>::try_from(w).ok());
        // the length depends on the blanks only, so the processor starts the next number before this one is done
        let len = window.map_or(0, word_len);
        match window.and_then(fast) {
            Some((v, used)) if used == len => {
                *value = v;
                at += len;
            }
            _ => {
                let (v, len) = careful(bytes, at)?;
                *value = v;
                at += len;
            }
        }
    }
    while matches!(bytes.get(at), Some(b' ' | b'\t')) {
        at += 1;
    }
    matches!(bytes.get(at), None | Some(b'\r' | b'\n')).then_some(at)
}

/// Parses the number at a position with the standard library; also returns its length.
#[cold]
fn careful(bytes: &[u8], at: usize) -> Option<(f64, usize)> {
    let word = word_at(bytes, at);
    Some((number(word).ok()?, word.len()))
}

/// Eight characters of the window, the first in the lowest byte. `at` is below 24 while a number continues.
#[inline(always)]
fn load(window: &[u8; WINDOW], at: usize) -> u64 {
    // the mask never changes `at`; it lets the compiler drop the bounds check
    let at = at % (WINDOW - 8);
    window[at..at + 8].try_into().map_or(0, u64::from_le_bytes)
}

/// One character of the window.
#[inline(always)]
fn byte(window: &[u8; WINDOW], at: usize) -> u8 {
    window[at % WINDOW]
}

/// Characters before the next blank or control character; 16 for 16 and more.
#[inline(always)]
fn word_len(window: &[u8; WINDOW]) -> usize {
    // the high bit of each byte below 0x21: 0x21 + 0x5F is the first sum that sets it
    let ends = |w: u64| !(((w & !HIGH) + 0x5F5F_5F5F_5F5F_5F5F) | w) & HIGH;
    let (first, second) = (ends(load(window, 0)), ends(load(window, 8)));
    let bits = if first != 0 { first.trailing_zeros() } else { 64 + second.trailing_zeros() };
    (bits / 8) as usize
}

/// Leading digits among eight characters: their number and value.
#[inline(always)]
fn digits(word: u64) -> (usize, u64) {
    let values = word ^ 0x3030_3030_3030_3030;
    // the high bit of each byte above 9, up to the first at least: 0x76 + 10 = 0x80, and only a byte above 9 can carry
    let stop = (values.wrapping_add(0x7676_7676_7676_7676) | values) & HIGH;
    let count = (stop.trailing_zeros() / 8) as usize;
    if count == 0 {
        return (0, 0);
    }
    // the first character is the lowest byte; after the shift, missing characters in front are zeros
    let v = values << (64 - 8 * count);
    let v = v.wrapping_mul(10).wrapping_add(v >> 8) & 0x00FF_00FF_00FF_00FF;
    let v = v.wrapping_mul(100).wrapping_add(v >> 16) & 0x0000_FFFF_0000_FFFF;
    let v = v.wrapping_mul(10_000).wrapping_add(v >> 32) & 0xFFFF_FFFF;
    (count, v)
}

/// The number at the start of a window and its length; `None` if the fast path isn't exact, or it is no number.
#[inline(always)]
fn fast(window: &[u8; WINDOW]) -> Option<(f64, usize)> {
    let negative = window[0] == b'-';
    let mut at = usize::from(negative);
    let (whole, mut mantissa) = digits(load(window, at));
    at += whole;
    let mut places = 0;
    if byte(window, at) == b'.' {
        let (fraction, value) = digits(load(window, at + 1));
        // `fraction` is at most 8, so `% 9` changes nothing and spares the bounds check
        mantissa = mantissa * INTEGERS[fraction % 9] + value;
        places = fraction;
        at += 1 + fraction;
    }
    if whole + places == 0 {
        return None;
    }
    let mut exponent = -(places as i64);
    if byte(window, at) | 0x20 == b'e' {
        let sign = byte(window, at + 1);
        at += 1 + usize::from(matches!(sign, b'+' | b'-'));
        let (count, value) = digits(load(window, at));
        if count == 0 || count == 8 {
            return None;
        }
        exponent += if sign == b'-' { -(value as i64) } else { value as i64 };
        at += count;
    }
    // a ninth digit, or anything else that can't follow a number
    if !matches!(byte(window, at), b' ' | b'\t' | b'\r' | b'\n') || mantissa > 1 << 53 {
        return None;
    }
    let value = mantissa as f64;
    let power = *POWERS.get(exponent.unsigned_abs() as usize)?;
    let value = if exponent < 0 { value / power } else { value * power };
    Some((if negative { -value } else { value }, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_and_digits() {
        let window = |text: &str| -> [u8; WINDOW] { format!("{text:\t<32}").into_bytes().try_into().unwrap() };
        for text in ["", "1", "-71.4479", "12345678", "-1.40554e-09", "123456789012345"] {
            assert_eq!(word_len(&window(text)), text.len(), "{text}");
        }
        assert_eq!(word_len(&window("1234567890123456")), 16);
        assert_eq!(word_len(&window("123456789012345678")), 16);
        assert_eq!(word_len(&[0xFF; WINDOW]), 16);
        for (text, want) in
            [("12x45678", (2, 12)), ("12345678", (8, 12345678)), ("x", (0, 0)), ("0:9", (1, 0)), ("7/9", (1, 7))]
        {
            assert_eq!(digits(load(&window(text), 0)), want, "{text:?}");
        }
    }

    #[test]
    fn every_way_gives_the_bits_of_the_standard_library() {
        let words = [
            "0",
            "-0",
            "-0.0",
            "1",
            ".5",
            "5.",
            "-.5",
            "+1.5",
            "71.4479",
            "-1.40554e-09",
            "3.15377E-15",
            "1e22",
            "1e23",
            "1e-22",
            "1e-23",
            "9007199254740993",
            "90071992.54740993",
            "12345678.12345678",
            "123456789.5",
            "1.123456789",
            "4e-320",
            "0.000000000000000000000000000001",
            "1e+5",
            "1e0000005",
            "1e00000005",
            "179769313486231570e291",
        ];
        for blanks in [" ", "\t", "   "] {
            // with and without a long rest, so that both paths are taken
            for after in ["", "\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"] {
                let text = words.join(blanks) + after;
                let mut got = vec![0.0; words.len()];
                assert_eq!(row(text.as_bytes(), 0, &mut got), Some(text.len() - after.len()));
                for (word, got) in words.iter().zip(got) {
                    assert_eq!(got.to_bits(), word.parse::<f64>().unwrap().to_bits(), "{word}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_row_is_left_to_the_slow_way() {
        for text in [
            "1 2",
            "1 2 3 4",
            "1 2 x",
            "1 2 nan",
            "1 2 3x",
            "1 2 -",
            "1 2 .",
            "1 2 1e",
            "1 2 1e999",
            "1,5 2 3",
            "1 2\n3",
        ] {
            for after in ["", "\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"] {
                assert_eq!(row((text.to_owned() + after).as_bytes(), 0, &mut [0.0; 3]), None, "{text}");
            }
        }
    }
}
