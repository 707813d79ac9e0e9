//! Encoding and decoding of messages: what generated code calls.
