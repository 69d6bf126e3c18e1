//! `kinelm-lab` as scripts call it.

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;

fn bench(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kinelm-lab"));
    command.args(args);
    command
}

fn lines(args: &[&str]) -> Vec<Value> {
    let output = bench(args).args(["--json", "--repeats", "2"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

/// What every row has, its rate under this key.
fn check(row: &Value, what: &str, rate: &str) {
    assert_eq!((&row["schema"], &row["what"]), (&Value::from(1), &Value::from(what)), "{row}");
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v} in {row}"));
    let (low, high) = (number(&row["spread"][0]), number(&row["spread"][1]));
    assert!(0.0 < low && low <= number(&row[rate]) && number(&row[rate]) <= high, "{row}");
    assert!(number(&row["threads"]) >= 1.0 && row["config"].is_string(), "{row}");
    if cfg!(target_os = "linux") {
        assert!(number(&row["peak_rss_mb"]) > 1.0, "{row}");
    }
}

#[test]
fn every_bench_has_rows_of_one_kind() {
    check(&lines(&["read"])[0], "read", "mb_per_s");
    let rows = lines(&["tokenize"]);
    assert_eq!(rows.len(), 2);
    rows.iter().for_each(|row| check(row, "tokenize", "frames_per_s"));
    check(&lines(&["lstm", "--width", "16"])[0], "lstm", "frames_per_s");
    let rows = lines(&["query", "--windows", "2000"]);
    assert_eq!(rows.iter().map(|row| row["distance"].as_str().unwrap()).collect::<Vec<_>>(), ["cosine", "euclid"]);
    rows.iter().for_each(|row| check(row, "query", "windows_per_s"));
    let rows = lines(&["decode", "--config", "tiny", "--context", "100", "--frames", "8"]);
    assert_eq!(rows.len(), 3);
    for (row, (what, rate)) in
        rows.iter().zip([("decode", "tokens_per_s"), ("prefill", "tokens_per_s"), ("generate", "frames_per_s")])
    {
        check(row, what, rate);
    }
}

#[test]
fn training_is_measured_by_config_batch_context_and_threads() {
    let rows = lines(&["train", "--config", "tiny", "--batch", "2", "--context", "90", "--threads", "1"]);
    let row = &rows[0];
    check(row, "train", "tokens_per_s");
    let told = [&row["config"], &row["batch"], &row["context"], &row["threads"]];
    assert_eq!(told, [&Value::from("tiny"), &2.into(), &90.into(), &1.into()]);
    // five steps on the same few tokens: below the loss of guessing among 400
    assert!(row["last_loss"].as_f64().unwrap() < 400f64.ln(), "{row}");
    assert!(row["share_of_peak"].as_f64().unwrap() > 0.0, "{row}");
}

#[test]
fn a_model_that_is_not_there_is_told_with_what_is() {
    bench(&["train", "--config", "huge"]).assert().code(1).stderr(contains("huge").and(contains("thesis-26m")));
    bench(&["train", "--vocabulary", "3"]).assert().code(2);
}

#[cfg(unix)]
#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    use std::process::{Command, Stdio};
    let mut command = Command::new(env!("CARGO_BIN_EXE_kinelm-lab"));
    let call = command.args(["train", "--config", "tiny", "--repeats", "1", "--batch", "1", "--quiet"]);
    let mut child = call.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // nobody reads when the row is written
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}
