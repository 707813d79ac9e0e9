//! `advee goal X,Y[,THETA]… [--loop]`, `advee goal cancel`, `advee goal --route NAME`: sends the robot somewhere.

use super::bus::{Heard, Tool};
use super::release::Release;
use super::{Common, Failed, Outcome, holder, print};
use base::{Duration, Instant};
use host::clock;
use host::log::OneLine;
use messages::lowlevel::DataHold;
use messages::middlelevel::{CmdGoal, DataEstimate, DataGoal, Waypoint};
use messages::{Channel, Hold, Message};
use navitools::Point;
use robot::config::{self, SIMULATOR};
use simulator::world::Route;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true, after_help = EXAMPLES)]
pub struct Goal {
    /// Target, m and rad; or `cancel`: stand still; without one the present goal is shown
    #[arg(conflicts_with = "route", value_name = "X,Y[,THETA]", value_parser = place)]
    waypoints: Vec<Destination>,
    /// A way of the simulated world's, by its name
    #[arg(long, value_name = "NAME")]
    route: Option<String>,
    /// The world that has it, if that is not the one that is simulated here
    #[arg(long, value_name = "FILE", requires = "route", conflicts_with = "waypoints")]
    world: Option<PathBuf>,
    /// Begin again after the last waypoint, for ever
    #[arg(long = "loop")]
    looped: bool,
    /// Distance that counts as reached, m
    #[arg(long, value_name = "M", default_value = "0", value_parser = super::finite)]
    tolerance: f64,
    /// Wait until the robot is ready before the goal is sent; release it where that waits for an operator
    #[arg(long)]
    when_ready: bool,
    /// Wait until it is reached
    #[arg(long, conflicts_with = "looped")]
    wait: bool,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  advee goal                    the present goal
  advee goal 12,3 --wait        there, until it is reached
  advee goal 12,3 5,6,1.57      by way of 12,3 to 5,6, heading 1.57 rad
  advee goal --route patrol     a route of the simulated world
  advee goal cancel             stands still";

/// Status of a goal in a word, by its number.
pub const STATUS: [&str; 6] = ["idle", "driving", "reached", "blocked", "failed", "cancelled"];

/// One argument.
#[derive(Clone, Debug, PartialEq)]
enum Destination {
    Cancel,
    At(Waypoint),
}

/// The planner answers at once.
const ANSWER: Duration = Duration::from_secs(2);
/// And knows after this time whether there is a way.
const KNOWN: Duration = Duration::from_secs(6);
/// A robot that is not ready by then will not be: homing takes 20 s at most, to find itself a few sweeps.
const READY: Duration = Duration::from_secs(60);
/// What was said longer ago is not known any more; the slowest of it comes at 5 Hz.
const CURRENT: Duration = Duration::from_millis(500);

fn place(text: &str) -> Result<Destination, String> {
    if text == "cancel" {
        return Ok(Destination::Cancel);
    }
    waypoint(text).map(Destination::At).map_err(|expected| format!("{expected}, or cancel"))
}

/// A place as people write it: `X,Y` or `X,Y,THETA`.
pub fn waypoint(text: &str) -> Result<Waypoint, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| super::finite(part.trim())).collect();
    match numbers.as_deref() {
        Ok([x, y]) => Ok(Waypoint { x: *x, y: *y, theta: 0.0, tolerance: 0.0, heading: false }),
        Ok([x, y, theta]) => Ok(Waypoint { x: *x, y: *y, theta: *theta, tolerance: 0.0, heading: true }),
        _ => Err("expected X,Y or X,Y,THETA".into()),
    }
}

pub fn goal(common: &Common, command: &Goal) -> Outcome {
    if command.waypoints.is_empty() && command.route.is_none() {
        return show(common, command);
    }
    let channels = [Channel::MlDataGoal, Channel::LlDataMotion, Channel::LlDataHold, Channel::MlDataEstimate];
    // Whatever is wrong with the goal is said before anything moves.
    let mut wanted = wanted(common, command)?;
    let mut tool = Tool::join(common, "goal", &channels)?;
    if command.when_ready {
        ready(&mut tool)?;
    }
    wanted.timestamp = tool.timestamp();
    // A number that no goal of late has had.
    wanted.id = (wanted.timestamp / 1000 % 1_000_000_000) as i32;
    tool.publish(wanted.clone())?;
    answer(common, command, &mut tool, &wanted)
}

