//! The paths of joints, in a real browser.

use super::browser;
use super::probe::answers;
use kinelm::view::{Figure, Page};
use kinelm_motion::synth;
use serde_json::json;
use std::path::Path;

/// Pieces of the paths that are drawn, how many of them are still ahead, and where each figure's path is from left to right.
const PROBE: &str = r"
  const pieces = time => { seek(time); draw(); return stage.things.pathCount; };
  const pale = () => {
    const c = stage.things.paths, tints = new Set();
    for (let i = 0; i < stage.things.pathCount; i++) tints.add(c[i * 11 + 8].toFixed(3));
    return tints.size;
  };
  const side = f => {
    const xs = [];
    for (let i = 0; i < f.frames; i++) { f.places(i / f.fps, f.now); xs.push(f.now[3 * f.paths[0]] + f.beside[0]); }
    return [Math.min(...xs), Math.max(...xs)];
  };
  play(false);
  const begin = pieces(0), first = pale(), middle = pieces(whole / 2), both = pale();
  draw(true);
  answer([begin, middle, first, both, stage.things.pathCount, state.follow, side(figures[0])[1] < side(figures[1])[0]]);
";

#[test]
fn paths_are_drawn_whole_in_bounded_pieces() {
    let Some(browser) = browser("paths_are_drawn_whole_in_bounded_pieces") else { return };
    let dances = synth::corpus(1, 2, 75.0, 60.0).unwrap();
    let of = |i: usize| Figure::new(dances[i].name(), &dances[i].clip).path(20);
    let figures = [of(0), of(1).path(21)];
    let page = Page::new(&figures).html().unwrap();
    // to be looked at
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("view-paths.html"), &page).unwrap();
    let found = answers(&browser, &page, PROBE);
    // 4,499 steps: every third, 1,500 pieces; two paths every fifth, 900 pieces each
    assert_eq!((&found[0], &found[1]), (&json!(1500 + 2 * 900), &json!(3300)), "{found}");
    // the passed and the coming part of both figures' colours, red alone; in a drawing without light none
    assert!(found[3].as_u64() > found[2].as_u64(), "{found}");
    assert_eq!((&found[4], &found[5], &found[6]), (&json!(0), &json!(false), &json!(true)), "{found}");
}
