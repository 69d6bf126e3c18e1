//! Dances: made, streamed, chosen, kept, exported; the timeline and steps back.

use super::client::Browser;
use super::place::{Place, bytes, dance};
use kinelm_motion::format::{self, Format, Importer, ReadOptions};
use kinelm_motion::retarget::Retarget;
use kinelm_motion::rig::{Humanoid, SkeletonMap, map_for};
use kinelm_motion::{Clip, Skeleton, smpl};
use serde_json::{Value, json};
use std::fs;
use std::sync::Arc;

/// A place with a dance in its library.
fn with_a_clip(seconds: f64) -> (Place, String) {
    let place = Place::new();
    let id = place.browser.upload("mine.bvh", &bytes("a.bvh", &dance(1, seconds, 60.0)));
    place.browser.wait("the timeline", |_| place.browser.get("/api/timeline").json()["segments"] != json!([]));
    (place, id)
}

/// Makes something, which must succeed: its dances. Where the request names no seed it is 1, since what an untrained model
/// invents from a seed of chance may miss a bound once in some hundred runs.
fn made(browser: &Browser, make: &Value) -> Vec<Value> {
    let mut request = json!({ "seed": 1 });
    request.as_object_mut().unwrap().extend(make.as_object().unwrap().clone());
    let job = browser.done("/api/make", &request)["job"].as_str().unwrap().to_owned();
    let ended = browser.wait_job(&job);
    assert_eq!(ended["state"], "done", "{make}: {ended}");
    let state = browser.state();
    let own = |dance: &&Value| dance["job"] == job.as_str();
    let dances: Vec<Value> = state["dances"].as_array().unwrap().iter().filter(own).cloned().collect();
    let ids: Vec<&Value> = dances.iter().map(|dance| &dance["id"]).collect();
    assert_eq!(ids, ended["dances"].as_array().unwrap().iter().collect::<Vec<_>>());
    dances
}

#[test]
fn every_kind_of_dance_is_made_and_the_rest_of_a_clip_stays() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    let free = made(browser, &json!({ "kind": "free", "seconds": 2, "seed": 5, "variations": 2 }));
    assert_eq!((free.len(), free[0]["frames"].as_u64(), free[0]["fps"].as_f64()), (2, Some(60), Some(30.0)));
    assert_eq!((free[0]["seed"].as_u64(), free[0]["name"].as_str()), (Some(5), Some("free dance 1")));
    // the same again
    let again = made(browser, &json!({ "kind": "free", "seconds": 2, "seed": 5, "variations": 2 }));
    let file = |dance: &Value| {
        fs::read(place.project().join(format!(".studio/made/{}.bvh", dance["id"].as_str().unwrap()))).unwrap()
    };
    assert!(file(&free[1]) == file(&again[1]) && file(&free[0]) != file(&free[1]));

    let edit = &made(browser, &json!({ "kind": "edit", "clip": clip, "free": ["left_arm@1s:2s"], "seed": 3 }))[0];
    assert_eq!((edit["generated_s"].clone(), edit["source"].as_str()), (json!([[1.0, 2.0]]), Some(&*clip)));
    assert_eq!(edit["free"], "left_arm@1s:2s");
    let path = place.project().join(format!(".studio/made/{}.bvh", edit["id"].as_str().unwrap()));
    let [own, other] = [place.project().join("clips/mine.bvh"), path].map(|path| fs::read_to_string(path).unwrap());
    let differ: Vec<usize> =
        own.lines().zip(other.lines()).enumerate().filter(|(_, (a, b))| a != b).map(|(n, _)| n).collect();
    let first = own.lines().position(|line| line.starts_with("Frame Time")).unwrap() + 1;
    assert!(
        differ.first() >= Some(&(first + 60)) && differ.last() < Some(&(first + 120)) && differ.len() > 40,
        "{differ:?}"
    );
    let figure = browser.get(&format!("/api/dances/{}/figure", edit["id"].as_str().unwrap())).json();
    let points = figure["made"][0]["points"].as_array().unwrap();
    let shown = |point: &Value| figure["joints"][point.as_u64().unwrap() as usize]["name"].as_str().unwrap();
    let shown: Vec<&str> = points.iter().map(shown).collect();
    assert!(shown.contains(&"left_elbow") && !shown.contains(&"right_elbow"), "{shown:?}");
    assert_eq!(figure["anew"], json!([[1.0, 2.0]]));

    let given = &made(browser, &json!({ "kind": "given", "clip": clip, "joints": "root,right_arm", "labels": {} }))[0];
    assert_eq!((given["given"].as_str(), given["name"].as_str()), (Some("root,right_arm"), Some("mine followed")));
    assert_eq!((given["fps"].as_f64(), given["frames"].as_u64()), (Some(60.0), Some(300)));
    let looped = &made(browser, &json!({ "kind": "loop", "clip": clip, "loop": "pose", "loop_over": 1 }))[0];
    assert_eq!(looped["frames"].as_u64(), Some(300));
    browser.done("/api/timeline", &json!({ "edits": [{ "op": "free", "joints": "arms", "from": 1, "to": 3 }] }));
    let danced = &made(browser, &json!({ "kind": "timeline", "variations": 2 }))[1];
    assert_eq!(
        (danced["source"].as_str(), danced["fps"].as_f64(), danced["variation"].as_u64()),
        (Some(&*clip), Some(60.0), Some(2))
    );
    // a dance is a clip of the next
    let next = &made(browser, &json!({ "kind": "edit", "clip": edit["id"], "free": ["right_arm"] }))[0];
    assert_eq!(next["source"], edit["id"]);
}

