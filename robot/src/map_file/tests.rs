use super::*;
use crate::config::{self, ConfigError, WorldSource};
use navitools::{Point, Pose};
use planner::map::Frame;
use simulator::world::{Segment, World};
use std::path::PathBuf;
use testing::Random;

/// Folder of a test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("advee-maps-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let file = self.0.join(name);
        fs::write(&file, text).unwrap();
        file
    }

    fn saved(&self, name: &str, map: &Map) -> PathBuf {
        let file = self.0.join(name);
        save(map, &file).unwrap();
        file
    }

    /// Error of a world's file, without the folder's name.
    fn refused(&self, file: &Path, sets: &[&str]) -> String {
        let ConfigError(lines) = world(file, sets).unwrap_err();
        assert_eq!(lines.len(), 1, "{lines:?}");
        lines[0].replace(&format!("{}/", self.0.display()), "")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee")
}

fn world(file: &Path, sets: &[&str]) -> Result<World, ConfigError> {
    let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    config::world(&shipped(), Some(file), &sets)
}

/// Map of rows, the top one first: `.` is free, `#` occupied, all others are unknown.
fn drawn(x: f64, y: f64, resolution: f64, rows: &[&str]) -> Map {
    let mut map = Map::new(Frame { x, y, resolution, width: rows[0].len(), height: rows.len() }).unwrap();
    for (row, cells) in rows.iter().rev().enumerate() {
        for (column, cell) in cells.bytes().enumerate() {
            map.set(
                column,
                row,
                match cell {
                    b'.' => Cell::Free,
                    b'#' => Cell::Occupied,
                    _ => Cell::Unknown,
                },
            );
        }
    }
    map
}

/// A room of `width` by `height` cells of 0.1 m within walls of one cell; its free corner is at the origin.
fn room(width: usize, height: usize) -> Map {
    let frame = Frame { x: -0.1, y: -0.1, resolution: 0.1, width: width + 2, height: height + 2 };
    let mut map = Map::new(frame).unwrap();
    for (column, row) in (0..height + 2).flat_map(|row| (0..width + 2).map(move |column| (column, row))) {
        if column == 0 || row == 0 || column > width || row > height {
            map.set(column, row, Cell::Occupied);
        }
    }
    map
}

fn in_walls(walls: Vec<Segment>) -> World {
    World::new(walls, Vec::new(), Vec::new(), Vec::new(), Pose::new(0.0, 0.0, 0.0)).unwrap()
}

fn is_free(map: &Map, column: i64, row: i64) -> bool {
    let (width, height) = (map.frame().width as i64, map.frame().height as i64);
    let within = (0..width).contains(&column) && (0..height).contains(&row);
    within && map.cells()[(row * width + column) as usize] == Cell::Free
}

#[test]
fn a_room_has_four_walls_and_a_pillar_four_more() {
    let map = drawn(1.0, 2.0, 0.5, &["#######", "#.....#", "#..##.#", "#..##.#", "#.....#", "#######"]);
    let found = walls(&map).unwrap();
    assert_eq!(found.len(), 8, "{found:?}");
    let distance = |from: (f64, f64), direction| {
        in_walls(found.clone()).ray(Point { x: from.0, y: from.1 }, direction, 100.0).unwrap().distance
    };
    assert!((distance((2.0, 3.0), (-1.0, 0.0)) - 0.5).abs() < 1e-3);
    assert!((distance((1.75, 3.5), (1.0, 0.0)) - 0.75).abs() < 1e-3, "the pillar");
    assert!((distance((1.75, 2.75), (1.0, 0.0)) - 2.25).abs() < 1e-3, "below it");
}

