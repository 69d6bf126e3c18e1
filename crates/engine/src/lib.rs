//! Transformer and LSTM mathematics on the CPU: fused forward and backward passes over buffers that are allocated once,
//! and incremental decoding. It knows numbers and shapes, no motion, no files, no random generator.
//!
//! **Letters**: B batch, T tokens, D width, H heads, d = D/H, L layers, V vocabulary, N = B T rows. The last index is
//! the fastest. Matrices of weights are (in, out).
//!
//! **Threads**: every function works on the rayon pool that it is called in; call it inside `ThreadPool::install` to
//! choose one. Sums are cut into pieces by shape alone and add up piece by piece, so the number of threads changes no bit of
//! any result. Workspaces hold scratch memory for each thread of the pool that they are made in.
//!
//! **Explicit passes.** The engine works beside the tensor library's autograd, not inside it: a model calls `forward`
//! and then `backward` of each part ([`block`], [`head`], [`op::embedding`]) itself. As custom operations of the
//! library the parts would allocate new tensors for every output and gradient; that memory, not arithmetic, took most
//! of a step. Explicit passes write into the caller's buffers, and a block's backward pass runs the attention beside
//! the products that don't wait for it. The price, a backward pass by hand, is paid once: every model is made of the
//! same blocks.
//!
//! **Kernels** are written once, over vectors of any width; [`dispatch`] picks their instructions when the program runs.
//! Results agree between them to rounding.

pub mod arena;
pub mod bins;
pub mod block;
pub mod decode;
pub mod dense;
pub mod dispatch;
mod element;
pub mod head;
pub mod linear;
pub mod lstm;
pub mod op;
mod per_thread;
mod pieces;
#[cfg(test)]
mod scalar;

/// The examples of the README are tested with those of the code.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
