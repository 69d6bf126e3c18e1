//! The words beside the body, in a real browser.

use super::browser;
use super::probe::answers;
use kinelm::evaluate::words_page::words_page;
use kinelm_motion::{Clip, resample, synth};
use kinelm_tokenizer::{DctConfig, SchemeConfig, Tokenizer, TokenizerConfig, Words};
use serde_json::{Value, json};
use std::path::Path;

/// What a user does: points at characters, presses the body, goes on with the keys; and what playing costs.
const PROBE: &str = r"
  const panel = panels[0], spans = () => [...panel.box.querySelectorAll('span')], text = () => panel.naming.innerText;
  const lit = () => [...figures[0].selected].flatMap((on, point) => (on ? [point] : []));
  const over = i => panel.box.querySelector(`[data-at='${i}']`).dispatchEvent(new PointerEvent('pointerover', { bubbles: true }));
  play(false); seek(3.001); show();
  const now = panel.box.querySelector('.now').dataset.word, at = panel.starts[now];
  const pointed = [0, 7].map(k => { over(at + k); return [text(), lit()]; });
  panel.box.dispatchEvent(new PointerEvent('pointerleave'));
  const left = lit();
  // the middle of the left shank, where it is on the canvas
  show();
  const view = stage.seen.view, f = figures[0], p = [0, 1, 2].map(i => (f.now[12 + i] + f.now[21 + i]) / 2 + [f.shift[0], 0, f.shift[1]][i]);
  const on = i => (view[i] * p[0] + view[4 + i] * p[1] + view[8 + i] * p[2] + view[12 + i]) / (view[3] * p[0] + view[7] * p[1] + view[11] * p[2] + view[15]);
  const box = scene.canvas.getBoundingClientRect();
  const press = type => scene.canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, bubbles: true, button: 0,
    clientX: box.left + (0.5 + 0.5 * on(0)) * box.width, clientY: box.top + (0.5 - 0.5 * on(1)) * box.height }));
  press('pointerdown'); press('pointerup');
  const marked = [panel.marked, spans().filter(s => s.className.includes('marked')).map(s => s.dataset.at - at).filter(k => k >= 0 && k < panel.starts[+now + 1] - at)];
  panel.mark(-1);
  panel.focus(at);
  document.activeElement.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true, cancelable: true }));
  const right = document.activeElement.dataset.at - at;
  document.activeElement.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowDown', bubbles: true, cancelable: true }));
  const down = [Number(document.activeElement.dataset.at), panel.starts[+now + 1] + 1, Math.floor(state.time / panel.word_s + 1e-6) - now];
  document.activeElement.blur();
  // every picture of half a minute of play, in the page's own steps; the quickest of three times, as other work slows some
  const most = Math.min(whole, 30), costs = [];
  let nodes = 0;
  for (let play = 0; play < 3; play++) {
    for (let time = 0, picture = 0; time < most; time += 1 / 60, picture++) {
      const begin = performance.now();
      panel.show(time);
      costs[picture] = Math.min(costs[picture] ?? Infinity, performance.now() - begin);
      nodes = Math.max(nodes, document.getElementsByTagName('*').length);
    }
  }
  costs.sort((a, b) => a - b);
  answer({ pointed, left, marked, right, down, nodes, ms: [costs[costs.length >> 1], costs[Math.floor(costs.length * 0.99)]] });
";

fn dance(seconds: f64) -> Clip {
    let clip = synth::corpus(4, 1, seconds, 60.0).unwrap().remove(0).clip;
    resample::resample(&clip, 20.0, resample::Method::Auto).unwrap()
}

fn found(browser: &Path, tokenizer: &Tokenizer, words: &Words, name: &str) -> Value {
    let page = words_page(tokenizer, words, "a dance").unwrap();
    // to be looked at
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), &page).unwrap();
    let found = answers(browser, &page, PROBE);
    eprintln!("{name}: {} KB, {} elements, {} ms a picture", page.len() / 1000, found["nodes"], found["ms"]);
    found
}

#[test]
fn a_character_names_what_it_stands_for_and_a_joint_marks_its_characters() {
    let Some(browser) = browser("a_character_names_what_it_stands_for_and_a_joint_marks_its_characters") else {
        return;
    };
    let clip = dance(600.0);
    let tokenizer = Tokenizer::fit([&clip.slice(0..2000)], TokenizerConfig::default()).unwrap();
    let words = tokenizer.encode(&clip).unwrap().words;
    let found = found(&browser, &tokenizer, &words, "view-words.html");
    let said = found["pointed"][0][0].as_str().unwrap();
    assert!(said.starts_with("frame 60, at 0:03.0") && said.contains("translation x, step: "), "{said}");
    // slot 7 is the y of the first joint after the pelvis
    let (said, lit) = (found["pointed"][1][0].as_str().unwrap(), &found["pointed"][1][1]);
    let degrees = tokenizer.uniform().unwrap().angles().vector([words.word(60)[7]; 3]).x.to_degrees().round();
    assert!(said.contains(&format!("left_hip y: {degrees}°")) && said.contains("moves left_hip"), "{said} {degrees}");
    assert_eq!((lit, &found["left"]), (&json!([1]), &json!([])));
    // the left knee, whose characters are a run of three
    assert_eq!(found["marked"], json!([4, [15, 16, 17]]));
    assert_eq!((&found["right"], &found["down"][0], &found["down"][2]), (&json!(1), &found["down"][1], &json!(1)));
    assert!(found["nodes"].as_f64().unwrap() < 1200.0 && found["ms"][1].as_f64().unwrap() < 16.0, "{found}");
}

#[test]
fn a_run_of_zeros_names_what_it_skips_and_a_component_its_joints() {
    let Some(browser) = browser("a_run_of_zeros_names_what_it_skips_and_a_component_its_joints") else { return };
    let clip = dance(30.0);
    let scheme = SchemeConfig::Dct(DctConfig { tile: 20, keep: 0.02, ..DctConfig::default() });
    let config = TokenizerConfig { scheme, ..TokenizerConfig::default() };
    let tokenizer = Tokenizer::fit([&clip], config).unwrap();
    let words = tokenizer.encode(&clip).unwrap().words;
    let page = words_page(&tokenizer, &words, "a dance").unwrap();
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("view-words-dct.html"), &page).unwrap();
    let says = r"
      const panel = panels[0];
      play(false); seek(3.001); show();
      const all = [...panel.box.querySelector('.now').querySelectorAll('span')];
      answer(all.map(span => { panel.name(span); return panel.naming.innerText; }));
    ";
    let found = answers(&browser, &page, says);
    let said: Vec<&str> = found.as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(said.len(), words.word(3).len());
    let has =
        |parts: &[&str]| assert!(said.iter().any(|s| parts.iter().all(|part| s.contains(part))), "{parts:?}: {said:?}");
    has(&["tile 3, frames 60 to 79, from 0:03.0", " zeros: ", ", coefficients "]);
    has(&["component ", "moves ", " %", "°"]);
}
