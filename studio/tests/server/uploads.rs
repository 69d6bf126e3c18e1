//! Files that are dropped in: good ones, doubtful ones, and those that are made to do harm.

use super::client::Browser;
use super::place::{Place, bytes, dance, reader};
use kinelm_motion::Clip;
use kinelm_studio::Limits;
use serde_json::{Value, json};
use std::fs;

/// The timeline, which begins with the first clip.
fn timeline(browser: &Browser) -> Value {
    let text = || browser.get("/api/timeline").json();
    browser.wait("the timeline", |_| text()["segments"] != json!([]));
    text()
}

#[test]
fn a_clip_is_read_shown_renamed_and_removed() {
    let place = Place::new();
    let browser = &place.browser;
    let id = browser.upload("salsa.bvh", &bytes("a.bvh", &dance(1, 4.0, 60.0)));
    let clip = browser.wait_clip(&id);
    assert_eq!(
        (clip["state"].as_str(), clip["name"].as_str(), clip["rig"].as_str()),
        (Some("ready"), Some("salsa"), Some("smpl"))
    );
    assert_eq!((clip["seconds"].as_f64(), clip["fps"].as_f64(), &clip["doubts"]), (Some(4.0), Some(60.0), &json!([])));
    let figure = browser.get(&format!("/api/clips/{id}/figure")).json();
    assert_eq!((figure["frames"].as_u64(), figure["points"].as_u64()), (Some(240), Some(30)), "with end sites");
    let joints = figure["joints"].as_array().unwrap();
    assert!(joints.iter().any(|joint| joint["label"] == "right_elbow" && joint["group"] == "right_arm"), "{joints:?}");
    assert_eq!(figure["data"].as_str().unwrap().len(), 240 * 30 * 6 * 4 / 3);
    let small = browser.get(&format!("/api/clips/{id}/figure?fps=10&seconds=2")).json();
    assert_eq!((small["frames"].as_u64(), small["fps"].as_f64()), (Some(20), Some(10.0)));
    for wrong in ["fps=0", "fps=x", "seconds=-1", "seconds=NaN", "path=x"] {
        assert_eq!(browser.get(&format!("/api/clips/{id}/figure?{wrong}")).status, 400, "{wrong}");
    }
    browser.done(&format!("/api/clips/{id}/rename"), &json!({ "name": "a/b" }));
    assert_eq!(browser.state()["clips"][0]["name"], "a_b");
    browser.done(&format!("/api/clips/{id}/remove"), &json!({}));
    assert_eq!(browser.state()["clips"], json!([]));
    assert_eq!(browser.get(&format!("/api/clips/{id}/figure")).status, 404);
    browser.done("/api/undo", &json!({}));
    assert_eq!(browser.wait_clip(&id)["name"], "a_b");
}

#[test]
fn a_doubt_is_settled_by_its_button() {
    let place = Place::new();
    let root = (0..240).map(|f| kinelm_motion::Vec3::Y * (30.0 - 4.9 * (f as f64 / 60.0).powi(2))).collect();
    let dance = dance(1, 4.0, 60.0);
    let falls = Clip::new(dance.skeleton().clone(), 240.0, root, dance.rotations().to_vec()).unwrap();
    let id = place.browser.upload("fast.bvh", &bytes("a.bvh", &falls));
    let clip = place.browser.wait_clip(&id);
    timeline(&place.browser);
    let doubt =
        clip["doubts"].as_array().unwrap().iter().find(|doubt| doubt["kind"] == "rate_doubted").unwrap().clone();
    assert_eq!(doubt["fix"]["label"], "Play it at 60 fps");
    place.browser.done(&format!("/api/clips/{id}/reading"), &doubt["fix"]["body"]);
    let clip = place.browser.wait("the clip", |state| state["clips"][0]["fps"] == 60.0)["clips"][0].clone();
    assert!(clip["doubts"].as_array().unwrap().iter().all(|doubt| doubt["kind"] != "rate_doubted"));
    // the timeline that began with it states the same, and one step takes both back
    let text = place.browser.get("/api/timeline").json()["text"].as_str().unwrap().to_owned();
    assert!(text.contains("fps_source = 60"), "{text}");
    // all of the clip, which lasts longer now
    let segment = place.browser.get("/api/timeline").json()["segments"][0].clone();
    assert_eq!(segment["to"].as_f64(), clip["seconds"].as_f64(), "{text}");
    // what can't be isn't
    let wrong = place.browser.post(&format!("/api/clips/{id}/reading"), &json!({ "root": "nobody" }));
    assert!(wrong.status == 409 && wrong.error().contains("stays as it was"), "{wrong:?}");
    place.browser.done("/api/undo", &json!({}));
    place.browser.wait("the clip", |state| state["clips"][0]["fps"] == 240.0);
    assert!(!fs::read_to_string(place.project().join("timeline.toml")).unwrap().contains("fps_source"));
}

