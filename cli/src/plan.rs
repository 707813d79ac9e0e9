//! `advee plan`: a drivable way on a map file, or in a world, without a robot.

use super::{Common, Failed, Outcome, finite, print};
use navitools::{Ackermann, Pose};
use planner::Direction;
use planner::map::{Field, Frame, Unknown};
use planner::path::{self, PathPoint};
use planner::search::{Abilities, Budget, Footprint, Goal, Limits, Search, SearchError};
use robot::{config, map_file};
use serde_json::json;
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

#[derive(clap::Args)]
pub struct Plan {
    /// The map: YAML and PGM as nav2's map_server reads them
    #[arg(long, value_name = "FILE", required_unless_present = "world", conflicts_with = "world")]
    map: Option<PathBuf>,
    /// A world in place of a map: a file, or a name in conf/worlds
    #[arg(long, value_name = "NAME")]
    world: Option<PathBuf>,
    /// Start pose of the rear axle's centre: m, m, rad
    #[arg(long, value_name = "X,Y,THETA", allow_hyphen_values = true, value_parser = numbers::<3, 3>)]
    start: Numbers,
    /// Target pose; without an angle the heading is free
    #[arg(long, value_name = "X,Y[,THETA]", allow_hyphen_values = true, value_parser = numbers::<2, 3>)]
    goal: Numbers,
    /// Nearer than this is there, m
    #[arg(long, value_name = "M", value_parser = finite, default_value = "0")]
    tolerance: f64,
    /// Length and width, m [default: the configured robot's]
    #[arg(long, value_name = "L,W", value_parser = numbers::<2, 2>)]
    footprint: Option<Numbers>,
    /// Rear axle to front axle, m; the robot's middle is halfway [default: the configured robot's]
    #[arg(long, value_name = "M", value_parser = finite)]
    wheelbase: Option<f64>,
    /// The least turning radius of the rear axle's middle, m [default: the configured robot's]
    #[arg(long, value_name = "M", value_parser = finite)]
    radius: Option<f64>,
    /// Drive through what is unknown
    #[arg(long)]
    through_unknown: bool,
    /// The way: x,y,theta,curvature,direction,s
    #[arg(long, value_name = "CSV")]
    out: Option<PathBuf>,
    /// Machine-readable
    #[arg(long)]
    json: bool,
}

pub fn plan(common: &Common, command: &Plan) -> Outcome {
    match way(common, command) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(failed) => {
            if command.json {
                print(json!({ "found": false, "reason": failed.why }))?;
            }
            Err(failed)
        }
    }
}

fn way(common: &Common, command: &Plan) -> Result<(), Failed> {
    let limits = limits(common, command)?;
    if let (Some(_), Some(set)) = (&command.map, common.sets.iter().find(|set| config::is_of_world(set))) {
        return Err(format!("{set}: there is no world beside a map").into());
    }
    let map = match (&command.map, &command.world) {
        (Some(file), _) => map_file::load(file)?,
        (None, world) => map_file::of_world(&config::world(&common.config_dir(), world.as_deref(), &common.sets)?)?,
    };
    let unknown = if command.through_unknown { Unknown::Free } else { Unknown::Blocked };
    let field = Field::new(&map, unknown);
    let (start, goal) = (&command.start.0, &command.goal.0);
    let start = Pose::new(start[0], start[1], start[2]);
    let goal = Goal { x: goal[0], y: goal[1], heading: goal.get(2).copied(), tolerance_m: command.tolerance };
    let mut search = Search::new(limits);
    let begun = Instant::now();
    let found = search.plan(&field, start, goal, Budget::default()).cloned();
    let milliseconds = begun.elapsed().as_secs_f64() * 1e3;
    let expansions = search.expansions();
    let path = found.map_err(|why| reason(why, field.frame(), start, goal))?;
    if let Some(out) = &command.out {
        fs::write(out, csv(&path)).map_err(|error| format!("{}: {error}", out.display()))?;
    }
    let (length, cusps, clearance, margin) = (path.length(), path.cusps().count(), path.clearance(), path.margin());
    if command.json {
        return print(json!({
            "found": true,
            "reason": null,
            "length": length,
            "cusps": cusps,
            "clearance": clearance,
            "margin": margin,
            "milliseconds": milliseconds,
            "expansions": expansions,
        }));
    }
    let narrow = if margin < limits.margin_m {
        format!(", planned with a margin of {:.0} mm instead of {:.0} mm", 1e3 * margin, 1e3 * limits.margin_m)
    } else {
        String::new()
    };
    print(format_args!(
        "{length:.2} m, {cusps} changes of direction, clearance {clearance:.2} m{narrow}; {expansions} states in \
         {milliseconds:.1} ms"
    ))
}

