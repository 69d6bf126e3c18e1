//! A study in a real browser: voted through, its votes counted.

use super::browser;
use super::probe::answers;
use kinelm::evaluate::blind::{Ask, Count, Study, StudyOptions, Votes};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::{Motion, synth};
use std::path::Path;

/// Answers every trial: the left twice, by button and by key, then goes back and changes the second to the right; the
/// third on the right.
const PROBE: &str = r"
  const seen = [], texts = () => ['progress', 'labels'].map(id => $(id).textContent);
  const look = () => { draw(); seen.push([...texts(), $('end').hidden]); };
  look();
  const answer_ = i => $('choices').children[i].click();
  answer_(0); look();
  document.dispatchEvent(new KeyboardEvent('keydown', { key: '1', bubbles: true }));
  $('back').click(); look();
  const pressed = [...$('choices').children].map(b => b.getAttribute('aria-pressed'));
  answer_(1); answer_(1); look();
  const pixels = new Uint8Array(4 * scene.canvas.width * scene.canvas.height), { gl } = scene;
  draw(); gl.readPixels(0, 0, scene.canvas.width, scene.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let kept = null;
  try { kept = localStorage.getItem(KEY); } catch { }
  answer([seen, pressed, votesText(), kept !== null || !$('note').hidden, pixels.some(v => v), gl.getError()]);
";

#[test]
fn a_study_is_voted_through_and_counted() {
    let Some(browser) = browser("a_study_is_voted_through_and_counted") else { return };
    let dir = tempfile::tempdir().unwrap();
    let folders = ["a", "b"].map(|name| dir.path().join(name));
    for (seed, folder) in folders.iter().enumerate() {
        std::fs::create_dir(folder).unwrap();
        for (i, dance) in synth::corpus(seed as u64, 3, 4.0, 30.0).unwrap().into_iter().enumerate() {
            let path = folder.join(format!("{i}.bvh"));
            format::write(&path, &Motion::new(&path, dance.clip)).unwrap();
        }
    }
    let options = StudyOptions {
        ask: Ask::Better,
        folders: folders.to_vec(),
        pairs: 20,
        seconds: 3.0,
        seed: 1,
        read: ReadOptions::default(),
    };
    let Study { page, key } = Study::make(&options).unwrap();
    // to be looked at
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("survey.html"), &page).unwrap();
    let found = answers(&browser, &page, PROBE);
    assert_eq!(found[0][0], serde_json::json!(["1 of 3", "12", true]), "{found}");
    assert_eq!(found[0][1][0], "2 of 3, 1 answered");
    assert_eq!((&found[0][2][0], &found[0][3][2]), (&"2 of 3, 2 answered".into(), &false.into()), "{found}");
    assert_eq!(found[1], serde_json::json!(["true", "false"]), "the answer that was given is shown");
    assert_eq!((&found[3], &found[4], &found[5]), (&true.into(), &true.into(), &0.into()), "{found}");
    let path = dir.path().join("votes.json");
    std::fs::write(&path, found[2].as_str().unwrap()).unwrap();
    let votes = Votes::load(&path, &key).unwrap();
    let count = Count::of(&key, &[(&path, votes)]).unwrap();
    let expected = [0, 1, 1].iter().zip(&key.trials).filter(|(side, trial)| **side == trial.left.folder).count();
    assert_eq!((count.votes, count.shares[0].votes), (3, expected));
}