/// A dance of another body, whose floor is above y = 0, at 48 frames a second.
fn on_a_platform() -> Clip {
    let body = smpl::neutral();
    let map = SkeletonMap::builtin("mixamo").unwrap();
    let names = (0..24).map(|id| map.joint(id).unwrap().to_owned()).collect();
    let offsets = body.offsets().iter().map(|offset| *offset * 1.1).collect();
    let rig = Arc::new(Skeleton::new(names, body.parents().to_vec(), offsets, vec![]).unwrap());
    let way = Retarget::new(&Humanoid::with_map(&rig, &map_for(&rig, None).unwrap()), body).unwrap();
    way.to_rig(&dance(1, 3.0, 48.0)).unwrap().raised(0.5)
}

#[test]
fn new_dances_are_on_the_rig_of_a_clip_at_its_rate_and_on_y_0() {
    let place = Place::new();
    let browser = &place.browser;
    let clip = browser.upload("mine.bvh", &bytes("a.bvh", &on_a_platform()));
    browser.wait("the clip", |state| state["clips"][0]["state"] == "ready");
    let mine = format::read(&place.project().join("clips/mine.bvh"), &ReadOptions::default()).unwrap().clip;
    let floor = |clip: &Clip| {
        let map = map_for(clip.skeleton(), None).unwrap();
        Humanoid::with_map(clip.skeleton(), &map).floor(clip).unwrap().height_m
    };
    let of = |make: &Value| {
        let dance = made(browser, make).remove(0);
        let id = dance["id"].as_str().unwrap().to_owned();
        let path = place.project().join(format!(".studio/made/{id}.bvh"));
        let sidecar: Value =
            serde_json::from_slice(&fs::read(format!("{}.kinelm.json", path.display())).unwrap()).unwrap();
        let low = browser.get(&format!("/api/dances/{id}/figure")).json()["low"][1].as_f64().unwrap();
        (dance, format::read(&path, &ReadOptions::default()).unwrap().clip, sidecar, low)
    };
    for (make, fps, frames, floor_m) in [
        (json!({ "kind": "free", "clip": clip, "seconds": 2, "seed": 1 }), 48.0, 96, 0.0),
        (json!({ "kind": "free", "clip": clip, "seconds": 2, "seed": 1, "fps": 25 }), 25.0, 50, 0.0),
        (json!({ "kind": "given", "clip": clip, "joints": "root,torso,right_arm" }), 48.0, 144, 0.0),
        (json!({ "kind": "edit", "clip": clip, "free": ["left_arm"] }), 48.0, 144, 0.5),
        (json!({ "kind": "loop", "clip": clip, "loop_over": 1 }), 48.0, 144, 0.5),
    ] {
        let (dance, found, sidecar, low) = of(&make);
        assert_eq!((found.fps(), found.frames()), (fps, frames), "{make}");
        assert_eq!(found.skeleton().names(), mine.skeleton().names(), "{make}");
        assert!((floor(&found) - floor_m).abs() < 0.05, "{make}: the floor is at {}", floor(&found));
        assert!((sidecar["read"]["floor"].as_f64().unwrap() - floor_m).abs() < 0.05, "{make}");
        let (source, rig) = (dance["source"].as_str(), dance["rig"].as_str());
        let is_new = make["kind"] == "free";
        // what an untrained model invents may reach below its feet; a floor that stays at 0.5 m is the fault
        assert!(is_new || low.abs() < 0.2, "{make}: on the stage its lowest point is at {low}");
        assert_eq!((source, rig), if is_new { (None, Some(&*clip)) } else { (Some(&*clip), None) }, "{make}");
    }
    let (dance, found, ..) = of(&json!({ "kind": "free", "seconds": 2 }));
    assert_eq!((found.fps(), found.skeleton().names()[1].as_str(), &dance["rig"]), (30.0, "left_hip", &Value::Null));
    assert_eq!(browser.state()["model"]["new_fps"], 30.0);
}

