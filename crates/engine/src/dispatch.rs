//! Which vector instructions the kernels become, decided once, when the program runs.
//!
//! A kernel is a struct of its operands that implements [`pulp::WithSimd`]: `with_simd` holds the loop, generic over the
//! width of a vector, and [`run`] calls the instance for AVX-512, AVX2, NEON or plain floats. The environment variable
//! `KINELM_KERNELS=portable`, `=avx2`, `=avx512` or `=amx` asks for no more than that, to compare or to look for an error; what the
//! CPU does not have is not used, whatever it says.

use pulp::{Arch, WithSimd};
use std::sync::OnceLock;

/// Runs a kernel with the best instructions of this CPU.
#[inline]
pub fn run<Op: WithSimd>(op: Op) -> Op::Output {
    arch().dispatch(op)
}

/// The variable that asks for kernels, and the names it may have.
pub const VARIABLE: &str = "KINELM_KERNELS";
/// See [`VARIABLE`]; `auto` is as if it were not set.
pub const NAMES: [&str; 5] = ["auto", "amx", "avx512", "avx2", "portable"];

/// The name of the instructions in use: `avx512`, `avx2`, `neon` or `portable`.
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

fn arch() -> Arch {
    static ARCH: OnceLock<Arch> = OnceLock::new();
    *ARCH.get_or_init(|| chosen(std::env::var(VARIABLE).ok().as_deref()))
}

fn chosen(asked: Option<&str>) -> Arch {
    match asked {
        Some("portable") => Arch::Scalar,
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Some("avx2") => pulp::x86::V3::try_new().map_or(Arch::Scalar, Arch::V3),
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
