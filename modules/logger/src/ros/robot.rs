//! Parts of the robot that the scene shows and no message has.

/// What the scene shows of the robot and no message says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotScene {
    /// The robot's name; in diagnostics the hardware's.
    pub name: String,
    /// Corners of its outline, robot frame, m, in order.
    pub outline: Vec<[f64; 2]>,
    /// Beacons in the map.
    pub beacons: Vec<Beacon>,
    /// What a sonar can see.
    pub sonar: Sensor,
    /// What an infrared range finder can see.
    pub infrared: Sensor,
}

/// A beacon in the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beacon {
    /// Its number.
    pub id: i32,
    /// Position in the map, m.
    pub x: f64,
    /// Position in the map, m.
    pub y: f64,
}

/// What a range finder can see; zeros where nobody knows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensor {
    /// Width of its beam, rad.
    pub field_of_view: f64,
    /// Nearest thing that it measures, m.
    pub min: f64,
    /// Farthest thing that it measures, m.
    pub max: f64,
}

impl Sensor {
    /// The sonar SRF-08 (`docs/facts/robot.md` 2.1), whose beam opens by this angle, rad.
    #[must_use]
    pub const fn srf08(field_of_view: f64) -> Self {
        Self { field_of_view, min: 0.03, max: 6.0 }
    }

    /// The infrared range finder GP2Y0A41SK0F (`docs/facts/robot.md` 2.2); its beam is a line.
    pub const GP2Y0A41: Self = Self { field_of_view: 0.0, min: 0.04, max: 0.3 };
}
