//! Words of any kind through the whole program: merged characters, tiles of frames.

use crate::support::{json, kinelm, read, save};
use kinelm::corpus::load::ModelClip;
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rig::{Humanoid, SkeletonMap};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Quat, Vec3, format, synth};
use kinelm_tokenizer::{
    DctConfig, Form, Height, JointTransform, LappedConfig, RootRotation, SchemeConfig, Tokenizer, TokenizerConfig,
    Travel, UncodedPose, UniformConfig,
};
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const FPS: f64 = 20.0;

const CONFIG: &str = "[model]\nlayers = 1\nheads = 2\nwidth = 32\ncontext = 60\n\
                      [train]\nbatch = 2\nsteps = 4\nwarmup = 1\neval_every = 2\ncheckpoint_every = 2\n";

/// Six dances of lengths that no tile divides, a prompt, and a tokenizer fitted on them.
struct Way {
    dir: tempfile::TempDir,
    tokenizer: Tokenizer,
    frames: usize,
}

impl Way {
    fn new(config: TokenizerConfig) -> Way {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("data")).unwrap();
        let dances: Vec<Clip> = synth::corpus(3, 7, 5.0, FPS).unwrap().into_iter().map(|d| d.clip).collect();
        let mut csv = "clip,split\n".to_string();
        let mut frames = 0;
        for (i, dance) in dances[1..].iter().enumerate() {
            let clip = dance.slice(0..dance.frames() - 7 * i);
            frames += clip.frames();
            save(&dir.path().join(format!("data/{i}.bvh")), &clip);
            csv += &format!("{i},{}\n", ["train", "train", "valid", "test"][i % 4]);
        }
        save(&dir.path().join("prompt.bvh"), &dances[0]);
        fs::write(dir.path().join("labels.csv"), csv).unwrap();
        fs::write(dir.path().join("c.toml"), CONFIG).unwrap();
        let tokenizer = Tokenizer::fit(&dances, config).unwrap();
        tokenizer.save(dir.path().join("t.json")).unwrap();
        Way { dir, tokenizer, frames }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn tokenize(&self, out: &str, more: &[&str]) {
        let mut c = kinelm();
        c.arg("tokenize").arg(self.at("data")).arg("--labels").arg(self.at("labels.csv"));
        c.arg("--tokenizer").arg(self.at("t.json")).arg("--out").arg(self.at(out)).args(more);
        c.assert().success();
    }

    fn generate(&self, out: &str, more: &[&str]) -> Vec<u8> {
        let mut c = kinelm();
        c.arg("generate")
            .arg("--run")
            .arg(self.at("run"))
            .arg("--out")
            .arg(self.at(out))
            .args(["--fps", "20"])
            .args(more);
        c.assert().success();
        // several go to files with numbers
        fs::read(self.at(out)).unwrap_or_default()
    }

    /// The words of a file, by the program.
    fn text(&self, clip: &str) -> String {
        let mut c = kinelm();
        c.args(["tokenizer", "text"]).arg(self.at(clip)).arg("--tokenizer").arg(self.at("t.json"));
        String::from_utf8(c.output().unwrap().stdout).unwrap()
    }

