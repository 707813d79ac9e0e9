//! `advee lcm gen` as used from the shell.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// Temporary folder, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-lcm-gen-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, text: &str) -> String {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().into()
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().into()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Exit code, stdout, stderr.
fn generate(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_advee")).args(["lcm", "gen"]).args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

const POINT: &str = "package demo.geom;\n\n// A place, m.\nstruct point_t { double x, y; string name; }\n";

#[test]
fn a_file_becomes_code_on_stdout() {
    let folder = Folder::new("stdout");
    let (code, out, err) = generate(&[&folder.file("point_t.lcm", POINT)]);
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(out.contains("/// A place, m.") && out.contains("pub struct Point {"), "{out}");
    assert!(!out.contains("serde") && !out.contains("PointRef"), "{out}");
    let (_, out, _) = generate(&[&folder.path("point_t.lcm"), "--views", "--serde", "both"]);
    assert!(out.contains("pub struct PointRef<'a> {") && out.contains("::serde::Deserialize"), "{out}");
}

#[test]
fn a_folder_becomes_a_file_or_a_file_for_each_package() {
    let folder = Folder::new("folder");
    folder.file("types/a/point_t.lcm", POINT);
    folder.file("types/line_t.lcm", "struct line_t { demo.geom.point_t ends[2]; }");
    let (types, one, many) = (folder.path("types"), folder.path("new/types.rs"), folder.path("many"));
    let (code, out, err) = generate(&[&types, "--out", &one]);
    assert_eq!((code, err.as_str(), out.lines().next()), (0, "", Some(format!("{one}: 2 types").as_str())));
    assert!(out.contains("official lcm-gen") && out.contains("-c|-x|-p|-j"), "{out}");
    assert_eq!(generate(&[&types, "--out", &many]).0, 0);
    let read = |name: &str| fs::read_to_string(format!("{many}/{name}")).unwrap();
    assert!(read("mod.rs").contains("pub mod demo;") && read("mod.rs").contains("pub struct Line {"));
    assert!(read("demo.rs").contains("pub mod geom {"));
    assert!(fs::read_to_string(&one).unwrap().contains("ends: [demo::geom::Point; 2]"));
}

#[test]
fn check_writes_nothing_and_detects_outdated_code() {
    let folder = Folder::new("check");
    let (point, out) = (folder.file("point_t.lcm", POINT), folder.path("types.rs"));
    let differs = (1, String::new(), format!("advee: {out}: is not what the types would give\n"));
    assert_eq!(generate(&[&point, "--check"]), (0, String::new(), String::new()));
    assert_eq!(generate(&[&point, "--check", "--out", &out]), differs);
    assert!(fs::metadata(&out).is_err());
    assert_eq!(generate(&[&point, "--out", &out]).0, 0);
    assert_eq!(generate(&[&point, "--check", "--out", &out]), (0, String::new(), String::new()));
    folder.file("point_t.lcm", &POINT.replace("x, y", "x, y, z"));
    assert_eq!(generate(&[&point, "--check", "--out", &out]), differs);
}

#[test]
fn an_error_is_one_line_with_its_position() {
    let folder = Folder::new("wrong");
    let bad = folder.file("bad_t.lcm", "package demo;\nstruct bad_t\n{\n    double x[n];\n}\n");
    let message = format!("advee: {bad}:4:14: `n` is not a constant or member declared before\n");
    assert_eq!(generate(&[&bad]), (1, String::new(), message));
    let empty = folder.path("");
    fs::remove_file(&bad).unwrap();
    assert_eq!(generate(&[&empty]), (1, String::new(), format!("advee: {empty}: no .lcm files\n")));
    let (code, _, err) = generate(&[&folder.path("none.lcm")]);
    assert!(code == 1 && err.contains("none.lcm: No such file"), "{err}");
    assert_eq!(generate(&[]).0, 2);
}
