//! Constant part of the view: dimensions of the robot, its map, the names of its parts.

use super::authority::Limits;
use super::publish::Publishable;
use logger::ros::Sensor;
use planner::map::{Cell, Map};
use serde::Serialize;

/// Maximum number of walls of a map; a finer map is coarsened.
const WALLS_MAX: usize = 4000;

/// Constant part of the view, sent once after connecting and when it changes. Lengths in m, angles in rad; the robot in
/// its own frame, everything else in the map frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "part", rename = "scene")]
pub struct Scene {
    /// Name of the robot.
    pub robot: String,
    /// Version of this program.
    pub version: &'static str,
    /// True for a simulated robot.
    pub simulated: bool,
    /// Recorded run being played; `None` for the live robot.
    pub demo: Option<Demo>,
    /// Corners of the body.
    pub outline: Vec<[f64; 2]>,
    /// Distance of rear and front axle.
    pub wheelbase: f64,
    /// Limits of manual commands.
    pub limits: Limits,
    /// Highest speed of a robot that senses nothing of what is in its way, m/s; `null`: it senses something.
    pub blind: Option<f64>,
    /// The beam of a sonar.
    pub sonar: Beam,
    /// The beam of an infrared sensor.
    pub infrared: Beam,
    /// Beacons on the map.
    pub beacons: Vec<Beacon>,
    /// Walls as x1, y1, x2, y2.
    pub walls: Vec<[f64; 4]>,
    /// Columns as x, y, radius.
    pub columns: Vec<[f64; 3]>,
    /// Named routes.
    pub routes: Vec<Route>,
    /// Text of the file of the simulated world; empty where there is none, or where it is longer than 32 KiB.
    pub world: String,
    /// Channels of the power controller.
    pub power_channels: Vec<&'static str>,
    /// Temperatures above which the robot reports an over-temperature.
    pub temperature_limits: Vec<TemperatureLimit>,
    /// Drives with their nodes.
    pub drives: Vec<Drive>,
    /// Faults that can be injected in the simulation.
    pub faults: Vec<Faults>,
    /// Channels of the robot on which engineers may publish.
    pub publish: Vec<Publishable>,
}

/// A recorded run being played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Demo {
    /// Name.
    pub run: String,
    /// Duration, s.
    pub seconds: f64,
}

/// A beam of a ranging sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Beam {
    /// Full width, rad.
    pub field_of_view: f64,
    /// Minimum range, m.
    pub min: f64,
    /// Maximum range, m.
    pub max: f64,
}

/// A beacon on the map, m.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Beacon {
    /// Number in its code.
    pub id: u8,
    /// x, m.
    pub x: f64,
    /// y, m.
    pub y: f64,
}

/// A named route.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Route {
    /// Name for display and commands.
    pub name: String,
    /// Points x, y, m.
    pub points: Vec<[f64; 2]>,
}

/// Limit of a thermometer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TemperatureLimit {
    /// Name of the thermometer in `LL_DATA_TEMPERATURE`.
    pub name: String,
    /// Temperature above which it is too hot, degrees Celsius.
    pub celsius: f64,
}

/// A drive on a CANopen bus.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// Name for display and commands.
    pub name: &'static str,
    /// CANopen node, as `LL_CMD_SDO` names it: 1000 more for each CAN bus before its own.
    pub node: i32,
}

/// A target of the simulation with its faults.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Faults {
    /// Name.
    pub target: String,
    /// Names of its faults.
    pub faults: Vec<&'static str>,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            robot: String::new(),
            version: env!("CARGO_PKG_VERSION"),
            simulated: false,
            demo: None,
            outline: Vec::new(),
            wheelbase: 0.0,
            limits: Limits { speed: 0.0, steering: 0.0, sideways: 0.0, rotation: 0.0 },
            blind: None,
            sonar: Sensor::default().into(),
            infrared: Sensor::GP2Y0A41.into(),
            beacons: Vec::new(),
            walls: Vec::new(),
            columns: Vec::new(),
            routes: Vec::new(),
            world: String::new(),
            power_channels: Vec::new(),
            temperature_limits: Vec::new(),
            drives: Vec::new(),
            faults: Vec::new(),
            publish: Vec::new(),
        }
    }
}