    /// From motion files to bits a frame.
    fn corpus_to_likelihood(&self) {
        self.tokenize("corpus", &[]);
        let manifest: Value = serde_json::from_slice(&fs::read(self.at("corpus/corpus.json")).unwrap()).unwrap();
        assert_eq!((&manifest["version"], &manifest["tokens_per_word"]), (&Value::from(5), &Value::Null));
        assert_eq!(manifest["frames_per_word"], self.tokenizer.frames_per_word());
        assert_eq!(manifest["count"]["frames"], self.frames);
        let clips = fs::read_to_string(self.at("corpus/clips.jsonl")).unwrap();
        let first: Value = serde_json::from_str(clips.lines().next().unwrap()).unwrap();
        for field in first.as_object().unwrap().keys() {
            let page = include_str!("../../docs/training.md");
            assert!(page.contains(&format!("`{field}`")), "docs/training.md doesn't say what `{field}` of a clip is");
        }
        self.tokenize("s0", &["--shard", "0/2"]);
        self.tokenize("s1", &["--shard", "1/2"]);
        let mut c = kinelm();
        c.args(["corpus", "merge"]).args([self.at("s1"), self.at("s0")]).arg("--out").arg(self.at("merged"));
        c.assert().success();
        for file in ["corpus.json", "tokens.u16", "clips.jsonl", "tokenizer.json"] {
            assert!(fs::read(self.at("merged").join(file)).unwrap() == fs::read(self.at("corpus").join(file)).unwrap());
        }
        let stats = json(kinelm().args(["corpus", "stats", "--json"]).arg(self.at("corpus")));
        assert_eq!(stats["count"]["frames"], self.frames);
        assert_eq!(stats["shared_runs"].is_null(), self.tokenizer.frames_per_word() > 1);
        kinelm().args(["corpus", "stats"]).arg(self.at("corpus")).assert().success().stdout(contains("6 clips"));

        let pretrain = |run: &str| {
            let mut c = kinelm();
            c.arg("pretrain").arg("--config").arg(self.at("c.toml")).arg("--corpus").arg(self.at("corpus"));
            c.arg("--run").arg(self.at(run)).assert().success().stderr(contains("bits/frame"));
            let latest = fs::read_to_string(self.at(run).join("latest")).unwrap();
            fs::read(self.at(run).join("checkpoints").join(latest.trim()).join("model.safetensors")).unwrap()
        };
        assert!(pretrain("run") == pretrain("again"), "the same seed gives the same bytes");
        let config = fs::read_to_string(self.at("run/config.toml")).unwrap();
        assert!(config.contains("varying = true"), "{config}");

        let measure = |what: &str, more: &[&str]| {
            let mut c = kinelm();
            c.args(["evaluate", what, "--json", "--corpus"]).arg(self.at("corpus")).args(more);
            json(&mut c)
        };
        let run = self.at("run").display().to_string();
        let found = measure("likelihood", &["--run", &run]);
        let floors = measure("baselines", &[]);
        assert_eq!(found["floors"], floors);
        let of = if self.tokenizer.frames_per_word() == 1 { "channels" } else { "tokens" };
        assert_eq!(floors["of"], of);
        let bits = found["bits_per_frame"].as_f64().unwrap();
        assert!((found["bits_per_s"].as_f64().unwrap() - FPS * bits).abs() < 1e-9);
        assert_eq!(found["frames"], 100 - 7 * 3, "one test clip");
        let uniform = found["tokens"].as_f64().unwrap() * (self.tokenizer.vocabulary().len() as f64).log2();
        // four steps of a tiny model: somewhere near every token equally likely
        assert!((bits / (uniform / found["frames"].as_f64().unwrap()) - 1.0).abs() < 0.3, "{found}");
        let plain = measure("likelihood", &["--run", &run, "--form", "plain"]);
        assert!((plain["bits_per_frame"].as_f64().unwrap() / bits - 1.0).abs() < 1e-5);
    }

    /// Dances of the run.
    fn dances(&self) {
        let prompt = self.at("prompt.bvh").display().to_string();
        let free = self.generate("free.json", &["--frames", "133", "--seed", "5"]);
        assert_eq!(read(&self.at("free.json")).frames(), 133);
        assert_eq!(free, self.generate("again.json", &["--frames", "133", "--seed", "5", "--threads", "1"]));
        assert_eq!(free, self.generate("ahead.json", &["--frames", "133", "--seed", "5", "--guesses", "4"]));
        self.generate("v.json", &["--frames", "133", "--seed", "5", "--variations", "2"]);
        assert_eq!(free, fs::read(self.at("v-1.json")).unwrap());
        assert_ne!(free, fs::read(self.at("v-2.json")).unwrap());
        assert_ne!(free, self.generate("other.json", &["--frames", "133", "--seed", "6"]));
        let greedy = self.generate("greedy.json", &["--frames", "33", "--greedy"]);
        assert_eq!(greedy, self.generate("slow.json", &["--frames", "33", "--greedy", "--form", "plain"]));

        // the dance begins with the prompt's own words, but for those that its end would be in
        let begin = ["--frames", "50", "--prompt", &prompt, "--from-frame", "41", "--uncoded-joints", "identity"];
        self.generate("begun.json", &begin);
        let begun = read(&self.at("begun.json"));
        let (l, unsettled) = (self.tokenizer.frames_per_word(), self.tokenizer.scheme().unsettled_words());
        let options = format::ReadOptions { rest: format::RestFrame::Drop, ..Default::default() };
        let placed = ModelClip::load(&self.at("prompt.bvh"), &options, self.tokenizer.config().into()).unwrap();
        let clip = placed.lowered();
        let whole = 41 / l;
        let words = self.tokenizer.encode(&clip.slice(0..whole * l)).unwrap().words.slice(0..whole - unsettled);
        let known = self.tokenizer.decode(&words, UncodedPose::Identity).unwrap();
        // and stands where the prompt stands, whose first place coding takes off, on y = 0
        let rise = if self.tokenizer.config().above_floor() {
            0.0
        } else {
            let smpl = SkeletonMap::by_name_or_file("smpl").unwrap();
            clip.root()[0].y
                - Humanoid::with_map(clip.skeleton(), &smpl).floor(&clip).unwrap().height_m
                - known.root()[0].y
        };
        let there = Vec3::new(clip.root()[0].x, rise, clip.root()[0].z);
        // the last words may reach into the next
        let same = (words.len() - unsettled) * l;
        assert!(same >= 20 && begun.frames() == 50);
        for f in 0..same {
            let apart = (0..24).map(|j| angle_between(begun.pose(f)[j], known.pose(f)[j])).fold(0.0, f64::max);
            assert!(apart < 1e-5 && begun.root()[f].distance(known.root()[f] + there) < 1e-5, "frame {f}: {apart}");
        }

        let mut c = kinelm();
        c.arg("generate").arg("--run").arg(self.at("run")).arg("--out").arg(self.at("no.bvh"));
        c.args(["--prompt", &prompt, "--joints", "root"]).assert().code(2).stderr(contains(" root: "));
        assert!(!self.at("no.bvh").exists());
    }

