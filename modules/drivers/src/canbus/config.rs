//! What the module must know of the robot; SI units.

use base::Duration;

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
    /// A command lives this long.
    pub ttl: Duration,
    /// Modules without which the robot must not move.
    pub critical: Vec<String>,
    /// Modules without which the planner must not move it.
    pub planning: Vec<String>,
    /// The robot has a power controller that tells of the PAUSE line.
    pub has_pause_line: bool,
    /// The drive of the rear axle.
    pub propulsion: PropulsionConfig,
    /// The drive of the front wheels' steering.
    pub steering: SteeringConfig,
}

/// Bounds. A command beyond `speed` or `steering` is refused and stops the robot; the others only slow it down.
#[derive(Clone, Debug)]
pub struct Limits {
    /// m/s, either way.
    pub speed: f64,
    /// rad, either way, of the equivalent single front wheel.
    pub steering: f64,
    /// m/s under a manual source.
    pub speed_manual: f64,
    /// m/s under the planner.
    pub speed_autonomous: f64,
    /// m/s², sideways at the rear axle's middle.
    pub lateral_acceleration: f64,
    /// m/s².
    pub acceleration: f64,
    /// m/s².
    pub deceleration: f64,
    /// m/s².
    pub quick_stop: f64,
}

/// The propulsion drive: an EPOS 70/10 in profile velocity mode.
#[derive(Clone, Debug)]
pub struct PropulsionConfig {
    /// Node id, 1..=127.
    pub node: u8,
    /// Motor speed at 1 m/s, rpm; negative when the motor is mounted the other way round.
    pub rpm_per_mps: f64,
}

/// The steering drive: an IclA N065 in profile position mode.
#[derive(Clone, Debug)]
pub struct SteeringConfig {
    /// Node id, 1..=127.
    pub node: u8,
    /// Position counts per turn of the motor.
    pub counts_per_turn: f64,
    /// Turns of the motor per turn of the equivalent single front wheel; negative when counts fall counter-clockwise.
    pub gear: f64,
    /// The angle at which the homing switch closes, rad.
    pub switch: f64,
    /// Homing method (CiA 402, 0x6098).
    pub homing_method: i8,
    /// Speed towards the switch, rad/s.
    pub homing_speed: f64,
    /// Homing takes at most this long.
    pub homing_timeout: Duration,
    /// Speed of the steering, rad/s.
    pub speed: f64,
    /// Maps the drive's PDOs as they must be; else a drive with others is refused.
    pub remap: bool,
}
