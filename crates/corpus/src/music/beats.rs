//! Beats as a text file: one time in seconds per line, as `numpy.loadtxt` and mir_eval read it.

use crate::{Error, Result};
use kinelm_store::{FileRecord, SourcePos};
use std::fmt::Write;
use std::path::Path;

/// Begins every file of beats that kinelm writes.
pub const MARK: &str = "# made by kinelm";

/// Precedes the hash of the times in the first line.
const HASH: &str = "seconds, SHA-256 ";

/// Formats beats: a first line with [`MARK`], the name of the music and the hash of the times; the times to a millisecond.
pub fn text(times_s: &[f64], of: &Path) -> String {
    let name = of.file_name().map(|n| n.to_string_lossy().replace(char::is_control, " ")).unwrap_or_default();
    let mut times = String::new();
    for time in times_s {
        writeln!(times, "{time:.3}").expect("a string takes whatever is written");
    }
    format!("{MARK}: beats of {name}, {HASH}{}\n{times}", FileRecord::of(times.as_bytes()).sha256)
}

/// Whether a text is as [`text`] wrote it; beats that somebody has corrected are not.
pub fn is_as_written(text: &str) -> bool {
    let Some((head, times)) = text.split_once('\n') else { return false };
    let hash = head.strip_prefix(MARK).and_then(|head| head.rsplit_once(HASH));
    hash.is_some_and(|(_, hash)| hash == FileRecord::of(times.as_bytes()).sha256)
}

/// Parses beats: the first number of each line, in seconds, ascending; `#` begins a comment. Further numbers of a line, as
/// bar trackers write them, are ignored.
///
/// # Errors
/// [`kinelm_store::Error::File`] with line and column for text that is no time, a decimal comma, a time below 0, or one that
/// doesn't ascend.
pub fn parse(path: &Path, text: &str) -> Result<Vec<f64>> {
    let mut out: Vec<f64> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or("");
        let Some(word) = content.split([' ', '\t', ',', ';']).find(|w| !w.trim().is_empty()) else { continue };
        let column = 1 + line.find(word).map_or(0, |at| line[..at].chars().count());
        let at = SourcePos { path: path.into(), line: i + 1, column };
        let help = "give one time in seconds per line, in ascending order";
        if is_decimal_comma(&content[content.find(word).unwrap_or(0)..]) {
            let help = "write times with a point, or a space after the comma before the next number";
            return Err(Error::at(at, format!("{:?}", content.trim()), "a time with a decimal point", help));
        }
        let time: f64 = match word.trim().parse() {
            Ok(time) if (0.0..1e6).contains(&time) => time,
            _ => return Err(Error::at(at, format!("{word:?}"), "a time in seconds, not below 0", help)),
        };
        if let Some(last) = out.last().filter(|last| time <= **last) {
            return Err(Error::at(at, format!("{time} after {last}"), "a later time", help));
        }
        out.push(time);
    }
    Ok(out)
}

/// Whether a line begins with a number such as `12,5`: all of it would be read as a whole second.
fn is_decimal_comma(line: &str) -> bool {
    let rest = line.trim_start_matches(|c: char| c.is_ascii_digit());
    rest.len() < line.len() && rest.strip_prefix(',').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_beats_are_parsed() {
        let path = Path::new("a/song\n.mp3");
        let written = text(&[0.0, 0.5126, 1.0], path);
        let (head, times) = written.split_once('\n').unwrap();
        assert!(head.starts_with("# made by kinelm: beats of song .mp3, seconds, SHA-256 "), "{head}");
        assert_eq!(times, "0.000\n0.513\n1.000\n");
        assert!(is_as_written(&written) && !is_as_written(&written.replace("0.513", "0.520")));
        assert!(!is_as_written("") && !is_as_written("# made by kinelm: beats of a, seconds\n0.5\n"));
        assert_eq!(parse(path, &written).unwrap(), [0.0, 0.513, 1.0]);
        assert_eq!(parse(path, "1.5,1\n\n 2, 2 # two\n2.5\t3\n").unwrap(), [1.5, 2.0, 2.5]);
    }

    #[test]
    fn a_bad_time_is_refused_with_its_position() {
        let of = |text| parse(Path::new("b.txt"), text).unwrap_err().to_string();
        assert!(of("0.5\n  zwei\n").starts_with("b.txt:2:3: found \"zwei\", expected a time in seconds"));
        assert!(of("0.5\n-1\n").starts_with("b.txt:2:1: found \"-1\""));
        assert!(of("0.5\n 1,25\n").starts_with("b.txt:2:2: found \"1,25\", expected a time with a decimal point"));
        assert!(of("0,512\n1,024\n2,1\n").starts_with("b.txt:1:1: found \"0,512\""));
        assert!(of("NaN").starts_with("b.txt:1:1: found \"NaN\""));
        assert!(of("0.5\n0.5\n").starts_with("b.txt:2:1: found 0.5 after 0.5, expected a later time"));
    }
}