    /// A text of words and back.
    fn text_and_back(&self) -> Clip {
        fs::write(self.at("w.txt"), self.text("prompt.bvh")).unwrap();
        let mut c = kinelm();
        c.args(["tokenizer", "decode"]).arg(self.at("w.txt")).arg(self.at("w.json"));
        c.arg("--tokenizer").arg(self.at("t.json")).assert().success();
        let (decoded, l) = (read(&self.at("w.json")), self.tokenizer.frames_per_word());
        assert_eq!(decoded.frames(), 100usize.div_ceil(l) * l);
        decoded
    }
}

#[test]
fn merged_characters_go_the_whole_way() {
    let way = Way::new(TokenizerConfig { merges: 100, ..TokenizerConfig::uniform(&THIRTEEN, FPS, 90) });
    way.corpus_to_likelihood();
    way.dances();
    way.text_and_back();
}

#[test]
fn tiles_go_the_whole_way() {
    let joint_transform = JointTransform::Pca { components: 6 };
    let scheme = SchemeConfig::Dct(DctConfig { tile: 20, joint_transform, keep: 0.2, bins: 60, ..Default::default() });
    let way = Way::new(TokenizerConfig { fps: FPS, scheme, ..Default::default() });
    way.corpus_to_likelihood();
    way.dances();
    way.text_and_back();
}

#[test]
fn lapped_tiles_go_the_whole_way() {
    let scheme = SchemeConfig::Lapped(LappedConfig { hop: 5, ..Default::default() });
    let way = Way::new(TokenizerConfig { fps: FPS, scheme, ..Default::default() });
    way.corpus_to_likelihood();
    way.dances();
    way.text_and_back();
}

/// Rotations as w x y z, root and joint positions that `scripts/reference/decode_words.py` makes of words. `None` without
/// Python.
fn decoded_by_the_page(tokenizer: &Path, words: &Path) -> Option<Value> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/reference/decode_words.py");
    let output = std::process::Command::new("python3").arg(script).args([tokenizer, words]).output().ok()?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn words_decode_as_the_page_says() {
    let uniform = |uniform: UniformConfig, root_rotation: RootRotation| TokenizerConfig {
        root_rotation,
        scheme: SchemeConfig::Uniform(uniform),
        ..Default::default()
    };
    let by_default = UniformConfig::default();
    let edges = UniformConfig { bins: 61, form: Form::Edge, height: Height::Velocity, ..by_default.clone() };
    let places = UniformConfig {
        form: Form::Edge,
        translation: Travel::Absolute,
        height: Height::Absolute,
        ..by_default.clone()
    };
    let configs = [
        uniform(by_default, RootRotation::HeadingDelta),
        uniform(edges, RootRotation::HeadingDelta),
        uniform(places, RootRotation::Absolute),
    ];
    for config in configs {
        let way = Way::new(config);
        let program = way.text_and_back();
        let Some(page) = decoded_by_the_page(&way.at("t.json"), &way.at("w.txt")) else {
            kinelm_shared_data::skipped("words decoded in Python", "there is no python3");
            return;
        };
        let numbers = |key: &str| -> Vec<Vec<Vec<f64>>> { serde_json::from_value(page[key].clone()).unwrap() };
        let (rotations, positions) = (numbers("rotations"), numbers("positions"));
        let places = program.positions();
        assert_eq!((rotations.len(), positions.len()), (program.frames(), program.frames()));
        for f in 0..program.frames() {
            for j in 0..24 {
                let [w, x, y, z] = rotations[f][j][..] else { panic!("a quaternion") };
                let apart = angle_between(Quat::from_xyzw(x, y, z, w), program.pose(f)[j]);
                let off = (Vec3::from_slice(&positions[f][j]) - places[24 * f + j]).length();
                assert!(apart < 1e-9 && off < 1e-9, "frame {f}, joint {j}: {apart} rad, {off} m");
            }
        }
    }
}
