//! LCM (Lightweight Communications and Marshalling), wire compatible, sans-IO core with a live transport.
#![forbid(unsafe_code)]

pub mod codec;