#[test]
fn the_best_of_several_are_chosen_with_scores() {
    let place = Place::new();
    let best = made(&place.browser, &json!({ "kind": "free", "seconds": 2, "variations": 2, "best": 4 }));
    let ranks: Vec<&Value> = best.iter().map(|dance| &dance["rank"]).collect();
    assert_eq!(ranks, [&json!([1, 4]), &json!([2, 4])]);
    assert!(best[0]["score"].is_f64() && best[0]["verdict"].as_str().unwrap().starts_with("score"));
    assert!(best[0]["note"].as_str().unwrap().contains("compared with the dances that the model was trained on"));
}

#[test]
fn what_cannot_be_made_says_why() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    for (make, expected) in [
        (json!({ "kind": "edit", "clip": clip }), "say which joints are free"),
        (json!({ "kind": "edit", "clip": "c99", "free": ["left_arm"] }), "no clip c99"),
        (json!({ "kind": "edit", "clip": clip, "free": ["left_arm@9s:10s"] }), "lies outside the clip"),
        (json!({ "kind": "given", "clip": clip, "joints": "wings" }), "wings"),
        (json!({ "kind": "free", "labels": { "genre": "salsa" } }), "labels"),
        (json!({ "kind": "free", "guidance": 2 }), "guidance"),
    ] {
        let job = browser.done("/api/make", &make)["job"].as_str().unwrap().to_owned();
        let ended = browser.wait_job(&job);
        let text = ended["text"].as_str().unwrap_or_default();
        assert!(ended["state"] == "failed" && text.contains(expected), "{make}: {ended}");
    }
    assert_eq!(browser.post("/api/make", &json!({ "kind": "free", "variations": 100 })).status, 400);
    assert_eq!(browser.state()["dances"], json!([]));
}

