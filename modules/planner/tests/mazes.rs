//! A tenth of the bench's mazes, without a clock.

#[path = "../../../benches/plan/maze.rs"]
mod maze;

use maze::{LENGTH_M, RADIUS_M, REAR_M, WIDTH_M, maze};
use navitools::Arc;
use planner::map::{Field, Unknown};
use planner::path::Move;
use planner::search::{Budget, Footprint, Goal, Limits, Search};

#[test]
fn solvable_mazes_are_solved_by_drivable_paths() {
    let footprint = Footprint { length_m: LENGTH_M, width_m: WIDTH_M, rear_m: REAR_M };
    let mut search = Search::new(Limits::new(footprint, RADIUS_M));
    for number in 0..10 {
        let maze = maze(number);
        let field = Field::new(&maze.map, Unknown::Blocked);
        let goal = Goal { x: maze.goal.x, y: maze.goal.y, heading: Some(maze.goal.theta.radians()), tolerance_m: 0.0 };
        let path = search.plan(&field, maze.start, goal, Budget::default());
        let path = path.unwrap_or_else(|why| panic!("maze {number}, {}: {why}", maze.kind));
        assert!(path.length() < maze.way_m, "maze {number}: {} m, not {}", path.length(), maze.way_m);
        let mut pose = maze.start;
        for part in path.moves() {
            let Move::Arc(arc) = part else { panic!("{part:?} of a robot that steers") };
            assert!(libm::fabs(arc.curvature) * RADIUS_M <= 1.0 + 1e-9, "maze {number}: {arc:?}");
            let steps = libm::ceil(libm::fabs(arc.length) / 0.01);
            for _ in 0..steps as u32 {
                pose = pose.along(Arc { length: arc.length / steps, ..*arc }.motion());
                assert!(footprint.is_free(&field, pose), "maze {number}: touches at {pose:?}");
            }
        }
        assert!(pose.point().distance(maze.goal.point()) < 1e-6, "maze {number} ends at {pose:?}");
        assert!(libm::fabs((pose.theta - maze.goal.theta).radians()) < 1e-6);
    }
}
