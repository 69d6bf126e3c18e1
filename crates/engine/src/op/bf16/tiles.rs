//! The tiles of AMX.
//!
//! A tile register holds 16 rows of 64 bytes. One instruction adds the product of a tile of 16 x 32 bf16 and one of
//! 32 x 16, given as pairs of rows, to 16 x 16 sums in f32. Source: Intel, "Architecture Instruction Set Extensions
//! Programming Reference", chapter 3. The standard library has no stable intrinsics for them, so they are here as
//! instructions.
#![allow(unsafe_code)]

use std::sync::OnceLock;

/// Rows of a tile, and 32-bit words of a row.
pub(super) const SIDE: usize = 16;
/// Rows and columns of the sums that [`multiply`] computes: two tiles by two.
pub(super) const SQUARE: usize = 2 * SIDE;

/// Whether this processor multiplies bf16 tiles and the system lets this process use them. Requested once.
pub(super) fn are_there() -> bool {
    static THERE: OnceLock<bool> = OnceLock::new();
    *THERE.get_or_init(|| amx::is_on_the_cpu() && amx::is_permitted())
}

/// Right factors: `blocks` blocks of panels, each with the same `steps` for the panel that is meant.
#[derive(Clone, Copy)]
pub(super) struct Right<'a> {
    /// The panel's numbers in the first block, and all after them: a step is 16 pairs of rows of [`SQUARE`] words.
    pub words: &'a [u32],
    /// Steps of 32 rows in a block.
    pub steps: usize,
    /// Blocks, 1 or more.
    pub blocks: usize,
    /// Words from a block's panel to the same panel of the next block.
    pub stride: usize,
}

impl Right<'_> {
    /// Makes sure that a product of `rows` rows, 1 or more, reads and writes inside its slices alone.
    ///
    /// # Panics
    /// Slices that are too short; no steps.
    pub fn check(&self, c: &[f32], ldc: usize, rows: usize, a: &[u32], lda: usize) {
        let depth = self.blocks * self.steps * SIDE;
        assert!(self.blocks > 0 && self.steps > 0, "a product of no steps");
        assert!(ldc >= SQUARE && c.len() >= (rows - 1) * ldc + SQUARE, "sums of {rows} rows in {} numbers", c.len());
        assert!(a.len() >= (rows - 1) * lda + depth, "{rows} rows of {depth} pairs in {} words", a.len());
        let last = (self.blocks - 1) * self.stride + self.steps * SIDE * SQUARE;
        assert!(self.words.len() >= last, "{last} words of panels in {}", self.words.len());
    }
}

