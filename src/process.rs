//! What the allocator and the tensor library read from the environment when a program starts.
//!
//! Neither has another switch, and the defaults slow down whatever the plain form computes on the CPU:
//! - The tensor library shares its sums out over threads that spin while they wait.
//! - Where the number of threads is not set, it asks the system for it at every product: some 45 microseconds each time,
//!   most of the time of reading one token with a tiny model.
//! - glibc gives every large tensor's memory back to the system and takes it anew.

/// What is set where the user has set nothing.
fn wanted() -> [(&'static str, String); 5] {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    [
        ("CANDLE_NUM_THREADS", "1".into()),
        ("RAYON_NUM_THREADS", threads.to_string()),
        ("MALLOC_MMAP_THRESHOLD_", (8u64 << 30).to_string()),
        ("MALLOC_TRIM_THRESHOLD_", (8u64 << 30).to_string()),
        ("MALLOC_TOP_PAD_", (256u64 << 20).to_string()),
    ]
}

fn missing(is_set: impl Fn(&str) -> bool) -> Vec<(&'static str, String)> {
    wanted().into_iter().filter(|(name, _)| !is_set(name)).collect()
}

/// Starts this program again, in its own place, with what is missing from the environment. Commands that train or
/// generate call it first thing; where nothing is missing, or the system won't, it returns and all goes on as it is,
/// slower but with the same results.
pub fn restart_tuned() {
    let missing = missing(|name| std::env::var_os(name).is_some());
    if missing.is_empty() {
        return;
    }
    #[cfg(unix)]
    if let Ok(program) = std::env::current_exe() {
        use std::os::unix::process::CommandExt;
        use std::process::Command;
        let mut arguments = std::env::args_os();
        let mut command = Command::new(program);
        if let Some(name) = arguments.next() {
            command.arg0(name);
        }
        // returns only if it failed
        let _ = command.args(arguments).envs(missing).exec();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_user_has_set_stays_and_a_second_start_finds_nothing_missing() {
        let names: Vec<_> = missing(|name| name == "RAYON_NUM_THREADS").into_iter().map(|(n, _)| n).collect();
        assert!(names.len() == 4 && !names.contains(&"RAYON_NUM_THREADS"), "{names:?}");
        assert!(missing(|_| true).is_empty());
    }
}
