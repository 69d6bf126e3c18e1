//! Memory for numbers, allocated once, in large pages where there are some.

use memmap2::MmapMut;
use std::fmt;
use std::ops::{Deref, DerefMut};

/// The payload with which a thread unwinds when it gets no memory, so that a program can catch and report it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoMemory {
    /// Bytes requested.
    pub bytes: usize,
}

impl fmt::Display for NoMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "there is none for {} bytes more", self.bytes)
    }
}

impl std::error::Error for NoMemory {}

/// A vector of fixed length, 0 at first, aligned to a page.
///
/// ```
/// use kinelm_engine::arena::Floats;
///
/// let mut numbers = Floats::new(3);
/// numbers[1] = 2.0;
/// assert_eq!(*numbers, [0.0, 2.0, 0.0]);
/// ```
///
/// # Panics
/// Making one unwinds with [`NoMemory`] where the system has no memory left.
#[derive(Debug)]
pub struct Floats {
    map: MmapMut,
    len: usize,
}

/// From this size on, large pages are requested.
const LARGE: usize = 1 << 20;

impl Floats {
    /// `len` zeros.
    pub fn new(len: usize) -> Floats {
        // mmap refuses a length of 0; one that doesn't fit a usize is refused as too much memory
        let bytes = len.saturating_mul(size_of::<f32>()).max(1);
        // without the panic hook: whoever catches it prints the message, and nothing else does
        let none = |_| std::panic::resume_unwind(Box::new(NoMemory { bytes }));
        let map = MmapMut::map_anon(bytes).unwrap_or_else(none);
        #[cfg(target_os = "linux")]
        if bytes >= LARGE {
            // fewer pages, fewer TLB misses; a kernel that refuses costs speed only
            let _ = map.advise(memmap2::Advice::HugePage);
        }
        Floats { map, len }
    }

    /// A copy of `numbers`.
    pub fn of(numbers: &[f32]) -> Floats {
        let mut floats = Floats::new(numbers.len());
        floats.copy_from_slice(numbers);
        floats
    }
}

impl Deref for Floats {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        bytemuck::cast_slice(&self.map[..self.len * size_of::<f32>()])
    }
}

impl DerefMut for Floats {
    fn deref_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.map[..self.len * size_of::<f32>()])
    }
}

impl Clone for Floats {
    fn clone(&self) -> Floats {
        Floats::of(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_there_is_no_memory_the_thread_unwinds_with_how_much_was_asked_for() {
        for len in [usize::MAX / 8, usize::MAX] {
            let caught = std::panic::catch_unwind(|| Floats::new(len).len()).unwrap_err();
            assert_eq!(caught.downcast_ref(), Some(&NoMemory { bytes: len.saturating_mul(4) }));
        }
    }

    #[test]
    fn floats_begin_at_zero_keep_what_they_get_and_lie_on_a_page() {
        for len in [0, 1, 1000, 1 << 19] {
            let mut floats = Floats::new(len);
            assert_eq!((floats.len(), floats.iter().any(|x| *x != 0.0)), (len, false));
            floats.fill(2.5);
            assert_eq!(&*floats.clone(), vec![2.5; len].as_slice());
            assert_eq!(floats.as_ptr() as usize % 4096, 0);
        }
    }
}
