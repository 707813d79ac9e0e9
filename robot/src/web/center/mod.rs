//! The diagnostic center in a browser: what page and server say to each other stands in `web/src/protocol.ts`.

pub mod access;
