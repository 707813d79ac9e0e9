//! The shipped robot with drives of other makers, by their data sheets alone.

use std::fs;
use std::path::{Path, PathBuf};

/// A drive: its data sheet in the tree, and its keys beside node, axis and sheet.
#[derive(Clone, Copy, Debug)]
pub struct Drive(pub &'static str, pub &'static str);

/// Both drives: the propulsion, the steering.
pub type Drives = [Drive; 2];

/// A wheel that states its units and turns backwards; a steering that leaves its units open, does not say whether its
/// position counts from home, and has its switch where its position is greatest.
pub const STATED: Drives = [
    Drive("maxon_epos4_50_15_node1.dcf", "gear = -26"),
    Drive(
        "ros2_cia402_slave.eds",
        "gear = -180\ncounts_per_turn = 4096\nhoming_method = 23\nswitch_rad = -0.6283\nhoming_speed_radps = 0.1745",
    ),
];

/// A wheel in counts per second that has no 0x6007; a steering that says whether its position counts from home.
pub const GIVEN: Drives = [
    Drive("ros2_cia402_slave.eds", "gear = 26\ncounts_per_turn = 2000"),
    Drive(
        "../icla_sim.eds",
        "gear = 180\ncounts_per_turn = 4096\nvelocity_unit = \"rpm\"\nhomed_bit = 15\nswitch_rad = \
         -0.6283\nhoming_speed_radps = 0.1745",
    ),
];

/// Writes the configuration of the shipped robot with these drives into a folder of this name.
pub fn configuration(name: &str, drives: Drives) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("by-sheets-{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    let mut nodes = String::new();
    for (n, (Drive(sheet, keys), axis)) in drives.iter().zip(["propulsion", "steering"]).enumerate() {
        fs::copy(root.join("buses/canopen/eds/others").join(sheet), folder.join(format!("{axis}.eds")))
            .expect("a sheet of the tree");
        let id = n + 1;
        nodes += &format!(
            "[[can.main.nodes]]\nid = {id}\naxis = \"{axis}\"\ndriver = \"cia402\"\neds = \"{axis}.eds\"\n{keys}\n\n"
        );
    }
    let shipped = root.join("conf/advee");
    for file in ["modules.toml", "sim.toml"] {
        fs::copy(shipped.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let robot = fs::read_to_string(shipped.join("robot.toml")).expect("the shipped configuration");
    let begin = robot.find("[[can.main.nodes]]").expect("its drives");
    let end = robot.find("[sensors]").expect("what follows them");
    fs::write(folder.join("robot.toml"), robot[..begin].to_owned() + &nodes + &robot[end..]).expect("a file");
    folder
}
