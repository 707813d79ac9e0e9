//! The courier with its right wheel on a CAN bus of its own, where it is node 1 as well.

use std::fs;
use std::path::{Path, PathBuf};

/// The buses, of the left wheel and of the right one.
pub const BUSES: [&str; 2] = ["can.main", "can.second"];

/// Its configuration, in a folder that lasts as long as this.
pub struct Folder {
    /// Where it is.
    pub path: PathBuf,
}

impl Folder {
    pub fn new(test: &str) -> Self {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("two-buses-{test}-{}", std::process::id()));
        fs::create_dir_all(&path).expect("a folder");
        for entry in fs::read_dir(&shipped).expect("the shipped folder") {
            let file = entry.expect("a file").path();
            fs::copy(&file, path.join(file.file_name().expect("a name"))).expect("a copy");
        }
        let change = |name: &str, change: &dyn Fn(String) -> String| {
            let file = path.join(name);
            fs::write(&file, change(fs::read_to_string(&file).expect("a text"))).expect("a file");
        };
        change("robot.toml", &|text| {
            let right = "[[can.main.nodes]]\nid = 2\naxis = \"right\"";
            assert!(text.contains(right), "the shipped courier");
            let bus = "[can.second]\ninterface = \"can1\"\nbitrate = 250000\n\n[[can.second.nodes]]\nid = 1\n";
            text.replace(right, &format!("{bus}axis = \"right\""))
        });
        change("sim.toml", &|text| text + "\n[can.second]\ninterface = \"udp:239.74.163.3\"\n");
        Self { path }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.path).expect("the folder");
    }
}
