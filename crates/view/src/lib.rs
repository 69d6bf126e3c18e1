//! A page to watch dances on: one HTML file with everything in it, for any browser with WebGL2, from `file://` and
//! without a network.
//!
//! Panels ([`panel`]) beside the dancers show numbers over the page's time. Figures are side by side or overlaid.
//! Figures of one world keep the relative positions of their clips; when all are of one world, the page starts
//! overlaid. Where the paths of joints are drawn, the camera starts still. All play by the same clock whatever their
//! rates and lengths. Given joints have another colour, and the time bar marks regenerated spans. The address's
//! fragment configures the page, with parts separated by `&`: `t=2.5` (seconds), `pause`, `yaw=`, `pitch=` (degrees),
//! `zoom=`, `overlay`, `beside`, `trails`, `still` (the camera doesn't follow), `bare` (no controls), `light`, `dark`,
//! `selftest` (the page tests itself and writes JSON into `<pre id="selftest">`).
#![forbid(unsafe_code)]

pub mod data;
pub mod music;
pub mod panel;
pub mod plot;
pub mod survey;
pub mod table;
pub mod words;

use kinelm_motion::Clip;
use kinelm_motion::metric::beat::BeatHits;
use kinelm_store::files;
pub use kinelm_store::{Error, Result};
use music::Music;
use panel::Panel;
use std::ops::Range;
use std::path::Path;

/// A dance on the page.
///
/// ```
/// use kinelm_motion::synth;
/// use kinelm_view::{Figure, page};
///
/// let dance = synth::corpus(1, 1, 1.0, 30.0)?.remove(0);
/// let html = page(&[Figure::new("synthetic", &dance.clip).note("one second")])?;
/// assert!(html.contains("<title>synthetic</title>") && html.contains(kinelm_view::MARK));
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Figure<'a> {
    /// Shown above the dancer.
    pub title: String,
    /// Shown below the title, smaller; may be empty.
    pub note: String,
    /// The dance, any skeleton.
    pub clip: &'a Clip,
    /// (J) The given joints, drawn in another colour; empty for none.
    pub given: Vec<bool>,
    /// The seconds in which they are given; `None`: throughout.
    pub given_s: Option<Range<f64>>,
    /// Figures of one world keep the relative positions of their clips; `None`: a world of its own.
    pub world: Option<usize>,
    /// Regenerated spans, from and to in seconds, marked on the time bar.
    pub regenerated_s: Vec<[f64; 2]>,
    /// Joints whose whole path is drawn.
    pub paths: Vec<usize>,
    /// A mark for each beat of the page's music: does it hit it? Hits are highlighted. `None`: not measured.
    pub hits: Option<BeatHits>,
}

impl<'a> Figure<'a> {
    /// A dance without given joints.
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
            paths: Vec::new(),
            hits: None,
        }
    }

    /// Adds a line below the title.
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Puts it into a world.
    pub fn in_world(mut self, world: Option<usize>) -> Self {
        self.world = world;
        self
    }

    /// Adds regenerated spans, seconds.
    pub fn regenerated(mut self, regenerated_s: &[[f64; 2]]) -> Self {
        self.regenerated_s = regenerated_s.to_vec();
        self
    }

    /// Draws the whole path of a joint, in up to 2,000 pieces for all of a figure's paths; ids beyond the skeleton are
    /// ignored.
    pub fn path(mut self, joint: usize) -> Self {
        self.paths.extend((joint < self.clip.joints()).then_some(joint));
        self
    }

    /// Adds the hits of the page's beats.
    pub fn hits(mut self, hits: Option<BeatHits>) -> Self {
        self.hits = hits;
        self
    }

    /// Marks joints as given; ids beyond the skeleton are ignored.
    pub fn given(mut self, joints: &[usize]) -> Self {
        self.given = (0..self.clip.joints()).map(|j| joints.contains(&j)).collect();
        self
    }

    /// Limits the given joints to a time span.
    pub fn given_over(mut self, seconds: Range<f64>) -> Self {
        self.given_s = Some(seconds);
        self
    }
}

