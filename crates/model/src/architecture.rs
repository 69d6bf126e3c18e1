//! What a model is built of, where that isn't one stack of blocks over all tokens: the keys `architecture`, `window` and
//! `[model.decoder]`.
//!
//! A *two-level* model has a trunk that sees frames and a small decoder that predicts one frame, character after character:
//! after MEGABYTE (Yu et al. 2023) and the RQ-Transformer (Lee et al. 2022). `layers`, `heads` and `width` are the trunk's
//! then.

use super::config::{Architecture, DecoderConfig, HeadKind, ModelConfig, ModelKind, Positions, TokenLayout};
use crate::{Error, Result};

/// Frames of a window, where the file doesn't say.
const WINDOW: usize = 128;

impl ModelConfig {
    /// The decoder of a two-level model.
    pub fn decoder(&self) -> DecoderConfig {
        self.decoder.clone().unwrap_or_default()
    }

    /// Numbers of a row that the head reads.
    pub fn head_width(&self) -> usize {
        match self.architecture {
            Architecture::Flat => self.width,
            Architecture::TwoLevel => self.decoder().width,
        }
    }

    /// The table whose rows give the logits of all ids.
    pub(crate) fn ids_table(&self) -> &'static str {
        match self.architecture.is_flat() && self.tied_head {
            true => "token.weight",
            false => "head.weight",
        }
    }

    /// F: whole words of a window, of a two-level model its frames.
    pub fn frames(&self, tokens: &TokenLayout) -> usize {
        tokens.room(self.context) / tokens.word.max(1)
    }

    /// Whether steps are coded from a linear forecast.
    pub fn forecast(&self) -> bool {
        !self.architecture.is_flat() && self.forecast.unwrap_or(true)
    }

    /// A two-level model's keys, with those that follow from them filled in.
    pub(super) fn two_levels(&self, tokens: &TokenLayout) -> ModelConfig {
        let window = self.window.unwrap_or(WINDOW);
        ModelConfig {
            // one input fewer than tokens: the front's last token predicts the first, a window's last predicts nothing
            context: window * tokens.word + tokens.front - 1,
            window: Some(window),
            decoder: Some(self.decoder()),
            positions: Positions::FrameJoint,
            previous_frame: Some(true),
            head: Some(HeadKind::Relative),
            forecast: Some(self.forecast()),
            tied_head: false,
            ..self.clone()
        }
    }

    /// Checks the keys of the architecture.
    ///
    /// # Errors
    /// The first key that doesn't go with it, or is outside its limits.
    pub(super) fn validate_architecture(&self) -> Result<()> {
        if self.architecture.is_flat() {
            let keys = [
                ("window", self.window.is_some()),
                ("decoder", self.decoder.is_some()),
                ("goal", self.goal),
                ("forecast", self.forecast.is_some()),
                ("music", !self.music.is_none()),
                ("music_scale", self.music_scale.is_some()),
            ];
            return match keys.into_iter().find(|(_, given)| *given) {
                Some((key, _)) => Err(Error::unsupported(
                    format!("model.{key}"),
                    "it goes with model.architecture = \"two_level\" alone",
                )),
                None => Ok(()),
            };
        }
        let DecoderConfig { layers, heads, width, character_width } = self.decoder();
        let window = self.window.unwrap_or(WINDOW);
        let keys = [
            ("window", window, 2, 8192),
            ("decoder.layers", layers, 1, 96),
            ("decoder.heads", heads, 1, 256),
            ("decoder.width", width, 1, 8192),
            ("decoder.character_width", character_width, 1, 512),
        ];
        if let Some((key, value, least, most)) = keys.into_iter().find(|(_, v, least, most)| v < least || v > most) {
            return Err(Error::invalid(format!("model.{key}"), value, format!("{least} to {most}")));
        }
        if !width.is_multiple_of(heads) {
            let found = format!("{width} and heads {heads}");
            return Err(Error::invalid("model.decoder.width", found, "heads that divide the width"));
        }
        let wrong = [
            // characters are predicted as steps from the previous frame, which may be `<mask>` in a masked model
            ("kind = \"masked\"", self.kind == ModelKind::Masked),
            ("previous_frame = false", self.previous_frame == Some(false)),
            ("head = \"absolute\"", self.head == Some(HeadKind::Absolute)),
        ];
        match wrong.into_iter().find(|(_, given)| *given) {
            Some((key, _)) => Err(Error::unsupported(
                format!("model.{key} with architecture = \"two_level\""),
                "a two-level model has no such choice; leave it out",
            )),
            None => Ok(()),
        }
    }

    /// Checks that words are frames, and that the context is a whole number of them.
    ///
    /// # Errors
    /// Tokens of tiles or merges; a context that isn't the window's.
    pub(super) fn validate_frames(&self, tokens: &TokenLayout) -> Result<()> {
        if self.architecture.is_flat() {
            return Ok(());
        }
        if tokens.places.is_empty() || tokens.varying {
            let why = "it decodes frames of bins; words of this tokenizer are tiles, components or merged: take the uniform \
                       or quantile scheme without merges";
            return Err(Error::unsupported("model.architecture = \"two_level\"", why));
        }
        // part of a frame has no row in the trunk, so a context between two whole windows means nothing
        let expected = self.two_levels(tokens).context;
        match self.context == expected {
            true => Ok(()),
            false => {
                let frames = self.window.unwrap_or(WINDOW);
                let expected = format!("{expected}, those of a window of {frames} frames: state model.window alone");
                Err(Error::invalid("model.context", format!("{} tokens", self.context), expected))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    #[test]
    fn keys_of_another_architecture_are_refused_by_name() {
        let said = |text: &str| toml::from_str::<ModelConfig>(text).unwrap().validate().unwrap_err().to_string();
        assert!(said("window = 12").starts_with("model.window: it goes with"));
        assert!(said("[decoder]\nlayers = 2").starts_with("model.decoder: it goes with"));
        assert!(said("goal = true").starts_with("model.goal: it goes with"));
        assert!(said("music = \"beats\"").starts_with("model.music: it goes with"));
        let two = "architecture = \"two_level\"\n";
        assert_eq!(said(&format!("{two}window = 1")), "model.window is 1; expected 2 to 8192");
        assert!(said(&format!("{two}[decoder]\nheads = 3")).contains("decoder.width is 128 and heads 3"));
        assert!(said(&format!("{two}kind = \"masked\"")).starts_with("model.kind = \"masked\" with"));
        assert!(said(&format!("{two}head = \"absolute\"")).starts_with("model.head = \"absolute\" with"));
    }

    #[test]
    fn words_that_are_no_frames_are_refused() {
        let config: ModelConfig = toml::from_str("architecture = \"two_level\"\nwindow = 4").unwrap();
        let tokens = TokenLayout { front: 1, ..fixtures::placed() };
        let whole = config.resolved(&tokens);
        assert_eq!((whole.context, whole.frames(&tokens), whole.head_width()), (24, 4, 128));
        assert_eq!(whole.resolved(&tokens), whole);
        whole.validate_for(&tokens).unwrap();
        let said = |tokens: TokenLayout| whole.validate_for(&tokens).unwrap_err().to_string();
        // two labels more in front
        assert!(said(fixtures::placed()).contains("expected 26, those of a window of 4 frames"));
        let labelled = config.resolved(&fixtures::placed());
        assert_eq!((labelled.context, labelled.frames(&fixtures::placed())), (26, 4));
        assert!(said(TokenLayout { front: 1, ..fixtures::varying() }).contains("tiles, components or merged"));
        let other = ModelConfig { context: 25, ..whole.clone() };
        assert!(
            other.validate_for(&tokens).unwrap_err().to_string().contains("expected 24, those of a window of 4 frames")
        );
    }
}
