//! Samples as a wav file of 16 bits.

/// The bytes of a mono wav file: what is beyond full scale is cut.
///
/// Source: the RIFF WAVE format, PCM; a file of more than 4 GiB has its lengths cut to what 32 bits hold.
pub fn bytes(samples: &[f32], rate: u32) -> Vec<u8> {
    let length = u32::try_from(2 * samples.len()).unwrap_or(u32::MAX - 36);
    let mut out = Vec::with_capacity(44 + 2 * samples.len());
    out.extend(b"RIFF");
    out.extend((36 + length).to_le_bytes());
    out.extend(b"WAVEfmt ");
    // 16 bytes of format: PCM, one channel
    out.extend(16u32.to_le_bytes());
    out.extend(1u16.to_le_bytes());
    out.extend(1u16.to_le_bytes());
    out.extend(rate.to_le_bytes());
    out.extend((2 * rate).to_le_bytes());
    out.extend(2u16.to_le_bytes());
    out.extend(16u16.to_le_bytes());
    out.extend(b"data");
    out.extend(length.to_le_bytes());
    for x in samples {
        // a float that is no number becomes 0
        out.extend(((x * 32_768.0).round().clamp(-32_768.0, 32_767.0) as i16).to_le_bytes());
    }
    out
}
