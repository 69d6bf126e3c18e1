//! The page in a real browser: what it draws, counted in pixels by the page itself, and what its controls do.

use super::browser;
use super::probe::{opened, opened_with};
use kinelm::view::{Figure, write_page};
use kinelm_motion::{Clip, joints, resample, synth};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn self_test(browser: &Path, page: &Path) -> Value {
    let dom = opened(browser, page, "selftest&light");
    let (_, behind) =
        dom.split_once("<pre id=\"selftest\" hidden=\"\">").unwrap_or_else(|| panic!("no result in {dom}"));
    let json = behind.split("</pre>").next().unwrap().replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let result: Value = serde_json::from_str(&json).unwrap();
    assert!(result["error"].is_null(), "{result:#}");
    assert_eq!(result["gl_error"], 0, "{result:#}");
    result
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn every_control_works(result: &Value) {
    let controls = result["controls"].as_object().unwrap();
    assert_eq!(controls.len(), 12);
    for (name, works) in controls {
        assert_eq!(*works, Value::Bool(true), "{name} in {controls:#?}");
    }
}

/// The page is left in the target folder, to be looked at.
fn written(name: &str, figures: &[Figure]) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    write_page(&path, figures).unwrap();
    path
}

#[test]
fn four_dancers_are_drawn() {
    let Some(browser) = browser("four_dancers_are_drawn") else { return };
    let dances = synth::corpus(1, 4, 30.0, 60.0).unwrap();
    let arm = joints::parse("root,right_arm").unwrap().joints;
    let figures: Vec<Figure> = dances
        .iter()
        .enumerate()
        .map(|(i, d)| Figure::new(d.name(), &d.clip).given(if i == 1 { &arm } else { &[] }).note(format!("note {i}")))
        .collect();
    let page = written("view-four.html", &figures);
    let result = self_test(&browser, &page);
    eprintln!(
        "{} bytes; {} with trails {}",
        page.metadata().unwrap().len(),
        result["cost"],
        result["cost_with_trails"]
    );
    for counts in result["counts"].as_array().unwrap() {
        for own in counts["own"].as_array().unwrap() {
            assert!(number(own) > 500.0, "a figure of {own} pixels: {result:#}");
        }
        let given = number(&counts["given"]);
        assert!(given > 100.0 && given < number(&counts["own"][1]), "{given} pixels given: {result:#}");
    }
    assert!(number(&result["changed"]) > 0.02 && number(&result["unchanged"]) == 0.0, "{result:#}");
    assert_eq!(number(&result["shared_columns"]), 0.0, "side by side nobody hides another");
    assert!(number(&result["shared_columns_overlaid"]) > 50.0, "on one spot they do");
    assert_eq!(result["labels"][2], "wave_ash_01note 2");
    assert_eq!(result["legend"], true);
    every_control_works(&result);
    // a frame at 60 fps has 16.7 ms, and this machine may be much slower than a dancer's laptop
    assert!(number(&result["cost"]["script_ms"]) < 8.0, "{}", result["cost"]);
}

#[test]
fn other_rates_lengths_and_sizes_play_together() {
    let Some(browser) = browser("other_rates_lengths_and_sizes_play_together") else { return };
    let dance = synth::corpus(2, 1, 5.0, 60.0).unwrap().remove(0).clip;
    let slow = resample::resample(&dance, 20.0, resample::Method::Auto).unwrap();
    let (still, s) = (dance.slice(0..1), dance.skeleton());
    let root = dance.root().iter().map(|p| *p * 100.0).collect();
    let giant = Clip::new(s.scaled(100.0).into(), 60.0, root, dance.rotations().to_vec()).unwrap();
    let alone = self_test(&browser, &written("view-still.html", &[Figure::new("</script><b>&amp;", &still)]));
    assert_eq!((number(&alone["whole"]), &alone["labels"][0]), (0.0, &Value::from("</script><b>&amp;")));
    assert_eq!((&alone["legend"], number(&alone["changed"])), (&Value::Bool(false), 0.0));
    assert!(number(&alone["counts"][0]["own"][0]) > 2000.0, "{alone:#}");
    let figures = [Figure::new("20 fps", &slow), Figure::new("one frame", &still), Figure::new("60 fps", &dance)];
    let result = self_test(&browser, &written("view-rates.html", &figures));
    assert!((number(&result["whole"]) - 299.0 / 60.0).abs() < 1e-6, "the longest counts: {}", result["whole"]);
    every_control_works(&result);
    assert_eq!((&result["anew"], &result["legend"]), (&serde_json::json!([]), &Value::Bool(false)));
    // a quarter and the end of 4.983 s, whatever the figure's own rate is
    let marked = [Figure::new("whole", &dance), Figure::new("anew", &slow).regenerated(&[[1.0, 2.0], [4.5, 9.0]])];
    let result = self_test(&browser, &written("view-anew.html", &marked));
    let marks: Vec<f64> =
        result["anew"].as_array().unwrap().iter().flat_map(|m| m.as_array().unwrap()).map(number).collect();
    let part = |s: f64| 100.0 * s / (299.0 / 60.0);
    for (found, expected) in marks.iter().zip([part(1.0), part(1.0), part(4.5), 100.0 - part(4.5)]) {
        assert!((found - expected).abs() < 0.01, "{marks:?}");
    }
    assert_eq!((marks.len(), &result["legend"]), (4, &Value::Bool(true)));
    let result = self_test(&browser, &written("view-giant.html", &[Figure::new("in centimetres", &giant)]));
    assert!(number(&result["counts"][1]["own"][0]) > 2000.0, "{result:#}");
}

#[test]
fn without_webgl_a_sentence_and_the_download_are_left() {
    let Some(browser) = browser("without_webgl_a_sentence_and_the_download_are_left") else { return };
    let dance = synth::corpus(3, 1, 5.0, 60.0).unwrap().remove(0).clip;
    let page = written("view-plain.html", &[Figure::new("one", &dance)]);
    let dom = opened_with(&browser, &["--disable-gpu", "--disable-3d-apis"], &page, "");
    let body = dom.split_once("<body>").unwrap().1;
    assert!(body.contains("has no WebGL 2") && body.contains("download=\"one.json\""), "{body}");
    assert!(!body.contains("class=\"label\"") && !body.contains("id=\"bar\""), "{body}");
}

#[test]
fn the_address_sets_the_page_up() {
    let Some(browser) = browser("the_address_sets_the_page_up") else { return };
    let dance = synth::corpus(3, 1, 5.0, 60.0).unwrap().remove(0).clip;
    let page = written("view-one.html", &[Figure::new("one", &dance)]);
    let dom = opened(&browser, &page, "t=2.5&pause&bare&dark&trails");
    assert!(dom.contains("<b id=\"now\">0:02.5</b>"), "{dom}");
    assert!(dom.contains("class=\"bare dark\"") && dom.contains("id=\"trails\" aria-pressed=\"true\""));
    // figures of one world stand in it until they are parted
    let pair = ["a", "b"].map(|name| Figure::new(name, &dance).in_world(Some(0)));
    let page = written("view-world.html", &pair);
    let onto = |fragment: &str| opened(&browser, &page, fragment).contains("id=\"overlay\" aria-pressed=\"true\"");
    assert!(onto("pause") && !onto("pause&beside"));
}
