//! What stays as it is while a robot is looked at: its measures, the map that it drives on, the names of its parts.

use crate::config::{Axis, CanBus, Robot};
use logger::ros::Sensor;
use navitools::Point;
use planner::map::{Cell, Map};
use rs485::boards::psc1;
use serde::Serialize;
use sim::world::World;

/// Walls of a map are not more than this; of a finer map they are coarser.
const WALLS_MAX: usize = 4000;

/// `ScenePart` of web/src/protocol.ts. Lengths in m, angles in rad; of the robot in its own frame, of all else in the
/// map's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene {
    part: &'static str,
    robot: String,
    version: &'static str,
    simulated: bool,
    demo: Option<Demo>,
    outline: Vec<[f64; 2]>,
    wheelbase: f64,
    limits: Limits,
    sonar: Beam,
    infrared: Beam,
    beacons: Vec<Beacon>,
    walls: Vec<[f64; 4]>,
    columns: Vec<[f64; 3]>,
    routes: Vec<Route>,
    power_channels: Vec<&'static str>,
    drives: Vec<Drive>,
    faults: Vec<Faults>,
}

/// A recorded run that is played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Demo {
    /// Its name.
    pub run: String,
    /// How long it takes, s.
    pub seconds: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Limits {
    speed: f64,
    steering: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Beam {
    field_of_view: f64,
    min: f64,
    max: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Beacon {
    id: u8,
    x: f64,
    y: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Route {
    name: String,
    points: Vec<[f64; 2]>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Drive {
    name: &'static str,
    node: u8,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Faults {
    target: String,
    faults: Vec<&'static str>,
}

impl Scene {
    /// Of a robot; where it is simulated of its world, else of the map that its planner has.
    #[must_use]
    pub fn of(robot: &Robot, world: Option<&World>, map: Option<&Map>) -> Self {
        let geometry = &robot.geometry;
        let (rear, front) = (-geometry.rear_overhang_m, geometry.length_m - geometry.rear_overhang_m);
        let half = geometry.width_m / 2.0;
        let walls = match (map, world) {
            (Some(map), _) => outline(map),
            (None, Some(world)) => {
                world.walls.iter().map(|wall| [wall.a.x, wall.a.y, wall.b.x, wall.b.y].map(rounded)).collect()
            }
            (None, None) => Vec::new(),
        };
        let columns = world.filter(|_| map.is_none()).map(|world| &world.columns[..]).unwrap_or_default();
        let routes = world.map(|world| &world.routes[..]).unwrap_or_default();
        let flat = |point: &Point| [rounded(point.x), rounded(point.y)];
        let route = |route: &sim::world::Route| {
            let mut points: Vec<_> = route.waypoints.iter().map(flat).collect();
            points.extend(route.waypoints.first().filter(|_| route.looped).map(flat));
            Route { name: route.name.clone(), points }
        };
        Self {
            part: "scene",
            robot: robot.name.clone(),
            version: env!("CARGO_PKG_VERSION"),
            simulated: world.is_some(),
            demo: None,
            outline: vec![[front, half], [rear, half], [rear, -half], [front, -half]],
            wheelbase: geometry.wheelbase_m,
            limits: Limits {
                speed: robot.limits.speed_manual_mps.min(robot.limits.speed_mps),
                steering: robot.limits.steering_rad,
            },
            sonar: beam(Sensor::SRF08),
            infrared: beam(Sensor::GP2Y0A41),
            beacons: robot.beacons.iter().map(|beacon| Beacon { id: beacon.id, x: beacon.x, y: beacon.y }).collect(),
            walls,
            columns: columns
                .iter()
                .map(|column| [column.centre.x, column.centre.y, column.radius].map(rounded))
                .collect(),
            routes: routes.iter().map(route).collect(),
            power_channels: robot.power.as_ref().map(|_| psc1::CHANNELS.to_vec()).unwrap_or_default(),
            drives: robot.can.iter().flat_map(drives).collect(),
            faults: Vec::new(),
        }
    }

    /// The same where this can be broken: targets, each with its faults.
    #[must_use]
    pub fn with_faults(self, faults: Vec<(String, Vec<&'static str>)>) -> Self {
        Self { faults: faults.into_iter().map(|(target, faults)| Faults { target, faults }).collect(), ..self }
    }

    /// The same while a recorded run is played: nothing can be broken then.
    #[must_use]
    pub fn played(self, demo: Demo) -> Self {
        Self { demo: Some(demo), faults: Vec::new(), ..self }
    }

    /// As the page is sent it.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

fn beam(sensor: Sensor) -> Beam {
    Beam { field_of_view: sensor.field_of_view, min: sensor.min, max: sensor.max }
}

fn drives(bus: &CanBus) -> impl Iterator<Item = Drive> {
    bus.nodes.iter().map(|node| Drive {
        name: match node.axis {
            Axis::Propulsion => "propulsion",
            Axis::Steering => "steering",
        },
        node: node.id,
    })
}

/// To a millimetre.
fn rounded(metres: f64) -> f64 {
    (metres * 1e3).round() / 1e3
}

/// The borders between what is occupied on a map and what is not, in as long pieces as they go straight.
fn outline(map: &Map) -> Vec<[f64; 4]> {
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

/// Tells each run of places for which it holds: its first, and the one after its last.
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
    fn a_map_of_dust_has_coarser_walls_but_not_more() {
        let walls = outline(&map(500, 400, |x, y| (x + y) % 2 == 0));
        assert!(!walls.is_empty() && walls.len() <= WALLS_MAX, "{}", walls.len());
    }
}
