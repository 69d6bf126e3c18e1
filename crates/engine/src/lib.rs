//! Transformer and LSTM mathematics on the CPU: fused forward and backward passes over buffers that are allocated once,
//! and decoding a token at a time. It knows numbers and shapes, no motion, no files, no random generator.
//!
//! **Letters**: B batch, T tokens, D width, H heads, d = D/H, L layers, V vocabulary, N = B T rows. The last index is
//! the fastest. Matrices of weights are (in, out).
//!
//! **Threads**: every function works on the rayon pool that it is called in; call it inside `ThreadPool::install` to
//! choose one. What is summed falls into pieces by its shape alone and adds up piece by piece, so the number of threads
//! changes no bit of any result. Workspaces hold scratch memory for each thread of the pool that they are made in.
//!
//! **The seam.** The engine stands beside the tensor library's autograd, not inside it: a model calls `forward` and then
//! `backward` of each part ([`block`], [`head`], [`op::embedding`]) itself. Behind a custom operation of the library every
//! part would still have to hand over new tensors for its output and for each gradient, which the library then adds into
//! more new tensors; that memory, not arithmetic, took most of a step. Explicit passes write into buffers that belong to
//! the caller, and a block's backward can run the attention beside the products that don't wait for it. The price, a
//! backward pass by hand, is paid once: every model is made of the same blocks.
//!
//! **Kernels** are written once, over vectors of any width ([`dispatch`]); which instructions they become is decided when
//! the program runs. Results agree between them to rounding.

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
pub mod pieces;
pub mod scalar;

/// The examples of the README are tested with those of the code.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
