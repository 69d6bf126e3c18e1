//! The pages a reader meets: their links lead somewhere, their lines fit a screen, the code cites pages that are here.

use kinelm_motion::rig::SkeletonMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Characters of a line outside tables, code blocks and lines with a link.
const WIDTH: usize = 120;

/// Text files of the repository by what their names end in: those that git knows, so that what somebody made beside them
/// is no page. None, with a word, where this is no git checkout.
fn files(endings: &[&str]) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let Some(listed) =
        Command::new("git").args(["ls-files", "-z"]).current_dir(root).output().ok().filter(|o| o.status.success())
    else {
        kinelm_shared_data::skipped("docs", "git lists no files here");
        return Vec::new();
    };
    let names = String::from_utf8(listed.stdout).unwrap();
    let is_golden = |name: &str| name.split('/').any(|folder| folder == "golden");
    let wanted = |name: &&str| endings.iter().any(|e| name.ends_with(e)) && !is_golden(name);
    // a file that is deleted and not yet committed is listed too
    names.split('\0').filter(wanted).map(|name| root.join(name)).filter(|path| path.is_file()).collect()
}

#[test]
fn pages_are_those_that_git_knows() {
    let pages = files(&[".md"]);
    assert!(pages.is_empty() || pages.iter().any(|page| page.ends_with("README.md")), "{pages:?}");
    assert!(!pages.iter().any(|page| page.ends_with("demo/report.md")), "{pages:?}");
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A page's lines with their numbers, without its blocks of code.
fn prose(page: &str) -> Vec<(usize, &str)> {
    let mut code = false;
    let outside = page.lines().enumerate().filter(|(_, line)| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        !code && !fence
    });
    outside.map(|(i, line)| (i + 1, line)).collect()
}

/// A heading as the anchor of a link, the way GitHub writes it.
fn anchor(heading: &str) -> String {
    let heading = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(page: &str) -> Vec<String> {
    prose(page).iter().filter(|(_, line)| line.starts_with('#')).map(|(_, line)| anchor(line)).collect()
}

/// What the links of a line point to.
fn links(line: &str) -> Vec<&str> {
    line.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect()
}

#[test]
fn relative_links_lead_somewhere() {
    let mut broken = Vec::new();
    for page in files(&[".md"]) {
        for (number, line) in prose(&text(&page)) {
            for link in links(line).into_iter().filter(|link| !link.contains("://")) {
                let (path, section) = link.split_once('#').unwrap_or((link, ""));
                let target = if path.is_empty() { page.clone() } else { page.parent().unwrap().join(path) };
                let there =
                    target.exists() && (section.is_empty() || anchors(&text(&target)).contains(&section.into()));
                if !there {
                    broken.push(format!("{}:{number}: {link}", page.display()));
                }
            }
        }
    }
    assert!(broken.is_empty(), "links to nowhere:\n{}", broken.join("\n"));
}

#[test]
fn lines_of_pages_are_short() {
    let mut long = Vec::new();
    for page in files(&[".md"]).iter().filter(|page| !page.ends_with("CHANGELOG.md")) {
        for (number, line) in prose(&text(page)) {
            let free = line.starts_with('|') || line.starts_with('!') || line.contains("](");
            if !free && line.chars().count() > WIDTH {
                long.push(format!("{}:{number}: {} characters", page.display(), line.chars().count()));
            }
        }
    }
    assert!(long.is_empty(), "lines of more than {WIDTH} characters:\n{}", long.join("\n"));
}

/// README is the way in; what comes later replaces something in it or goes to a manual.
#[test]
fn readme_is_short() {
    let lines = include_str!("../README.md").lines().count();
    assert!(lines <= 180, "README.md has {lines} lines; at most 180, the manuals in docs/ have the rest");
}

#[test]
fn cited_pages_and_sections_are_in_the_repository() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    // written apart, for this file is looked at as well
    let elsewhere = [concat!("PROTO", "COLS "), concat!("DESIGN", ".md"), concat!("STYLE", ".md")];
    let mut wrong = Vec::new();
    for file in files(&[".rs", ".py", ".sh", ".toml", ".js", ".html", ".md", "run"]) {
        // a citation may go over a line of comment
        let starts = ['/', '!', '#', ' '];
        let text: Vec<String> = text(&file).lines().map(|l| l.trim().trim_start_matches(starts).to_owned()).collect();
        let text = text.join(" ");
        for name in elsewhere.iter().filter(|name| text.contains(**name)) {
            wrong.push(format!("{}: cites {name}, which is not in the repository", file.display()));
        }
        for (at, _) in text.match_indices("docs/") {
            let Some((page, rest)) = text[at..].split_once(".md") else { continue };
            if page.contains(|c: char| !(c.is_ascii_alphanumeric() || "-_/".contains(c))) {
                continue;
            }
            let path = root.join(format!("{page}.md"));
            if !path.exists() {
                wrong.push(format!("{}: {page}.md is not there", file.display()));
            } else if let Some((section, _)) = rest.strip_prefix(", \"").and_then(|rest| rest.split_once('"'))
                && !anchors(&fs::read_to_string(&path).unwrap()).contains(&anchor(section))
            {
                wrong.push(format!("{}: {page}.md has no section \"{section}\"", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `crates/store/src/input.rs` refuses pipes and devices and keeps what was read: what opens files by itself does neither.
#[test]
fn inputs_are_opened_in_one_place() {
    // folders, what the system tells of itself, sound, whose crate knows no other and refuses pipes itself, a file that was
    // just written
    let own = [
        "crates/music/src/read.rs",
        "crates/store/src/files.rs",
        "crates/store/src/input.rs",
        "crates/store/src/memory.rs",
        "crates/store/src/part.rs",
        "crates/spectral/src/query/build.rs",
        "crates/spectral/src/query/writer.rs",
    ];
    let opens = ["File::open(", "fs::read(", "fs::read_to_string("];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for path in files(&[".rs"]) {
        let name = path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
        let is_code = ["src/", "crates/", "tokenizer/src/"];
        let is_test = name.ends_with("tests.rs") || name.contains("/tests/") || own.contains(&&*name);
        if is_test || !is_code.iter().any(|folder| name.starts_with(folder)) {
            continue;
        }
        let text = text(&path);
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        let found =
            code.lines().position(|line| opens.iter().any(|open| line.replace("ArrayFile::", "").contains(open)));
        assert!(found.is_none(), "{name}:{}: open it by kinelm_store::input", found.unwrap_or_default() + 1);
    }
}

#[test]
fn the_examples_of_the_manual_of_skeletons_are_maps() {
    let page = include_str!("../docs/skeletons.md");
    let blocks: Vec<_> = page.split("```toml\n").skip(1).filter_map(|b| b.split("```").next()).collect();
    let map = SkeletonMap::parse(&blocks.concat(), Path::new("docs/skeletons.md")).unwrap();
    assert_eq!((map.name.as_str(), map.joint(9), map.reference().count()), ("my-rig", Some("Chest"), 2));
}
