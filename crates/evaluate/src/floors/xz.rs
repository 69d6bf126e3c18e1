//! What a general compressor makes of the codes.

use super::codes::CodeClips;
use crate::{Error, Result};
use std::io::{BufWriter, ErrorKind, Write};
use std::process::{Command, Stdio};

/// Bits per frame of the codes as little-endian uint16 under `xz -9`: frame after frame, and channel after channel.
/// `None` where there is no `xz` program, or not one frame.
///
/// # Errors
/// [`kinelm_store::Error::Io`] when the program is there and fails.
pub fn bits_per_frame(clips: &CodeClips, channels: usize) -> Result<Option<[f64; 2]>> {
    let frames = clips.iter().map(Vec::len).sum::<usize>() / channels.max(1);
    if frames == 0 {
        return Ok(None);
    }
    let write = |pipe: &mut dyn Write, codes: &mut dyn Iterator<Item = &u16>| {
        for code in codes {
            pipe.write_all(&code.to_le_bytes())?;
        }
        Ok(())
    };
    let by_frame = compressed_bytes(&|pipe| write(pipe, &mut clips.iter().flatten()))?;
    let by_channel = compressed_bytes(&|pipe| {
        let of = |c: usize| clips.iter().flat_map(move |clip| clip.iter().skip(c).step_by(channels));
        write(pipe, &mut (0..channels).flat_map(of))
    })?;
    let (Some(a), Some(b)) = (by_frame, by_channel) else { return Ok(None) };
    Ok(Some([a, b].map(|bytes| 8.0 * bytes as f64 / frames as f64)))
}

/// What writes the bytes that are to be compressed.
pub(super) type Source<'a> = dyn Fn(&mut dyn Write) -> std::io::Result<()> + Sync + 'a;

/// Length of what `write` writes under `xz -9` in one thread (several would cut blocks); `None` where there is no such
/// program.
pub(super) fn compressed_bytes(write: &Source) -> Result<Option<u64>> {
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
    let (read, written) = std::thread::scope(|scope| {
        let writer = scope.spawn(move || {
            let mut pipe = BufWriter::new(stdin?);
            Some(write(&mut pipe).and_then(|()| pipe.flush()))
        });
        let read = stdout.map(|mut pipe| std::io::copy(&mut pipe, &mut std::io::sink())).transpose();
        (read, writer.join().ok().flatten().unwrap_or(Ok(())))
    });
    let output = child.wait_with_output().map_err(Error::io("xz"))?;
    match read {
        Ok(packed) if output.status.success() => match written {
            Ok(()) => Ok(packed),
            Err(e) => Err(Error::io("xz")(e)),
        },
        Ok(_) => {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            Err(Error::io("xz")(std::io::Error::other(format!("{}: {said}", output.status))))
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
        let clips = vec![(0..40_000).map(|i| if i % 2 == 0 { 7 } else { noise() }).collect()];
        let Some([by_frame, by_channel]) = bits_per_frame(&clips, 2).unwrap() else {
            kinelm_shared_data::skipped("evaluate::xz", "there is no xz program");
            return;
        };
        assert!(by_channel > 16.0 && by_channel < 16.5, "{by_channel}");
        assert!(by_frame >= by_channel && by_frame < 24.0, "{by_frame}");
        assert_eq!(bits_per_frame(&CodeClips::default(), 2).unwrap(), None);
    }
}