#[test]
fn frames_are_streamed_as_they_are_sampled_and_a_page_hears_what_it_missed() {
    let (place, clip) = with_a_clip(40.0);
    let mut events = place.browser.events(None);
    let hello = events.next();
    assert_eq!((hello.name.as_str(), &hello.data["resumed"]), ("hello", &json!(false)));
    let make = json!({ "kind": "edit", "clip": clip, "free": ["right_arm"], "variations": 4 });
    let job = place.browser.done("/api/make", &make)["job"].as_str().unwrap().to_owned();
    let (mut frames, mut dances, mut last) = (vec![0; 4], 0, 0);
    while dances < 4 {
        let event = events.next();
        assert!(event.id > last || event.name == "hello", "numbers grow");
        last = event.id;
        match event.name.as_str() {
            "frames" => {
                assert_eq!((event.data["job"].as_str(), dances), (Some(&*job), 0));
                let variation = event.data["variation"].as_u64().unwrap() as usize - 1;
                let from = event.data["from"].as_u64().unwrap() as usize;
                // all again where a dance leaves the box of its numbers
                assert!(from == frames[variation] || from == 0, "{from} of {frames:?}");
                assert_eq!(event.data.get("figure_head").is_some(), from == 0);
                let points = 25;
                let bytes = event.data["data"].as_str().unwrap().len() / 4 * 3;
                frames[variation] = from + bytes / (points * 6);
            }
            "dance" => dances += 1,
            _ => {}
        }
    }
    assert!(frames.iter().all(|frames| *frames > 10), "{frames:?}");
    // from an event on, those after it
    let mut again = place.browser.events(Some(hello.id));
    assert_eq!(again.next().data["resumed"], true);
    let (first, same) = (again.next(), events.named("job"));
    assert!(first.id == hello.id + 1 && same.data["state"] == "done");
    // a page that opens while dances are sampled asks for their frames from the first
    let since = place.browser.state()["jobs"].as_array().unwrap().last().unwrap()["since"].as_u64().unwrap();
    let late = place.browser.get(&format!("/api/frames?since={since}")).json();
    let (first, last) = (&late["events"][0], late["last"].as_u64().unwrap());
    assert!(first["data"]["from"] == 0 && first["data"]["figure_head"].is_object(), "{first}");
    let sent = late["events"].as_array().unwrap();
    assert!(sent.iter().all(|event| event["data"]["data"].is_string() && event["id"].as_u64().unwrap() <= last));
    assert_eq!(place.browser.get("/api/frames?since=7").json()["events"].as_array().unwrap().len(), sent.len());
    assert_eq!(place.browser.get(&format!("/api/frames?since={last}")).json(), json!({ "last": last, "events": [] }));
    assert_eq!(place.browser.get("/api/frames?since=x").status, 400);
    // a number of another server: load the state again
    assert_eq!(place.browser.events(Some(7)).next().data["resumed"], false);
}

#[test]
fn a_job_is_cancelled_at_once() {
    let place = Place::new();
    let browser = &place.browser;
    let mut events = browser.events(None);
    let job = browser.done("/api/make", &json!({ "kind": "free", "seconds": 600 }))["job"].as_str().unwrap().to_owned();
    let waits = browser.done("/api/make", &json!({ "kind": "free", "seconds": 1 }))["job"].as_str().unwrap().to_owned();
    events.named("frames");
    browser.done(&format!("/api/jobs/{job}/cancel"), &json!({}));
    let of = |state: &Value, id: &str| {
        state["jobs"].as_array().unwrap().iter().find(|j| j["id"] == id).unwrap()["state"].clone()
    };
    assert_eq!(of(&browser.state(), &job), "cancelled");
    assert_eq!(browser.wait_job(&waits)["state"], "done");
    assert_eq!(browser.state()["dances"].as_array().unwrap().len(), 1, "nothing of it is there");
    assert_eq!(browser.post(&format!("/api/jobs/{job}/cancel"), &json!({})).status, 409);
}