impl From<Sensor> for Beam {
    fn from(sensor: Sensor) -> Self {
        Self { field_of_view: sensor.field_of_view, min: sensor.min, max: sensor.max }
    }
}

impl Scene {
    /// Adds the targets of the simulation, each with its faults.
    #[must_use]
    pub fn with_faults(self, faults: Vec<(String, Vec<&'static str>)>) -> Self {
        Self { faults: faults.into_iter().map(|(target, faults)| Faults { target, faults }).collect(), ..self }
    }

    /// Scene of a recorded run, in which nothing can be commanded.
    #[must_use]
    pub fn played(self, demo: Demo) -> Self {
        Self { demo: Some(demo), faults: Vec::new(), publish: Vec::new(), ..self }
    }

    /// JSON for the page.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// Rounds to a millimetre.
#[must_use]
pub fn rounded(metres: f64) -> f64 {
    (metres * 1e3).round() / 1e3
}

/// Borders between occupied and free areas of a map, as straight segments of maximum length.
#[must_use]
pub fn outline(map: &Map) -> Vec<[f64; 4]> {
    let frame = map.frame();
    let mut step = 1;
    loop {
        let (width, height) = (frame.width.div_ceil(step), frame.height.div_ceil(step));
        let mut grid = vec![false; width * height];
        for (place, _) in map.cells().iter().enumerate().filter(|(_, cell)| **cell == Cell::Occupied) {
            grid[place / frame.width / step * width + place % frame.width / step] = true;
        }
        let at = |x: usize, y: usize| x < width && y < height && grid[y * width + x];
        let walls = borders(width, height, at);
        if walls.len() <= WALLS_MAX || step >= frame.width.max(frame.height) {
            let side = frame.resolution * step as f64;
            let [x, y] = [frame.x, frame.y];
            let metres = |cells: usize, from: f64| rounded(from + cells as f64 * side);
            return walls
                .into_iter()
                .map(|[a, b, c, d]| [metres(a, x), metres(b, y), metres(c, x), metres(d, y)])
                .collect();
        }
        step *= 2;
    }
}

/// x1, y1, x2, y2 in cells.
fn borders(width: usize, height: usize, at: impl Fn(usize, usize) -> bool) -> Vec<[usize; 4]> {
    let mut walls = Vec::new();
    for y in 0..=height {
        let differs = |x: usize| at(x, y) != (y > 0 && at(x, y - 1));
        runs(width, differs, |from, to| walls.push([from, y, to, y]));
    }
    for x in 0..=width {
        let differs = |y: usize| at(x, y) != (x > 0 && at(x - 1, y));
        runs(height, differs, |from, to| walls.push([x, from, x, to]));
    }
    walls
}

/// Calls `tell` with each run of indices for which `holds` is true: its first, and the one after its last.
fn runs(count: usize, holds: impl Fn(usize) -> bool, mut tell: impl FnMut(usize, usize)) {
    let mut begin = None;
    for place in 0..=count {
        match (place < count && holds(place), begin) {
            (true, None) => begin = Some(place),
            (false, Some(from)) => {
                tell(from, place);
                begin = None;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use planner::map::Frame;

    fn map(width: usize, height: usize, occupied: impl Fn(usize, usize) -> bool) -> Map {
        let mut map = Map::new(Frame { x: -1.0, y: 2.0, resolution: 0.5, width, height }).unwrap();
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|(x, y)| occupied(*x, *y)) {
            map.set(x, y, Cell::Occupied);
        }
        map
    }

    #[test]
    fn a_block_of_cells_has_four_walls() {
        let mut walls = outline(&map(6, 4, |x, y| (1..4).contains(&x) && (2..4).contains(&y)));
        walls.sort_by(|a, b| a.partial_cmp(b).unwrap());
        let (left, right, low, high) = (-0.5, 1.0, 3.0, 4.0);
        assert_eq!(
            walls,
            [[left, low, left, high], [left, low, right, low], [left, high, right, high], [right, low, right, high]]
        );
        assert!(outline(&map(6, 4, |_, _| false)).is_empty());
    }

    #[test]
    fn a_noisy_map_has_coarser_but_not_more_walls() {
        let walls = outline(&map(500, 400, |x, y| (x + y) % 2 == 0));
        assert!(!walls.is_empty() && walls.len() <= WALLS_MAX, "{}", walls.len());
    }
}
