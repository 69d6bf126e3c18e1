//! `kinelm compare` and `kinelm evaluate blind` as a user runs them.

use crate::support::{json, kinelm_in, save, stdout};
use kinelm_motion::synth;
use predicates::str::contains;
use serde_json::{Value, json as object};
use std::fs;

#[test]
fn a_late_student_is_named_in_text_in_json_and_on_a_page() {
    let dir = tempfile::tempdir().unwrap();
    let dance = synth::corpus(2, 1, 12.0, 60.0).unwrap().remove(0).clip;
    save(&dir.path().join("teacher.bvh"), &dance);
    save(&dir.path().join("student.bvh"), &dance.slice(24..dance.frames()));
    let call = |more: &str| kinelm_in(dir.path(), &format!("compare teacher.bvh student.bvh --keep-rest {more}"));
    let said = stdout(&mut call("--page page.html"));
    assert!(said.contains("0.40 s early, 12 frames") && said.contains("1.000, the same"), "{said}");
    let page = fs::read_to_string(dir.path().join("page.html")).unwrap();
    assert!(page.contains("\"in step\"") && page.contains("\"title\":\"Distance\""));
    let found = json(&mut call("--json --joints arms --band 15f"));
    assert_eq!(
        (&found["lag_frames"], &found["mirrored"], &found["schema"]),
        (&object!(-12), &object!(false), &object!(1))
    );
    assert_eq!((found["joints"].as_array().unwrap().len(), &found["student"]), (10, &object!("student.bvh")));
    call("--joints root").assert().code(2).stderr(contains("--joints is root; expected joints besides the pelvis"));
    call("--band 31s").assert().code(2).stderr(contains("--band is 31; expected 0.1 to 30 seconds"));
    call("--page page.bvh").assert().code(2);
}

#[test]
fn a_study_is_made_and_its_votes_counted() {
    let dir = tempfile::tempdir().unwrap();
    for (seed, folder) in ["real", "made"].into_iter().enumerate() {
        for (i, dance) in synth::corpus(seed as u64, 3, 3.0, 30.0).unwrap().into_iter().enumerate() {
            save(&dir.path().join(folder).join(format!("{i}.bvh")), &dance.clip);
        }
    }
    let call = |words: &str| kinelm_in(dir.path(), words);
    let make = "evaluate blind make real made --ask real --out study.html --seed";
    call(&format!("{make} 1")).assert().success().stderr(contains("3 trials of 3.0 s"));
    // the same again; another study would lose the key
    call(&format!("{make} 1")).assert().success();
    call(&format!("{make} 2")).assert().code(2).stderr(contains("study.key.json is there already"));
    let key: Value = serde_json::from_str(&fs::read_to_string(dir.path().join("study.key.json")).unwrap()).unwrap();
    let file = |voter: &str, page: &Value| {
        let real = |trial: &Value| i32::from(trial["left"]["folder"] != 0);
        let trials = key["trials"].as_array().unwrap().iter().enumerate();
        let votes: Vec<Value> =
            trials.map(|(i, trial)| object!({"trial": i, "choice": real(trial), "seconds": 2.5})).collect();
        let votes = object!({"schema": 1, "page": page, "voter": voter, "votes": votes});
        fs::write(dir.path().join(format!("{voter}.json")), votes.to_string()).unwrap();
    };
    file("ann", &key["page"]);
    file("bob", &key["page"]);
    file("eve", &object!("another"));
    let count = json(&mut call("evaluate blind count study.key.json ann.json bob.json --json"));
    assert_eq!((&count["voters"], &count["votes"], &count["kappa"]), (&object!(2), &object!(6), &object!(1.0)));
    assert_eq!(count["shares"][0]["of"], "real");
    assert_eq!((&count["shares"][0]["votes"], &count["shares"][1]["votes"]), (&object!(6), &object!(0)));
    let left_out = call("evaluate blind count study.key.json ann.json eve.json").assert().code(1);
    left_out.stdout(contains("3 votes of 1 voter")).stderr(contains("eve.json: found votes of another page"));
    call("evaluate blind make real made --ask blend --out x.html")
        .assert()
        .code(2)
        .stderr(contains("three, A, B and C"));
}
