//! Runs of somebody else, with links in them: nothing that they lead to is read as a part of them, continued or emptied.
#![cfg(unix)]

use crate::support::{kinelm_in, save, stdout};
use assert_cmd::Command;
use kinelm_motion::synth;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;

const TRAIN: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 16\ncontext = 130\n\
                     [train]\nbatch = 1\nsteps = 2\nwarmup = 1\neval_every = 2\ncheckpoint_every = 1\n";
/// What a file of the user holds that no call names.
const MINE: &str = "mine\n";

/// A folder with dances, and a run of each kind that can be resumed.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Place {
        let place = Place(tempfile::tempdir().unwrap());
        let mut labels = "clip,split,genre\n".to_owned();
        for (i, dance) in synth::corpus(3, 6, 4.0, 30.0).unwrap().into_iter().enumerate() {
            save(&place.at(&format!("data/{i}.bvh")), &dance.clip);
            labels += &format!("{i},{},{}\n", ["train", "valid", "test"][i % 3], ["salsa", "waltz"][i / 3]);
        }
        fs::write(place.at("labels.csv"), labels).unwrap();
        fs::write(place.at("train.toml"), TRAIN).unwrap();
        let lstm = "width = 8\nlayers = 1\nlength = 20\nbatch = 2\nsteps = 2\nmargin = 3\ncheckpoint_every = 1\n";
        fs::write(place.at("lstm.toml"), lstm).unwrap();
        for call in [
            "tokenizer fit data --labels labels.csv --joints 13 --out t.json",
            "tokenize data --labels labels.csv --tokenizer t.json --out corpus",
            "pretrain --config train.toml --corpus corpus --run pretrained",
            "finetune --config finetune --set train.steps=2 --from pretrained --corpus corpus --run finetuned",
            "aclstm train data --labels labels.csv --config lstm.toml --run lstm",
        ] {
            stdout(&mut place.call(call));
        }
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn call(&self, words: &str) -> Command {
        kinelm_in(self.0.path(), words)
    }
}

#[test]
fn a_run_with_links_is_not_opened_and_what_they_lead_to_stays() {
    let place = Place::new();
    fs::create_dir_all(place.at("mine/step-00000001")).unwrap();
    let files = [place.at("mine/notes"), place.at("mine/step-00000001/notes")];
    files.iter().for_each(|file| fs::write(file, MINE).unwrap());
    for (run, resume) in [
        ("pretrained", "pretrain resume pretrained --steps 4"),
        ("finetuned", "finetune resume finetuned --steps 4"),
        ("lstm", "aclstm resume lstm"),
    ] {
        for (name, to) in [(".lock", "mine/notes"), ("metrics.jsonl", "mine/notes"), ("checkpoints", "mine")] {
            let (there, kept) = (place.at(run).join(name), place.at("kept"));
            fs::rename(&there, &kept).unwrap();
            symlink(place.at(to), &there).unwrap();
            let mut calls = vec![resume.to_owned()];
            if run != "lstm" {
                calls.push(format!("generate --run {run} --frames 5 --out no.bvh"));
            }
            for call in calls {
                let said = place.call(&call).assert().failure();
                let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
                for part in [&format!("{run}: found 1 link: {name}"), "a run without links", "by a copy"] {
                    assert!(said.contains(part), "{call}, {name}: {said}");
                }
            }
            for file in &files {
                assert_eq!(fs::read_to_string(file).unwrap(), MINE, "{resume}, {name}");
            }
            assert_eq!(fs::read_dir(place.at("mine")).unwrap().count(), 2, "{resume}, {name}");
            fs::remove_file(&there).unwrap();
            fs::rename(&kept, &there).unwrap();
        }
        // a pipe isn't waited for
        let lock = place.at(run).join(".lock");
        fs::remove_file(&lock).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(&lock).status().unwrap().success());
        place.call(resume).timeout(std::time::Duration::from_secs(60)).assert().failure().code(1);
        fs::remove_file(&lock).unwrap();
    }
    // the folder itself may be reached by a link
    symlink(place.at("pretrained"), place.at("by-a-link")).unwrap();
    stdout(&mut place.call("pretrain resume by-a-link --steps 4"));
    assert!(!place.at("no.bvh").exists());
}
