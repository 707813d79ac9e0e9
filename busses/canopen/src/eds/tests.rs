//! The files of others, and what they taught.
