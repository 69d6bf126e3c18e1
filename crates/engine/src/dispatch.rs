//! The choice of vector instructions, made once, when the program runs.
//!
//! A kernel is a struct of its operands that implements [`pulp::WithSimd`]: `with_simd` holds the loop, generic over the
//! width of a vector, and [`run`] calls the instance for AVX-512, AVX2, NEON or plain floats. The environment variable
//! `KINELM_KERNELS=portable`, `=avx2`, `=avx512`, `=bf16` or `=amx` limits the choice, to compare or to find an error; instructions that
//! the CPU lacks are never used.

use pulp::{Arch, WithSimd};
use std::sync::OnceLock;

/// Runs a kernel with the best instructions of this CPU.
#[inline]
pub fn run<Op: WithSimd>(op: Op) -> Op::Output {
    arch().dispatch(op)
}

/// The environment variable that limits the kernels.
pub const VARIABLE: &str = "KINELM_KERNELS";
/// The values of [`VARIABLE`]; `auto` is no limit, `bf16` is AVX-512 with AVX512-BF16.
pub const NAMES: [&str; 6] = ["auto", "amx", "bf16", "avx512", "avx2", "portable"];

/// The name of the instructions in use: `avx512`, `avx2`, `neon` or `portable`.
///
/// ```
/// assert!(["avx512", "avx2", "neon", "portable"].contains(&kinelm_engine::dispatch::name()));
/// ```
pub fn name() -> &'static str {
    match arch() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V4(_) => "avx512",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V3(_) => "avx2",
        #[cfg(target_arch = "aarch64")]
        Arch::Neon(_) => "neon",
        _ => "portable",
    }
}

/// Whether the tiles of AMX may be used where there are some.
pub(crate) fn may_use_tiles() -> bool {
    matches!(std::env::var(VARIABLE).as_deref(), Err(_) | Ok("auto" | "amx"))
}

/// Whether AVX512-BF16 may be used where it is.
pub(crate) fn may_use_dots() -> bool {
    may_use_tiles() || std::env::var(VARIABLE).as_deref() == Ok("bf16")
}

pub(crate) fn arch() -> Arch {
    // once: panels are packed for the width of its vectors
    static ARCH: OnceLock<Arch> = OnceLock::new();
    *ARCH.get_or_init(|| chosen(std::env::var(VARIABLE).ok().as_deref()))
}

fn chosen(requested: Option<&str>) -> Arch {
    match requested {
        Some("portable") => Arch::Scalar,
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Some("avx2") => pulp::x86::V3::try_new().map_or(Arch::Scalar, Arch::V3),
        // `avx512`, `bf16` and `amx` limit nothing here: the latter two add instructions beside pulp's vectors
        _ => Arch::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_than_the_cpu_has_can_be_asked_for() {
        assert!(matches!(chosen(Some("portable")), Arch::Scalar));
        assert!(["avx512", "avx2", "neon", "portable"].contains(&name()));
        #[cfg(target_arch = "x86_64")]
        assert!(!matches!(chosen(Some("avx2")), Arch::V4(_)));
    }
}
