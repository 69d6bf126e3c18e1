//! The tokens of real motion stay the same bytes, whatever becomes of the readers.

use super::support::kinelm;
use kinelm_store::hash;
use std::path::Path;

/// SHA-256 of `tokens.u16` of a set, by its own fitted tokenizer and by the ready one.
const SETS: [(&str, [&str; 2]); 3] = [
    (
        "cmu-dance",
        [
            "9ee27979ccd449f53dd5246aacf5e05202166a08bcffab4c92cc87cfbcb42608",
            "f9e3abc10fef559f55ecedfe0eb2478bcc43d0b78bf94c721fd5e6927815d03c",
        ],
    ),
    (
        "bandai-1",
        [
            "30cee79e54e106f5a557e7e02ed86892ab6eba89a1dbe5955b1b77456d5016c9",
            "c6c00aab1209cfa29156fb319d706ae72296584dae1609298851c3204be243c7",
        ],
    ),
    (
        "bandai-2",
        [
            "30e6ebe349f988294924223c2e9cbf144d9e22f21ee80a516011236d1eef4135",
            "47cc2761d29e6c8bf5ebe88fe8e88898d79f13a63f58e3b07bcadf33ff3402c7",
        ],
    ),
];

#[test]
fn tokens_of_real_motion_stay_the_same_bytes() {
    let ready = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/ready/data/tokenizer.json");
    for (set, expected) in SETS {
        let test = "tokens_of_real_motion_stay_the_same_bytes";
        let Some(folder) = kinelm_shared_data::set(set, test) else { continue };
        let labels = kinelm_shared_data::split_csv(set);
        let dir = tempfile::tempdir().unwrap();
        let fitted = dir.path().join("tokenizer.json");
        let with = |verb: &[&str]| {
            let mut call = kinelm();
            call.args(verb).arg("-q").arg(&folder).arg("--labels").arg(&labels);
            call
        };
        with(&["tokenizer", "fit"]).arg("--out").arg(&fitted).assert().success();
        for (tokenizer, expected) in [&fitted, &ready].into_iter().zip(expected) {
            let corpus = dir.path().join(&expected[..8]);
            with(&["tokenize"]).arg("--tokenizer").arg(tokenizer).arg("--out").arg(&corpus).assert().success();
            assert_eq!(hash::of_file(&corpus.join("tokens.u16")).unwrap(), expected, "{set}, {}", tokenizer.display());
        }
    }
}
