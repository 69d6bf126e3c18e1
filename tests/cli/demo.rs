//! The demos, whole.

use crate::support::kinelm;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

#[test]
#[ignore = "84 dances, their music and 24 more: a minute or two"]
fn the_demo_with_music_makes_all_it_promises() {
    let dir = tempfile::tempdir().unwrap();
    let mut demo = kinelm();
    demo.current_dir(dir.path()).args(["demo", "--music", "--steps", "2"]).timeout(std::time::Duration::from_secs(900));
    demo.assert().success().stdout(contains("half a beat off").and(contains("with music")));
    for name in ["page.html", "dance.bvh", "report.md", "music/sway/sway_ash_01.wav"] {
        assert!(dir.path().join("demo").join(name).exists(), "{name}");
    }
}

#[test]
fn the_demo_makes_all_it_promises() {
    let dir = tempfile::tempdir().unwrap();
    let demo = || {
        let mut c = kinelm();
        c.current_dir(dir.path()).args(["demo", "--steps", "2"]);
        c
    };
    demo().assert().success().stdout(contains("order 0").and(contains("the trained model")));
    for name in ["tokenizer.json", "run/config.toml", "dance.bvh", "page.html", "report.md", "corpus/tokens.u16"] {
        assert!(dir.path().join("demo").join(name).exists(), "{name}");
    }
    demo().assert().code(2).stderr(contains("--force"));
}
