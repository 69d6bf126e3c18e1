//! The root's path over the ground by the codes of frames: its position after each word, and the codes of a step.

use crate::scheme::angle::Angles;
use crate::scheme::line::Line;
use crate::scheme::pelvis::{Turns, about_y};
use crate::scheme::walk::Walk;
use crate::{Error, Height, JointTransform, Result, Tokenizer, Travel};
use kinelm_motion::Vec3;
use kinelm_motion::rotation::exp_map;
use std::f64::consts::{PI, TAU};

/// The slots of a word that code the root: its step in x, its height, its step in z, its turn, its tilt in x and z.
pub const ROOT_SLOTS: usize = 6;

/// The slots that are steps from the previous frame: in x, in z, in turn.
pub const STEP_SLOTS: [usize; 3] = [0, 2, 3];

/// How a tokenizer's codes move the root.
#[derive(Debug, Clone)]
pub struct RootPath {
    translation: [Line; 3],
    angles: Angles,
    turns: Turns,
    start: Walk,
}

/// Position and heading of the root.
#[derive(Debug, Clone)]
pub struct RootState {
    walk: Walk,
    turns: Turns,
}

impl RootPath {
    /// For a tokenizer with frames of uniform bins, x, z and turns coded as steps, and heights coded otherwise.
    ///
    /// # Errors
    /// [`Error::Setting`] with the first setting of another tokenizer.
    pub fn of(tokenizer: &Tokenizer) -> Result<RootPath> {
        let refused = |field, found: String, expected: &str| Err(Error::setting(field, found, expected));
        let Some(uniform) = tokenizer.uniform().filter(|_| tokenizer.tokens_per_word().is_some()) else {
            return refused("scheme", "another, or merged tokens".into(), "uniform bins without merges");
        };
        let config = uniform.config();
        if config.joint_transform != (JointTransform::None {}) {
            return refused("joint_transform", "components of poses".into(), "none");
        }
        if config.translation != Travel::Velocity {
            return refused("translation", "absolute".into(), "velocity");
        }
        if config.height == Height::Velocity {
            return refused("height", "velocity".into(), "floor or absolute");
        }
        if !tokenizer.channels().has_turn() {
            return refused("root_rotation", "absolute, or a pelvis that is not coded".into(), "heading_delta");
        }
        Ok(RootPath {
            translation: *uniform.translation(),
            angles: uniform.angles(),
            turns: Turns::new(config.bins),
            start: Walk::new(uniform.first_height(), config.translation, config.height),
        })
    }

    /// The start of every clip: x = z = 0, turn 0.
    pub fn start(&self) -> RootState {
        RootState { walk: self.start.clone(), turns: self.turns }
    }

    /// Moves by a word's codes, at least [`ROOT_SLOTS`].
    ///
    /// # Panics
    /// When there are fewer codes.
    pub fn follow(&self, state: &mut RootState, word: &[u16]) {
        state.walk.follow(&self.translation, [word[0], word[1], word[2]]);
        state.turns.follow(word[3]);
        let tilt = self.angles.vector([word[4], 0, word[5]]) * Vec3::new(1.0, 0.0, 1.0);
        state.walk.face(about_y(state.turns.radians()) * exp_map::from_vector(tilt));
    }

    /// The codes at [`STEP_SLOTS`] of a step ([`RootState::step_to`]), not rounded.
    pub fn step_codes(&self, [x, z, turn]: [f64; 3]) -> [f64; 3] {
        let along = |line: &Line, step: f64| f64::from(line.zero) + (step - line.offset) / line.width;
        let bins = self.turns.bins();
        [along(&self.translation[0], x), along(&self.translation[2], z), (bins / 2) as f64 + turn / TAU * bins as f64]
    }
}

impl RootState {
    /// The step to another state: metres in x and z relative to this heading, and the turn in radians, -PI to PI.
    pub fn step_to(&self, there: &RootState) -> [f64; 3] {
        let offset = self.walk.turned_in(there.walk.at() - self.walk.at());
        let turn = there.turns.radians() - self.turns.radians();
        // turns are whole bins modulo a full turn, so their difference may need a full turn more or less
        [offset.x, offset.z, (turn + PI).rem_euclid(TAU) - PI]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::{bent, presets};
    use crate::{Form, RootRotation, SchemeConfig, TokenizerConfig, UncodedPose, UniformConfig};

    fn fitted(form: Form, height: Height) -> Tokenizer {
        let scheme = SchemeConfig::Uniform(UniformConfig { bins: 120, form, height, ..Default::default() });
        let config = TokenizerConfig::uniform(&[0, 4], 20.0, 120);
        let config = TokenizerConfig { root_rotation: RootRotation::HeadingDelta, scheme, ..config };
        Tokenizer::fit([&bent(2, 90)], config).unwrap()
    }

    #[test]
    fn a_stand_is_where_the_decoder_puts_the_root_and_steps_lead_from_one_to_the_next() {
        for (form, height) in [(Form::Centred, Height::Floor), (Form::Edge, Height::Absolute)] {
            let tokenizer = fitted(form, height);
            let words = tokenizer.encode(&bent(5, 60)).unwrap().words;
            let clip = tokenizer.decode(&words, UncodedPose::Identity).unwrap();
            let root_path = RootPath::of(&tokenizer).unwrap();
            let mut state = root_path.start();
            for (frame, word) in words.iter().enumerate() {
                let before = state.clone();
                root_path.follow(&mut state, word);
                assert_eq!(state.walk.at(), clip.root()[frame], "frame {frame}");
                // the codes of the very step
                let codes = root_path.step_codes(before.step_to(&state));
                for (code, place) in codes.iter().zip(STEP_SLOTS) {
                    assert!((code - f64::from(word[place])).abs() < 1e-6, "frame {frame}, place {place}: {code}");
                }
            }
        }
    }

    #[test]
    fn other_tokenizers_are_refused_by_their_first_setting() {
        let said = |tokenizer: &Tokenizer| RootPath::of(tokenizer).map(|_| ()).map_err(|e| e.to_string());
        for (name, tokenizer) in presets() {
            assert_eq!(said(&tokenizer).is_ok(), ["uniform", "uniform, headings"].contains(&name), "{name}");
        }
        let absolute =
            TokenizerConfig { root_rotation: RootRotation::Absolute, ..TokenizerConfig::uniform(&[0], 20.0, 60) };
        assert!(said(&Tokenizer::fit([&bent(1, 20)], absolute).unwrap()).unwrap_err().contains("root_rotation"));
        assert!(said(&fitted(Form::Centred, Height::Velocity)).unwrap_err().contains("height"));
    }
}
