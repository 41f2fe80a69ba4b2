//! The replay against flights whose truth is known.

mod edges;
mod flights;
mod like_cases;
