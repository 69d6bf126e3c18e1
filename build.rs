//! The commit that the program is built from, for what runs say of themselves.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-env-changed=KINELM_COMMIT");
    let git = |args: &[&str]| {
        let output = Command::new("git").args(args).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    };
    // of a package without its history, or in another project's checkout, none is known
    let own = git(&["ls-files", "--error-unmatch", "build.rs"]).is_some();
    let commit = std::env::var("KINELM_COMMIT").ok().or_else(|| git(&["rev-parse", "HEAD"]).filter(|_| own));
    if let Some(commit) = commit {
        println!("cargo:rustc-env=KINELM_COMMIT={commit}");
    }
    // where HEAD, and the branch that it names, change
    let paths = [git(&["rev-parse", "--git-path", "HEAD"]), git(&["rev-parse", "--git-path", "logs/HEAD"])];
    for path in paths.into_iter().flatten().filter(|path| Path::new(path).exists()) {
        println!("cargo:rerun-if-changed={path}");
    }
    println!("cargo:rerun-if-changed=build.rs");
}
