//! Files that are read whole: only what is a file, and text that is text.

use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// The bytes of a file. Pipes and devices, which may have no end, are refused before they are opened.
///
/// # Errors
/// What is no file; what the system refuses.
pub fn bytes(path: &Path) -> Result<Vec<u8>> {
    check(path)?;
    fs::read(path)
}

/// The text of a file.
///
/// # Errors
/// As [`bytes`]; [`ErrorKind::InvalidData`] for bytes that are no UTF-8.
pub fn text(path: &Path) -> Result<String> {
    let no_text =
        |_| Error::new(ErrorKind::InvalidData, "found bytes that are no UTF-8, expected text; save it as UTF-8");
    String::from_utf8(bytes(path)?).map_err(no_text)
}

/// Refuses pipes and devices; a folder's own error says that it is one.
///
/// # Errors
/// What is no file; what the system refuses.
pub fn check(path: &Path) -> Result<()> {
    let kind = fs::metadata(path)?;
    match kind.is_file() || kind.is_dir() {
        true => Ok(()),
        false => Err(Error::other("found a pipe or a device, expected a file; save what it gives as a file first")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_file_and_what_is_no_text_is_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bvh");
        fs::write(&path, b"a\xff").unwrap();
        assert_eq!(bytes(&path).unwrap(), b"a\xff");
        let e = text(&path).unwrap_err();
        assert!(e.kind() == ErrorKind::InvalidData && e.to_string().contains("no UTF-8"), "{e}");
        assert_eq!(bytes(&dir.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
        assert!(bytes(dir.path()).is_err());
        if cfg!(unix) {
            // with no end
            assert!(bytes(Path::new("/dev/zero")).unwrap_err().to_string().contains("expected a file"));
        }
    }
}
