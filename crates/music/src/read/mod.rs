//! Decodes music files, packet by packet.
//!
//! `bounds`: which decoded samples are the sound; stated by an mp3's first frame (`mp3`) or an mp4's edit list (`mp4`). `tags`:
//! where the frames of an mp3 or aac begin and end.
//!
//! Limits: a file without a stated length is decoded to find its end; mp3 and aac without one may be cut unnoticed.
//! Channels become their mean, so sound in opposite phase vanishes. Surround channels count as much as the front ones.

mod bounds;
mod mp3;
mod mp4;
mod tags;

use self::bounds::Bounds;
use crate::error::{FaultKind, FileError};
use crate::resample::{RATES, Resampler, Sink};
use crate::{Error, Result};
use kinelm_store::input;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use symphonia::core::codecs::CodecParameters;
use symphonia::core::codecs::audio::well_known::CODEC_ID_OPUS;
use symphonia::core::codecs::audio::{AudioCodecParameters, AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error as Fault;
use symphonia::core::formats::probe::Hint;
use symphonia::core::formats::{FormatOptions, FormatReader, Track, TrackType};
use symphonia::core::io::{MediaSource, MediaSourceStream, ReadOnlySource};
use symphonia::core::meta::MetadataOptions;

const CONVERT: &str = "wav, flac, ogg (Vorbis), mp3, m4a and aac (AAC-LC) are read; convert the file to one of them";
const AGAIN: &str = "copy or download the file again";
/// Consecutive undecodable packets that are skipped before the file counts as damaged.
const MOST_SKIPPED: usize = 8;
/// Seconds of silence before the sound that an mp4 may state.
const MOST_SILENCE_S: u64 = 3600;
/// Samples by which a header may overstate the length: less than a packet of mp3.
const ROUNDED: u64 = 1151;

/// The header of a music file.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// The container's name, such as `wave` or `ogg`.
    pub container: &'static str,
    /// Samples per second.
    pub rate: u32,
    /// Channels; the decoded sound is their mean.
    pub channels: usize,
    /// Samples per channel, when the header states them.
    pub samples: Option<u64>,
}

/// An open music file, read by `Reader::next_block`.
pub struct Reader {
    path: PathBuf,
    info: Info,
    track: u32,
    format: Box<dyn FormatReader>,
    decoder: Box<dyn AudioDecoder>,
    planes: Vec<f32>,
    mono: Vec<f32>,
    /// Samples returned so far.
    emitted: u64,
    /// Whether this is a wav whose length was unknown when it was written.
    streamed: bool,
    /// Samples of silence that are still to be returned before the others.
    silence: u64,
    /// Samples decoded so far.
    decoded: u64,
    bounds: Bounds,
    skipped: usize,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader").field("path", &self.path).field("info", &self.info).finish_non_exhaustive()
    }
}

