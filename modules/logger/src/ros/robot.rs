//! Parts of the robot that the scene shows and no message contains.

/// Robot as shown in the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotScene {
    /// Name of the robot; the hardware id in diagnostics.
    pub name: String,
    /// Corners of its outline in the robot frame, m, in order.
    pub outline: Vec<[f64; 2]>,
    /// Beacons in the map.
    pub beacons: Vec<Beacon>,
    /// Measuring range of a sonar.
    pub sonar: Sensor,
    /// Measuring range of an infrared range finder.
    pub infrared: Sensor,
}

/// Beacon in the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beacon {
    /// Number.
    pub id: i32,
    /// Position in the map, x, m.
    pub x: f64,
    /// Position in the map, y, m.
    pub y: f64,
}

/// Measuring range of a range finder; zeros if unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensor {
    /// Opening angle of the beam, rad.
    pub field_of_view: f64,
    /// Shortest measurable distance, m.
    pub min: f64,
    /// Longest measurable distance, m.
    pub max: f64,
}

impl Sensor {
    /// Sonar SRF-08 (`docs/facts/robot.md` 2.1), with this opening angle, rad.
    #[must_use]
    pub const fn srf08(field_of_view: f64) -> Self {
        Self { field_of_view, min: 0.03, max: 6.0 }
    }

    /// Infrared range finder GP2Y0A41SK0F (`docs/facts/robot.md` 2.2); its beam is a line.
    pub const GP2Y0A41: Self = Self { field_of_view: 0.0, min: 0.04, max: 0.3 };
}
