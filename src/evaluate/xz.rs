//! What a general compressor makes of the codes.

use super::codes::CodeClips;
use crate::{Error, Result};
use std::io::{ErrorKind, Read, Write};
use std::process::{Command, Stdio};

/// Bits per frame of the codes as little-endian uint16 under `xz -9`: frame after frame, and channel after channel.
/// `None` where there is no `xz` program, or not one frame.
///
/// # Errors
/// [`Error::Call`] when the program is there and fails.
pub fn bits_per_frame(clips: &CodeClips, channels: usize) -> Result<Option<[f64; 2]>> {
    let codes: Vec<u16> = clips.clips.concat();
    let frames = codes.len() / channels.max(1);
    if frames == 0 {
        return Ok(None);
    }
    let by_frame: Vec<u8> = codes.iter().flat_map(|c| c.to_le_bytes()).collect();
    let by_channel: Vec<u8> =
        (0..channels).flat_map(|c| codes[c..].iter().step_by(channels)).flat_map(|c| c.to_le_bytes()).collect();
    let (Some(a), Some(b)) = (compressed_bytes(&by_frame)?, compressed_bytes(&by_channel)?) else { return Ok(None) };
    Ok(Some([a, b].map(|bytes| 8.0 * bytes as f64 / frames as f64)))
}

/// Length of the bytes under `xz -9` in one thread (several would cut blocks); `None` where there is no such program.
pub(super) fn compressed_bytes(bytes: &[u8]) -> Result<Option<usize>> {
    let mut command = Command::new("xz");
    command.args(["--format=xz", "-9", "-T1", "--stdout"]);
    // these may hold options that change the size
    command.env_remove("XZ_DEFAULTS").env_remove("XZ_OPT");
    let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = match child {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        other => other.map_err(Error::io("xz"))?,
    };
    let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
    let mut packed = Vec::new();
    let read = std::thread::scope(|scope| {
        scope.spawn(move || stdin.map(|mut pipe| pipe.write_all(bytes)));
        stdout.map(|mut pipe| pipe.read_to_end(&mut packed)).transpose()
    });
    let output = child.wait_with_output().map_err(Error::io("xz"))?;
    match read {
        Ok(_) if output.status.success() => Ok(Some(packed.len())),
        Ok(_) => {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            Err(Error::Call(format!("xz failed ({}): {said}", output.status)))
        }
        Err(e) => Err(Error::io("xz")(e)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_costs_its_bits_and_constants_little() {
        let mut x = 1_u32;
        let mut noise = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 16) as u16
        };
        let clips = CodeClips { clips: vec![(0..40_000).map(|i| if i % 2 == 0 { 7 } else { noise() }).collect()] };
        let Some([by_frame, by_channel]) = bits_per_frame(&clips, 2).unwrap() else {
            kinelm_shared_data::skipped("evaluate::xz", "there is no xz program");
            return;
        };
        assert!(by_channel > 16.0 && by_channel < 16.5, "{by_channel}");
        assert!(by_frame >= by_channel && by_frame < 24.0, "{by_frame}");
        assert_eq!(bits_per_frame(&CodeClips::default(), 2).unwrap(), None);
    }
}
