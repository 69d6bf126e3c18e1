//! The page in a real browser.

mod music;
mod page;
mod panels;
mod paths;
mod probe;
mod survey;
mod words;

use std::path::PathBuf;

const BROWSERS: [&str; 5] =
    ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// A browser on the PATH, or `None` after a line on stderr that `test` was skipped.
fn browser(test: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let mut all = BROWSERS.iter().flat_map(|name| std::env::split_paths(&path).map(move |folder| folder.join(name)));
    let found = all.find(|p| p.is_file());
    if found.is_none() {
        kinelm_shared_data::skipped(test, "no chromium on the PATH");
    }
    found
}