#[test]
fn the_walls_are_the_edges_of_the_free_cells_and_nothing_else() {
    let mut random = Random::new(7);
    let mut corners = 0;
    for _ in 0..400 {
        let (width, height) = (1 + random.index(12), 1 + random.index(12));
        let resolution = [0.025, 0.05, 0.3][random.index(3)];
        let frame = Frame { x: -3.17 + random.below(100) as f64, y: 0.1, resolution, width, height };
        let mut map = Map::new(frame).unwrap();
        let share = 2 + random.below(6);
        for (column, row) in (0..height).flat_map(|row| (0..width).map(move |column| (column, row))) {
            let cell = if random.one_in(2) { Cell::Occupied } else { Cell::Unknown };
            if random.one_in(share) {
                map.set(column, row, cell);
            }
        }
        let Ok(found) = walls(&map) else {
            assert!(!map.cells().contains(&Cell::Free));
            continue;
        };
        // Together they are as long as all edges; the ends and what joins corners aside.
        let straight = found.iter().filter(|wall| wall.a.x == wall.b.x || wall.a.y == wall.b.y);
        let length: f64 = straight.clone().map(|wall| wall.a.distance(wall.b) / resolution).sum();
        let sides = |column: i64, row: i64| {
            let around = [(1, 0), (-1, 0), (0, 1), (0, -1)];
            around.map(|(x, y)| is_free(&map, column, row) && !is_free(&map, column + x, row + y))
        };
        let (columns, rows) = (width as i64, height as i64);
        let edges = (0..rows).flat_map(|row| (0..columns).flat_map(move |column| sides(column, row)));
        let edges = edges.filter(|is_edge| *is_edge).count() as f64;
        let slack = 0.003 * straight.count() as f64;
        assert!((length - edges).abs() <= slack, "{length} of {edges}: {map:?}");
        corners += found.iter().filter(|wall| wall.a.x != wall.b.x && wall.a.y != wall.b.y).count();
        // From the middle of each free cell, a ray ends at the first cell that is not free.
        let seen = in_walls(found);
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            if !is_free(&map, column, row) {
                continue;
            }
            let (x, y) = frame.centre(column as usize, row as usize);
            for (right, up) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let mut off = 1;
                while is_free(&map, column + off * right, row + off * up) {
                    off += 1;
                }
                let hit = seen.ray(Point { x, y }, (right as f64, up as f64), 1e3).unwrap();
                let expected = (off as f64 - 0.5 + 1e-3) * resolution;
                assert!((hit.distance - expected).abs() < 1e-9, "{hit:?}, {expected}: {map:?}");
            }
            // In any direction it ends, and passes free cells only: all along it is not beyond an inset.
            for _ in 0..4 {
                let angle = random.below(1_000_000) as f64 * 1e-6 * std::f64::consts::TAU;
                let (sin, cos) = angle.sin_cos();
                let hit = seen.ray(Point { x, y }, (cos, sin), 1e3).expect("closed on all sides");
                let free = |x: f64, y: f64| {
                    let near = [-2e-3, 2e-3].map(|by| by * resolution);
                    near.iter().any(|dx| near.iter().any(|dy| map.at(x + dx, y + dy) == Some(Cell::Free)))
                };
                for step in 0..=20 {
                    let along = hit.distance * f64::from(step) / 20.0;
                    assert!(free(x + along * cos, y + along * sin), "{along} of {hit:?}: {map:?}");
                }
            }
        }
    }
    assert!(corners > 100, "{corners} corners that touch");
}

#[test]
fn nothing_passes_between_cells_that_touch_with_a_corner() {
    for rows in [["#.", ".#"], [".#", "#."]] {
        let map = drawn(0.0, 0.0, 1.0, &rows);
        let seen = in_walls(walls(&map).unwrap());
        let (from, to) = if rows[0] == "#." { ((0.5, 0.5), (1.0, 1.0)) } else { ((0.5, 1.5), (1.0, -1.0)) };
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let hit = seen.ray(Point { x: from.0, y: from.1 }, (to.0 * half, to.1 * half), 9.0).unwrap();
        assert!((hit.distance - half).abs() < 1e-2, "{rows:?}: {hit:?}");
    }
}

