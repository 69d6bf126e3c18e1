//! Content sniffing: what a file is when it is not what its name says.

/// Describes the kind of a file's content, for messages.
pub(crate) fn sniff(bytes: &[u8]) -> &'static str {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let start = text.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(text.len());
    let head: Vec<u8> = text[start..].iter().take(64).map(u8::to_ascii_lowercase).collect();
    let starts = |p: &[u8]| head.starts_with(p);
    if bytes.is_empty() {
        "an empty file"
    } else if head.is_empty() {
        "a file of blanks"
    } else if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06") {
        let first = &bytes[..bytes.len().min(400)];
        if first.windows(4).any(|w| w == b".npy") { "an npz archive" } else { "a zip archive" }
    } else if bytes.starts_with(b"\x93NUMPY") {
        "an npy array"
    } else if starts(b"kaydara fbx") || starts(b"; fbx") {
        "an FBX file"
    } else if starts(b"version https://git-lfs") {
        "a Git LFS pointer (the file itself was not fetched: git lfs pull)"
    } else if starts(b"<!doctype html") || starts(b"<html") {
        "an HTML page"
    } else if starts(b"<?xml") {
        "an XML file"
    } else if bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
        "UTF-16 text (save it as UTF-8)"
    } else if bytes.starts_with(b"\x1F\x8B") {
        "a gzip archive"
    } else if bytes.starts_with(b"glTF") {
        "a glTF file"
    // protocols 0 and 1 have no magic and pass as text or binary data
    } else if bytes[0] == 0x80 && bytes.get(1).is_some_and(|&p| (2..=5).contains(&p)) {
        "a pickle"
    } else if starts(b"hierarchy") {
        "a BVH"
    } else if starts(b":asf") || starts(b":version") {
        "an ASF skeleton"
    } else if starts(b":fully-specified") || starts(b"#!omf") {
        "an AMC motion"
    } else if starts(b"{") || starts(b"[") {
        "JSON"
    } else if bytes.iter().take(512).any(|&b| b == 0) {
        "binary data"
    } else {
        "text"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_are_named() {
        for (bytes, want) in [
            (&b""[..], "empty"),
            (b"PK\x03\x04....poses.npy", "npz"),
            (b"PK\x03\x04", "zip"),
            (b"Kaydara FBX Binary", "FBX"),
            (b"\n<!DOCTYPE html>", "HTML"),
            (b"version https://git-lfs.github.com/spec/v1", "LFS"),
            (b"\x80\x04\x95", "pickle"),
            (b"\xFF\xFEH\0", "UTF-16"),
            (b"\0\x01\x02", "binary"),
            (b"hello", "text"),
        ] {
            assert!(sniff(bytes).contains(want), "{want}: {}", sniff(bytes));
        }
    }
}