#[test]
fn an_fbx_becomes_a_bvh_in_a_process_of_its_own() {
    let place = Place::new();
    let golden =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/motion/tests/golden/blender_dance.fbx");
    let id = place.browser.upload("dance.fbx", &fs::read(golden).unwrap());
    let clip = place.browser.wait_clip(&id);
    assert_eq!(
        (clip["state"].as_str(), clip["format"].as_str(), clip["frames"].as_u64()),
        (Some("ready"), Some("FBX"), Some(16))
    );
    assert!(place.project().join(format!("converted/{id}.bvh")).exists());
    assert_eq!(place.browser.get(&format!("/api/clips/{id}/figure")).json()["frames"], 16);
    let view = timeline(&place.browser);
    assert_eq!((&view["trouble"], &view["segments"][0]["clip"]), (&json!([]), &json!("dance")));
}

#[test]
fn a_reader_that_crashes_or_hangs_is_an_error_of_one_file() {
    for (what, expected) in [("crash", "its reader ended"), ("hang", "takes longer than 1 seconds")] {
        let limits = Limits { seconds: 1, ..Limits::default() };
        let place = Place::with(|options| options.reader = kinelm_studio::Reader { limits, ..reader(what) });
        let id = place.browser.upload("evil.fbx", b"Kaydara FBX Binary");
        let clip = place.browser.wait_clip(&id);
        let error = clip["error"].as_str().unwrap();
        assert!(clip["state"] == "failed" && error.contains("evil.fbx") && error.contains(expected), "{what}: {error}");
        assert_eq!(place.browser.get("/api/state").status, 200);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_file_that_takes_all_memory_is_an_error_of_one_file() {
    let limits = Limits { memory: 300 << 20, ..Limits::default() };
    let place = Place::with(|options| options.reader = kinelm_studio::Reader { limits, ..reader("read") });
    let good = place.browser.upload("good.bvh", &bytes("a.bvh", &dance(1, 2.0, 30.0)));
    assert_eq!(place.browser.wait_clip(&good)["state"], "ready");
    // three million frames of one joint, which take a byte each in the file
    let mut text =
        b"HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 3 Xrotation Yrotation Zrotation End Site { OFFSET 0 1 0 } }\n\
                     MOTION\nFrames: 3000000\nFrame Time: 0.01\n"
            .to_vec();
    text.extend(b"0 0 0\n".repeat(3_000_000));
    let id = place.browser.upload("large.bvh", &text);
    let clip = place.browser.wait_clip(&id);
    assert!(clip["state"] == "failed" && clip["error"].as_str().unwrap().contains("large.bvh"), "{clip}");
    assert_eq!(place.browser.wait_clip(&good)["state"], "ready");
}

#[test]
fn other_files_are_refused_with_words() {
    let place = Place::new();
    for name in ["a.exe", "a", "timeline.toml", "x.html", ""] {
        let answer = place.browser.post_bytes(&format!("/api/clips?name={name}"), b"x");
        assert!(answer.status == 422 && answer.error().contains("motion (.bvh"), "{name}: {answer:?}");
    }
    assert_eq!(place.browser.post_bytes("/api/clips", b"x").status, 422);
    assert_eq!(place.browser.post_bytes("/api/clips?name=a.bvh", b"").status, 422);
    assert_eq!(fs::read_dir(place.project().join("clips")).unwrap().count(), 0);
}

#[test]
fn an_amc_waits_for_its_skeleton() {
    let place = Place::new();
    let id = place.browser.upload("07_01.amc", b":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 0 0 0 0 0\n");
    let clip = place.browser.wait_clip(&id);
    assert!(clip["error"].as_str().unwrap().contains("skeleton"), "{clip}");
    let asf = ":version 1.10\n:name a\n:units\n mass 1.0\n length 1.0\n angle deg\n:root\n order TX TY TZ RX RY RZ\n axis XYZ\n\
               position 0 0 0\n orientation 0 0 0\n:bonedata\n:hierarchy\nbegin\nend\n";
    let answer = place.browser.post_bytes("/api/clips?name=07.asf", asf.as_bytes());
    assert_eq!((answer.status, &answer.json()["id"]), (200, &json!(null)));
    // it is read again: what is wrong now is the file itself, or nothing
    let state = place.browser.wait("the clip", |state| {
        let clip = &state["clips"][0];
        clip["state"] != "reading" && !clip["error"].as_str().unwrap_or_default().contains("skeleton beside")
    });
    assert_eq!(state["clips"].as_array().unwrap().len(), 1);
}

#[test]
fn music_has_beats_and_ranges() {
    let place = Place::new();
    let score = kinelm_music::synth::Score {
        style: kinelm_music::synth::Style::Pop,
        beats_s: (0..20).map(|i| 0.5 * f64::from(i)).collect(),
        downbeat: 0,
        seconds: 10.0,
        seed: 1,
    };
    let rate = kinelm_music::beat::RATE;
    let samples = kinelm_music::synth::render(&score, rate).unwrap();
    let wav = kinelm_music::wav::bytes(&samples, rate);
    let id = place.browser.upload("song.wav", &wav);
    let clip = place.browser.wait_clip(&id);
    assert_eq!((clip["music"].as_bool(), clip["state"].as_str()), (Some(true), Some("ready")));
    assert!(clip["beats"].as_array().unwrap().len() > 10, "{clip}");
    let all = place.browser.get(&format!("/api/clips/{id}/sound"));
    assert_eq!((all.status, all.body.len(), all.header("content-type")), (200, wav.len(), Some("audio/wav")));
    let head = format!("{}Range: bytes=10-19\r\n\r\n", place.browser.head("GET", &format!("/api/clips/{id}/sound")));
    let part = super::client::send(place.browser.port, head.as_bytes()).unwrap();
    assert_eq!((part.status, &part.body[..]), (206, &wav[10..20]));
    place.browser.done("/api/music", &json!({ "clip": id, "from_s": 1.5 }));
    assert_eq!(place.browser.state()["music"], json!({ "clip": id, "from_s": 1.5 }));
    let make = place.browser.done("/api/make", &json!({ "kind": "free", "seconds": 1, "music": id }));
    let job = place.browser.wait_job(make["job"].as_str().unwrap());
    assert!(job["state"] == "failed" && job["text"].as_str().unwrap().contains("music"), "{job}");
    let place = place.again();
    assert_eq!(place.browser.state()["music"]["from_s"], 1.5);
}

#[test]
fn files_of_the_call_stay_where_they_are() {
    let own = tempfile::tempdir().unwrap();
    for (name, seed) in [("a.bvh", 1), ("b.bvh", 2)] {
        fs::write(own.path().join(name), bytes(name, &dance(seed, 3.0, 60.0))).unwrap();
    }
    let folder = own.path().to_owned();
    let place = Place::with(move |options| options.files = vec![folder.clone()]);
    let state =
        place.browser.wait("both", |state| state["clips"].as_array().unwrap().iter().all(|c| c["state"] == "ready"));
    assert_eq!((state["clips"].as_array().unwrap().len(), state["clips"][0]["name"].as_str()), (2, Some("a")));
    assert!(!place.browser.get("/api/state").text().contains(own.path().to_str().unwrap()));
    assert_eq!(fs::read_dir(place.project().join("clips")).unwrap().count(), 0);
    let looked = json!({ "clip": state["clips"][0]["id"], "from_s": 0.2, "to_s": 2.2, "k": 2 });
    let matches = place.browser.done("/api/search", &looked)["matches"].as_array().unwrap().clone();
    assert_eq!(matches[0]["clip"], state["clips"][1]["id"], "{matches:?}");

    // one beside itself, and the page of both to be saved
    let id = |n: usize| state["clips"][n]["id"].as_str().unwrap();
    let compared = place.browser.done("/api/compare", &json!({ "teacher": id(0), "student": id(0) }));
    assert_eq!(compared["facts"][0], json!(["distance", "0.0 cm"]));
    assert_eq!(compared["facts"][1], json!(["lag", "none"]));
    let page = place.browser.get(&format!("/api/compare/{}/{}", id(0), id(1)));
    assert!(page.text().contains("<title>a, b</title>") && page.text().contains("Farthest apart"));
    assert_eq!(page.header("content-disposition"), Some("attachment; filename*=UTF-8''b%20beside%20a.html"));
    assert_eq!(place.browser.get(&format!("/api/compare/{}/none", id(0))).status, 404);
}