/// The generator mark in every page.
pub const MARK: &str = r#"<meta name="generator" content="kinelm view">"#;

/// The page as text: about 200 bytes per frame of 24 joints, and 60 KB.
///
/// # Errors
/// [`Error::Unsupported`] without a figure, for a clip without frames, for marks of given joints of another number than the
/// joints, and for positions beyond 1,000 km.
pub fn page(figures: &[Figure]) -> Result<String> {
    Page::new(figures).html()
}

/// A page with more than its figures.
#[derive(Debug, Clone, Copy)]
pub struct Page<'a> {
    figures: &'a [Figure<'a>],
    music: Option<&'a Music>,
    panels: &'a [Panel],
}

impl<'a> Page<'a> {
    /// A page of these figures.
    pub fn new(figures: &'a [Figure<'a>]) -> Self {
        Page { figures, music: None, panels: &[] }
    }

    /// Adds music that plays in step with the dancers; the first frame is at its `from_s`. Beats that a figure hits are
    /// highlighted in its colour.
    pub fn music(mut self, music: Option<&'a Music>) -> Self {
        self.music = music;
        self
    }

    /// Adds panels beside the dancers, in their order.
    pub fn panels(mut self, panels: &'a [Panel]) -> Self {
        self.panels = panels;
        self
    }

    /// The page as text; panels add 20 KB and 3 bytes a value.
    ///
    /// # Errors
    /// As [`page`]; marks of hits of another number than the beats of the music; panels of figures that the page doesn't have,
    /// or without a rate.
    pub fn html(&self) -> Result<String> {
        let Page { figures, music, panels } = *self;
        if figures.is_empty() {
            return Err(Error::unsupported("a page of no figures", "expected at least one clip"));
        }
        let beats = music.map_or(0, |music| music.beats_s.len());
        let marked = |figure: &&Figure| figure.hits.as_ref().is_some_and(|hits| hits.each.len() != beats);
        if let Some(Figure { title, hits: Some(hits), .. }) = figures.iter().find(marked) {
            let why = format!("{} marks of hits for {beats} beats of music; expected as many", hits.each.len());
            return Err(Error::unsupported(format!("the figure {title:?}"), why));
        }
        let data = serde_json::to_string(&data::drawn(figures)?).expect("plain data with text keys is JSON");
        let titles: Vec<&str> = figures.iter().map(|f| f.title.as_str()).collect();
        let beside = panels.iter().map(|panel| panel.json(figures)).collect::<Result<Vec<_>>>()?;
        // pages without panels don't carry their script
        let of_panels = |text: &str| if panels.is_empty() { String::new() } else { text.into() };
        let words = panels.iter().any(Panel::has_words);
        let of_words = |text: &'static str| if words { text } else { "" };
        let left_out = [(SOUND, music.is_some()), (PICK, words)].map(|(name, there)| if there { "" } else { name });
        let style = include_str!("page.css").to_owned() + &of_panels(include_str!("panels.css"));
        let shades = of_panels(&format!("const SHADES = {:?};\n", plot::SHADES));
        let parts = [
            ("title", escaped(&titles.join(", "))),
            ("style", [include_str!("player/look.css"), &style, of_words(include_str!("words.css"))].concat()),
            ("modules", script(&left_out)),
            ("any_page", ANY_PAGE.into()),
            ("page", include_str!("page.js").into()),
            ("controls", include_str!("controls.js").into()),
            (
                "panel_script",
                [of_words(include_str!("words.js")), &shades, &of_panels(include_str!("panels.js"))].concat(),
            ),
            ("selftest", include_str!("selftest.js").into()),
            // in JSON, `<` is only inside strings: none is left that could end the element or open a comment
            ("data", data.replace('<', "\\u003c")),
            ("music", music.map_or("null".into(), Music::json).replace('<', "\\u003c")),
            ("panels", serde_json::Value::from(beside).to_string().replace('<', "\\u003c")),
            // the page's policy allows no sources at all but those listed here
            ("media", if music.is_some() { "; media-src 'self' data: file:".into() } else { String::new() }),
        ];
        Ok(filled(include_str!("page.html"), &parts))
    }
}

