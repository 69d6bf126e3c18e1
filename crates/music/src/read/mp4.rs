//! The beginning of the sound in an mp4, from the edit list of its own track.
//!
//! Source: ISO/IEC 14496-12: 4.2 (boxes), 8.2.2 (mvhd), 8.3.2 (tkhd), 8.4.2 (mdhd), 8.6.6 (elst).

use super::bounds::Bounds;
use super::tags::bytes;
use std::fs::File;
use std::ops::Range;

/// Boxes of one level that are looked at.
const MOST_BOXES: usize = 1 << 20;
/// Edits that are looked at: empty ones, then the first that has sound.
const MOST_EDITS: u32 = 16;

/// The bounds of track `id`, which has `samples` samples at `rate` per second; `None` without an edit list.
pub fn bounds(file: &mut File, id: u32, rate: u32, samples: Option<u64>) -> Option<Bounds> {
    let all = 0..file.metadata().ok()?.len();
    let moov = find(file, &all, &[b"moov"])?;
    let header = |file: &mut File, range: &Range<u64>, path: &[&[u8; 4]]| {
        let header = find(file, range, path)?;
        // the number after two times, which are longer in version 1
        let at = if bytes::<1>(file, header.start).ok()? == [0] { 12 } else { 20 };
        bytes(file, header.start + at).ok().map(u32::from_be_bytes)
    };
    let movie_scale = header(file, &moov, &[b"mvhd"])?;
    let tracks = boxes(file, &moov).into_iter().filter(|(kind, _)| kind == b"trak");
    let (_, track) = tracks.into_iter().find(|(_, track)| header(file, track, &[b"tkhd"]) == Some(id))?;
    let scale = header(file, &track, &[b"mdia", b"mdhd"])?;
    let list = find(file, &track, &[b"edts", b"elst"])?;
    let [version, ..] = bytes::<4>(file, list.start).ok()?;
    let count = bytes(file, list.start + 4).ok().map(u32::from_be_bytes)?;
    // in u128, as a 64-bit time times a rate overflows; to the nearest sample
    let in_samples = |time: u64, scale: u32| {
        let scale = u128::from(scale.max(1));
        u64::try_from((u128::from(time) * u128::from(rate) + scale / 2) / scale).ok()
    };
    let mut empty = 0_u64;
    for i in 0..u64::from(count.min(MOST_EDITS)) {
        let (duration, time) = if version == 0 {
            let [d0, d1, d2, d3, t0, t1, t2, t3] = bytes(file, list.start + 8 + 12 * i).ok()?;
            (u32::from_be_bytes([d0, d1, d2, d3]).into(), i32::from_be_bytes([t0, t1, t2, t3]).into())
        } else {
            let at = list.start + 8 + 20 * i;
            (bytes(file, at).ok().map(u64::from_be_bytes)?, bytes(file, at + 8).ok().map(i64::from_be_bytes)?)
        };
        // a media time of -1 is an empty edit: silence of its duration, in the movie's scale
        match u64::try_from(time) {
            Ok(time) => {
                let (lead, silence) = (in_samples(time, scale)?, in_samples(empty, movie_scale)?);
                let samples = samples.map(|n| n.saturating_sub(lead).saturating_add(silence));
                return Some(Bounds { samples, silence, dropped: [0..lead, 0..0] });
            }
            Err(_) => empty = empty.saturating_add(duration),
        }
    }
    None
}

/// The contents of the first box at a path of kinds.
fn find(file: &mut File, range: &Range<u64>, path: &[&[u8; 4]]) -> Option<Range<u64>> {
    path.iter().try_fold(range.clone(), |range, kind| {
        boxes(file, &range).into_iter().find(|(found, _)| found == *kind).map(|(_, contents)| contents)
    })
}

/// Kinds and contents of the boxes in a range, up to the first that is damaged.
fn boxes(file: &mut File, range: &Range<u64>) -> Vec<([u8; 4], Range<u64>)> {
    let mut found = Vec::new();
    let mut at = range.start;
    while at < range.end && found.len() < MOST_BOXES {
        let Ok([s0, s1, s2, s3, k0, k1, k2, k3, large @ ..]) = bytes::<16>(file, at) else { break };
        let (head, size) = match u32::from_be_bytes([s0, s1, s2, s3]) {
            // size 0: up to the end; size 1: 64 bits after the kind (4.2)
            0 => (8, range.end - at),
            1 => (16, u64::from_be_bytes(large)),
            size => (8, size.into()),
        };
        // a size below its header would never advance
        if size < head || size > range.end - at {
            break;
        }
        found.push(([k0, k1, k2, k3], at + head..at + size));
        at += size;
    }
    found
}