#[test]
fn unknown_cells_and_the_edge_of_the_map_are_walls() {
    let found = walls(&drawn(0.0, 0.0, 1.0, &["...", ". .", "..."])).unwrap();
    assert_eq!(found.len(), 8, "{found:?}");
}

#[test]
fn maps_that_cannot_be_a_world_are_refused() {
    assert_eq!(walls(&drawn(0.0, 0.0, 1.0, &["# #"])).unwrap_err(), "the map has no free cell");
    for (x, y) in [(9999.5, 0.0), (0.0, -1e5)] {
        assert_eq!(walls(&drawn(x, y, 1.0, &["..."])).unwrap_err(), "the map is not within ±10000 m");
    }
    let mut map = Map::new(Frame { x: 0.0, y: 0.0, resolution: 0.05, width: 300, height: 300 }).unwrap();
    for cell in (0..300 * 300).filter(|cell| (cell % 300 + cell / 300) % 2 == 0) {
        map.set(cell % 300, cell / 300, Cell::Occupied);
    }
    assert!(walls(&map).unwrap_err().starts_with("the map's free space has more than 16384 walls"));
    let folder = Folder::new("many");
    let file = folder.saved("noise.yaml", &map);
    let refused = folder.refused(&file, &["world.start=[1, 1, 0]"]);
    assert!(refused.starts_with("noise.yaml: the map's free space has more than"), "{refused}");
}

#[test]
fn a_saved_map_is_loaded_again() {
    let folder = Folder::new("saved");
    let map = drawn(-1.35, 0.15000000000000002, 0.05, &["#.# ", " ..#", "####"]);
    assert_eq!(load(&folder.saved("a map #2.yaml", &map)).unwrap(), map);
    assert_eq!(load(&folder.saved("b.yml", &map)).unwrap(), map);
    let refused = |name: &str| save(&map, &folder.0.join(name)).unwrap_err();
    assert!(refused("map.pgm").ends_with("a map's name ends in .yaml"));
    assert!(refused("it's.yaml").ends_with("a name with letters that a map's text cannot contain"));
    assert!(refused("none/map.yaml").ends_with("none/map.pgm: No such file or directory (os error 2)"));
}

#[test]
fn shipped_worlds_become_maps_and_worlds_again_cell_by_cell() {
    let folder = Folder::new("round");
    for name in ["corridor", "empty", "foyer", "hall", "warehouse"] {
        let first = config::world(&shipped(), Some(name.as_ref()), &[]).unwrap();
        let map = of_rooms(&first).unwrap();
        let count = |cell| map.cells().iter().filter(|other| **other == cell).count();
        assert!(count(Cell::Free) > 10_000 && count(Cell::Occupied) > 500, "{name}");
        let file = folder.saved(&format!("{name}.yaml"), &map);
        let Pose { x, y, theta } = first.start;
        let start = format!("[{x:?}, {y:?}, {:?}]", theta.radians());
        let direct = world(&file, &[&format!("world.start={start}")]).unwrap();
        assert_eq!(of_rooms(&direct).unwrap(), map, "{name}");
        let file = folder.write(&format!("{name}.toml"), format!("start = {start}\nmap = \"{name}.yaml\"\n"));
        let by_key = world(&file, &[]).unwrap();
        assert_eq!(by_key.walls, direct.walls, "{name}");
        // Where the robot can be, the planner's map is that of the world, too.
        let planned = of_world(&direct).unwrap();
        for row in 0..map.frame().height {
            for column in 0..map.frame().width {
                let (x, y) = map.frame().centre(column, row);
                let (cell, shown) = (map.at(x, y), planned.at(x, y));
                match cell {
                    Some(Cell::Free) => assert_eq!(shown, cell, "{name}: {x}, {y}"),
                    Some(Cell::Unknown) => {}
                    _ => assert!(shown.is_some_and(|shown| shown != Cell::Unknown), "{name}: {x}, {y}"),
                }
            }
        }
    }
}