/// `c`, [`SQUARE`] columns and 16 or 32 rows, one every `ldc` numbers, becomes (or, with `add`, grows by) the product
/// of `a`, as many rows of bf16 pairs, one every `lda` words, and `right`.
///
/// # Panics
/// Slices that are too short; a processor for which [`are_there`] is false.
pub(super) fn multiply(c: &mut [f32], ldc: usize, rows: usize, a: &[u32], lda: usize, right: Right, add: bool) {
    assert!(are_there() && (rows == SIDE || rows == SQUARE), "{rows} rows of tiles");
    right.check(c, ldc, rows, a, lda);
    amx::CONFIGURED.with(|_| {
        // SAFETY: the tiles are there and permitted (asserted), this thread has configured them as 16 rows of 64 bytes
        // (`CONFIGURED` is alive), and every row that is read or written is inside its slice (asserted above).
        unsafe { amx::multiply(c.as_mut_ptr(), ldc, rows == SQUARE, a.as_ptr(), lda, right, add) }
    });
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx {
    use super::{Right, SIDE, SQUARE};
    use std::arch::asm;
    use std::arch::x86_64::{__cpuid_count, __get_cpuid_max};

    pub fn is_on_the_cpu() -> bool {
        let bits = (1 << 22) | (1 << 24); // amx-bf16 and amx-tile: leaf 7, EDX
        __get_cpuid_max(0).0 >= 7 && __cpuid_count(7, 0).edx & bits == bits
    }

    /// Requests the state of the tiles from Linux, 8 KB a thread, which a process has only on request.
    pub fn is_permitted() -> bool {
        const ARCH_PRCTL: i64 = 158;
        const REQUEST: i64 = 0x1023; // ARCH_REQ_XCOMP_PERM
        const TILES: i64 = 18; // XFEATURE_XTILEDATA
        let refused: i64;
        // SAFETY: arch_prctl with this request takes two numbers and touches no memory of ours; a kernel that doesn't know
        // it returns an error. The instruction overwrites rcx and r11, as said.
        unsafe {
            asm!("syscall", inlateout("rax") ARCH_PRCTL => refused, in("rdi") REQUEST, in("rsi") TILES,
                out("rcx") _, out("r11") _, options(nostack));
        }
        refused == 0
    }

    thread_local! {
        /// Alive while this thread's tiles are configured, until it ends.
        pub static CONFIGURED: Configured = Configured::new();
    }

    pub struct Configured;

    /// The operand of `ldtilecfg`: Intel's palette 1.
    #[repr(C, align(64))]
    struct Palette {
        palette: u8,
        start_row: u8,
        reserved: [u8; 14],
        bytes: [u16; 16],
        rows: [u8; 16],
    }

    impl Configured {
        fn new() -> Configured {
            let mut all = Palette { palette: 1, start_row: 0, reserved: [0; 14], bytes: [0; 16], rows: [0; 16] };
            all.bytes[..8].fill(64);
            all.rows[..8].fill(SIDE as u8);
            // SAFETY: only called after `are_there`; reads the 64 bytes of `all`, a valid palette.
            unsafe { asm!("ldtilecfg [{}]", in(reg) &all, options(nostack, readonly)) }
            Configured
        }
    }

    impl Drop for Configured {
        fn drop(&mut self) {
            // SAFETY: this thread has configured its tiles; without them a switch of threads saves 8 KB less.
            unsafe { asm!("tilerelease", options(nostack, nomem)) }
        }
    }

    /// # Safety
    /// Tiles that are there, permitted and configured by this thread; all rows inside what the pointers may touch.
    pub unsafe fn multiply(c: *mut f32, ldc: usize, two: bool, a: *const u32, lda: usize, right: Right, add: bool) {
        let (ldc, lda) = (4 * ldc, 4 * lda);
        let (steps, blocks, below) = (right.steps, right.blocks, right.words.as_ptr());
        // from after a block's last step to the panel in the next
        let skip = 4 * right.stride.wrapping_sub(steps * SIDE * SQUARE) as isize;
        // Sums of two tiles by two: four loads for four products, which is what the caches feed. One asm block from the
        // first load to the last store, since no tile may be assumed to live between two.
        macro_rules! kernel {
            ($load:literal, $store:literal, $product:literal) => {
                asm!(
                    "test {add}, {add}",
                    "jnz 20f",
                    "tilezero tmm0", "tilezero tmm1", "tilezero tmm2", "tilezero tmm3",
                    "jmp 21f",
                    "20:",
                    "tileloadd tmm0, [{c} + {ldc}*1]",
                    "tileloadd tmm1, [{c} + {ldc}*1 + 64]",
                    $load,
                    "21:",
                    "mov {left}, {steps}",
                    "22:",
                    "tileloadd tmm4, [{a} + {lda}*1]",
                    "tileloadd tmm6, [{b} + {ldb}*1]",
                    "tdpbf16ps tmm0, tmm4, tmm6",
                    "tileloadd tmm7, [{b} + {ldb}*1 + 64]",
                    "tdpbf16ps tmm1, tmm4, tmm7",
                    $product,
                    "add {a}, 64",
                    "add {a2}, 64",
                    "add {b}, 2048",
                    "dec {left}",
                    "jnz 22b",
                    // also after the last block, where b is read no more
                    "add {b}, {skip}",
                    "dec {blocks}",
                    "jnz 21b",
                    "tilestored [{c} + {ldc}*1], tmm0",
                    "tilestored [{c} + {ldc}*1 + 64], tmm1",
                    $store,
                    add = in(reg) usize::from(add),
                    c = in(reg) c,
                    c2 = in(reg) c.wrapping_byte_add(SIDE * ldc),
                    ldc = in(reg) ldc,
                    a = inout(reg) a => _,
                    a2 = inout(reg) a.wrapping_byte_add(SIDE * lda) => _,
                    lda = in(reg) lda,
                    b = inout(reg) below => _,
                    ldb = in(reg) 4 * SQUARE,
                    skip = in(reg) skip,
                    steps = in(reg) steps,
                    left = out(reg) _,
                    blocks = inout(reg) blocks => _,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                    options(nostack),
                )
            };
        }
        // SAFETY: the caller's promise; the loops touch `rows` rows of `c` and `a` and the steps of `right`, no more.
        unsafe {
            match two {
                true => kernel!(
                    "tileloadd tmm2, [{c2} + {ldc}*1]\ntileloadd tmm3, [{c2} + {ldc}*1 + 64]",
                    "tilestored [{c2} + {ldc}*1], tmm2\ntilestored [{c2} + {ldc}*1 + 64], tmm3",
                    "tileloadd tmm5, [{a2} + {lda}*1]\ntdpbf16ps tmm2, tmm5, tmm6\ntdpbf16ps tmm3, tmm5, tmm7"
                ),
                // an operand that no line names is an error: one row of tiles names {c2} in a comment
                false => kernel!("# {c2}", "", ""),
            }
        }
    }
}

#[cfg(not(all(target_arch = "x86_64", target_os = "linux")))]
mod amx {
    use super::Right;

    pub fn is_on_the_cpu() -> bool {
        false
    }

    pub fn is_permitted() -> bool {
        false
    }

    thread_local! {
        pub static CONFIGURED: () = ();
    }

    /// # Safety
    /// Never called: the tiles are not there.
    pub unsafe fn multiply(_: *mut f32, _: usize, _: bool, _: *const u32, _: usize, _: Right, _: bool) {}
}