/// Opens a music file and reads its header.
///
/// # Errors
/// A file that can't be opened; [`Error::File`] with its [`FaultKind`].
pub fn open(path: &Path) -> Result<Reader> {
    let fault = |kind, what: &str, help: &str| file_error(path, kind, what, help);
    if path.is_dir() {
        return Err(fault(FaultKind::Unknown, "found a folder, expected a file", CONVERT));
    }
    // recorded as an input; all later reads of it go through `peek`
    let file = input::open(path).map_err(Error::io(path))?;
    if file.metadata().is_ok_and(|about| about.len() == 0) {
        return Err(fault(FaultKind::Empty, "found 0 bytes, expected a sound", AGAIN));
    }
    let mut format = probe(path, Box::new(file))?;
    let container = format.format_info().short_name;
    let mut stated = None;
    if ["mp3", "aac"].contains(&container) {
        let (source, bounds) = frames(path, container == "mp3").map_err(Error::io(path))?;
        format = probe(path, source)?;
        stated = Some(bounds);
    }
    let track = choose(path, &*format)?;
    let (id, samples) = (track.id, track.num_frames);
    let parameters = parameters(path, track)?;
    // here, as the missing decoder below would only be an unknown coding
    if parameters.codec == CODEC_ID_OPUS {
        return Err(fault(FaultKind::Opus, "found sound coded by Opus, expected another coding", CONVERT));
    }
    // symphonia ignores a delay whose checksum is wrong, and what follows the stated end
    let options = AudioDecoderOptions::default().gapless(stated.is_none());
    let made = symphonia::default::get_codecs().make_audio_decoder(parameters, &options);
    let decoder =
        made.map_err(|e| fault(FaultKind::Codec, &format!("found a coding that isn't read ({e})"), CONVERT))?;
    let rate = parameters.sample_rate.unwrap_or(0);
    if !RATES.contains(&rate) {
        let (low, high) = RATES.into_inner();
        let what = format!("found a rate of {rate} samples per second, expected {low} to {high}");
        return Err(fault(FaultKind::Range, &what, CONVERT));
    }
    let channels = parameters.channels.as_ref().map_or(0, |c| c.count());
    // a program that writes into a pipe can't go back to fill in the length: it leaves 0xffffffff
    let streamed = container == "wave" && ends(path).first().and_then(|head| head.get(4..8)) == Some(&[0xff; 4]);
    // that many samples would count as a file that is cut
    let samples = samples.filter(|_| !streamed);
    let edited = || mp4::bounds(&mut input::peek(path).ok()?, id, rate, samples);
    let bounds = stated.or_else(|| edited().filter(|_| container == "isomp4"));
    let bounds = bounds.unwrap_or_else(|| Bounds { samples, ..Bounds::default() });
    // a table can state years, and each sample of it would be resampled
    let silence_s = bounds.silence / u64::from(rate);
    if silence_s > MOST_SILENCE_S {
        let what = format!("found {silence_s} s of silence before the sound, expected {MOST_SILENCE_S} s at most");
        return Err(fault(FaultKind::Range, &what, CONVERT));
    }
    let info = Info { container, rate, channels, samples: bounds.samples };
    let (planes, mono) = (Vec::new(), Vec::new());
    let mut reader = Reader {
        path: path.into(),
        info,
        track: id,
        format,
        decoder,
        planes,
        mono,
        emitted: 0,
        streamed,
        silence: bounds.silence,
        decoded: 0,
        bounds,
        skipped: 0,
    };
    // when the header leaves the channels open, the first packet has them
    if reader.info.channels == 0 {
        reader.decode()?;
    }
    Ok(reader)
}

/// The frames of an mp3 or aac, as a source that can't seek: else symphonia guesses a length from the first ones.
fn frames(path: &Path, mp3: bool) -> std::io::Result<(Box<dyn MediaSource>, Bounds)> {
    let mut file = input::peek(path)?;
    let range = tags::between(&mut file)?;
    if mp3 {
        let (frames, bounds) = mp3::frames(file, &range)?;
        return Ok((Box::new(ReadOnlySource::new(frames)), bounds));
    }
    file.seek(SeekFrom::Start(range.start))?;
    Ok((Box::new(ReadOnlySource::new(file.take(range.end - range.start))), Bounds::default()))
}

/// Finds the reader of a source's container.
fn probe(path: &Path, source: Box<dyn MediaSource>) -> Result<Box<dyn FormatReader>> {
    let fault = |kind, what: &str, help: &str| file_error(path, kind, what, help);
    let mut hint = Hint::new();
    if let Some(extension) = path.extension().and_then(|e| e.to_str()) {
        hint.with_extension(extension);
    }
    let stream = MediaSourceStream::new(source, Default::default());
    let probed =
        symphonia::default::get_probe().probe(&hint, stream, FormatOptions::default(), MetadataOptions::default());
    probed.map_err(|e| match e {
        Fault::IoError(e) if e.kind() == ErrorKind::UnexpectedEof => {
            fault(FaultKind::Cut, "the file ends within its header, expected a sound after it", AGAIN)
        }
        Fault::IoError(e) => Error::io(path)(e),
        e if e.to_string().contains("missing moov") => {
            fault(FaultKind::Cut, "the file ends before its table (moov), expected one", AGAIN)
        }
        e => fault(FaultKind::Unknown, &format!("found no sound ({e}), expected one"), CONVERT),
    })
}

fn file_error(path: &Path, kind: FaultKind, what: &str, help: &str) -> Error {
    Box::new(FileError { path: path.into(), kind, what: what.into(), help: help.into() }).into()
}

