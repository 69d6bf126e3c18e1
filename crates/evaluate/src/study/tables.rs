//! The tables of a study.

use super::Report;
use super::metrics::RowMetrics;
use kinelm_view::plot::TEXT_MARK;
use kinelm_view::table::ReportTable;
use std::fmt::Write;

type Column = (&'static str, fn(&RowMetrics) -> String);

const TEXT: &[Column] = &[
    ("row", |f| f.name().into()),
    ("fps", |f| short(f.fps())),
    ("frames a word", |f| f.text.frames_per_word.to_string()),
    ("word, mean", |f| fixed(f.text.word_mean, 1)),
    ("max", |f| f.text.word_max.to_string()),
    ("characters", |f| fixed(f.text.characters_mean, 1)),
    ("tokens/s", |f| fixed(f.text.tokens_per_second, 1)),
    ("s in 1,024, compat", |f| fixed(f.text.seconds_compat, 2)),
    ("s in 1,024", |f| fixed(f.text.seconds, 2)),
    ("factor, chars", |f| fixed(f.bytes.factor_chars, 2)),
    ("utf8", |f| fixed(f.bytes.factor_utf8, 2)),
    ("entropy", |f| fixed(f.bytes.factor_entropy, 2)),
];

const ERRORS: &[Column] = &[
    ("row", |f| f.name().into()),
    ("MPJPE, mm", |f| fixed(f.mpjpe.global, 2)),
    ("root, mm", |f| fixed(f.mpjpe.root, 2)),
    ("max, mm", |f| fixed(f.mpjpe.max, 1)),
    ("border jerk", |f| f.border_jerk.ratio.map_or("".into(), |r| fixed(r, 3))),
    ("angle, mean deg", |f| fixed(f.angle.mean.to_degrees(), 3)),
    ("RMS", |f| fixed(f.angle.rms.to_degrees(), 3)),
    ("99 %", |f| fixed(f.angle.percentile_99.to_degrees(), 3)),
    ("max", |f| fixed(f.angle.max.to_degrees(), 2)),
    ("sum over joints, rad", |f| fixed(f.angle.sum_joints, 4)),
    ("vector, joint rad (compat)", |f| fixed(f.angle.vector_joint, 4)),
    ("vector, frame rad (compat)", |f| fixed(f.angle.vector_frame, 4)),
];

const BITS: &[Column] = &[
    ("row", |f| f.name().into()),
    ("order 0, bits/frame", |f| fixed(f.order0.bits_per_frame, 2)),
    ("bits/s", |f| fixed(f.order0.bits_per_second, 0)),
    ("as written, bits/frame", |f| fixed(f.order0.written_bits_per_frame, 2)),
    ("differences, bits/frame", |f| f.order0.difference_bits_per_frame.map_or("".into(), |b| fixed(b, 2))),
    ("MPJPE, mm", |f| fixed(f.mpjpe.global, 2)),
];

const BYTES: &[Column] = &[
    ("row", |f| f.name().into()),
    ("SMPL", |f| f.bytes.smpl.to_string()),
    ("characters", |f| f.bytes.characters.to_string()),
    ("UTF-8", |f| f.bytes.utf8.to_string()),
    ("alphabet and tables", |f| f.bytes.alphabet.to_string()),
    ("clipped values", |f| f.text.clipped.to_string()),
    ("second codes", |f| f.text.second_codes.to_string()),
    ("padded frames", |f| f.text.padded.to_string()),
    ("quantile bins left", |f| f.text.bins_left.map_or("".into(), |(a, b)| format!("{a} to {b}"))),
];

const SPEED: &[Column] = &[
    ("row", |f| f.name().into()),
    ("encode, frames/s", |f| fixed(f.speed.encode_frames, 0)),
    ("tokens/s", |f| fixed(f.speed.encode_tokens, 0)),
    ("decode, frames/s", |f| fixed(f.speed.decode_frames, 0)),
    ("tokens/s", |f| fixed(f.speed.decode_tokens, 0)),
    ("threads", |f| f.speed.threads.to_string()),
];

/// All tables of a report, each with a note on its columns.
pub fn tables(report: &Report) -> Vec<(ReportTable, &'static str)> {
    let of = |title: &str, note, columns: &[Column]| {
        let head = columns.iter().map(|c| c.0.into()).collect();
        let rows = report.rows.iter().map(|f| columns.iter().map(|c| c.1(f)).collect()).collect();
        (ReportTable { title: title.into(), head, rows }, note)
    };
    let mut tables = vec![
        of(
            "Text",
            "Words without their space, in tokens; characters are the tokens before merging. Tokens a second with spaces. \
             compat: spaces not counted. Factors: bytes of 75 f32 numbers a frame of the files over those of the text.",
            TEXT,
        ),
        of(
            "Errors",
            "Of the test clips at the row's own rate, the coded joints' angles, the places of all 24. Border jerk: 1 can't \
             be seen. compat: angles between rotation vectors, which see the direction of the axis alone.",
            ERRORS,
        ),
        of(
            "Bits",
            "Static tables fitted on train, measured on test. Order 0: a table a number of the word. As written: a table a \
             place (words of one length), else one over all tokens and the space.",
            BITS,
        ),
        of("Bytes", "Train and test together; clipped, second codes and padded in test.", BYTES),
        of("Speed", "In memory, all threads; not the same twice.", SPEED),
    ];
    tables.push(losses(report));
    tables
}

fn losses(report: &Report) -> (ReportTable, &'static str) {
    let row = |l: &super::Loss| {
        let joints = format!("{} joints at {} fps", l.joints.len(), short(l.fps));
        vec![joints, fixed(l.rate_mpjpe, 2), fixed(l.rate_angle.to_degrees(), 3), fixed(l.joints_mpjpe, 2)]
    };
    let note = "Rate: the row's rate brought back to the files' by slerp, against the files. Joints: those that are not coded \
                held straight, against the clip.";
    let head = ["", "rate, mm", "rate, mean deg", "joints, mm"].map(String::from).into();
    (ReportTable { title: "Lost before coding".into(), head, rows: report.losses.iter().map(row).collect() }, note)
}

/// The whole report in Markdown.
pub(crate) fn markdown(report: &Report) -> String {
    let mut text = format!("# Motion as text\n\n{TEXT_MARK}\n\n");
    for line in report.notes() {
        let _ = writeln!(text, "- {line}");
    }
    let pictures = "\n![angle error against bins](bins.png)\n\n![rate against distortion](rate.png)\n";
    text += pictures;
    for (table, note) in tables(report) {
        let _ = write!(text, "\n## {}\n\n{note}\n\n{}", table.title, table.markdown());
    }
    text
}

fn fixed(x: f64, digits: usize) -> String {
    format!("{x:.digits$}")
}

/// A rate with as few digits as say it.
pub(crate) fn short(x: f64) -> String {
    ((x * 1000.0).round() / 1000.0).to_string()
}
