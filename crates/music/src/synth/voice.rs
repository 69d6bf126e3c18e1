//! The sounds of the instruments.

use std::f64::consts::TAU;

/// Pseudorandom noise from a seed.
///
/// Source: Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators" (2014).
pub struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Noise {
        Noise(seed)
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1 to 1.
    pub fn next(&mut self) -> f32 {
        // 24 bits, as many as a float has
        (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Uniform below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        // n is below 10: the bias is 10^-18
        (self.bits() % n.max(1) as u64) as usize
    }
}

/// A sound.
pub enum Sound {
    Kick,
    Snare,
    Hat,
    /// A MIDI note held for `length` seconds.
    Bass {
        note: i32,
        length: f64,
    },
    Chord {
        notes: [i32; 3],
        length: f64,
    },
}

fn hz(note: i32) -> f64 {
    440.0 * 2f64.powf(f64::from(note - 69) / 12.0)
}

/// Adds a sound at a time; it is truncated at the end.
pub fn add(out: &mut [f32], rate: u32, at_s: f64, loud: f32, sound: &Sound, noise: &mut Noise) {
    let start = (at_s * f64::from(rate)).round() as usize;
    let Some(out) = out.get_mut(start..) else { return };
    let each = |seconds: f64| (0..(seconds * f64::from(rate)) as usize).map(|i| i as f64 / f64::from(rate));
    match sound {
        Sound::Kick => {
            // the pitch falls from 160 to 45 Hz within 40 ms
            // the integral of 45 + 115 e^(-t / 0.04) Hz: sin(2 pi f(t) t) would sweep too far
            let phase = |t: f64| 45.0 * t + 115.0 * 0.04 * (1.0 - (-t / 0.04).exp());
            for (to, t) in out.iter_mut().zip(each(0.4)) {
                *to += loud * ((TAU * phase(t)).sin() * (-t / 0.11).exp() * attack(t)) as f32;
            }
        }
        Sound::Snare => {
            for (to, t) in out.iter_mut().zip(each(0.25)) {
                let rattle = f64::from(noise.next()) * (-t / 0.06).exp();
                let skin = (TAU * 190.0 * t).sin() * (-t / 0.04).exp();
                *to += loud * (0.6 * rattle + 0.5 * skin) as f32;
            }
        }
        Sound::Hat => {
            // second differences of noise have little low-frequency energy
            let (mut last, mut before) = (0.0, 0.0);
            for (to, t) in out.iter_mut().zip(each(0.12)) {
                let x = noise.next();
                *to += loud * (x - 2.0 * last + before) * 0.5 * (-t / 0.025).exp() as f32;
                (before, last) = (last, x);
            }
        }
        Sound::Bass { note, length } => tone(out, rate, hz(*note), *length, 0.5, loud, 5),
        Sound::Chord { notes, length } => {
            notes.iter().for_each(|note| tone(out, rate, hz(*note), *length, 0.9, loud / 3.0, 4));
        }
    }
}

/// A fade-in of 2 ms, against clicks.
fn attack(t: f64) -> f64 {
    (t / 0.002).min(1.0)
}

/// A note with the decaying overtones of a plucked string, damped at its end.
fn tone(out: &mut [f32], rate: u32, hz: f64, length: f64, decay: f64, loud: f32, overtones: u32) {
    let n = ((length + 0.05) * f64::from(rate)) as usize;
    for (i, to) in out.iter_mut().take(n).enumerate() {
        let t = i as f64 / f64::from(rate);
        let damped = if t > length { 1.0 - (t - length) / 0.05 } else { 1.0 };
        let mut x = 0.0;
        // below half the rate, or overtones alias
        for h in (1..=overtones).map(f64::from).take_while(|h| h * hz < 0.45 * f64::from(rate)) {
            x += (TAU * h * hz * t).sin() * (-t * h / decay).exp() / h;
        }
        *to += loud * (x * damped * attack(t)) as f32;
    }
}
