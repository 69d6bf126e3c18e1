//! A server that is killed again and again in the middle of jobs and edits: what was answered is there.

use super::client::Browser;
use super::place::{Place, bytes, dance, process};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::time::{Duration, Instant};

/// How often it is killed.
const KILLS: usize = 50;

/// What the server has answered.
#[derive(Default)]
struct Promised {
    clips: Vec<String>,
    /// The text of the timeline after the last edit that was answered, and after one whose answer never came.
    text: Vec<String>,
    /// File and bytes of kept dances.
    kept: BTreeMap<String, Vec<u8>>,
}

/// A request whose answer may never come.
fn try_post(browser: &Browser, path: &str, body: &Value) -> Option<Value> {
    let head = format!("{}Content-Length: {}\r\n\r\n{body}", browser.head("POST", path), body.to_string().len());
    let mut stream = std::net::TcpStream::connect(("127.0.0.1", browser.port)).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(30))).ok()?;
    std::io::Write::write_all(&mut stream, head.as_bytes()).ok()?;
    let mut all = Vec::new();
    std::io::Read::read_to_end(&mut stream, &mut all).ok()?;
    let text = String::from_utf8(all).ok()?;
    let (head, body) = text.split_once("\r\n\r\n")?;
    if !head.starts_with("HTTP/1.1 200") {
        return None;
    }
    serde_json::from_str(body).ok()
}

#[test]
fn killed_fifty_times_in_the_middle_of_jobs_and_edits_nothing_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let project = dir.path().join("project");
    let mut promised = Promised::default();
    let clip = bytes("a.bvh", &dance(1, 3.0, 30.0));
    for round in 0..KILLS {
        let server = process(&project);
        let browser = server.1.clone();
        check(&browser, &project, &mut promised, round);
        if round % 10 == 0 {
            promised.clips.push(browser.upload(&format!("clip{round}.bvh"), &clip));
        }
        let id = promised.clips[0].clone();
        if browser.wait_clip(&id)["state"] != "ready" {
            panic!("the clip is read");
        }
        if promised.text.is_empty() {
            browser.wait("the timeline", |_| !browser.get("/api/timeline").json()["text"].as_str().unwrap().is_empty());
            promised.text = vec![browser.get("/api/timeline").json()["text"].as_str().unwrap().to_owned()];
        }
        let make = match round % 5 {
            0 => json!({ "kind": "edit", "clip": id, "free": ["right_arm"], "variations": 2, "seed": round }),
            _ => json!({ "kind": "free", "seconds": 1, "variations": 2, "seed": round }),
        };
        try_post(&browser, "/api/make", &make);
        if round % 3 == 2 {
            // so that one can be kept while the process ends
            let is_open = |dance: &Value| dance["kept"] == false;
            browser.wait("a dance", |state| state["dances"].as_array().unwrap().iter().any(is_open));
        }
        // killed at another moment each time, while requests are under way
        let mut child = server;
        let wait = Duration::from_millis(5 + 17 * (round as u64 * 7 % 23));
        let killer = std::thread::spawn(move || {
            std::thread::sleep(wait);
            child.0.kill().unwrap();
            child.0.wait().unwrap();
        });
        let begun = Instant::now();
        while !killer.is_finished() && begun.elapsed() < Duration::from_secs(30) {
            act(&browser, &project, &mut promised, round);
        }
        killer.join().unwrap();
    }
    let server = process(&project);
    check(&server.1, &project, &mut promised, KILLS);
    let jobs = server.1.wait("all jobs", |state| {
        let running = |job: &Value| ["waiting", "running"].contains(&job["state"].as_str().unwrap());
        !state["jobs"].as_array().unwrap().iter().any(running)
    });
    let failed: Vec<&Value> = jobs["jobs"].as_array().unwrap().iter().filter(|job| job["state"] == "failed").collect();
    let often = |job: &&&Value| !job["text"].as_str().unwrap_or_default().contains("again and again");
    assert!(failed.iter().filter(often).count() == 0, "{failed:?}");
    assert!(promised.kept.len() > 3, "dances were kept in between: {}", promised.kept.len());
}

#[test]
fn a_job_that_is_begun_again_leaves_what_was_kept_and_rejected_of_it() {
    let place = Place::new();
    let make = json!({ "kind": "free", "seconds": 1, "variations": 3, "seed": 1 });
    place.browser.done("/api/make", &make);
    let all = place.browser.wait("three dances", |state| state["dances"].as_array().unwrap().len() == 3);
    let id = |n: usize| all["dances"][n]["id"].as_str().unwrap().to_owned();
    place.browser.wait("the job's end", |state| state["jobs"][0]["state"] == "done");
    let kept = place.browser.done(&format!("/api/dances/{}/keep", id(0)), &json!({ "name": "mine" }));
    place.browser.done(&format!("/api/dances/{}/reject", id(1)), &json!({}));
    let dir = place.stop();
    // as if the process had ended before the third was written
    let project = dir.path().join("project");
    let jobs = project.join(".studio/jobs.jsonl");
    let text = fs::read_to_string(&jobs).unwrap();
    fs::write(&jobs, text.replace("\"done\"", "\"running\"")).unwrap();
    fs::remove_file(project.join(format!(".studio/made/{}.bvh", id(2)))).unwrap();
    let server = process(&project);
    let state = server.1.wait("the job's end", |state| state["jobs"][0]["state"] == "done");
    let dances = state["dances"].as_array().unwrap();
    assert_eq!(dances.iter().map(|dance| dance["id"].as_str().unwrap()).collect::<Vec<_>>(), [id(0), id(1), id(2)]);
    assert_eq!((&dances[0]["kept_name"], &dances[0]["name"]), (&kept["kept_name"], &json!("mine")));
    assert_eq!((&dances[1]["rejected"], &dances[2]["rejected"]), (&json!(true), &json!(false)));
}

