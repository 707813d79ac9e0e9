//! The shipped rover on other motor controllers than its ODrives.

use std::path::{Path, PathBuf};

/// What turns its wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rover {
    /// A VESC on CAN for each wheel.
    VescsOnCan,
    /// A VESC on a UART for each wheel; there is no CAN bus.
    VescsOnUarts,
    /// One RoboClaw for both, on a serial line. A GPIO line cuts the motors' feed, since its command time limit cannot
    /// be proven.
    RoboClaw,
}

/// A configuration; removed when it is dropped.
pub struct Folder {
    /// Where it is.
    pub path: PathBuf,
}

impl Drop for Folder {
    fn drop(&mut self) {
        // One that cannot be removed is overwritten by the next run.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

/// The folder of the shipped robots.
fn conf() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf")
}

fn shipped(file: &str) -> String {
    std::fs::read_to_string(conf().join("rover").join(file)).expect("the rover")
}

impl Rover {
    /// Its configuration, in a folder of this test.
    pub fn folder(self, test: &str) -> Folder {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}-{self:?}-{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        let write = |file: &str, text: String| std::fs::write(path.join(file), text).expect("a file");
        write("modules.toml", shipped("modules.toml"));
        write("robot.toml", self.robot());
        write("sim.toml", if self == Self::VescsOnCan { shipped("sim.toml") } else { without_bus("sim.toml", "") });
        Folder { path }
    }

    fn robot(self) -> String {
        match self {
            Self::VescsOnCan => {
                let of_odrives = ["hardware", "firmware", "enable_watchdog", "watchdog_timeout"];
                let text = shipped("robot.toml");
                let lines = text.lines().filter(|line| !of_odrives.iter().any(|key| line.starts_with(key)));
                let vesc = "driver = \"vesc\"\npole_pairs = 7\nerpm_min = 60";
                lines.map(|line| line.replace("driver = \"odrive\"", vesc) + "\n").collect()
            }
            Self::VescsOnUarts => {
                let tables = [("left", 1, 8), ("right", 2, -8)].map(|(axis, id, gear)| {
                    format!(
                        "[serial.{axis}]\nport = \"serial-{axis}\"\ndriver = \"vesc\"\naxis = \"{axis}\"\n\
                         id = {id}\ngear = {gear}\npole_pairs = 7\nerpm_min = 60\n\n"
                    )
                });
                without_bus("robot.toml", &tables.concat())
            }
            Self::RoboClaw => {
                let tables = "[serial.wheels]\nport = \"serial-wheels\"\ndriver = \"roboclaw\"\n\
                              model = \"RoboClaw 2x15a v4.1.34\"\n\
                              m1 = { axis = \"left\", gear = 8, counts_per_turn = 4096 }\n\
                              m2 = { axis = \"right\", gear = -8, counts_per_turn = 4096 }\n\n\
                              [stop.gpio]\nchip = \"feed\"\nline = 17\n\n";
                without_bus("robot.toml", tables).replace("second_way = \"none\"", "second_way = \"gpio\"")
            }
        }
    }
}

/// A file of the rover with these tables in place of its CAN bus.
fn without_bus(file: &str, tables: &str) -> String {
    let text = shipped(file);
    let (begin, end) = (text.find("[can.main]").expect("a bus"), text.find("[rs485.b]").expect("the next table"));
    [&text[..begin], tables, &text[end..]].concat()
}
