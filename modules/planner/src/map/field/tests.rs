//! Distances compared with a brute-force search.

use super::*;

fn random(seed: &mut u32, count: usize) -> usize {
    *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    (*seed >> 8) as usize % count
}

/// Distance by comparing with every cell, and with the ring of cells outside.
fn brute(map: &Map, column: usize, row: usize) -> f32 {
    let (width, height) = (map.frame().width as i64, map.frame().height as i64);
    let (x, y) = (column as i64, row as i64);
    let mut least = i64::MAX;
    for b in -1..=height {
        for a in -1..=width {
            let inside = (0..width).contains(&a) && (0..height).contains(&b);
            if !inside || map.cells()[(b * width + a) as usize] == Cell::Occupied {
                least = least.min((a - x) * (a - x) + (b - y) * (b - y));
            }
        }
    }
    (least as f32).sqrt() * map.frame().resolution as f32
}

fn scattered(seed: &mut u32) -> Map {
    let (width, height) = (1 + random(seed, 25), 1 + random(seed, 25));
    let mut map = Map::new(Frame { x: -0.4, y: 0.3, resolution: 0.05, width, height }).unwrap();
    for _ in 0..random(seed, 12) {
        map.set(random(seed, width), random(seed, height), Cell::Occupied);
    }
    map
}

#[test]
fn distances_are_exact() {
    let mut seed = 3;
    for _ in 0..300 {
        let map = scattered(&mut seed);
        let field = Field::new(&map, Unknown::Blocked);
        for row in 0..map.frame().height {
            for column in 0..map.frame().width {
                assert_eq!(field.cell(column, row), brute(&map, column, row), "{column} {row} of {:?}", map.frame());
            }
        }
    }
}

#[test]
fn unknown_cells_block_as_configured() {
    let mut map = Map::around((0.0, 0.0), (5.0, 5.0), 0.05).unwrap();
    map.set(50, 50, Cell::Unknown);
    assert_eq!(Field::new(&map, Unknown::Blocked).cell(50, 50), 0.0);
    assert!(Field::new(&map, Unknown::Free).cell(50, 50) > 2.0);
}

#[test]
fn obstacles_come_and_go_without_a_trace() {
    let map = Map::around((0.0, 0.0), (6.0, 4.0), 0.05).unwrap();
    let still = Field::new(&map, Unknown::Blocked);
    let mut field = still.clone();
    let obstacles = [
        Obstacle { x: 2.0, y: 2.0, radius: 0.2 },
        Obstacle { x: 2.3, y: 2.1, radius: 0.0 },
        Obstacle { x: 0.0, y: 0.0, radius: 1.0 },
    ];
    field.overlay(&obstacles);
    assert_ne!(field.identity(), still.identity());
    assert!(field.distance(2.0, 2.19) <= 0.0 && field.distance(2.3, 2.1) <= 0.0);
    let at = field.distance(2.0, 3.0);
    assert!((at - 0.8).abs() < 0.08, "{at}");
    // Each cell has the minimum of its distances from the map and from each obstacle within reach.
    for row in 0..80 {
        for column in 0..120 {
            let (x, y) = still.frame().centre(column, row);
            let middle = |at: f64| (libm::floor(at / 0.05) + 0.5) * 0.05;
            let away = |obstacle: &Obstacle| {
                (libm::hypot(x - middle(obstacle.x), y - middle(obstacle.y)) - obstacle.radius) as f32
            };
            let nearest = obstacles.iter().map(away).fold(still.cell(column, row), f32::min);
            let seen = field.cell(column, row);
            assert!(
                (seen - nearest).abs() < 1e-4 || f64::from(nearest) > REACH_M - 0.1,
                "{column} {row}: {seen} {nearest}"
            );
        }
    }
    field.overlay(&[]);
    assert_eq!((field.identity(), &field.live), (still.identity(), &still.live));
    let nothing = [f64::NAN, f64::INFINITY, -1.0].map(|odd| Obstacle { x: odd, y: 1.0, radius: odd });
    field.overlay(&nothing);
    field.overlay(&[Obstacle { x: 1.0, y: 1.0, radius: f64::NAN }, Obstacle { x: 1.0, y: 1.0, radius: -1.0 }]);
    assert_eq!(field.live, still.live);
}

#[test]
fn another_map_has_another_identity() {
    let mut map = Map::around((0.0, 0.0), (2.0, 2.0), 0.05).unwrap();
    let one = Field::new(&map, Unknown::Blocked).identity();
    assert_eq!(one, Field::new(&map, Unknown::Blocked).identity());
    map.set(3, 3, Cell::Occupied);
    assert_ne!(one, Field::new(&map, Unknown::Blocked).identity());
}