#[test]
fn all_steps_can_be_taken_back_and_done_again() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    browser.done("/api/timeline", &json!({ "edits": [{ "op": "free", "joints": "arms", "from": 1, "to": 3 }] }));
    let dances = made(browser, &json!({ "kind": "timeline", "variations": 2 }));
    assert_eq!(dances[0]["name"], "mine anew 1");
    browser.done(&format!("/api/dances/{}/keep", dances[0]["id"].as_str().unwrap()), &json!({}));
    let text = browser.get("/api/timeline").json()["text"].clone();
    let steps = browser.state()["undo"]["undo"].as_u64().unwrap();
    for _ in 0..steps {
        browser.done("/api/undo", &json!({}));
    }
    assert_eq!(browser.state()["clips"], json!([]));
    for n in 0..steps {
        browser.done("/api/redo", &json!({}));
        // the clip is read again, and begins no timeline of its own
        browser.wait("the clip", |state| state["clips"][0]["state"] == "ready");
        assert_eq!(browser.state()["undo"]["redo"].as_u64(), Some(steps - n - 1));
    }
    assert_eq!(browser.get("/api/timeline").json()["text"], text);
    assert!(browser.state()["dances"].as_array().unwrap().iter().any(|dance| dance["kept"] == true));
    assert!(place.project().join("dances/mine anew 1.bvh").exists());
    let again = made(browser, &json!({ "kind": "timeline", "variations": 2 }));
    let kept = browser.done(&format!("/api/dances/{}/keep", again[0]["id"].as_str().unwrap()), &json!({}));
    assert_eq!((kept["name"].as_str(), kept["source"].as_str()), (Some("mine anew 1-2"), Some(&*clip)));
}

#[test]
fn a_dance_is_kept_taken_back_and_rejected() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    let make = json!({ "kind": "edit", "clip": clip, "free": ["right_arm"], "variations": 2 });
    let dances = made(browser, &make);
    let id = dances[0]["id"].as_str().unwrap();
    let kept = browser.done(&format!("/api/dances/{id}/keep"), &json!({ "name": "../my arm" }));
    assert_eq!((kept["kept"].as_bool(), kept["kept_name"].as_str()), (Some(true), Some("_my arm.bvh")));
    let file = place.project().join("dances/_my arm.bvh");
    assert!(kinelm_store::sidecar::has_hash_of(&file).unwrap());
    let bytes = fs::read(&file).unwrap();
    assert_eq!(browser.post(&format!("/api/dances/{id}/reject"), &json!({})).status, 409);
    let undone = browser.done("/api/undo", &json!({}));
    assert_eq!((undone["redo_name"].as_str(), file.exists()), (Some("keep _my arm"), false));
    browser.done("/api/redo", &json!({}));
    assert!(fs::read(&file).unwrap() == bytes);
    // a file that the user changed isn't removed by a step back
    fs::write(&file, "mine now").unwrap();
    browser.done("/api/undo", &json!({}));
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine now");
    fs::remove_file(&file).unwrap();
    fs::remove_file(kinelm_store::sidecar::path_of(&file)).unwrap();

    let other = dances[1]["id"].as_str().unwrap();
    browser.done(&format!("/api/dances/{other}/reject"), &json!({}));
    let rejected = |state: &Value| state["dances"][1]["rejected"].as_bool().unwrap();
    assert!(rejected(&browser.state()));
    browser.done(&format!("/api/dances/{other}/reject"), &json!({ "back": true }));
    assert!(!rejected(&browser.state()));
    browser.done("/api/undo", &json!({}));
    assert!(rejected(&browser.state()));
    // two of one name
    browser.done(&format!("/api/dances/{id}/keep"), &json!({ "name": "two" }));
    let again = made(browser, &make);
    let kept =
        browser.done(&format!("/api/dances/{}/keep", again[0]["id"].as_str().unwrap()), &json!({ "name": "two" }));
    assert_eq!(kept["kept_name"], "two-2.bvh");
    // it is there after a restart, with the steps
    let place = place.again();
    let state = place.browser.state();
    assert_eq!(state["dances"].as_array().unwrap().iter().filter(|dance| dance["kept"] == true).count(), 2);
    assert!(place.project().join("dances/two.bvh").exists());
    place.browser.done("/api/undo", &json!({}));
    assert!(!place.project().join("dances/two-2.bvh").exists());
}

