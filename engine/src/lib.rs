//! Transformer mathematics on the CPU: fused forward and backward passes over buffers that are allocated once, and
//! decoding a token at a time. It knows numbers and shapes, no motion, no files, no random generator.
//!
//! **Letters**: B batch, T tokens, D width, H heads, d = D/H, L layers, V vocabulary, N = B T rows. The last index is
//! the fastest. Matrices of weights are (in, out).
//!
//! **Threads**: every function works on the rayon pool that it is called in; call it inside `ThreadPool::install` to
//! choose one. Work falls into pieces by its shape alone and sums add up piece by piece, so the number of threads changes
//! no bit of any result.
//!
//! **Kernels** are written once, over vectors of any width ([`dispatch`]); which instructions they become is decided when
//! the program runs. Results agree between them to rounding.

pub mod arena;
pub mod block;
pub mod decode;
pub mod dispatch;
pub mod head;
pub mod op;
pub mod pieces;
pub mod scalar;
