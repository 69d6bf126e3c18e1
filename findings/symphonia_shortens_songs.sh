#!/usr/bin/env bash
# symphonia 0.6.1 (crates.io), mp3: the end of a song is dropped without an error or a mark when its file has no Xing, Info or
# VBRI header, varies its bit rate and begins louder than it goes on. From a source that can seek, the demuxer guesses the
# length by the sizes of the first 17 frames at most, and the packets beyond that guess are trimmed, by default, as if it
# were stated. The same bytes from a source that can't seek (ReadOnlySource) decode whole.
#
# Seen: 30 s of sound at 22,050 samples per second (5 s of noise, then a soft tone; lameenc 1.9.0, quality 4), 661,500 samples
# and the encoder's padding: 662,976 through ReadOnlySource, 255,168 from the file. Needs cargo and python3 with venv;
# prints what it saw and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv python
python/bin/pip install --quiet --disable-pip-version-check lameenc==1.9.0
cat >write.py <<'PY'
import math
import random
from array import array

import lameenc

rate, noise = 22050, random.Random(0)
sound = [noise.randint(-9000, 9000) for _ in range(5 * rate)]
sound += [int(300 * math.sin(math.tau * 440 * i / rate)) for i in range(25 * rate)]
encoder = lameenc.Encoder()
encoder.silence()
encoder.set_channels(1)
encoder.set_in_sample_rate(rate)
encoder.set_vbr(4)
encoder.set_vbr_quality(4)
song = bytes(encoder.encode(array("h", sound).tobytes()) + encoder.flush())
assert not any(tag in song for tag in [b"Xing", b"Info", b"VBRI"])
open("song.mp3", "wb").write(song)
PY
python/bin/python write.py
mkdir src
cat >Cargo.toml <<'TOML'
[package]
name = "look"
version = "0.0.0"
edition = "2024"

[dependencies]
symphonia = { version = "=0.6.1", default-features = false, features = ["mp3"] }
symphonia-bundle-mp3 = { version = "=0.6.1", default-features = false }
symphonia-core = "=0.6.1"
TOML
cat >src/main.rs <<'RS'
use std::fs::File;
use symphonia::core::io::{MediaSource, MediaSourceStream, ReadOnlySource};

fn samples(source: Box<dyn MediaSource>) -> Result<(Option<u64>, usize), Box<dyn std::error::Error>> {
    let stream = MediaSourceStream::new(source, Default::default());
    let probe = symphonia::default::get_probe();
    let mut format = probe.probe(&Default::default(), stream, Default::default(), Default::default())?;
    let track = format.tracks().first().ok_or("no track")?;
    let stated = track.num_frames;
    let parameters = track.codec_params.as_ref().and_then(|p| p.audio()).ok_or("no sound")?;
    let mut decoder = symphonia::default::get_codecs().make_audio_decoder(parameters, &Default::default())?;
    let mut decoded = 0;
    while let Some(packet) = format.next_packet()? {
        decoded += decoder.decode(&packet)?.frames();
    }
    Ok((stated, decoded))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (stated, seekable) = samples(Box::new(File::open("song.mp3")?))?;
    let (_, whole) = samples(Box::new(ReadOnlySource::new(File::open("song.mp3")?)))?;
    println!("{whole} samples through ReadOnlySource, {seekable} from the file (length of its track: {stated:?})");
    let shortened = whole >= 661_500 && seekable < whole / 2 && stated == Some(seekable as u64);
    if shortened { Ok(()) } else { Err("expected the file's sound to be shortened".into()) }
}
RS
cargo run --quiet