/// Shows the present goal.
fn show(common: &Common, command: &Goal) -> Outcome {
    let options = [
        ("--loop", command.looped),
        ("--tolerance", command.tolerance != 0.0),
        ("--when-ready", command.when_ready),
        ("--wait", command.wait),
    ];
    if let Some((option, _)) = options.iter().find(|(_, given)| *given) {
        return Err(Failed { code: 2, why: format!("{option} needs a target: X,Y[,THETA] or --route NAME") });
    }
    let mut tool = Tool::join(common, "goal", &[Channel::MlDataGoal])?;
    let until = clock::now() + ANSWER;
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataGoal(goal)) if command.json => {
                print(serde_json::to_string(&goal).map_err(|error| error.to_string())?)?;
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Message(Message::MlDataGoal(goal)) => {
                print(in_words(&goal))?;
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Message(_) => {}
            Heard::Nothing => {
                return Err(format!("no planner is heard on {}; is advee up?", common.lcm_url()).into());
            }
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

/// `driving, 4.7 m left: drives to waypoint 1 of 1`.
fn in_words(goal: &DataGoal) -> String {
    let status = usize::try_from(goal.status).ok().and_then(|place| STATUS.get(place)).unwrap_or(&"?");
    let under_way = matches!(goal.status, DataGoal::DRIVING | DataGoal::BLOCKED) && goal.remaining.is_finite();
    let left = if under_way { format!(", {:.1} m left", goal.remaining) } else { String::new() };
    match (goal.status, goal.message.is_empty()) {
        (_, true) => format!("{status}{left}"),
        // The message begins with the status: `cancelled: there is no goal`.
        (DataGoal::CANCELLED, false) => OneLine(&goal.message).to_string(),
        (_, false) => format!("{status}{left}: {}", OneLine(&goal.message)),
    }
}

fn wanted(common: &Common, command: &Goal) -> Result<CmdGoal, super::Failed> {
    let mut goal = CmdGoal { r#loop: command.looped, ..CmdGoal::default() };
    if let Some(name) = &command.route {
        let simulated = |running: holder::Running| {
            let folders = [&running.place.run_dir, &common.run_dir()].map(std::fs::canonicalize);
            let here = matches!(folders, [Ok(theirs), Ok(ours)] if theirs == ours);
            (running.module == SIMULATOR && here).then_some(running.place.world).flatten()
        };
        let file = command.world.clone().or_else(|| holder::modules().find_map(simulated));
        let world = config::world(&common.config_dir(), file.as_deref(), &common.sets)?;
        let Some(route) = world.routes.iter().find(|route| route.name == *name) else {
            let there = world.routes.iter().map(|route| route.name.as_str()).collect::<Vec<_>>().join(", ");
            let there = if there.is_empty() { "none".into() } else { there };
            return Err(format!("route {name}: the world has none of that name; there are: {there}").into());
        };
        let way = by_route(route, command.tolerance);
        return Ok(CmdGoal { r#loop: goal.r#loop || way.r#loop, ..way });
    }
    match &command.waypoints[..] {
        [Destination::Cancel] => {}
        places => {
            for place in places {
                let Destination::At(waypoint) = place else { return Err("cancel stands alone".into()) };
                goal.waypoints.push(Waypoint { tolerance: command.tolerance, ..waypoint.clone() });
            }
        }
    }
    Ok(goal)
}

/// The goal of a route; its waypoints are reached within `tolerance`, m.
pub fn by_route(route: &Route, tolerance: f64) -> CmdGoal {
    let waypoint = |at: &Point| Waypoint { x: at.x, y: at.y, theta: 0.0, tolerance, heading: false };
    CmdGoal { waypoints: route.waypoints.iter().map(waypoint).collect(), r#loop: route.looped, ..CmdGoal::default() }
}

/// Until the robot knows where it is, and nothing stands against motion but that nobody commands it.
fn ready(tool: &mut Tool) -> Result<(), super::Failed> {
    let until = clock::now() + READY;
    let (mut located, mut homed, mut free) = (None, None, None);
    let mut release = Release::default();
    let mut why = String::from("LL_DATA_MOTION is not heard");
    let fresh = |at: Option<Instant>| at.is_some_and(|at| clock::now().since(at) < CURRENT);
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataEstimate(estimate)) => {
                located = (estimate.quality >= DataEstimate::COARSE).then(clock::now);
            }
            Heard::Message(Message::LlDataHold(list)) if list.is_of_motion() => {
                free = list.is_free().then(clock::now);
                release.on_holds(tool, &list)?;
            }
            Heard::Message(Message::LlDataMotion(motion)) => {
                homed = motion.homed.then(clock::now);
                let moves = fresh(homed) && fresh(free);
                why = if moves { "the estimator does not know where it is".into() } else { motion.reason };
            }
            Heard::Message(_) => {}
            Heard::Nothing => {
                return Err(format!("the robot is not ready within {} s: {why}", READY.as_secs()).into());
            }
            Heard::Interrupt => return Err("interrupted before the robot was ready; nothing was sent".into()),
        }
        if fresh(located) && fresh(homed) && fresh(free) {
            return Ok(());
        }
    }
}

/// What the planner says to it.
fn answer(common: &Common, command: &Goal, tool: &mut Tool, wanted: &CmdGoal) -> Outcome {
    let sent = clock::now();
    let mut last: Option<DataGoal> = None;
    let mut holds: Option<DataHold> = None;
    let mut others: Option<Instant> = None;
    loop {
        let until = match &last {
            None => sent + ANSWER,
            Some(_) if command.wait => Instant::NEVER,
            Some(_) => sent + KNOWN,
        };
        match tool.hear(until)? {
            Heard::Message(Message::MlDataGoal(goal)) if goal.id == wanted.id => {
                let news =
                    last.as_ref().is_none_or(|last| (last.status, &last.message) != (goal.status, &goal.message));
                if news && command.wait && !command.json {
                    print(format_args!("{}", goal.message))?;
                }
                (last, others) = (Some(goal), None);
            }
            Heard::Message(Message::LlDataHold(list)) if list.is_of_goal() => holds = Some(list),
            Heard::Message(Message::MlDataGoal(_)) if last.is_some() => {
                if is_replaced(&mut others, clock::now()) {
                    return Err("another goal has taken its place".into());
                }
            }
            Heard::Message(_) => {}
            Heard::Nothing => break,
            Heard::Interrupt => return Err("interrupted; the robot goes on to its goal".into()),
        }
        let decided = |goal: &DataGoal| over(goal) || (!command.wait && is_decided(goal, holds.as_ref()));
        if last.as_ref().is_some_and(decided) {
            break;
        }
    }
    let Some(goal) = last else {
        return Err(format!("no planner answers on {}; is advee up?", common.lcm_url()).into());
    };
    if command.json {
        print(serde_json::to_string(&goal).map_err(|error| error.to_string())?)?;
    } else if !command.wait && goal.status != DataGoal::FAILED {
        print(format_args!("{}", goal.message))?;
    }
    match goal.status {
        DataGoal::FAILED => Err(goal.message.into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// True if the planner speaks of other goals only: of one that it refuses it speaks once, and then goes on with this.
fn is_replaced(others: &mut Option<Instant>, now: Instant) -> bool {
    now.since(*others.get_or_insert(now)) >= CURRENT
}

/// Whether the planner knows what comes of a goal: it drives, or waits for something other than its own search.
fn is_decided(goal: &DataGoal, holds: Option<&DataHold>) -> bool {
    // A list from before the goal is about another one.
    let holds = holds.filter(|list| list.timestamp >= goal.timestamp);
    holds.is_some_and(|list| !matches!(list.first(), Some(Hold::Planning | Hold::Starting)))
}

fn over(goal: &DataGoal) -> bool {
    [DataGoal::REACHED, DataGoal::FAILED, DataGoal::CANCELLED].contains(&goal.status)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_goal_is_decided_by_the_planners_list_whatever_its_words() {
        let list = |timestamp, holds: &[Hold]| {
            let row = |hold: &Hold| messages::lowlevel::Hold { code: hold.code(), ..Default::default() };
            DataHold { timestamp, module: "planner".into(), holds: holds.iter().map(row).collect() }
        };
        for message in ["looks for a way", "begins", "reworded", ""] {
            let goal = DataGoal { timestamp: 10, message: message.into(), ..Default::default() };
            assert!(!is_decided(&goal, None));
            assert!(!is_decided(&goal, Some(&list(9, &[]))), "the list before");
            assert!(is_decided(&goal, Some(&list(10, &[]))), "it drives");
            assert!(is_decided(&goal, Some(&list(11, &[Hold::PauseButton, Hold::Planning]))));
            for thinks in [Hold::Planning, Hold::Starting] {
                assert!(!is_decided(&goal, Some(&list(10, &[thinks]))));
            }
        }
    }

    #[test]
    fn a_goal_is_replaced_when_the_planner_speaks_of_others_only() {
        let mut others = None;
        let at = Instant::from_millis;
        assert!(!is_replaced(&mut others, at(1000)) && !is_replaced(&mut others, at(1200)));
        // It speaks of this one again.
        others = None;
        assert!(!is_replaced(&mut others, at(1400)) && !is_replaced(&mut others, at(1899)));
        assert!(is_replaced(&mut others, at(1900)));
    }

    #[test]
    fn the_present_goal_is_a_sentence() {
        let goal = DataGoal {
            status: DataGoal::DRIVING,
            remaining: 4.71,
            message: "on its\nway".into(),
            ..Default::default()
        };
        assert!(in_words(&goal).starts_with("driving, 4.7 m left: on its") && !in_words(&goal).contains('\n'));
        assert_eq!(in_words(&DataGoal { remaining: f64::NAN, ..DataGoal::default() }), "idle");
        assert_eq!(in_words(&DataGoal { status: 99, ..DataGoal::default() }), "?");
        let message = "cancelled: there is no goal".into();
        let cancelled = DataGoal { status: DataGoal::CANCELLED, message, ..DataGoal::default() };
        assert_eq!(in_words(&cancelled), "cancelled: there is no goal");
    }

    #[test]
    fn a_place_is_two_numbers_or_three_or_no_place() {
        let at = |x, y, theta, heading| Ok(Destination::At(Waypoint { x, y, theta, tolerance: 0.0, heading }));
        assert_eq!(place("1,-2"), at(1.0, -2.0, 0.0, false));
        assert_eq!(place("1.5, 2 ,3.1"), at(1.5, 2.0, 3.1, true));
        assert_eq!(place("cancel"), Ok(Destination::Cancel));
        for bad in ["", "1", "1,2,3,4", "1,nan", "a,b", "inf,0", "1,,2"] {
            assert!(place(bad).is_err(), "{bad}");
        }
    }
}