/// The default audio track, or the first one.
fn choose<'a>(path: &Path, format: &'a dyn FormatReader) -> Result<&'a Track> {
    let is_sound = |t: &&Track| matches!(t.codec_params, Some(CodecParameters::Audio(_)));
    let track = format.default_track(TrackType::Audio).or_else(|| format.tracks().iter().find(is_sound));
    track.ok_or_else(|| {
        if holds(path, &[b"enca", b"drms"]) {
            let what = "found encrypted sound, expected plain";
            return file_error(path, FaultKind::Protected, what, "its shop's own player is the only one to open it");
        }
        if holds(path, &[b"OpusHead"]) {
            return file_error(path, FaultKind::Opus, "found sound coded by Opus, expected another coding", CONVERT);
        }
        file_error(path, FaultKind::NoAudioTrack, "found no sound in it, expected a track of it", CONVERT)
    })
}

fn parameters<'a>(path: &Path, track: &'a Track) -> Result<&'a AudioCodecParameters> {
    let found = track.codec_params.as_ref().and_then(|p| p.audio());
    found.ok_or_else(|| {
        file_error(path, FaultKind::NoAudioTrack, "found a track of unknown coding, expected sound", CONVERT)
    })
}

/// Whether one of these byte strings occurs in the file's ends.
fn holds(path: &Path, marks: &[&[u8]]) -> bool {
    ends(path).iter().any(|piece| marks.iter().any(|mark| piece.windows(mark.len()).any(|w| w == *mark)))
}

/// The file's first and last 256 KiB, which hold the tables of m4a and the headers of Ogg.
fn ends(path: &Path) -> Vec<Vec<u8>> {
    const PIECE: u64 = 256 << 10;
    let Ok(mut file) = input::peek(path) else { return Vec::new() };
    let length = file.metadata().map_or(0, |m| m.len());
    let mut piece = |from: u64| {
        let mut piece = Vec::new();
        file.seek(SeekFrom::Start(from)).and_then(|_| (&mut file).take(PIECE).read_to_end(&mut piece)).ok()?;
        Some(piece)
    };
    // the table of an m4a is at the beginning or at the end, as its program pleased
    [0, length.saturating_sub(PIECE)].into_iter().filter_map(&mut piece).collect()
}

impl Reader {
    /// The header.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The next samples, at most a packet; `None` at the end.
    ///
    /// # Errors
    /// [`Error::File`]: [`FaultKind::Cut`] when the file ends before its track, [`FaultKind::Damaged`] when it can't be
    /// decoded, [`FaultKind::Empty`] when it has no samples. An mp3 or aac that states no length may be cut unnoticed.
    pub(crate) fn next_block(&mut self) -> Result<Option<&[f32]>> {
        if self.silence > 0 {
            // in blocks like packets: an hour at 192 kHz would be 2.8 GB
            let samples = self.silence.min(1 << 12);
            self.silence -= samples;
            self.emitted += samples;
            self.planes.clear();
            self.planes.resize(samples as usize, 0.0);
            return Ok(Some(&self.planes));
        }
        if self.mono.is_empty() && !self.decode()? {
            return self.end().map(|()| None);
        }
        self.emitted += self.mono.len() as u64;
        self.planes.clear();
        // `mono` is empty then, and the next call decodes; both keep their memory
        std::mem::swap(&mut self.planes, &mut self.mono);
        Ok(Some(&self.planes))
    }

    fn fault<T>(&self, kind: FaultKind, what: String, help: &str) -> Result<T> {
        Err(file_error(&self.path, kind, &what, help))
    }

    fn seconds(&self) -> f64 {
        self.emitted as f64 / f64::from(self.info.rate)
    }

    fn end(&self) -> Result<()> {
        match self.info.samples {
            // more than stated is no fault: headers are wrong more often than samples
            Some(stated) if stated > self.emitted + ROUNDED => {
                let whole = stated as f64 / f64::from(self.info.rate);
                let what = format!("ends after {:.2} s, expected {whole:.2} s of sound", self.seconds());
                self.fault(FaultKind::Cut, what, AGAIN)
            }
            _ if self.emitted == 0 => {
                self.fault(FaultKind::Empty, "found a track without samples, expected some".into(), AGAIN)
            }
            _ => Ok(()),
        }
    }

