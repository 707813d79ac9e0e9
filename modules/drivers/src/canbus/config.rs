//! Settings of the CAN bus and its drives; SI units.

use base::Duration;
use settings::robot::{Geometry, Limits};
use settings::{Blank, Off, Table, ZeroOr, settings};
use std::path::PathBuf;

settings! {
    /// Keys of `[can.<name>]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BusConfig {
        /// Bit rate; of a kernel's interface it must have been set before.
        bitrate: u32 = 500_000, 10_000..=1_000_000;
        /// CANopen node of the master.
        master: u8 = 127, 1..=127;
        /// Period of SYNC; 0: no SYNC.
        sync_s as sync: Option<Duration> = None, Off(ZeroOr(0.001..=10.0));
        /// Drives.
        nodes: Vec<Node> = [];
    }
    check BusConfig::check;
}

settings! {
    /// `[[can.<name>.nodes]]`: a drive.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Node {
        /// CANopen node.
        id: u8 = required, 1..=127;
        /// Axis that it moves.
        axis: Axis = required;
        /// Electronic data sheet, beside `robot.toml`: it must agree with the driver, and names objects in `advee can`.
        /// Absent: the sheet that is built in.
        eds: Option<PathBuf> = None, Blank;
        drive: Drive = flat;
    }
    check Node::check;
}

settings! {
    /// What a drive moves.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Axis {
        /// The rear wheels.
        Propulsion = "propulsion",
        /// The front wheels' angle.
        Steering = "steering",
    }
}

settings! {
    /// CANopen drives with a driver.
    #[derive(Clone, Debug, PartialEq)]
    pub enum Drive by driver {
        /// maxon EPOS 70/10, for the propulsion.
        Epos(EposConfig) = "epos",
        /// Berger Lahr IclA, for the steering.
        Icla(SteeringConfig) = "icla",
    }
}

settings! {
    /// An EPOS 70/10.
    #[derive(Clone, Debug, PartialEq)]
    pub struct EposConfig {
        /// Motor turns per wheel turn, not 0; negative when the motor is mounted the other way round.
        gear: f64 = required, -1000.0..=1000.0;
    }
    check EposConfig::check;
}

settings! {
    /// The steering drive: an IclA N065 in profile position mode.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SteeringConfig {
        /// Node id, 1..=127.
        node: u8 = unset 0;
        /// Motor turns per turn of the equivalent single front wheel, not 0; negative when counts fall
        /// counter-clockwise.
        gear: f64 = required, -10_000.0..=10_000.0;
        /// Position counts per turn of the motor.
        counts_per_turn: f64 = 4096.0, 1.0..=1e6;
        /// Angle at which the homing switch closes.
        switch_rad as switch: f64 = required, -2.0..=2.0;
        /// CiA 402 homing method; 27: onto the switch from above, and off it.
        homing_method: i8 = 27, -128..=127;
        /// Speed towards the switch.
        homing_speed_radps as homing_speed: f64 = required, 0.001..=10.0;
        /// Longest homing.
        homing_timeout_s as homing_timeout: Duration = 15.0, 1.0..=120.0;
        /// Speed of the steering, rad/s.
        speed: f64 = unset 0.0;
        /// Maps the PDOs of a drive that has others; else such a drive is refused.
        remap: bool = false;
    }
    check SteeringConfig::check;
}

/// Configuration of `driver_canbus`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The bus's name: `can.main`.
    pub bus: String,
    /// bit/s.
    pub bitrate: u32,
    /// Node id of this master, 1..=127.
    pub node_id: u8,
    /// Period of SYNC, if any drive needs it.
    pub sync: Option<Duration>,
    /// Front to rear axle, m.
    pub wheelbase: f64,
    /// Bounds on commands and on what is done.
    pub limits: Limits,
    /// Modules without which the robot must not move.
    pub critical: Vec<String>,
    /// Modules without which the planner must not move it.
    pub planning: Vec<String>,
    /// The robot has a power controller that reports the PAUSE line.
    pub has_pause_line: bool,
    /// The drive of the rear axle.
    pub propulsion: PropulsionConfig,
    /// The drive of the front wheels' steering.
    pub steering: SteeringConfig,
}

/// The propulsion drive: an EPOS 70/10 in profile velocity mode.
#[derive(Clone, Debug)]
pub struct PropulsionConfig {
    /// Node id, 1..=127.
    pub node: u8,
    /// Motor speed at 1 m/s, rpm; negative when the motor is mounted the other way round.
    pub rpm_per_mps: f64,
}

impl BusConfig {
    fn check(&self, table: &Table<'_>) {
        let ids: Vec<u8> = self.nodes.iter().map(|node| node.id).collect();
        table.unique("nodes", "id", &ids, "one that no other node of the bus has");
        for n in (0..ids.len()).filter(|n| ids[*n] == self.master) {
            let _ = table.item("nodes", n).map(|item| item.refuse("id", "one that no other node of the bus has"));
        }
        let axes: Vec<Axis> = self.nodes.iter().map(|node| node.axis).collect();
        table.unique("nodes", "axis", &axes, "one that no other node has");
    }

    /// The drive of the propulsion: node id and gear.
    #[must_use]
    pub fn propulsion(&self) -> Option<(u8, f64)> {
        self.nodes.iter().find_map(|node| match &node.drive {
            Drive::Epos(epos) => Some((node.id, epos.gear)),
            Drive::Icla(_) => None,
        })
    }

    /// The drive of the steering.
    #[must_use]
    pub fn steering(&self) -> Option<SteeringConfig> {
        self.nodes.iter().find_map(|node| match &node.drive {
            Drive::Icla(icla) => Some(SteeringConfig { node: node.id, ..icla.clone() }),
            Drive::Epos(_) => None,
        })
    }

    /// Configuration of the driver for the bus of this name; absent unless both drives are on it. The other modules are
    /// to be set.
    #[must_use]
    pub fn driver(&self, bus: String, geometry: &Geometry, limits: Limits) -> Option<Config> {
        let (node, gear) = self.propulsion()?;
        let steering = SteeringConfig { speed: limits.steering_rate_radps, ..self.steering()? };
        Some(Config {
            bus,
            bitrate: self.bitrate,
            node_id: self.master,
            sync: self.sync,
            wheelbase: geometry.wheelbase_m,
            limits,
            critical: Vec::new(),
            planning: Vec::new(),
            has_pause_line: false,
            propulsion: PropulsionConfig { node, rpm_per_mps: 60.0 * gear / geometry.wheel_circumference_m() },
            steering,
        })
    }
}

impl Node {
    fn check(&self, table: &Table<'_>) {
        let (moves, expected) = match self.drive {
            Drive::Epos(_) => (Axis::Propulsion, r#""propulsion", which is all that this driver can move"#),
            Drive::Icla(_) => (Axis::Steering, r#""steering", which is all that this driver can move"#),
        };
        if self.axis != moves {
            table.refuse("axis", expected);
        }
    }
}

impl EposConfig {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
    }
}

impl SteeringConfig {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
    }
}

fn not_zero(table: &Table<'_>, gear: f64) {
    if gear == 0.0 {
        table.refuse("gear", "a number that is not 0");
    }
}