#[test]
fn a_world_without_outer_walls_is_enclosed_by_its_map() {
    let pillar = simulator::world::Column { centre: Point { x: 1.0, y: 1.0 }, radius: 0.2 };
    let open = World { columns: vec![pillar], start: Pose::new(-1.0, -1.0, 0.0), ..World::default() };
    let map = of_rooms(&open).unwrap();
    assert_eq!(map.at(-1.0, -1.0), Some(Cell::Free));
    assert_eq!(map.at(1.0, 1.0), Some(Cell::Unknown), "within the pillar");
    let (width, height) = (map.frame().width, map.frame().height);
    for at in 0..width.min(height) {
        for (column, row) in [(at, 0), (at, height - 1), (0, at), (width - 1, at)] {
            assert_ne!(map.cells()[row * width + column], Cell::Free);
        }
    }
    let closed = World { walls: walls(&map).unwrap(), columns: Vec::new(), ..open };
    assert_eq!(of_rooms(&closed).unwrap(), map);
}

#[test]
fn a_world_has_the_walls_of_its_map_beside_its_own() {
    let folder = Folder::new("beside");
    folder.saved("plan.yaml", &room(60, 40));
    let text = "start = [2, 2, 0]\nmap = \"plan.yaml\"\nwalls = [[3, 0, 3, 1]]\nglass = [[4, 0, 4, 1]]\npeople = 3\n";
    let file = folder.write("room.toml", text);
    let read = world(&file, &[]).unwrap();
    assert_eq!((read.walls.len(), read.glass.len(), read.people.count, read.map), (6, 1, 3, None));
    assert_eq!(world(&file, &["world.map=plan.yaml", "world.people=0"]).unwrap().walls.len(), 6);
    // Both texts make it again when its files are gone.
    let source = WorldSource::read(&shipped(), Some(&file), &["world.people=9".into()]).unwrap();
    let node = |text: &str| settings::Node::parse(Path::new("world.toml"), text).unwrap();
    let walls = source.walls.as_deref().map(node);
    let again = config::recorded_world(node(&source.text), Path::new("w"), &["world.people=9".into()], walls).unwrap();
    assert_eq!(again, source.world);
    assert_eq!(again.people.count, 9);
    let ConfigError(lines) = config::parsed_world(node(&source.text), Path::new("w"), &[]).unwrap_err();
    assert_eq!(lines, ["w: map = \"plan.yaml\": a file that is not here"]);
}

#[test]
fn a_robot_starts_in_the_middle_of_a_map_or_at_the_start_that_is_given() {
    let folder = Folder::new("start");
    let mut map = room(60, 40);
    let file = folder.saved("room.yaml", &map);
    let read = world(&file, &[]).unwrap();
    assert!(read.start.point().distance(Point { x: 3.0, y: 2.0 }) < 0.1, "{:?}", read.start);
    assert!(read.routes.is_empty() && read.walls.len() == 4);
    assert_eq!(world(&file, &["world.start=[1, 1.5, 1]"]).unwrap().start, Pose::new(1.0, 1.5, 1.0));
    // A block in the middle: beside it.
    for (column, row) in (0..40).flat_map(|row| (25..37).map(move |column| (column, row))) {
        map.set(column, row, Cell::Occupied);
    }
    let beside = world(&folder.saved("block.yaml", &map), &[]).unwrap().start;
    assert!((1.0..1.4).contains(&beside.x) || (4.6..5.0).contains(&beside.x), "{beside:?}");
    assert!(of_world(&read).unwrap().at(beside.x, beside.y) == Some(Cell::Free));
    for start in ["[3, 2, 0]", "[-5, 2, 0]"] {
        let refused = folder.refused(&folder.0.join("block.yaml"), &[&format!("world.start={start}")]);
        assert!(refused.starts_with("block.yaml: start: ") && refused.ends_with("not on a free cell of the map"));
    }
    let narrow = folder.saved("narrow.yaml", &room(90, 14));
    let why = "narrow.yaml: no place in the map is 0.8 m from everything; choose one: --set world.start=[X,Y,THETA]";
    assert_eq!(folder.refused(&narrow, &[]), why);
    assert!(world(&narrow, &["world.start=[2, 0.7, 0]"]).is_ok());
}

