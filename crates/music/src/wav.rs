//! Samples as a wav file of 16 bits.

use hound::{SampleFormat, WavSpec, WavWriter};
use std::io::Cursor;

/// The bytes of a mono wav file; samples beyond full scale are clipped.
///
/// # Panics
/// More samples than the 4 GiB of a wav file hold.
pub fn bytes(samples: &[f32], rate: u32) -> Vec<u8> {
    let spec = WavSpec { channels: 1, sample_rate: rate, bits_per_sample: 16, sample_format: SampleFormat::Int };
    let mut out = Cursor::new(Vec::with_capacity(44 + 2 * samples.len()));
    let mut write = || -> hound::Result<()> {
        let mut writer = WavWriter::new(&mut out, spec)?;
        for x in samples {
            // a float that is no number becomes 0
            writer.write_sample((x * 32_768.0).round().clamp(-32_768.0, 32_767.0) as i16)?;
        }
        writer.finalize()
    };
    write().expect("memory takes what a wav file holds");
    out.into_inner()
}
