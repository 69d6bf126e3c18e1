//! A page to watch dances on: one HTML file with everything in it, for any browser with WebGL2, from `file://` and
//! without a network.
//!
//! Figures stand side by side or on one spot. Those of one world stand to each other as their clips put them; if all are
//! of one, Overlay is on from the start, and off they stand side by side. All play together by the clock whatever their
//! rates and lengths, and show which joints were given in another colour; the bar of the time shows what was made anew. The fragment of the address sets the page up,
//! `&` between the parts: `t=2.5` (seconds), `pause`, `yaw=`, `pitch=` (degrees), `zoom=`, `overlay`, `beside`, `trails`,
//! `still` (the camera doesn't follow), `bare` (no controls), `light`, `dark`, `selftest` (the page tests itself and
//! writes the result as JSON
//! into `<pre id="selftest">`).
#![forbid(unsafe_code)]

mod data;
pub mod music;
pub mod plot;
pub mod table;

use kinelm_motion::Clip;
use kinelm_motion::metric::beat::BeatHits;
use kinelm_store::files;
pub use kinelm_store::{Error, Result};
use music::Music;
use std::ops::Range;
use std::path::Path;

/// A dance on the page.
#[derive(Debug, Clone)]
pub struct Figure<'a> {
    /// Stands above the dancer.
    pub title: String,
    /// Stands under the title, smaller; may be empty.
    pub note: String,
    /// The dance, any skeleton.
    pub clip: &'a Clip,
    /// (J) the joints that were given and not generated, or empty: drawn in another colour.
    pub given: Vec<bool>,
    /// The seconds in which they were; `None`: throughout.
    pub given_s: Option<Range<f64>>,
    /// Figures of one number stand to each other as their clips put them; `None`: alone.
    pub world: Option<usize>,
    /// Seconds in which something of it was made anew, each from and to: marked on the bar of the time.
    pub regenerated_s: Vec<[f64; 2]>,
    /// Which beats of the page's music it hits, one mark a beat: these are lit. `None`: nobody has looked.
    pub hits: Option<BeatHits>,
}

impl<'a> Figure<'a> {
    /// A dance with no joints given.
    pub fn new(title: impl Into<String>, clip: &'a Clip) -> Self {
        let (title, note) = (title.into(), String::new());
        Figure {
            title,
            note,
            clip,
            given: Vec::new(),
            given_s: None,
            world: None,
            regenerated_s: Vec::new(),
            hits: None,
        }
    }

    /// The same with a line under the title.
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// The same in a world with others.
    pub fn in_world(mut self, world: Option<usize>) -> Self {
        self.world = world;
        self
    }

    /// The same with the times at which it was made anew.
    pub fn regenerated(mut self, regenerated_s: &[[f64; 2]]) -> Self {
        self.regenerated_s = regenerated_s.to_vec();
        self
    }

    /// The same with what it hits of the page's music.
    pub fn hits(mut self, hits: Option<BeatHits>) -> Self {
        self.hits = hits;
        self
    }

    /// The same with these joints given; ids beyond the skeleton are left out.
    pub fn given(mut self, joints: &[usize]) -> Self {
        self.given = (0..self.clip.joints()).map(|j| joints.contains(&j)).collect();
        self
    }

    /// The same with them given from one second to another alone.
    pub fn given_over(mut self, seconds: Range<f64>) -> Self {
        self.given_s = Some(seconds);
        self
    }
}

/// Stands in every page: who made it.
pub const MARK: &str = r#"<meta name="generator" content="kinelm view">"#;

/// The page as text. About 200 bytes for each frame of 24 joints, and 45 KB.
///
/// # Errors
/// [`crate::Error::Call`] when there is no figure, a clip has no frames, the marks of given joints are not as many as
/// the joints, or a place is beyond any stage (1,000 km).
pub fn page(figures: &[Figure]) -> Result<String> {
    page_with(figures, None)
}

