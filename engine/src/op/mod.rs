//! The operations, each a safe function on slices that checks its shapes.
