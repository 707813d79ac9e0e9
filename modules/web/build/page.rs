//! Takes the page of the web diagnostic center into the program, as `make web` has built and packed it.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// A table of the files under `page/dist`; empty where they have not been built.
pub fn table(web: &Path) -> String {
    let dist = web.join("dist");
    // Cargo takes a file that is not there for changed, each time; a folder that gets one is changed once.
    let watched = if dist.is_dir() { &dist } else { web };
    println!("cargo::rerun-if-changed={}", watched.display());
    let mut files = Vec::new();
    collect(&dist, &mut files);
    files.sort();
    let mut out = "pub static FILES: &[File] = &[\n".to_owned();
    for packed in files {
        let path = packed.strip_prefix(&dist).expect("it was found there").with_extension("");
        let path = path.to_str().expect("names that the page has").to_owned();
        let bytes = fs::read(&packed).expect("it was found");
        // What gzip says of itself (RFC 1952, 2.3.1): the check and the length of what is packed.
        let tag = bytes.last_chunk::<8>().map(|tail| u64::from_le_bytes(*tail)).expect("a gzip file");
        let full = packed.canonicalize().expect("it was found");
        let (kind, hashed) = (content_type(&path), path.starts_with("assets/"));
        writeln!(
            out,
            "    File {{ path: {:?}, content_type: {kind:?}, hashed: {hashed}, tag: \"\\\"{tag:016x}\\\"\", \
            packed: include_bytes!({full:?}) }},",
            format!("/{path}"),
        )
        .expect("a text takes text");
    }
    out + "];\n"
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match path.is_dir() {
            true => collect(&path, files),
            false if path.extension().is_some_and(|extension| extension == "gz") => files.push(path),
            false => {}
        }
    }
}

fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "webmanifest" => "application/manifest+json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "woff2" => "font/woff2",
        _ => "application/octet-stream",
    }
}
