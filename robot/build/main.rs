//! What the program takes into itself: the letters that `advee plot` draws, and the page that the web server serves.

mod letters;
mod page;

use std::path::Path;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=build");
    let folder = env::var("OUT_DIR").expect("cargo says where");
    let write = |name: &str, text: String| fs::write(Path::new(&folder).join(name), text).expect("there is room");
    write("letters.rs", letters::tables());
    write("page.rs", page::table(Path::new("../web")));
}
