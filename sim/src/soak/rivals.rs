//! Others who command the robot beside its operator, to exercise the arbitration: sources of the robot's own, and
//! foreigners on the message bus and on the CAN bus, who must not have any effect. None of them avoids obstacles.

use super::chaos::Fault;
use crate::check::Limits;
use crate::check::wire::Wheel;
use crate::host::Virtual;
use base::can::Frame;
use base::{Duration, Instant};
use messages::{Message, common, lowlevel, middlelevel};
use module::State;
use module::admission::{Sender, Way};

/// Period of motion commands, estimates, and what foreigners send on the message bus.
const PERIOD: Duration = Duration::from_millis(50);
/// Period of foreign commands on the CAN bus.
const FRAME_PERIOD: Duration = Duration::from_millis(4);
/// Period of reports of the PAUSE line.
const PAUSE_PERIOD: Duration = Duration::from_millis(500);
/// Duration of zero before a manual source commands motion.
const ZERO: Duration = Duration::from_millis(100);
/// Names and priorities of manual sources.
const MANUAL: [(&str, i8); 3] = [
    ("remote", lowlevel::CmdMotion::REMOTE),
    ("gamepad", lowlevel::CmdMotion::GAMEPAD),
    ("maintenance", lowlevel::CmdMotion::MAINTENANCE),
];

/// Sends the messages of a rival; false if the fault is not of this kind. `drive`: the target commands `value` m/s with
/// the priority of its name, by default the planner's. `plan`: the same with a goal and an estimate, which a robot with
/// an estimator does not accept; `plan_unasked`: without a goal; `plan_blind`: without an estimate. `engage`: the
/// target reports that it engages the PAUSE line.
///
/// From a sender that does not belong to this robot, `network` or `host`: `foreign_drive` commands `value` m/s,
/// `foreign_pause` reports that the PAUSE line is open, `foreign_list` that all processes run, `foreign_release` does
/// all that an operator can do to release the robot. From another node on the CAN bus, to a drive: `foreign_pdo`
/// commands `value` m/s, `foreign_nmt` stops the node, `foreign_sdo` takes its quick stop away.
pub(super) fn speak(machine: &mut Virtual, fault: &Fault, limits: &Limits) -> bool {
    let now = machine.now();
    let end = now + Duration::from_secs_f64(fault.lasts.clamp(0.0, 600.0));
    let times = |period| std::iter::successors(Some(now), move |at| Some(*at + period).filter(|at| *at < end));
    match fault.fault.as_str() {
        "drive" => command(machine, fault, end, false, false),
        "plan" => command(machine, fault, end, true, true),
        "plan_unasked" => command(machine, fault, end, false, true),
        "plan_blind" => command(machine, fault, end, true, false),
        "engage" => {
            for at in times(PAUSE_PERIOD) {
                machine.inject(at, lowlevel::EventStop { timestamp: 0, engaged: true, source: fault.target.clone() });
            }
        }
        "foreign_drive" | "foreign_pause" | "foreign_list" | "foreign_release" => {
            let Some(sender) = foreigner(&fault.target) else { return false };
            for at in times(PERIOD) {
                for message in foreign_messages(machine, fault, at == now) {
                    machine.inject_by(at, sender, message);
                }
            }
        }
        "foreign_pdo" | "foreign_nmt" | "foreign_sdo" => {
            let Some((bus, frame)) = foreign_frame(fault, limits) else { return false };
            return times(FRAME_PERIOD).all(|at| machine.inject_frame(at, bus, frame));
        }
        _ => return false,
    }
    true
}

fn command(machine: &mut Virtual, fault: &Fault, end: Instant, asked: bool, located: bool) {
    let now = machine.now();
    let mut at = now;
    while at < end {
        if asked {
            machine.inject(at, goal());
        }
        if located {
            let quality = middlelevel::DataEstimate::FINE;
            machine.inject(at, middlelevel::DataEstimate { quality, ..Default::default() });
        }
        // Most begin with zero; a source that does not is obeyed only the first time.
        let zero = at < now + ZERO && !now.as_nanos().is_multiple_of(4);
        machine.inject(at, motion(&fault.target, if zero { 0.0 } else { fault.value }));
        at += PERIOD;
    }
}

fn goal() -> middlelevel::CmdGoal {
    middlelevel::CmdGoal { waypoints: vec![middlelevel::Waypoint::default()], ..Default::default() }
}

fn motion(source: &str, speed: f64) -> lowlevel::CmdMotion {
    let known = MANUAL.into_iter().find(|(name, _)| *name == source);
    let priority = known.map_or(lowlevel::CmdMotion::PLANNER, |(_, priority)| priority);
    lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source: source.into() }
}

/// Sender by the name of a target: a program of another computer, or of another user of this one.
fn foreigner(name: &str) -> Option<Sender> {
    match name {
        "network" => Some(Sender { way: Way::Network, process: None }),
        "host" => Some(Sender { way: Way::Host, process: None }),
        _ => None,
    }
}

fn foreign_messages(machine: &Virtual, fault: &Fault, first: bool) -> Vec<Message> {
    match fault.fault.as_str() {
        "foreign_drive" => {
            let (speed, priority) = (if first { 0.0 } else { fault.value }, lowlevel::CmdMotion::MAINTENANCE);
            let source = fault.target.clone();
            vec![lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source }.into()]
        }
        "foreign_pause" => vec![lowlevel::EventStop::default().into()],
        "foreign_list" => {
            let row = |(pid, module): (u32, &str)| common::Process {
                module: module.into(),
                pid: i32::try_from(pid).unwrap_or(0),
                phase: common::Process::RUNNING,
                state: State::Run as i8,
                wanted: State::Run as i8,
                ..Default::default()
            };
            vec![common::DataProcesses { timestamp: 0, processes: machine.processes().map(row).collect() }.into()]
        }
        _ => {
            let (state, source) = (State::Run as i8, fault.target.clone());
            let run = common::CmdState { timestamp: 0, module: "*".into(), state, manual: true, source };
            let homing = lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() };
            let motors = rs485::boards::psc1::CHANNELS.iter().position(|name| *name == "motors").unwrap_or(0) as i8;
            let power = lowlevel::CmdPower { timestamp: 0, device: motors, action: lowlevel::CmdPower::ON };
            vec![run.into(), homing.into(), power.into(), goal().into()]
        }
    }
}

/// The frame of another master, and its bus.
fn foreign_frame<'a>(fault: &Fault, limits: &'a Limits) -> Option<(&'a str, Frame)> {
    let wheel = limits.wheels.iter().find(|wheel| wheel.name == fault.target);
    let steering = limits.steering.as_ref().filter(|_| fault.target == "steering");
    let of = wheel.map(|wheel| &wheel.drive).or(steering)?;
    let frame = match (fault.fault.as_str(), wheel) {
        ("foreign_pdo", Some(Wheel { drive, units_per_mps, .. })) => drive.drive_at(fault.value * units_per_mps),
        // A frame that the steering does not receive.
        ("foreign_pdo", None) => Some(Frame::standard(0x500 + u16::from(of.node), &[0x0F, 0, 0, 0, 0, 0])),
        ("foreign_nmt", _) => of.foreign_stop(),
        _ => of.foreign_parameter(),
    };
    Some((limits.buses.get(usize::from(of.bus))?, frame?))
}
