use super::*;

/// A folder of empty files.
fn tree(files: &[&str]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for file in files {
        let path = dir.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, if file.ends_with(".json") { "{\"schema\":1}" } else { "" }).unwrap();
    }
    dir
}

fn names(g: &Dataset) -> Vec<&str> {
    g.items.iter().map(|i| i.name.as_str()).collect()
}

fn notes(g: &Dataset, what: &str) -> bool {
    g.notes.iter().any(|s| s.contains(what))
}

#[test]
fn files_are_found_sorted_and_others_left_out() {
    let dir = tree(&[
        "b/2.BVH",
        "b/10.bvh",
        "a/x.npz",
        "a/shape.npz",
        "a/neutral_stagei.npz",
        "n.txt",
        ".h.bvh",
        "c.pkl",
        "d.json",
    ]);
    fs::write(dir.path().join("other.json"), "{}").unwrap();
    fs::write(dir.path().join("b/2.kinelm.json"), r#"{"schema":1,"kinelm":"0.1.0"}"#).unwrap();
    let g = Dataset::find(&[dir.path().into()], &[]).unwrap();
    assert_eq!(names(&g), ["a/x", "b/10", "b/2", "c", "d"]);
    // two AMASS files by their names, other.json, and the sidecar
    assert_eq!(g.no_motion, 4);
    assert!(notes(&g, "4 files hold no motion"), "{:?}", g.notes);
    assert_eq!(g.items[4].key, 4);
}

#[test]
fn an_ignore_list_counts_for_its_folder_and_below() {
    let dir = tree(&["m/gBR_sBM_cAll_d04_mBR0_ch01.pkl", "m/gBR_sBM_cAll_d04_mBR0_ch02.pkl", "z.bvh"]);
    fs::write(dir.path().join("ignore_list.txt"), "gBR_sBM_cAll_d04_mBR0_ch01\nz\n").unwrap();
    for (data, ignored) in [(dir.path().to_owned(), 2), (dir.path().join("m"), 1)] {
        let g = Dataset::find(&[data], &[]).unwrap();
        assert_eq!((g.items.len(), g.ignored), (1, ignored));
        assert_eq!(g.items[0].labels["genre"], "break");
        assert_eq!(g.items[0].take, "gBR_sBM_d04_mBR0_ch02");
    }
}

#[test]
fn a_csv_labels_and_both_leftovers_are_counted() {
    let dir = tree(&["salsa/01.bvh", "salsa/02.bvh", "salsa/03.bvh"]);
    let csv = dir.path().join("l.csv");
    fs::write(&csv, "clip,split,genre,take,fps,skip\nsalsa/01,test,salsa,t,60,10\nsalsa/02.bvh,,salsa,t,,\nsalsa/09,train,salsa,u,,\n").unwrap();
    let g = Dataset::find(&[dir.path().into()], &[csv.display().to_string()]).unwrap();
    let i = &g.items[0];
    assert_eq!((i.split, i.take.as_str(), i.fps, i.skip), (Split::Test, "t", Some(60.0), Some(10)));
    assert_eq!(g.items[1].split, Split::Test, "as its take");
    assert_eq!((g.without_file, g.without_row), (1, 1));
    assert!(notes(&g, "1 rows have no file: salsa/09 (line 4)") && notes(&g, "1 files have no row"), "{:?}", g.notes);
    assert!(notes(&g, "2 clips have labels by the CSV: genre"), "{:?}", g.notes);
    assert!(g.items[2].labels.is_empty());
}

#[test]
fn a_file_given_itself_is_labelled_by_its_folders() {
    let dir = tree(&["salsa/01.bvh"]);
    let file = dir.path().join("salsa/01.bvh");
    let csv = dir.path().join("l.csv");
    fs::write(&csv, "clip,mood\nsalsa/01,glad\n").unwrap();
    let g = Dataset::find(std::slice::from_ref(&file), &[csv.display().to_string()]).unwrap();
    assert_eq!((g.items[0].name.as_str(), g.items[0].labels["mood"].as_str()), ("01", "glad"));
    let g = Dataset::find(std::slice::from_ref(&file), &["{genre}/{take}".to_string()]).unwrap();
    assert_eq!((g.items[0].labels["genre"].as_str(), g.items[0].take.as_str()), ("salsa", "01"));
    let g = Dataset::find(&[file], &[]).unwrap();
    assert!(g.items[0].labels.is_empty() && notes(&g, "1 clips have no labels"), "{:?}", g.notes);
}

#[test]
fn label_lists_go_with_their_data() {
    let (a, b) = (tree(&["01.bvh"]), tree(&["x_y.bvh"]));
    let data = [a.path().to_owned(), b.path().to_owned()];
    let g = Dataset::find(&data, &["{genre}".into(), "{style}_{content}".into()]).unwrap();
    assert_eq!(g.items[0].labels["genre"], "01");
    assert_eq!(g.items[1].labels["style"], "x");
    let g = Dataset::find(&data, &["{genre}_*".into()]).unwrap();
    assert!(notes(&g, "1 files don't fit {genre}_*"), "{:?}", g.notes);
    assert!(Dataset::find(&[data.to_vec(), data.to_vec()].concat()[..3], &["".into(), "".into()]).is_err());
}

#[test]
fn equal_names_are_made_unique() {
    let (a, b) = (tree(&["s/01.bvh", "s/01.npz", "t.bvh"]), tree(&["t.bvh"]));
    let (pa, pb) = (a.path().to_owned(), b.path().to_owned());
    let g = Dataset::find(&[pa.clone(), pb.clone(), pa.join("t.bvh")], &[]).unwrap();
    let base = |p: &Path| p.file_name().unwrap().to_string_lossy().into_owned();
    let (t, u) = (format!("{}/t.bvh", base(&pa)), format!("{}/t.bvh", base(&pb)));
    assert_eq!(names(&g), ["s/01.bvh", "s/01.npz", &t, &u]);
    assert!(notes(&g, "1 files were given twice"), "{:?}", g.notes);
}

#[test]
fn nothing_to_find_is_an_error() {
    let dir = tree(&["a.txt"]);
    assert!(Dataset::find(&[dir.path().into()], &[]).unwrap_err().to_string().contains("no motion in"));
    assert!(Dataset::find(&[dir.path().join("none")], &[]).is_err());
    assert!(
        Dataset::find(&[dir.path().join("a.txt")], &[])
            .unwrap_err()
            .to_string()
            .contains("found the extension .txt, expected .bvh")
    );
}

#[test]
fn the_shared_lists_cover_the_shared_data() {
    let Some(dir) = kinelm_shared_data::set("cmu-dance", "corpus::dataset") else { return };
    let csv = kinelm_shared_data::split_csv("cmu-dance").display().to_string();
    let g = Dataset::find(std::slice::from_ref(&dir), &[csv]).unwrap();
    let count = |s| g.items.iter().filter(|i| i.split == s).count();
    assert_eq!([Split::Train, Split::Valid, Split::Test].map(count), [29, 4, 10]);
    assert_eq!((g.without_file, g.without_row), (0, 0));
    let salsa = g.items.iter().find(|i| i.name == "salsa/01").unwrap();
    assert_eq!((salsa.fps, salsa.labels["dancer"].as_str()), (Some(60.0), "cmu60"));
    let g = Dataset::find(&[dir], &[]).unwrap();
    assert!(notes(&g, "43 clips have labels by {genre}/{take}.bvh: genre"), "{:?}", g.notes);
}

#[test]
fn an_archive_is_a_folder_that_is_read_where_it_lies() {
    let dir = tree(&["salsa/02.bvh", "salsa/01.bvh", "salsa/notes.txt", "a.npz"]);
    std::fs::write(dir.path().join("salsa/01.bvh"), "one").unwrap();
    let mut tar = tar::Builder::new(Vec::new());
    tar.append_dir_all(".", dir.path()).unwrap();
    let bytes = tar.into_inner().unwrap();
    let shards = tempfile::tempdir().unwrap();
    fs::write(shards.path().join("shard-0.tar"), &bytes).unwrap();
    let csv = shards.path().join("l.csv");
    fs::write(&csv, "clip,genre\nsalsa/01,salsa\n").unwrap();
    let alone = Dataset::find(&[shards.path().join("shard-0.tar")], &[csv.display().to_string()]).unwrap();
    let mut found = names(&alone);
    found.sort_unstable();
    assert_eq!(found, ["a", "salsa/01", "salsa/02"]);
    let one = alone.items.iter().find(|item| item.name == "salsa/01").unwrap();
    assert_eq!((one.bytes().unwrap().as_slice(), one.labels["genre"].as_str()), (&b"one"[..], "salsa"));
    assert_eq!(one.file(), shards.path().join("shard-0.tar"));
    let among = Dataset::find(&[shards.path().into()], &[]).unwrap();
    assert!(names(&among).contains(&"shard-0/salsa/01"), "{:?}", names(&among));
    assert!(motion_files(shards.path()).unwrap().is_empty(), "who reads by path finds none");
    // what is cut costs a note or its own line, not the rest
    fs::write(shards.path().join("shard-0.tar"), &bytes[..bytes.len() - 2048]).unwrap();
    let cut = Dataset::find(&[shards.path().into()], &[]).unwrap();
    assert!(!cut.items.is_empty());
}
