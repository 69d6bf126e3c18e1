//! The memory still available to this process within the system, its control groups and its own limits.
//!
//! Limits: an estimate at one moment, which other processes may take; nothing is known without `/proc`, that is outside
//! Linux.
//!
//! Sources: proc(5) (`meminfo`, `limits`, `status`), the kernel's documentation of control groups, versions 1 and 2.

use crate::{Error, Result};
use std::fs;
use std::path::Path;

/// Bytes available to this process; `None` when unknown.
pub fn free() -> Option<u64> {
    let system = read("/proc/meminfo").and_then(|text| kilobytes(&text, "MemAvailable:"));
    let own =
        read("/proc/self/limits").zip(read("/proc/self/status")).and_then(|(limits, status)| own(&limits, &status));
    let groups = read("/proc/self/cgroup").and_then(|text| groups(&text, Path::new("/sys/fs/cgroup")));
    // the tightest counts; one that can't be read says nothing
    [system, own, groups].into_iter().flatten().min()
}

/// Refuses, before it begins, work that needs more than the available memory.
///
/// # Errors
/// [`Error::Limit`] with the needed and the available memory; never when the latter is unknown.
pub fn check(needed: u128, what: &str, help: &str) -> Result<()> {
    free().map_or(Ok(()), |free| compare(needed, free.into(), what, help))
}

fn compare(needed: u128, free: u128, what: &str, help: &str) -> Result<()> {
    if needed <= free {
        return Ok(());
    }
    let (needed, free) =
        (format!("about {} of memory", in_words(needed)), format!("the {} that are free", in_words(free)));
    Err(Error::limit(what, needed, free, help))
}

fn in_words(bytes: u128) -> String {
    let bytes = bytes as f64;
    if bytes < 1e9 { format!("{:.0} MB", bytes / 1e6) } else { format!("{:.1} GB", bytes / 1e9) }
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    fs::read_to_string(path).ok()
}

/// Bytes of the line that begins with `key` and is in kilobytes.
fn kilobytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Bytes left by the limits of the process (`ulimit -v`, `ulimit -d`).
fn own(limits: &str, status: &str) -> Option<u64> {
    let left = |limit: &str, used: &str| {
        let line = limits.lines().find_map(|line| line.strip_prefix(limit))?;
        let most: u64 = line.split_whitespace().next()?.parse().ok()?; // "unlimited" doesn't parse
        Some(most.saturating_sub(kilobytes(status, used)?))
    };
    [left("Max address space", "VmSize:"), left("Max data size", "VmData:")].into_iter().flatten().min()
}

/// Bytes left by the nested control groups of the process; `text` is `/proc/self/cgroup`.
fn groups(text: &str, root: &Path) -> Option<u64> {
    let mut least = None;
    for line in text.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(kinds), Some(group)) = (parts.next(), parts.next()) else { continue };
        let (root, names) = match kinds {
            "" => (root.to_path_buf(), ["memory.max", "memory.current", "inactive_file "]),
            kinds if kinds.split(',').any(|kind| kind == "memory") => {
                // version 1 has a hierarchy of folders for each kind, and without a limit a number near 2^63
                let names = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "];
                (root.join("memory"), names)
            }
            _ => continue,
        };
        // in a container the group may have its outer name, for which there is no folder
        let group = root.join(group.trim_start_matches('/'));
        // every group above limits this one too
        let all = group.ancestors().take_while(|folder| folder.starts_with(&root));
        least = all.filter_map(|folder| left_in(folder, names)).chain(least).min();
    }
    least
}

/// Bytes left in one group; inactive file cache counts as free.
fn left_in(folder: &Path, [limit, used, unused]: [&str; 3]) -> Option<u64> {
    let number = |name: &str| read(folder.join(name))?.trim().parse::<u64>().ok();
    let stat = read(folder.join("memory.stat")).unwrap_or_default();
    let files = stat.lines().find_map(|line| line.strip_prefix(unused)?.trim().parse::<u64>().ok());
    // "max" is no number: such a group has no limit
    Some(number(limit)?.saturating_sub(number(used)?.saturating_sub(files.unwrap_or(0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_limits_of_a_process_leave() {
        let status = "Name:\tkinelm\nVmSize:\t    1000 kB\nVmData:\t     400 kB\n";
        let limits = |space: &str, data: &str| {
            let head = "Limit                     Soft Limit           Hard Limit           Units\n";
            format!(
                "{head}Max address space         {space}  unlimited  bytes\nMax data size             {data}  unlimited  bytes\n"
            )
        };
        assert_eq!(own(&limits("unlimited", "unlimited"), status), None);
        assert_eq!(own(&limits("1048576", "unlimited"), status), Some(1048576 - 1024000));
        assert_eq!(own(&limits("9048576", "500000"), status), Some(500000 - 409600));
        assert_eq!(own(&limits("5", "unlimited"), status), Some(0));
        assert_eq!(kilobytes("MemTotal: 3 kB\nMemAvailable:   2 kB\n", "MemAvailable:"), Some(2048));
    }

    #[test]
    fn what_control_groups_leave() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let left = |text: &str| groups(text, dir.path());
        assert_eq!(left("0::/\n"), None);
        write("a/memory.max", "1000\n");
        write("a/memory.current", "700\n");
        write("a/memory.stat", "anon 1\ninactive_file 200\n");
        write("a/b/memory.max", "max\n");
        write("a/b/memory.current", "5\n");
        // the group itself has no limit, the one around it has
        assert_eq!(left("0::/a/b\n"), Some(500));
        assert_eq!(left("0::/gone/elsewhere\n"), None);
        write("memory/c/memory.limit_in_bytes", "900\n");
        write("memory/c/memory.usage_in_bytes", "800\n");
        assert_eq!(left("3:cpu:/c\n2:cpuset,memory:/c\n0::/a\n"), Some(100));
    }

    #[test]
    fn what_does_not_fit_is_told() {
        compare(5, 5, "a dance", "").unwrap();
        let message = |needed, free| compare(needed, free, "a dance", "make it shorter").unwrap_err().to_string();
        let expected = "a dance takes about 3.0 GB of memory, the limit is the 500 MB that are free; make it shorter";
        assert_eq!(message(3_000_000_000, 500_000_000), expected);
    }

    #[test]
    fn this_system_tells() {
        assert!(free().is_none_or(|bytes| bytes > 1 << 20), "{:?}", free());
    }
}