#[test]
fn files_that_are_wrong_are_named() {
    let folder = Folder::new("wrong");
    let start = "start = [2, 2, 0]\n";
    let file = folder.write("w.toml", format!("{start}map = \"gone.yaml\"\n"));
    assert_eq!(folder.refused(&file, &[]), "w.toml: map: gone.yaml: No such file or directory (os error 2)");
    let refused = folder.refused(&folder.0.join("gone.yaml"), &[]);
    assert!(refused.starts_with("gone.yaml: No such file or directory (os error 2); a world is"), "{refused}");
    let yaml = |image: &str, theta: &str| {
        format!(
            "image: {image}\nresolution: 0.1\norigin: [0, 0, {theta}]\nnegate: 0\noccupied_thresh: 0.65\n\
             free_thresh: 0.196\n"
        )
    };
    folder.write("a.yaml", yaml("none.pgm", "0"));
    let file = folder.write("w.toml", format!("{start}map = \"a.yaml\"\n"));
    assert_eq!(folder.refused(&file, &[]), "w.toml: map: none.pgm: No such file or directory (os error 2)");
    folder.write("short.pgm", "P5\n40 40\n255\n");
    folder.write("a.yaml", yaml("short.pgm", "0"));
    let refused = folder.refused(&file, &[]);
    assert!(refused.starts_with("w.toml: map: short.pgm: byte ") && refused.contains("the picture ends after 0 of"));
    folder.write("a.yaml", yaml("short.pgm", "0.5"));
    let refused = folder.refused(&file, &[]);
    assert!(refused.starts_with("w.toml: map: a.yaml: line 3: origin: "), "{refused}");
    let file = folder.write("w.toml", format!("{start}map = \"\"\n"));
    let refused = folder.refused(&file, &[]);
    assert!(refused.starts_with("w.toml:2: map = \"\": expected"), "{refused}");
    let map = folder.saved("b.yaml", &room(60, 40));
    let refused = folder.refused(&map, &["world.map=a.yaml"]);
    assert_eq!(refused, "b.yaml: map: the world is a map itself");
}

#[test]
fn a_map_in_the_folder_of_worlds_is_a_world_by_its_name() {
    let folder = Folder::new("named");
    let worlds = folder.0.join("worlds");
    fs::create_dir_all(&worlds).unwrap();
    save(&room(60, 40), &worlds.join("attic.yaml")).unwrap();
    let conf = folder.0.join("conf");
    assert_eq!(config::world(&conf, Some("attic".as_ref()), &[]).unwrap().walls.len(), 4);
    // A world of the same name is the world.
    fs::write(worlds.join("attic.toml"), "start = [1, 1, 0]\n").unwrap();
    assert_eq!(config::world(&conf, Some("attic".as_ref()), &[]).unwrap().walls.len(), 0);
}

#[test]
fn the_largest_map_has_an_outline_and_the_worst_pattern_is_refused() {
    let side = 4096;
    let frame = Frame { x: 0.0, y: 0.0, resolution: 0.05, width: side, height: side };
    let mut map = Map::new(frame).unwrap();
    assert_eq!(walls(&map).unwrap().len(), 4);
    for (column, row) in (0..side).flat_map(|row| (0..side).map(move |column| (column, row))) {
        if (column + row) % 2 == 0 {
            map.set(column, row, Cell::Occupied);
        }
    }
    let why = walls(&map).unwrap_err();
    assert!(why.contains("more than 16384 walls"), "{why}");
}
