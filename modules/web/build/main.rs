//! Takes the page of the web diagnostic center into the program.

mod page;

use std::path::Path;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=build");
    let folder = env::var("OUT_DIR").expect("cargo sets it for build scripts");
    let table = page::table(Path::new("page"));
    fs::write(Path::new(&folder).join("page.rs"), table).expect("OUT_DIR can be written");
}