    /// Decodes packets into `mono` until it has samples; `false` at the end.
    fn decode(&mut self) -> Result<bool> {
        let mut failed = 0;
        loop {
            let packet = match self.format.next_packet() {
                Ok(Some(packet)) => packet,
                // a second stream in the file, as in radio recordings, is another sound
                Ok(None) | Err(Fault::ResetRequired) => return Ok(false),
                Err(Fault::IoError(e)) if e.kind() == ErrorKind::UnexpectedEof && self.streamed => return Ok(false),
                Err(Fault::IoError(e)) if e.kind() == ErrorKind::UnexpectedEof => {
                    let what = format!("ends within a packet after {:.2} s, expected its rest", self.seconds());
                    return self.fault(FaultKind::Cut, what, AGAIN);
                }
                Err(Fault::IoError(e)) => return Err(Error::io(&self.path)(e)),
                Err(e) => {
                    let what = format!("found no packet after {:.2} s ({e}), expected one", self.seconds());
                    return self.fault(FaultKind::Damaged, what, AGAIN);
                }
            };
            // video, or a second language
            if packet.track_id != self.track {
                continue;
            }
            match self.decoder.decode(&packet) {
                Ok(buffer) => {
                    let (channels, rate) = (buffer.spec().channels().count(), buffer.spec().rate());
                    // the resamplers and the bounds are for one rate
                    if rate != self.info.rate {
                        let (was, at) = (self.info.rate, self.seconds());
                        let what = format!("found {rate} samples per second after {at:.2} s, expected {was} as before");
                        return self.fault(FaultKind::Damaged, what, CONVERT);
                    }
                    if channels == 0 || buffer.frames() == 0 {
                        continue;
                    }
                    // may change from packet to packet: the mean is still one channel
                    self.info.channels = channels;
                    self.planes.resize(buffer.samples_interleaved(), 0.0);
                    buffer.copy_to_slice_interleaved(&mut self.planes);
                    let share = 1.0 / channels as f32;
                    let mean = |frame: &[f32]| clean(frame.iter().sum::<f32>() * share);
                    self.mono.clear();
                    let frames = (self.decoded..).zip(self.planes.chunks_exact(channels));
                    let sound = frames.filter(|(i, _)| self.bounds.keep(*i));
                    self.mono.extend(sound.map(|(_, frame)| mean(frame)));
                    self.decoded += buffer.frames() as u64;
                    if !self.mono.is_empty() {
                        return Ok(true);
                    }
                }
                // per call, that is in a row: a sound with scattered faults is still a sound
                Err(Fault::DecodeError(_)) if failed < MOST_SKIPPED => {
                    failed += 1;
                    self.skipped += 1;
                }
                Err(e) => {
                    let what = format!("found no sound after {:.2} s ({e}), expected some", self.seconds());
                    return self.fault(FaultKind::Damaged, what, AGAIN);
                }
            }
        }
    }
}

/// Files of floats may hold NaN, infinities and absurdly large numbers.
fn clean(x: f32) -> f32 {
    if x.is_finite() { x.clamp(-1e3, 1e3) } else { 0.0 }
}

/// Decodes a file in one pass and sends its samples to each sink at the sink's rate.
///
/// # Errors
/// Those of [`open`] and `Reader::next_block`, a rate outside `RATES`, and those of the sinks.
pub fn decode_at(path: &Path, sinks: &mut [(u32, Sink)]) -> Result<Info> {
    let mut reader = open(path)?;
    let rate = reader.info.rate;
    let mut resamplers = sinks.iter().map(|(to, _)| Resampler::new(rate, *to)).collect::<Result<Vec<_>>>()?;
    while let Some(block) = reader.next_block()? {
        for (resampler, (_, sink)) in resamplers.iter_mut().zip(&mut *sinks) {
            resampler.push(block, sink)?;
        }
    }
    for (resampler, (_, sink)) in resamplers.into_iter().zip(sinks) {
        resampler.finish(sink)?;
    }
    // what was decoded, whatever the header had
    Ok(Info { samples: Some(reader.emitted), ..reader.info })
}

/// All samples of a short file, at a rate.
///
/// # Errors
/// Those of [`decode_at`].
pub fn samples(path: &Path, rate: u32) -> Result<Vec<f32>> {
    let mut out = Vec::new();
    let mut sink = |block: &[f32]| {
        out.extend_from_slice(block);
        Ok(())
    };
    decode_at(path, &mut [(rate, &mut sink)])?;
    Ok(out)
}
