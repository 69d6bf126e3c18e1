//! Length, delay and padding of an mp3: symphonia guesses a length where none is stated, ignores a delay whose checksum
//! is wrong, and ends with the first of several songs in one file.
//!
//! Source: ISO/IEC 11172-3, 2.4.1.3 and 13818-3 (frame headers); the tags Xing, Info, VBRI and LAME.
//!
//! Limits: layer 3 alone, no free bit rate; the checksums of frames and tags aren't verified.

use super::bounds::Bounds;
use super::tags;
use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom, Take};
use std::ops::Range;

/// Junk before the first frame that is searched.
const MOST_JUNK: u64 = 1 << 20;
/// No frame is longer.
const FRAME: u64 = 4096;
/// Samples of delay of every decoder, which the LAME tag leaves out.
const DECODER_DELAY: u64 = 529;

/// The bytes of the frames of a file.
#[derive(Debug)]
pub struct Frames {
    file: Take<File>,
    at: u64,
    /// Positions of the names of the tags after the first.
    names: Vec<u64>,
}

/// The frames in a range of a file, and the bounds that their tags state.
pub fn frames(mut file: File, range: &Range<u64>) -> Result<(Frames, Bounds)> {
    let mut parts = Vec::new();
    let mut goes_on = false;
    let mut at = first(&piece(&mut file, range, MOST_JUNK)?).map(|at| range.start + at);
    while let Some(start) = at {
        let frame = piece(&mut file, &(start..range.end), FRAME)?;
        let Some(header) = Header::parse(&frame) else { break };
        // true also when the next song has no tag: its frames follow, so the first song's padding is inside
        goes_on = !parts.is_empty();
        let Some(tag) = header.tag(&frame) else { break };
        // a tag that states 0 bytes must not lead to itself
        let end = tag.bytes.map(|bytes| start.saturating_add(bytes.max(header.size as u64)));
        at = end.map(|end| tags::after(&mut file, end)).transpose()?;
        parts.push((start, tag));
    }
    let names = parts.iter().skip(1).map(|(start, tag)| start + tag.name).collect();
    file.seek(SeekFrom::Start(range.start))?;
    let frames = Frames { file: file.take(range.end - range.start), at: range.start, names };
    let tags: Vec<Tag> = parts.into_iter().map(|(_, tag)| tag).collect();
    Ok((frames, bounds(&tags, goes_on)))
}

/// The bounds of a file by the tags of its parts; whether frames follow the first of them.
fn bounds(tags: &[Tag], goes_on: bool) -> Bounds {
    let Some(first) = tags.first() else { return Bounds::default() };
    // of several parts, players drop the first delay only, and play the other tags as silence
    let padding = if goes_on { 0 } else { first.padding };
    let silence: u64 = tags.iter().skip(1).map(|tag| tag.frame).sum();
    let all = tags.iter().map(|tag| tag.samples).sum::<Option<u64>>();
    let samples = all.map(|all| (all + silence).saturating_sub(first.delay + padding));
    // no stated length: padding can't be found, and the end is beyond all samples
    let end = first.delay + samples.unwrap_or(u64::MAX >> 1);
    Bounds { samples, silence: 0, dropped: [0..first.delay, end..end + padding] }
}

impl Read for Frames {
    /// Blanks the names of later tags: symphonia leaves such frames out.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let n = self.file.read(buffer)?;
        let range = self.at..self.at + n as u64;
        // a name may be split between two reads: also those that begin before this one
        let from = self.names.partition_point(|name| name + 4 <= range.start);
        for byte in self.names[from..].iter().take_while(|name| **name < range.end).flat_map(|name| *name..name + 4) {
            if range.contains(&byte) {
                buffer[(byte - range.start) as usize] = 0;
            }
        }
        self.at = range.end;
        Ok(n)
    }
}

/// The first bytes of a range of the file.
fn piece(file: &mut File, range: &Range<u64>, most: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(range.start))?;
    file.take(range.end.saturating_sub(range.start).min(most)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The position of the first frame that is followed by one of its kind.
fn first(bytes: &[u8]) -> Option<u64> {
    let header_at = |at: usize| bytes.get(at..).and_then(Header::parse);
    let is_first = |at: &usize| {
        let Some(header) = header_at(*at) else { return false };
        let next = at + header.size;
        // 11 set bits and a few fields occur in any data: the next frame must be there too, or the bytes end
        next >= bytes.len() || header_at(next).is_some_and(|next| next.kind == header.kind)
    };
    (0..bytes.len()).find(is_first).map(|at| at as u64)
}

/// The tag in the first frame of a song, in samples per channel.
#[derive(Debug)]
struct Tag {
    /// Bytes of the frame before the tag's name.
    name: u64,
    /// Bytes of the song with this frame.
    bytes: Option<u64>,
    /// Samples of the song with delay and padding.
    samples: Option<u64>,
    /// Samples of this frame.
    frame: u64,
    delay: u64,
    padding: u64,
}

/// A frame header of layer 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Header {
    /// The bits of version, layer and sampling rate, which all frames share, and whether there is one channel.
    kind: (u8, u8, bool),
    /// Bytes of the frame with its header.
    size: usize,
    /// Bytes of header and side information.
    side: usize,
    /// Whether a checksum of two bytes follows the header.
    checksum: bool,
    /// Samples per channel.
    samples: u64,
}

