//! The panels beside the dancers, in a real browser.

use super::browser;
use super::probe::answers;
use kinelm::view::panel::{Bands, Choice, Facts, Lines, Moment, Moments, Panel, Strip, Track};
use kinelm::view::{Figure, Page};
use kinelm_motion::synth;
use serde_json::json;
use std::path::Path;

/// What a user does and sees: the playhead, the values at it, a press on a curve, a moment's button, a menu.
const PROBE: &str = r"
  const panel = i => document.querySelectorAll('#panels > *')[i], values = i => panel(i).querySelector('.values').textContent;
  const head = i => new DOMMatrix(panel(i).querySelector('.playhead').style.transform).m41;
  play(false); seek(0); show();
  const begin = [head(0), values(0)];
  seek(whole); show();
  const end = [head(0), values(0)];
  const canvas = panel(0).querySelector('canvas').getBoundingClientRect();
  const press = x => panel(0).querySelector('.over-time').dispatchEvent(new PointerEvent('pointerdown',
    { clientX: x, clientY: canvas.top + 20, pointerId: 1, bubbles: true }));
  try { press((canvas.left + 52 + canvas.right - 10) / 2); } catch (e) { /* no such pointer to capture */ }
  const pressed = state.time / whole;
  panel(3).querySelectorAll('button')[1].click();
  const jumped = state.time;
  const menu = panel(5).querySelector('select'), chosen = () => panel(5).querySelectorAll('h2').length && panel(5).querySelector('h2').textContent;
  const first = chosen();
  menu.value = 1; menu.onchange();
  const painted = i => { const c = panel(i).querySelector('canvas'); return c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(v => v); };
  answer([begin, end, pressed, jumped, first, chosen(), [0, 1, 2].map(painted), panel(4).textContent, scene.canvas.clientWidth < window.innerWidth]);
";

#[test]
fn panels_show_the_pages_time_and_seek() {
    let Some(browser) = browser("panels_show_the_pages_time_and_seek") else { return };
    let dances = synth::corpus(1, 2, 20.0, 60.0).unwrap();
    let figures: Vec<Figure> = dances.iter().map(|d| Figure::new(d.name(), &d.clip)).collect();
    let track = |name: &str, figure, value: &dyn Fn(f64) -> f64| Track {
        name: name.into(),
        figure,
        fps: 30.0,
        from_s: 0.0,
        values: (0..600).map(|i| value(f64::from(i) / 30.0)).collect(),
    };
    let lines = |title: &str| {
        let gap = |t: f64| if (6.0..8.0).contains(&t) { f64::NAN } else { 1.0 + (0.8 * t).cos() };
        let tracks = vec![track("made", Some(0), &|t| t / 10.0), track("real", Some(1), &gap)];
        Panel::Lines(Lines { title: title.into(), unit: "m/s".into(), tracks })
    };
    let bands = |n: u32| {
        let wave = |k: u32| track(&format!("row {k}"), None, &|t| (t * f64::from(k + 1)).sin());
        let (title, unit) = (format!("Bands of {n}"), "rad/s".into());
        Panel::Bands(Bands { title, unit, tracks: (0..n).map(wave).collect(), range: None })
    };
    let moment = |label: &str, at_s| Moment { label: label.into(), at_s, figure: Some(0) };
    let moments = vec![moment("the longest freeze", 2.5), moment("off balance <b>", 12.25)];
    let panels = [
        lines("Speed"),
        bands(3),
        Panel::Strip(Strip { title: "Made".into(), figure: 0, every_s: 0.5 }),
        Panel::Moments(Moments { title: "Moments".into(), moments }),
        Panel::Facts(Facts {
            title: "Ways".into(),
            head: ["dance", "length, m"].map(String::from).to_vec(),
            rows: vec![["made", "12.4"].map(String::from).to_vec(), ["real", "9.1"].map(String::from).to_vec()],
        }),
        Panel::Choice(Choice {
            title: "Joint".into(),
            options: vec![("pelvis".into(), vec![bands(30)]), ("head".into(), vec![lines("Head"), bands(2)])],
        }),
    ];
    let page = Page::new(&figures).panels(&panels).html().unwrap();
    // to be looked at
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("view-panels.html"), &page).unwrap();
    let found = answers(&browser, &page, PROBE);
    let (begin, end) = (&found[0], &found[1]);
    assert!(begin[0] == 52.0 && end[0].as_f64().unwrap() > 200.0, "{found}");
    assert_eq!([&begin[1], &end[1]], ["made 0real 2", "made 2real 0.0426"]);
    assert!((found[2].as_f64().unwrap() - 0.5).abs() < 0.01, "{found}");
    assert_eq!(found[3], 12.25);
    assert_eq!([&found[4], &found[5]], ["Bands of 30, rad/s", "Head, m/s"]);
    assert_eq!(found[6], json!([true, true, true]));
    assert_eq!((&found[7], &found[8]), (&json!("Waysdancelength, mmade12.4real9.1"), &json!(true)));
}
