//! `advee plan` as used from the shell.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Temporary folder with a map: a room of 8 m by 6 m at 5 cm with a wall, and no path to its right end.
fn map(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("advee-plan-{}-{name}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let mut picture = b"P5\n# drawn by a test\n160 120\n255\n".to_vec();
    for row in 0..120 {
        for column in 0..160 {
            let wall = row == 0 || row == 119 || column == 0 || column == 159 || column == 140;
            let middle = column == 70 && row > 45;
            picture.push(if wall || middle { 0 } else { 254 });
        }
    }
    fs::write(folder.join("room.pgm"), picture).unwrap();
    let text = "image: room.pgm\nmode: trinary\nresolution: 0.05\norigin: [-4.0, -3.0, 0]\nnegate: 0\n\
                occupied_thresh: 0.65\nfree_thresh: 0.196\n";
    fs::write(folder.join("room.yaml"), text).unwrap();
    folder
}

fn plan(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
    command.arg("plan").current_dir(folder).args(arguments);
    command.args(["--footprint", "0.9,0.6", "--wheelbase", "0.6", "--radius", "0.857", "--json"]).output().unwrap()
}

#[test]
fn a_path_is_written_as_csv_and_as_json() {
    let folder = map("way");
    let output = plan(
        &folder,
        &["--map", "room.yaml", "--start", "-3.0,-2.0,1.57", "--goal", "1.5,-2.0,-1.57", "--out", "path.csv"],
    );
    assert!(output.status.success(), "{output:?}");
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&told["found"], &told["reason"]), (&Value::Bool(true), &Value::Null));
    let number = |key: &str| told[key].as_f64().unwrap_or_else(|| panic!("{key} in {told}"));
    assert!(number("length") > 8.0 && number("length") < 16.0 && number("clearance") > 0.0, "{told}");
    assert_eq!(number("margin"), 0.02, "{told}");
    assert!(number("cusps") >= 0.0 && number("expansions") > 0.0 && number("milliseconds") > 0.0, "{told}");
    let text = fs::read_to_string(folder.join("path.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x,y,theta,curvature,direction,s"));
    let rows: Vec<Vec<f64>> = lines.map(|line| line.split(',').map(|part| part.parse().unwrap()).collect()).collect();
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    assert!((first[0] + 3.0).abs() < 1e-5 && (first[1] + 2.0).abs() < 1e-5 && first[5] == 0.0, "{first:?}");
    assert!((last[0] - 1.5).abs() < 1e-5 && (last[1] + 2.0).abs() < 1e-5 && (last[2] + 1.57).abs() < 1e-5, "{last:?}");
    assert!((last[5] - number("length")).abs() < 1e-4);
    assert!(rows.iter().all(|row| row[3].abs() <= 1.0 / 0.857 + 1e-5 && row[4].abs() == 1.0));
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn without_a_path_it_fails_with_the_reason() {
    let folder = map("none");
    for (start, goal, reason) in [
        ("-3,-2,0", "3.5,0,1.57", "no way leads to the goal"),
        ("-3,-2,0", "-0.5,1,0", "the robot does not fit in at the goal"),
        ("-3,-2,0", "50,1", "the goal is outside the map, which is -4…4 by -3…3 m"),
        ("-9,-2,0", "1,1", "the start is outside the map, which is -4…4 by -3…3 m"),
        ("-0.8,0,0", "1,1", "the robot stands in an obstacle or outside of the map"),
    ] {
        let output = plan(&folder, &["--map", "room.yaml", "--start", start, "--goal", goal, "--out", "path.csv"]);
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&told["found"], told["reason"].as_str()), (&Value::Bool(false), Some(reason)), "{start} {goal}");
        assert_eq!(output.status.code(), Some(1));
        assert_eq!(String::from_utf8_lossy(&output.stderr), format!("advee: {reason}\n"));
    }
    assert!(!folder.join("path.csv").exists());
    for odd in [
        ["--start", "nan,0,0", "--goal", "1,1"],
        ["--start", "0,0,0", "--goal", "1,inf"],
        ["--start", "0,0", "--goal", "1,1"],
    ] {
        let output = plan(&folder, &[&["--map", "room.yaml"][..], &odd[..]].concat());
        assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).lines().count() == 1, "{output:?}");
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn an_invalid_map_is_named_with_line_or_byte() {
    let folder = map("bad");
    let text = fs::read_to_string(folder.join("room.yaml")).unwrap();
    let request = ["--map", "bad.yaml", "--start", "-3,-2,0", "--goal", "1,1"];
    fs::write(folder.join("short.pgm"), b"P5 160 120 255\n123").unwrap();
    fs::write(folder.join("header.pgm"), b"P7 160 120 255\n123").unwrap();
    for (from, to, why) in [
        ("0.05", "nan", "bad.yaml: line 3: resolution: "),
        ("-3.0, 0]", "-3.0]", "bad.yaml: line 4: origin: "),
        ("-3.0, 0]", "-3.0, 0.3]", "is turned"),
        ("negate: 0\n", "", "bad.yaml: negate is missing"),
        ("room.pgm", "short.pgm", "short.pgm: byte 18: the picture ends after 3 of 19200 pixels"),
        ("room.pgm", "header.pgm", "header.pgm: byte 0: not a PGM file"),
        ("room.pgm", "nowhere.pgm", "nowhere.pgm: "),
        ("room.pgm", ".", "not a file"),
    ] {
        fs::write(folder.join("bad.yaml"), text.replace(from, to)).unwrap();
        let output = plan(&folder, &request);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && told.contains(why) && told.lines().count() == 1, "{to}: {told}");
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn overrides_that_do_not_exist_are_refused() {
    let folder = map("sets");
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("conf/advee");
    let request = ["--map", "room.yaml", "--start", "-3,-2,0", "--goal", "1.5,-2", "--config", conf.to_str().unwrap()];
    for (set, exists) in
        [("planner.margin_m=0.2", true), ("planner.no_such_key=1", false), ("world.x=1", false), ("nowhere=1", false)]
    {
        let output = plan(&folder, &[&request[..], &["--set", set]].concat());
        assert_eq!(output.status.success(), exists, "{set}: {output:?}");
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(exists || told.contains(set.split('=').next().unwrap()), "{told}");
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_hall_is_a_map_too() {
    let output = Command::new(env!("CARGO_BIN_EXE_advee"))
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap())
        .args(["plan", "--world", "hall", "--start", "3,6,0", "--goal", "18,2", "--tolerance", "0.2", "--json"])
        .output()
        .unwrap();
    let told: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"));
    assert!(output.status.success() && told["found"] == true, "{told}");
}

#[test]
fn a_world_is_written_as_a_map_and_read_as_a_world() {
    let folder = map("world");
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("conf/advee");
    let advee = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
        command.current_dir(&folder).args(arguments).args(["--config", conf.to_str().unwrap()]).output().unwrap()
    };
    let output = advee(&["world", "map", "--world", "hall", "--out", "hall.yaml"]);
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && told.starts_with("hall.yaml: 0…20 by 0…12.05 m, "), "{output:?}");
    assert!(folder.join("hall.pgm").is_file());
    let way = ["--start", "3,6,0", "--goal", "18,2", "--tolerance", "0.2"];
    for from in [["plan", "--map", "hall.yaml"], ["plan", "--world", "hall.yaml"], ["plan", "--world", "room.yaml"]] {
        let output = advee(&[&from[..], &way[..]].concat());
        assert_eq!(output.status.success(), from[2] == "hall.yaml", "{from:?}: {output:?}");
    }
    let output = advee(&["world", "map", "--world", "hall", "--out", "hall.png"]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && told.contains("hall.png: a map's name ends in .yaml"), "{told}");
    fs::remove_dir_all(folder).unwrap();
}