impl Header {
    fn parse(bytes: &[u8]) -> Option<Header> {
        const MPEG1: [usize; 14] = [32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320];
        const MPEG2: [usize; 14] = [8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160];
        let [sync, kind, rates, mode, ..] = *bytes else { return None };
        // 11 bits of sync, then layer 3 (01)
        if sync != 0xff || kind & 0xe6 != 0xe2 {
            return None;
        }
        // MPEG 2.5 (no standard), 2 and 1; 1 is reserved
        let (divisor, mpeg1) = match kind >> 3 & 3 {
            0 => (4, false),
            2 => (2, false),
            3 => (1, true),
            _ => return None,
        };
        let rate = [44_100, 48_000, 32_000].get(usize::from(rates >> 2 & 3))? / divisor;
        // 0 is a free bit rate, 15 forbidden
        let bits = usize::from(rates >> 4).checked_sub(1).and_then(|i| if mpeg1 { &MPEG1 } else { &MPEG2 }.get(i))?;
        let mono = mode >> 6 == 3;
        Some(Header {
            kind: (kind & 0xfe, rates & 0x0c, mono),
            // samples / 8 bits * kbit/s * 1000 / rate, and a byte of padding: 1152 / 8 = 144, 576 / 8 = 72
            size: if mpeg1 { 144_000 } else { 72_000 } * bits / rate + usize::from(rates >> 1 & 1),
            side: 4 + match (mpeg1, mono) {
                (true, false) => 32,
                (false, true) => 9,
                _ => 17,
            },
            checksum: kind & 1 == 0,
            samples: if mpeg1 { 1152 } else { 576 },
        })
    }

    /// The tag of the frame that begins with this header; `None` if it is sound.
    fn tag(&self, frame: &[u8]) -> Option<Tag> {
        let frame = &frame[..self.size.min(frame.len())];
        let number = |at: usize| Some(u32::from_be_bytes(*frame.get(at..)?.first_chunk()?));
        // symphonia takes a frame for sound unless it is empty up to the tag; so must this reader
        let is_tag = |at: usize, names: &[&[u8]]| {
            let empty =
                frame.get(if self.checksum { 6 } else { 4 }..at).is_some_and(|side| side.iter().all(|b| *b == 0));
            empty && frame.get(at..at + 4).is_some_and(|name| names.contains(&name))
        };
        let tag = |name: usize, bytes: Option<u32>, frames: Option<u32>, delay, padding| Tag {
            name: name as u64,
            bytes: bytes.map(u64::from),
            samples: frames.map(|n| u64::from(n) * self.samples),
            frame: self.samples,
            delay,
            padding,
        };
        if is_tag(36, &[b"VBRI"]) && frame.get(40..42) == Some(&[0, 1]) {
            return Some(tag(36, number(46), number(50), 0, 0));
        }
        if !is_tag(self.side, &[b"Xing", b"Info"]) {
            return None;
        }
        let flags = number(self.side + 4)?;
        let mut at = self.side + 8;
        let mut field = |bit: u32, size: usize| {
            let found = (flags & bit != 0).then_some(at)?;
            at += size;
            number(found)
        };
        let (frames, bytes) = (field(1, 4), field(2, 4));
        // table of contents and quality are skipped; `at` is then the encoder's name
        let _ = (field(4, 100), field(8, 4));
        let is_lame = frame.get(at..at + 4).is_some_and(|name| [b"LAME", b"Lavf", b"Lavc"].iter().any(|n| name == *n));
        // whatever the tag's checksum: a program that cuts without coding again changes the delay only
        let trim = number(at + 20).filter(|_| is_lame).map(|n| u64::from(n & 0xff_ffff));
        // 12 bits each: the encoder's delay, and its padding, which includes the decoder's
        let delay = trim.map_or(0, |trim| (trim >> 12) + DECODER_DELAY);
        let padding = trim.map_or(0, |trim| (trim & 0xfff).saturating_sub(DECODER_DELAY));
        Some(tag(self.side, bytes, frames, delay, padding))
    }
}