/// The same with music, which plays in step with the dancers; the first frame stands at its `from_s`. Beats that a figure
/// hits are lit in its colour.
///
/// # Errors
/// As [`page`]; marks of hits that aren't as many as the beats of the music.
pub fn page_with(figures: &[Figure], music: Option<&Music>) -> Result<String> {
    if figures.is_empty() {
        return Err(crate::Error::call("a page of no figures; expected at least one clip"));
    }
    let beats = music.map_or(0, |music| music.beats_s.len());
    let marked = |figure: &&Figure| figure.hits.as_ref().is_some_and(|hits| hits.each.len() != beats);
    if let Some(Figure { title, hits: Some(hits), .. }) = figures.iter().find(marked) {
        let n = hits.each.len();
        let what = format!("the figure {title:?}: {n} marks of hits for {beats} beats of music; expected as many");
        return Err(crate::Error::call(what));
    }
    let data = serde_json::to_string(&data::drawn(figures)?)
        .map_err(|e| crate::Error::call(format!("the page's data: {e}")))?;
    let titles: Vec<&str> = figures.iter().map(|f| f.title.as_str()).collect();
    let parts = [
        ("title", escaped(&titles.join(", "))),
        ("style", include_str!("page.css").into()),
        ("scene", include_str!("scene.js").into()),
        ("player", if music.is_some() { include_str!("player.js").into() } else { String::new() }),
        ("page", include_str!("page.js").into()),
        ("controls", include_str!("controls.js").into()),
        ("selftest", include_str!("selftest.js").into()),
        // in JSON, `<` stands only inside strings: none is left that could end the element or open a comment
        ("data", data.replace('<', "\\u003c")),
        ("music", music.map(Music::json).transpose()?.unwrap_or("null".into()).replace('<', "\\u003c")),
        ("media", if music.is_some() { "; media-src 'self' data: file:".into() } else { String::new() }),
    ];
    Ok(filled(include_str!("page.html"), &parts))
}

/// Writes [`page`] to a file and returns its size in bytes.
///
/// # Errors
/// As [`page`], and when the file can't be written.
pub fn write_page(path: &Path, figures: &[Figure]) -> Result<usize> {
    let page = page(figures)?;
    files::write_whole(path, page.as_bytes())?;
    Ok(page.len())
}

/// The template with `{{name}}` replaced, once and in order, so that nothing inside a part is taken for a place.
fn filled(template: &str, parts: &[(&str, String)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some((before, behind)) = rest.split_once("{{") {
        page.push_str(before);
        let (name, behind) = behind.split_once("}}").unwrap_or((behind, ""));
        if let Some((_, part)) = parts.iter().find(|(n, _)| *n == name) {
            page.push_str(part);
        }
        rest = behind;
    }
    page + rest
}

fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    fn dance(seconds: f64) -> Clip {
        synth::corpus(1, 1, seconds, 60.0).unwrap().remove(0).clip
    }

    #[test]
    fn hostile_titles_are_text() {
        let clip = dance(1.0);
        let title = "</script><script>alert(1)</script> {{data}} <!-- & \"'";
        let page = page(&[Figure::new(title, &clip).note("</title><b>")]).unwrap();
        assert!(!page.contains("alert(1)</script>") && !page.contains("<script>alert"));
        assert!(page.contains("&lt;/script&gt;&lt;script&gt;alert(1)"));
        assert_eq!(page.matches("<script").count(), page.matches("</script>").count());
        assert_eq!(page.matches("\"data\":").count(), 1, "the data stand there once");
        assert!(!page.contains("{{style}}") && !page.contains("</title><b>"));
    }

    #[test]
    fn nothing_is_fetched() {
        let clip = dance(1.0);
        let page = page(&[Figure::new("a", &clip)]).unwrap();
        for scheme in ["http:", "https:", "//cdn", "@import", "url("] {
            assert!(!page.contains(scheme), "{scheme}");
        }
        assert!(page.contains("default-src 'none'"), "and the page itself forbids it");
    }

    #[test]
    fn what_cannot_be_shown_is_said() {
        let clip = dance(1.0);
        let said = |figures: &[Figure]| page(figures).unwrap_err().to_string();
        assert!(said(&[]).contains("no figures"));
        assert!(said(&[Figure::new("empty", &dance(0.0))]).contains("\"empty\": no frames"));
        let marks = Figure { given: vec![true; 3], ..Figure::new("marks", &clip) };
        assert!(said(&[marks]).contains("3 marks of given joints for 24 joints"));
        let root = clip.root().iter().map(|p| *p * 1e300).collect();
        let far = Clip::new(clip.skeleton().clone(), 60.0, root, clip.rotations().to_vec()).unwrap();
        assert!(said(&[Figure::new("far", &far)]).contains("expected a body within"));
    }

    #[test]
    fn size_is_as_documented() {
        let clip = dance(30.0);
        let frames = clip.frames() as f64;
        let pages = [1, 2].map(|n| page(&vec![Figure::new("a", &clip); n]).unwrap().len() as f64);
        let a_frame = (pages[1] - pages[0]) / frames;
        assert!((190.0..210.0).contains(&a_frame), "{a_frame} bytes a frame");
        assert!(pages[0] - a_frame * frames < 50_000.0, "{} bytes of page", pages[0] - a_frame * frames);
    }
}