/// Writes [`page`] to a file and returns its size in bytes.
///
/// # Errors
/// As [`page`]; I/O errors.
pub fn write_page(path: &Path, figures: &[Figure]) -> Result<usize> {
    let page = page(figures)?;
    files::write_whole(path, page.as_bytes())?;
    Ok(page.len())
}

/// The modules of the page's player, each after those it imports, and its look. The page has them in one script and one
/// style sheet, the studio loads them. An `import` or `export` begins its line, an `import` has one line alone, and no two
/// modules have names in common, so that `script` needs no parser.
pub const MODULES: &[(&str, &str)] = &[
    ("scene.js", include_str!("player/scene.js")),
    ("figure.js", include_str!("player/figure.js")),
    ("capsules.js", include_str!("player/capsules.js")),
    ("stage.js", include_str!("player/stage.js")),
    ("labels.js", include_str!("player/labels.js")),
    ("pointers.js", include_str!("player/pointers.js")),
    (PICK, include_str!("player/pick.js")),
    (SOUND, include_str!("player/sound.js")),
    ("look.css", include_str!("player/look.css")),
];
const SOUND: &str = "sound.js";
const PICK: &str = "pick.js";

/// The script of every page after its modules.
const ANY_PAGE: &str = include_str!("any_page.js");

/// The modules, but those `left_out`, as one script: without imports, `export`, comments, and the types in
/// `/** .. */`, which only a checker reads.
fn script(left_out: &[&str]) -> String {
    let mut script = String::new();
    for (_, text) in MODULES.iter().filter(|(name, _)| name.ends_with(".js") && !left_out.contains(name)) {
        let mut in_types = false;
        for line in text.lines().filter(|line| !line.starts_with("import ")) {
            in_types |= line.trim_start().starts_with("/**");
            if !in_types && !line.trim_start().starts_with("//") {
                script.extend([line.strip_prefix("export ").unwrap_or(line), "\n"]);
            }
            // after the line is judged: the last line of a block is still in it
            in_types &= !line.ends_with("*/");
        }
    }
    script
}

/// Replaces each `{{name}}` of the template in one pass, so that the contents of parts are not replaced.
fn filled(template: &str, parts: &[(&str, String)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        page.push_str(before);
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        if let Some((_, part)) = parts.iter().find(|(n, _)| *n == name) {
            page.push_str(part);
        }
        rest = after;
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
    use panel::Facts;

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
    fn panels_are_plain_text_and_come_with_their_script() {
        let clip = dance(1.0);
        let figures = [Figure::new("a", &clip)];
        let facts = Facts { title: "</script>".into(), rows: vec![vec!["<b>".into()]], ..Facts::default() };
        let with = Page::new(&figures).panels(&[Panel::Facts(facts)]).html().unwrap();
        assert!(with.contains("\\u003c/script>") && with.contains("class Timed") && with.contains(".playhead"));
        assert_eq!(with.matches("<script").count(), with.matches("</script>").count());
        assert!(!page(&figures).unwrap().contains("class Timed"));
    }

    #[test]
    fn the_modules_are_one_script() {
        let script = script(&[]);
        for part in ["import ", "export ", "/**", "@param", "*/"] {
            assert!(!script.lines().any(|line| line.trim_start().starts_with(part)), "{part}");
        }
        for part in ["class Stage {", "function decoded(text) {", "gl_Position", "class Player {"] {
            assert!(script.contains(part), "{part}");
        }
        let names = script.lines().filter_map(|line| {
            let (kind, rest) = line.split_once(' ')?;
            ["const", "let", "class", "function"].contains(&kind).then(|| rest.split([' ', '(']).next())?
        });
        let mut seen = std::collections::BTreeSet::new();
        names.for_each(|name| assert!(seen.insert(name), "{name} is in two modules"));
        assert!(seen.len() > 20 && !super::script(&[SOUND]).contains("class Player"));
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
        assert!(pages[0] - a_frame * frames < 64_000.0, "{} bytes of page", pages[0] - a_frame * frames);
    }
}
