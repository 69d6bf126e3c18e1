//! Tags around a stream of frames. A decoder that runs into one takes bytes of its pictures for frames.
//!
//! Source: ID3v2.4, 3.1; ID3v1; APEv2; Lyrics3 v2.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};
use std::ops::Range;

/// The bytes between the tags at both ends of a file; all bytes if nothing is between them.
pub fn between(file: &mut File) -> Result<Range<u64>> {
    let length = file.metadata()?.len();
    let (start, mut end) = (after(file, 0)?, length);
    // several may follow each other: APE before Lyrics3 before ID3v1
    while let Some(before) = end.checked_sub(128) {
        let Some(size) = trailing(&bytes(file, before)?) else { break };
        end = end.saturating_sub(size);
    }
    Ok(if start < end { start..end } else { 0..length })
}

/// The first byte after the tags that begin at `at`.
pub fn after(file: &mut File, mut at: u64) -> Result<u64> {
    while let Some(size) = leading(&bytes(file, at)?) {
        at += size;
    }
    Ok(at)
}

/// The bytes from a position on; zeros after the end of the file.
pub fn bytes<const N: usize>(file: &mut File, from: u64) -> Result<[u8; N]> {
    let mut read = Vec::new();
    file.seek(SeekFrom::Start(from))?;
    file.take(N as u64).read_to_end(&mut read)?;
    read.resize(N, 0);
    Ok(std::array::from_fn(|i| read[i]))
}

/// The size of the tag that begins so.
fn leading(head: &[u8; 10]) -> Option<u64> {
    if head.starts_with(b"TAG") {
        return Some(128);
    }
    let [b'I', b'D', b'3', _, _, flags, size @ ..] = head else { return None };
    // seven bits a byte, so that no size looks like the sync of a frame
    let size = size.iter().fold(0, |sum, byte| sum << 7 | u64::from(byte & 0x7f));
    // the size counts neither header nor footer, 10 bytes each
    Some(size + if flags & 0x10 != 0 { 20 } else { 10 })
}

/// The size of the tag that ends so.
fn trailing(tail: &[u8; 128]) -> Option<u64> {
    if tail.starts_with(b"TAG") {
        return Some(128);
    }
    if let Some(size) = tail.strip_suffix(b"LYRICS200") {
        let size = std::str::from_utf8(&size[size.len() - 6..]).ok()?;
        // six digits that count neither themselves nor the name
        return Some(size.parse::<u64>().ok()? + 15);
    }
    let footer = &tail[96..];
    let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| footer[at + i]));
    // the size counts the footer, not the header, which bit 31 of the flags states
    let header = if number(20) >> 31 == 1 { 32 } else { 0 };
    footer.starts_with(b"APETAGEX").then(|| u64::from(number(12)).max(32) + header)
}
