//! Resampling, block by block.

use crate::{Error, Result};
use rubato::audioadapter_buffers::direct::SequentialSlice;
use rubato::{Fft, FixedSync, Indexing, Resampler as _, WindowFunction};

/// Supported rates, samples per second.
pub(crate) const RATES: std::ops::RangeInclusive<u32> = 1_000..=768_000;

/// Receives samples as they become available.
pub(crate) type Sink<'a> = &'a mut dyn FnMut(&[f32]) -> Result<()>;

/// Samples per block, about. A longer block has a sharper filter.
const BLOCK: usize = 4096;

/// Resamples a stream, without delay; the output is as long as the sound.
pub(crate) struct Resampler {
    from: u32,
    to: u32,
    /// `None` when the rates are equal.
    fft: Option<Fft<f32>>,
    waiting: Vec<f32>,
    out: Vec<f32>,
    /// Output samples of the filter's delay that are still to be dropped.
    delay: usize,
    read: u64,
    written: u64,
}

impl Resampler {
    /// From one rate to another, samples per second.
    ///
    /// # Errors
    /// A rate outside [`RATES`]: [`kinelm_store::Error::Invalid`].
    pub fn new(from: u32, to: u32) -> Result<Resampler> {
        if let Some(rate) = [from, to].into_iter().find(|rate| !RATES.contains(rate)) {
            let (low, high) = RATES.into_inner();
            let found = format!("{rate} samples per second");
            return Err(Error::invalid("the sampling rate", found, format!("{low} to {high}")));
        }
        let fft = (from != to).then(|| {
            let (from, to, window) = (from as usize, to as usize, WindowFunction::BlackmanHarris2);
            Fft::new_custom(from, to, BLOCK, 1, 1, window, FixedSync::Input).expect("rates and sizes above 0")
        });
        let delay = fft.as_ref().map_or(0, |fft| fft.output_delay());
        let out = vec![0.0; fft.as_ref().map_or(0, |fft| fft.output_frames_max())];
        Ok(Resampler { from, to, fft, waiting: Vec::new(), out, delay, read: 0, written: 0 })
    }

    /// Takes samples and passes on those that are ready.
    ///
    /// # Errors
    /// Errors of `sink`.
    pub fn push(&mut self, samples: &[f32], sink: Sink) -> Result<()> {
        self.read += samples.len() as u64;
        let Some(size) = self.fft.as_ref().map(|fft| fft.input_frames_next()) else {
            self.written += samples.len() as u64;
            return sink(samples);
        };
        self.waiting.extend_from_slice(samples);
        let mut done = 0;
        while self.waiting.len() - done >= size {
            self.block(done, size, sink)?;
            done += size;
        }
        self.waiting.drain(..done);
        Ok(())
    }

    /// Passes on the rest. n samples give `round(n to / from)` in all.
    ///
    /// # Errors
    /// Errors of `sink`.
    pub fn finish(mut self, sink: Sink) -> Result<()> {
        let total = self.total();
        // more than once where the delay is longer than the last block
        while self.fft.is_some() && self.written < total {
            let have = self.waiting.len();
            self.block(0, have, sink)?;
            self.waiting.clear();
        }
        Ok(())
    }

    /// Output samples of all input so far.
    fn total(&self) -> u64 {
        let (n, from, to) = (u128::from(self.read), u128::from(self.from), u128::from(self.to));
        // n to / from, a half rounded up; 2^64 samples times a rate need more than 64 bits
        ((2 * n * to + from) / (2 * from)) as u64
    }

    /// Resamples `len` waiting samples from `start` on, padded with silence to a whole block.
    fn block(&mut self, start: usize, len: usize, sink: Sink) -> Result<()> {
        let Some(fft) = self.fft.as_mut() else { return Ok(()) };
        // constant: FixedSync::Input
        let size = fft.input_frames_next();
        let mut input = self.waiting[start..start + len].to_vec();
        input.resize(size, 0.0);
        let space = self.out.len();
        let from = SequentialSlice::new(&input[..], 1, size).expect("one channel of this length");
        let mut to = SequentialSlice::new_mut(&mut self.out[..], 1, space).expect("one channel of this length");
        let (_, made) =
            fft.process_into_buffer(&from, &mut to, None::<&Indexing>).expect("buffers of the lengths it gave");
        let skipped = self.delay.min(made);
        self.delay -= skipped;
        // what follows the sound's end is the filter's tail
        let most = usize::try_from(self.total() - self.written).unwrap_or(usize::MAX);
        let kept = (made - skipped).min(most);
        self.written += kept as u64;
        sink(&self.out[skipped..skipped + kept])
    }
}

/// Resamples a whole sound.
///
/// ```
/// let half = kinelm_music::resample::resample(&[0.5; 44_100], 44_100, 22_050)?;
/// assert_eq!(half.len(), 22_050);
/// # Ok::<(), kinelm_music::Error>(())
/// ```
///
/// # Errors
/// A rate outside `RATES`: [`kinelm_store::Error::Invalid`].
pub fn resample(samples: &[f32], from: u32, to: u32) -> Result<Vec<f32>> {
    let mut out = Vec::new();
    let mut sink = |block: &[f32]| {
        out.extend_from_slice(block);
        Ok(())
    };
    let mut resampler = Resampler::new(from, to)?;
    resampler.push(samples, &mut sink)?;
    resampler.finish(&mut sink)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn sine(hz: f64, rate: u32, n: usize) -> Vec<f32> {
        (0..n).map(|i| (TAU * hz * i as f64 / f64::from(rate)).sin() as f32).collect()
    }

    #[test]
    fn a_sine_stays_where_it_is() {
        for (from, to) in [(44_100, 22_050), (44_100, 30_720), (48_000, 15_360), (8_000, 16_000), (11_025, 44_100)] {
            let hz = f64::from(from.min(to)) * 0.2;
            let (x, n) = (sine(hz, from, 2 * from as usize + 17), (2 * to) as usize);
            let (y, wanted) = (resample(&x, from, to).unwrap(), sine(hz, to, n));
            assert_eq!(y.len(), (x.len() as f64 * f64::from(to) / f64::from(from)).round() as usize);
            // the ends contain the silence beyond them
            let inside = n / 10..n * 9 / 10;
            let worst = inside.map(|i| (y[i] - wanted[i]).abs()).fold(0.0, f32::max);
            assert!(worst < 2e-4, "{from} to {to}: {worst}");
        }
    }

    #[test]
    fn what_a_lower_rate_cannot_hold_is_gone() {
        let y = resample(&sine(15_000.0, 44_100, 44_100), 44_100, 22_050).unwrap();
        let worst = y[2_000..20_000].iter().fold(0.0f32, |a, b| a.max(b.abs()));
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn blocks_change_nothing() {
        let x = sine(440.0, 44_100, 20_000);
        let whole = resample(&x, 44_100, 30_720).unwrap();
        for size in [1, 7, 999, 5_000] {
            let (mut r, mut y) = (Resampler::new(44_100, 30_720).unwrap(), Vec::new());
            let mut sink = |block: &[f32]| {
                y.extend_from_slice(block);
                Ok(())
            };
            x.chunks(size).try_for_each(|block| r.push(block, &mut sink)).unwrap();
            r.finish(&mut sink).unwrap();
            assert_eq!(y, whole, "blocks of {size}");
        }
        assert!(resample(&[], 44_100, 30_720).unwrap().is_empty());
        assert_eq!(resample(&[1.0], 44_100, 44_100).unwrap(), [1.0]);
        assert!(Resampler::new(0, 44_100).is_err() && Resampler::new(44_100, 1_000_000).is_err());
    }
}
