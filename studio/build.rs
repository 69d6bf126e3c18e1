//! The table of the page's files: all of `web/`, compiled in, so that a file is there by being there.

use std::fmt::Write;
use std::path::{Path, PathBuf};

fn main() {
    let root = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let web = root.join("web");
    println!("cargo::rerun-if-changed={}", web.display());
    let mut files: Vec<PathBuf> = std::fs::read_dir(&web).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.sort();
    let mut table = String::from("/// The files of `web/` by name.\nstatic WEB: &[(&str, &[u8])] = &[\n");
    for file in files.iter().filter(|file| is_served(file)) {
        println!("cargo::rerun-if-changed={}", file.display());
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let _ = writeln!(table, "    ({name:?}, include_bytes!({:?})),", file.display().to_string());
    }
    table.push_str("];\n");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default()).join("web.rs");
    if let Err(e) = std::fs::write(&out, table) {
        println!("cargo::error={}: {e}", out.display());
    }
}

/// What a page loads; not the settings of those who write it.
fn is_served(file: &Path) -> bool {
    let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
    file.is_file() && ["html", "js", "css", "svg", "png", "woff2"].contains(&extension)
}