#[test]
fn exports_hold_the_dance() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    let id = made(browser, &json!({ "kind": "edit", "clip": clip, "free": ["right_arm@1s:2s"] }))[0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    for format in ["bvh", "glb", "vrma", "npz", "json"] {
        let answer = browser.get(&format!("/api/dances/{id}/export?format={format}"));
        assert_eq!(answer.status, 200, "{format}: {}", answer.text());
        let saved = answer.header("content-disposition").unwrap().to_owned();
        assert!(
            saved.starts_with("attachment; filename*=UTF-8''mine%2C%20another%20right%20arm")
                && saved.ends_with(format),
            "{saved}"
        );
        let path = place.dir.path().join(format!("x.{format}"));
        fs::write(&path, &answer.body).unwrap();
        let motion = format::read(&path, &ReadOptions::default()).unwrap();
        assert_eq!((motion.clip.frames(), motion.clip.fps().round()), (300, 60.0), "{format}");
    }
    // for Blender as `convert --for blender` writes it
    let file = place.project().join(format!(".studio/made/{id}.bvh"));
    let motion = format::read(&file, &ReadOptions::default()).unwrap();
    for (format, kind) in [("bvh", Format::Bvh), ("glb", Format::Glb)] {
        let answer = browser.get(&format!("/api/dances/{id}/export?format={format}&for=blender"));
        let name = format!("-blender.{format}");
        assert!(answer.header("content-disposition").unwrap().ends_with(&name));
        let known = Importer::Blender.to_bytes("mine, another right arm", &motion, kind).unwrap();
        assert!(answer.body == known, "{format}");
    }
    for (query, status) in [("format=exe", 400), ("format=bvh&for=maya", 400), ("format=npz&for=blender", 422)] {
        assert_eq!(browser.get(&format!("/api/dances/{id}/export?{query}")).status, status, "{query}");
    }
    assert_eq!(browser.get(&format!("/api/dances/{id}/export")).status, 422);
}

#[test]
fn an_edit_with_a_dance_keeps_it_first() {
    let (place, clip) = with_a_clip(5.0);
    let browser = &place.browser;
    let id = made(browser, &json!({ "kind": "edit", "clip": clip, "free": ["right_arm"] }))[0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let give = json!({ "op": "give", "clip": id, "joints": "right_arm", "from": 1, "to": 3, "at": 1 });
    let view = browser.done("/api/timeline", &json!({ "edits": [give] }));
    assert_eq!(view["trouble"], json!([]));
    let clips = view["clips"].as_object().unwrap();
    let named = clips.values().find(|clip| clip["clip"] == id.as_str()).unwrap();
    assert!(place.project().join("dances").join(named["file"].as_str().unwrap()).exists());
}

#[test]
fn a_new_project_begins_with_a_dance_and_four_of_its_right_arm() {
    let place = Place::with(|options| options.empty = false);
    let state = place.browser.wait("the opening", |state| state["dances"].as_array().unwrap().len() == 5);
    let dances = state["dances"].as_array().unwrap();
    assert!(dances.iter().all(|dance| dance["opening"] == true));
    assert_eq!((dances[0]["source"].clone(), dances[1]["source"].clone()), (Value::Null, dances[0]["id"].clone()));
    assert_eq!((dances[0]["seconds"].as_f64(), dances[4]["free"].as_str()), (Some(8.0), Some("right_arm")));
    let place = place.again();
    assert_eq!(place.browser.state()["dances"].as_array().unwrap().len(), 5, "once");
}

#[test]
fn it_ends_when_it_is_told_to() {
    let place = Place::new();
    assert_eq!(place.browser.post("/api/stop", &json!({})).status, 200);
    let begun = std::time::Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", place.browser.port)).is_ok() {
        assert!(begun.elapsed() < std::time::Duration::from_secs(20));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let file = place.file();
    let begun = std::time::Instant::now();
    while file.exists() {
        assert!(begun.elapsed() < std::time::Duration::from_secs(20), "nobody is led to a server that is gone");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}