/// Reason why there is no way: a place outside of the map is named with the map's extent.
fn reason(why: SearchError, map: &Frame, start: Pose, goal: Goal) -> String {
    match why {
        SearchError::GoalBlocked if map.is_outside(goal.x, goal.y) => {
            format!("the goal is outside the map, which is {}", map.extent())
        }
        SearchError::StartBlocked if map.is_outside(start.x, start.y) => {
            format!("the start is outside the map, which is {}", map.extent())
        }
        why => why.to_string(),
    }
}

/// Limits from the arguments, else from the configuration.
fn limits(common: &Common, command: &Plan) -> Result<Limits, Failed> {
    let given = (command.footprint.as_ref(), command.wheelbase, command.radius);
    // Overrides are checked even if the arguments leave nothing to the configuration.
    let loaded = if common.sets.is_empty() { None } else { Some(common.load(false)?.robot) };
    let mut shape = None;
    let (length_m, width_m, rear_m, radius, abilities) = if let (Some(footprint), Some(wheelbase), Some(radius)) = given
    {
        (footprint.0[0], footprint.0[1], (footprint.0[0] - wheelbase) / 2.0, radius, Abilities::default())
    } else {
        let robot = match loaded {
            Some(robot) => robot,
            None => common.load(false)?.robot,
        };
        let config::Robot { geometry, limits, .. } = &robot;
        let (length, width) =
            given.0.map_or((geometry.length_m(), geometry.width_m()), |given| (given.0[0], given.0[1]));
        let rear = match (given.0, given.1) {
            (None, None) => {
                shape = geometry.footprint().copied();
                geometry.rear_m()
            }
            (_, wheelbase) => (length - wheelbase.unwrap_or(geometry.wheelbase_m)) / 2.0,
        };
        let wheelbase_m = given.1.unwrap_or(geometry.wheelbase_m);
        let sharpest = Ackermann { wheelbase_m, track_m: geometry.track_m }.curvature(limits.steering_rad);
        (length, width, rear, given.2.unwrap_or(1.0 / sharpest), robot.abilities())
    };
    let sensible = [length_m, width_m, radius].iter().all(|size| (0.05..=100.0).contains(size)) && rear_m >= 0.0;
    if !sensible {
        return Err(format!(
            "a footprint of {length_m} m by {width_m} m, the axle {rear_m} m from its rear, on a radius of {radius} m: \
             expected sizes from 0.05 to 100 m, and the wheelbase within the length"
        )
        .into());
    }
    Ok(Limits { abilities, shape, ..Limits::new(Footprint { length_m, width_m, rear_m }, radius) })
}

fn csv(path: &path::Path) -> String {
    let mut text = String::from("x,y,theta,curvature,direction,s\n");
    for PathPoint { pose, curvature, direction, s } in path.points() {
        let direction = match direction {
            Direction::Forward => 1,
            Direction::Backward => -1,
            Direction::Left => 2,
            Direction::Right => -2,
            Direction::TurnLeft => 3,
            Direction::TurnRight => -3,
        };
        let theta = pose.theta.radians();
        // Writing to a string does not fail.
        let _ = writeln!(text, "{:.6},{:.6},{theta:.6},{curvature:.6},{direction},{s:.6}", pose.x, pose.y);
    }
    text
}

/// Numbers with commas in between.
#[derive(Clone, Debug)]
struct Numbers(Vec<f64>);

fn numbers<const LEAST: usize, const MOST: usize>(text: &str) -> Result<Numbers, String> {
    let numbers = text.split(',').map(|part| finite(part.trim())).collect::<Result<Vec<f64>, _>>();
    let numbers = numbers.ok().filter(|numbers| (LEAST..=MOST).contains(&numbers.len()));
    let range = if LEAST == MOST { LEAST.to_string() } else { format!("{LEAST} to {MOST}") };
    numbers.map(Numbers).ok_or_else(|| format!("expected {range} numbers with commas in between"))
}