#[test]
fn what_is_in_the_folder_is_taken_in_where_the_journal_is_lost() {
    let place = Place::new();
    place.browser.upload("clip.bvh", &bytes("a.bvh", &dance(1, 3.0, 30.0)));
    place.browser.upload("song.wav", &kinelm_music::wav::bytes(&[0.0; 8000], 8000));
    place.browser.done("/api/make", &json!({ "kind": "free", "seconds": 1, "variations": 1, "seed": 1 }));
    let all = place.browser.wait("a dance", |state| state["dances"].as_array().unwrap().len() == 1);
    let id = all["dances"][0]["id"].as_str().unwrap();
    place.browser.done(&format!("/api/dances/{id}/keep"), &json!({ "name": "mine" }));
    let dir = place.stop();
    let project = dir.path().join("project");
    let journal = project.join(".studio/journal.jsonl");
    for lost in [true, false] {
        fs::remove_file(&journal).unwrap();
        if !lost {
            fs::write(&journal, "").unwrap();
        }
        let server = process(&project);
        let state = server.1.state();
        let names = |key: &str| -> Vec<String> {
            state[key].as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap().to_owned()).collect()
        };
        assert_eq!((names("clips"), names("dances")), (vec!["clip".into(), "song".into()], vec!["mine".into()]));
        let found = &state["dances"][0];
        assert_eq!(
            (&found["kept"], found["frames"].as_u64(), found["fps"].as_f64()),
            (&json!(true), Some(30), Some(30.0))
        );
    }
}

/// An edit and a dance that is kept, remembered where they were answered.
fn act(browser: &Browser, project: &std::path::Path, promised: &mut Promised, round: usize) {
    let seconds = 3.0 + (round % 7) as f64 + promised.text.len() as f64 / 8.0;
    let edit = json!({ "edits": [{ "op": "set_top", "key": "seconds", "value": seconds }] });
    if round % 3 == 2 {
        keep(browser, project, promised, round);
    }
    match try_post(browser, "/api/timeline", &edit) {
        Some(view) => promised.text = vec![view["text"].as_str().unwrap().to_owned()],
        // it may be there or not
        None => promised.text.push(format!("seconds {seconds}")),
    }
}

fn keep(browser: &Browser, project: &std::path::Path, promised: &mut Promised, round: usize) {
    let Some(state) = try_state(browser) else { return };
    let open = state["dances"].as_array().unwrap().iter().find(|dance| dance["kept"] == false).cloned();
    let Some(dance) = open else { return };
    let (id, name) = (dance["id"].as_str().unwrap(), json!({ "name": format!("kept {round}") }));
    if let Some(kept) = try_post(browser, &format!("/api/dances/{id}/keep"), &name) {
        let file = kept["kept_name"].as_str().unwrap().to_owned();
        // it is on the disk before the answer is on its way
        let bytes = fs::read(project.join("dances").join(&file)).unwrap();
        promised.kept.insert(file, bytes);
    }
}

fn try_state(browser: &Browser) -> Option<Value> {
    let mut stream = std::net::TcpStream::connect(("127.0.0.1", browser.port)).ok()?;
    std::io::Write::write_all(&mut stream, format!("{}\r\n", browser.head("GET", "/api/state")).as_bytes()).ok()?;
    let mut text = String::new();
    std::io::Read::read_to_string(&mut stream, &mut text).ok()?;
    serde_json::from_str(text.split_once("\r\n\r\n")?.1).ok()
}

/// Whether everything that was promised is there.
fn check(browser: &Browser, project: &std::path::Path, promised: &mut Promised, round: usize) {
    let state = browser.state();
    for clip in &promised.clips {
        assert!(
            state["clips"].as_array().unwrap().iter().any(|c| c["id"] == clip.as_str()),
            "round {round}: clip {clip}"
        );
    }
    if let Some(answered) = promised.text.first() {
        let view = browser.get("/api/timeline").json();
        let text = view["text"].as_str().unwrap().to_owned();
        assert_eq!(fs::read_to_string(project.join("timeline.toml")).unwrap(), text, "round {round}");
        assert_eq!(view["trouble"], json!([]), "round {round}");
        let is_answered = text == *answered;
        let is_asked = promised.text[1..].iter().any(|asked| text.contains(&asked.replace("seconds ", "seconds = ")));
        assert!(is_answered || is_asked, "round {round}: {text}\nanswered {answered}\nasked {:?}", &promised.text[1..]);
        promised.text = vec![text];
    }
    for (file, bytes) in &promised.kept {
        let path = project.join("dances").join(file);
        assert!(fs::read(&path).is_ok_and(|found| found == *bytes), "round {round}: {file}");
        assert!(kinelm_store::sidecar::has_hash_of(&path).unwrap(), "round {round}: {file}");
        let is_kept = |dance: &Value| dance["kept_name"] == file.as_str();
        assert!(state["dances"].as_array().unwrap().iter().any(is_kept), "round {round}: {file}");
    }
}
