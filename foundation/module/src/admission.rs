//! Which messages a module accepts: who may command is configured, what stops the robot is accepted from any sender,
//! and what releases it only from the process that is responsible for publishing it.
//!
//! A table of channel, content and sender, applied by a host before the [shell](crate::Shell): a recording holds the
//! messages that passed, with their [`Origin`] where a module needs it, and replay needs no senders.
//!
//! | message | accepted from |
//! |---|---|
//! | engages or keeps a stop: `LL_EVENT_STOP` engaged, `CM_CMD_STATE` other than RUN, `ML_CMD_GOAL` without waypoints,
//! `ML_CMD_MODE` MANUAL, `LL_DATA_GUARD` that permits nothing, `LL_DATA_RANGES` of unknown readings only | any sender |
//! | commands: the other `*_CMD_*`, and `LL_DATA_ACTIVE_BEACONS` | [`Commands`] |
//! | `CM_DATA_PROCESSES` | the watchdog that guards this process |
//! | `LL_EVENT_STOP` not engaged, of the power controller's line | its process, as that watchdog lists it |
//! | the same of a lidar whose fields stop the robot: `lidar.front` | the process of the lidars' driver, likewise |
//! | the same of a signal of `[io]` that stops the robot: `io.estop` | the process of the signals' driver, likewise |
//! | the same, for what the sender engaged itself | that sender, if [`Commands`] |
//! | `LL_EVENT_STOP` not engaged, of another source for itself | [`Commands`]: the same senders may overrule it |
//! | other `LL_DATA_GUARD`, `LL_DATA_RANGES` | the process of `guard`, and of the ranging boards' driver, likewise |
//! | `LL_DATA_SCAN`, `LL_DATA_IMU` | the process of the lidars' driver, and of that of the inertial units, likewise |
//! | `LL_DATA_MOTION`, `LL_DATA_VELOCITY`, of a robot that stands, too | the process of the motion's driver, likewise |
//! | `LL_DATA_NODE_IO`, whatever it says | the process of the motion's driver: it is the master of their bus |
//! | `LL_DATA_POWER`, `ML_DATA_ESTIMATE`, whatever they say | the power controller's process, and the estimator's |
//! | `LL_DATA_HOLD` of the motion's driver and of the planner | the process of the module that it names, likewise |
//! | `CM_DATA_STATE` RUN or PAUSE, for the watchdog, which judges by it | the module's process, as it lists it |
//! | any other `CM_DATA_STATE`, since that module does not do its work | any sender |
//! | others | any sender |
//!
//! Where the robot has no such module, and in a module that no watchdog started, these are accepted from any sender
//! that may command.

use base::Duration;
use messages::common::{CmdState, DataProcesses, DataState};
use messages::lowlevel::{DataGuard, DataRanges, Reading};
use messages::middlelevel::CmdMode;
use messages::{Channel, Message, StopSource};

/// Channels by which a module reports that all is well; a module that subscribes to one also needs `CM_DATA_PROCESSES`.
pub const RELEASES: [Channel; 12] = [
    Channel::CmDataProcesses,
    Channel::LlEventStop,
    Channel::LlDataGuard,
    Channel::LlDataRanges,
    Channel::LlDataScan,
    Channel::LlDataImu,
    Channel::LlDataMotion,
    Channel::LlDataVelocity,
    Channel::LlDataNodeIo,
    Channel::LlDataPower,
    Channel::LlDataHold,
    Channel::MlDataEstimate,
];

/// Silence after which another watchdog counts as gone.
pub const SECOND_ROBOT_END: Duration = Duration::from_secs(3);

/// Who may command the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Commands {
    /// Processes of the robot's users, through shared memory.
    Memory,
    /// Any process of this computer, as with the official LCM.
    #[default]
    Host,
    /// Any process of any computer that reaches the bus.
    Network,
}

/// Way by which a message came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Memory that only one of the robot's users can write.
    Memory,
    /// A socket of this computer.
    Host,
    /// A socket of another computer.
    Network,
}

/// A process of one of the robot's users.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Process {
    /// Process id: a process could claim that of another process of its own user, never of another user.
    pub pid: u32,
    /// User id, as the kernel says.
    pub uid: u32,
}

/// Sender of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Way.
    pub way: Way,
    /// The process, where it is known, and of one of the robot's users.
    pub process: Option<Process>,
}

impl Sender {
    /// Process id, where it is known.
    #[must_use]
    pub fn pid(self) -> Option<u32> {
        self.process.map(|process| process.pid)
    }
}

/// Who sent a message that was accepted, as far as a module treats senders differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The sender is the process that is responsible for the message, or none is known to be, or it makes no
    /// difference. False for what stops the robot and comes from another sender.
    pub due: bool,
    /// Process that sent a `LL_EVENT_STOP`, where it is known and a watchdog guards this process.
    pub process: Option<Process>,
}

impl Origin {
    /// Of a message whose sender makes no difference, and of all in a process that no watchdog guards.
    pub const DUE: Self = Self { due: true, process: None };
}

/// Maximum number of senders that are remembered to have engaged PAUSE in the name of a module; a further one replaces
/// the oldest.
const ENGAGING_MAX: usize = 8;

/// Lists of the watchdog, which come at 10 Hz or more, after which the robot has started: a module without a process
/// then has none.
const STARTING_LISTS: u32 = 50;

/// Why a message is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A command from a sender who may not command.
    Command,
    /// A report that all is well, from another process than the one that is responsible for it.
    Release,
    /// Likewise, before the watchdog has listed a process for it for the first time, as while the robot starts: the
    /// list may follow the message, so this is no fault of the sender.
    NotYet,
    /// The list of processes of another watchdog: another robot is on this bus.
    SecondRobot,
}

/// What a message does, as far as that decides whose messages are accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effect {
    Stops,
    Commands,
    SaysThatProcessesRun,
    /// Reports that nothing pauses the robot, that its way is free, how it moves, where it is, or what holds it.
    Frees(Witness),
    /// A module reports that it does its work.
    Works,
    /// Says that what the sender itself paused may go on.
    EndsItsOwnStop,
    Informs,
}

/// Module whose process is responsible for a report that frees the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Witness {
    Power,
    Guard,
    Ranging,
    Lidar,
    Imu,
    Io,
    Motion,
    Estimator,
    Planner,
}

impl Witness {
    const ALL: [Self; 9] = [
        Self::Power,
        Self::Guard,
        Self::Ranging,
        Self::Lidar,
        Self::Imu,
        Self::Io,
        Self::Motion,
        Self::Estimator,
        Self::Planner,
    ];
}

/// Rules of a robot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Policy {
    /// Who may command.
    pub commands: Commands,
    /// Module of the power controller, whose process publishes the state of the PAUSE line and of the power channels.
    pub power: Option<String>,
    /// Module that bounds the speed by what is sensed.
    pub guard: Option<String>,
    /// Module of the ranging boards.
    pub ranging: Option<String>,
    /// Module of the lidars.
    pub lidar: Option<String>,
    /// Module of the inertial measurement units.
    pub imu: Option<String>,
    /// Module of the signals by name, if one of them stops the robot.
    pub io: Option<String>,
    /// Module that moves the robot, and measures how it moves.
    pub motion: Option<String>,
    /// Module that knows where the robot is.
    pub estimator: Option<String>,
    /// Module that drives to goals.
    pub planner: Option<String>,
    /// Modules whose senders can be identified: their watchdog accepts their announcements from them alone.
    pub announcing: Vec<String>,
}

impl Policy {
    fn module(&self, witness: Witness) -> Option<&str> {
        let module = match witness {
            Witness::Power => &self.power,
            Witness::Guard => &self.guard,
            Witness::Ranging => &self.ranging,
            Witness::Lidar => &self.lidar,
            Witness::Imu => &self.imu,
            Witness::Io => &self.io,
            Witness::Motion => &self.motion,
            Witness::Estimator => &self.estimator,
            Witness::Planner => &self.planner,
        };
        module.as_deref()
    }

    /// True for a module some of whose messages are accepted from its process alone: a process of the watchdog's user.
    #[must_use]
    pub fn is_witness(&self, module: &str) -> bool {
        Witness::ALL.into_iter().any(|witness| self.module(witness) == Some(module))
    }
}

/// The rules as a module's process applies them.
#[derive(Clone, Debug)]
pub struct Admission {
    policy: Policy,
    /// The watchdog that guards this process; `None`: there is none.
    watchdog: Option<Process>,
    /// The witnesses, in the order of [`Witness`], as the watchdog last listed them; within, `None` if they had no
    /// process then. Processes of the watchdog's user. `None`: it never listed one.
    witnesses: [Option<Option<Process>>; Witness::ALL.len()],
    /// Number of lists of the watchdog, up to [`STARTING_LISTS`].
    lists: u32,
    /// Processes of [`Policy::announcing`], in that order, as this process last listed them, of its own user; empty: it
    /// is no watchdog.
    own: Vec<Option<Process>>,
    /// Senders that engaged PAUSE in the name of another module, and are not it: they may release that.
    engaging: Vec<Option<Process>>,
}

impl Admission {
    /// Rules for a process that is guarded by the process `watchdog`, if by any.
    #[must_use]
    pub fn new(policy: Policy, watchdog: Option<Process>) -> Self {
        Self {
            policy,
            watchdog,
            witnesses: [None; Witness::ALL.len()],
            lists: 0,
            own: Vec::new(),
            engaging: Vec::new(),
        }
    }

    /// From now on that process guards this one. Without a watchdog it stays so.
    pub fn set_watchdog(&mut self, process: Process) {
        if let Some(watchdog) = &mut self.watchdog {
            *watchdog = process;
        }
    }

    /// True if a watchdog guards this process: then reports that all is well are accepted only from it and the modules
    /// that it lists.
    #[must_use]
    pub fn is_guarded(&self) -> bool {
        self.watchdog.is_some()
    }

    /// This process is a watchdog of the user `uid`, and publishes this list of the modules that it guards.
    pub fn on_own_list(&mut self, list: &DataProcesses, uid: u32) {
        self.own.clear();
        self.own.extend(self.policy.announcing.iter().map(|name| process_of(name, list, uid)));
    }

    /// True if a message can only be judged once the news of a start have been processed: a module that has no process
    /// yet reports that it does its work.
    #[must_use]
    pub fn is_early(&self, message: &Message) -> bool {
        effect(message) == Effect::Works && self.own_process(message) == Some(None)
    }

    /// Process of the module that a message announces, `None` within if it has none; `None` if this process is not its
    /// watchdog, or the module cannot be told from other senders.
    fn own_process(&self, message: &Message) -> Option<Option<Process>> {
        let Message::CmDataState(DataState { module, .. }) = message else { return None };
        let place = self.policy.announcing.iter().position(|name| name == module)?;
        self.own.get(place).copied()
    }

    /// Decides whether a message is accepted.
    ///
    /// # Errors
    /// It is not, and why: the message is to be dropped and counted.
    pub fn judge(&mut self, message: &Message, sender: Sender) -> Result<(), Refusal> {
        let may_command = match self.policy.commands {
            Commands::Memory => sender.way == Way::Memory,
            Commands::Host => sender.way != Way::Network,
            Commands::Network => true,
        };
        let allowed = |may, refusal| if may { Ok(()) } else { Err(refusal) };
        match (effect(message), self.watchdog) {
            (Effect::Stops, _) => {
                self.note_engaging(message, sender);
                Ok(())
            }
            (Effect::Informs, _) => Ok(()),
            (Effect::Commands, _) => allowed(may_command, Refusal::Command),
            // Of a module without a process the watchdog takes nothing, and reports the claim.
            (Effect::Works, _) => match self.own_process(message) {
                Some(Some(due)) => allowed(sender.process == Some(due), Refusal::Release),
                Some(None) => Ok(()),
                None if self.own.is_empty() => Ok(()),
                None => allowed(may_command, Refusal::Release),
            },
            (Effect::SaysThatProcessesRun, Some(watchdog)) => {
                allowed(sender.process == Some(watchdog), Refusal::SecondRobot)?;
                self.learn(message, watchdog.uid);
                Ok(())
            }
            (Effect::Frees(witness), Some(_)) if self.policy.module(witness).is_some() => {
                if may_command && self.is_its_own_stop(message, sender) {
                    return Ok(());
                }
                let due = self.witnesses[witness as usize].ok_or(Refusal::NotYet)?;
                allowed(due.is_some() && sender.process == due, Refusal::Release)
            }
            (Effect::SaysThatProcessesRun | Effect::Frees(_) | Effect::EndsItsOwnStop, _) => {
                allowed(may_command, Refusal::Release)
            }
        }
    }

    /// Who sent a message that was accepted, as the module is to be told.
    #[must_use]
    pub fn origin(&self, message: &Message, sender: Sender) -> Origin {
        match message {
            Message::LlEventStop(stop) if self.is_guarded() => {
                let due = witness_of(&stop.source).is_none_or(|witness| self.is_due(witness, sender));
                Origin { due, process: sender.process }
            }
            Message::LlDataGuard(_) if self.is_guarded() => {
                Origin { due: self.is_due(Witness::Guard, sender), ..Origin::DUE }
            }
            _ => Origin::DUE,
        }
    }

    /// True if the sender is that witness's process, or the robot has no such witness.
    fn is_due(&self, witness: Witness, sender: Sender) -> bool {
        let known = self.witnesses[witness as usize].flatten();
        self.policy.module(witness).is_none() || known.is_some() && sender.process == known
    }

    /// Remembers that a sender engages PAUSE in the name of another module.
    fn note_engaging(&mut self, message: &Message, sender: Sender) {
        let Message::LlEventStop(stop) = message else { return };
        let is_foreign = witness_of(&stop.source).is_some_and(|witness| !self.is_due(witness, sender));
        if !is_foreign || self.engaging.contains(&sender.process) {
            return;
        }
        if self.engaging.len() >= ENGAGING_MAX {
            self.engaging.remove(0);
        }
        self.engaging.push(sender.process);
    }

    /// True if a sender that engaged PAUSE in the name of another module releases that.
    fn is_its_own_stop(&self, message: &Message, sender: Sender) -> bool {
        matches!(message, Message::LlEventStop(_)) && self.engaging.contains(&sender.process)
    }

    /// Learns from the list of a watchdog of the user `uid` which processes are the witnesses'.
    fn learn(&mut self, message: &Message, uid: u32) {
        let Message::CmDataProcesses(list) = message else { return };
        self.lists = STARTING_LISTS.min(self.lists + 1);
        for witness in Witness::ALL {
            let name = self.policy.module(witness);
            let process = name.and_then(|name| process_of(name, list, uid));
            let known = &mut self.witnesses[witness as usize];
            if process.is_some() || known.is_some() || self.lists == STARTING_LISTS {
                *known = Some(process);
            }
        }
    }
}

/// Process of a module that runs as the user `uid`; `None` if it has none.
fn process_of(module: &str, list: &DataProcesses, uid: u32) -> Option<Process> {
    let row = list.processes.iter().find(|process| process.module == module)?;
    let pid = u32::try_from(row.pid).ok().filter(|pid| *pid != 0)?;
    Some(Process { pid, uid })
}

/// True for a message that engages or keeps a stop, which is accepted from any sender: the first row of the table.
#[must_use]
pub fn stops(message: &Message) -> bool {
    effect(message) == Effect::Stops
}

fn effect(heard: &Message) -> Effect {
    match heard {
        Message::LlEventStop(stop) if stop.engaged => Effect::Stops,
        Message::LlEventStop(stop) => witness_of(&stop.source).map_or(Effect::EndsItsOwnStop, Effect::Frees),
        Message::LlDataGuard(guard) if permits_nothing(guard) => Effect::Stops,
        Message::LlDataGuard(_) => Effect::Frees(Witness::Guard),
        Message::LlDataRanges(ranges) if measures_nothing(ranges) => Effect::Stops,
        Message::LlDataRanges(_) => Effect::Frees(Witness::Ranging),
        Message::LlDataScan(_) => Effect::Frees(Witness::Lidar),
        Message::LlDataImu(_) => Effect::Frees(Witness::Imu),
        Message::LlDataMotion(_) | Message::LlDataVelocity(_) => Effect::Frees(Witness::Motion),
        // An input may permit what a program does. One that is unknown would take the place of the true one as well.
        Message::LlDataNodeIo(_) => Effect::Frees(Witness::Motion),
        Message::LlDataPower(_) => Effect::Frees(Witness::Power),
        // One that is lost would take the place of the true one as well.
        Message::MlDataEstimate(_) => Effect::Frees(Witness::Estimator),
        Message::LlDataHold(list) if list.is_of_motion() => Effect::Frees(Witness::Motion),
        Message::LlDataHold(list) if list.is_of_goal() => Effect::Frees(Witness::Planner),
        Message::CmDataProcesses(_) => Effect::SaysThatProcessesRun,
        // Sensor drivers measure in PAUSE, too: there a critical module counts as working.
        Message::CmDataState(DataState { state: DataState::RUN | DataState::PAUSE, .. }) => Effect::Works,
        Message::CmCmdState(CmdState { state, .. }) if *state != crate::State::Run as i8 => Effect::Stops,
        Message::MlCmdGoal(goal) if goal.waypoints.is_empty() => Effect::Stops,
        // The planner then drives nowhere.
        Message::MlCmdMode(CmdMode { mode: CmdMode::MANUAL, .. }) => Effect::Stops,
        Message::LlDataActiveBeacons(_) => Effect::Commands,
        other if other.channel().name().contains("_CMD_") => Effect::Commands,
        _ => Effect::Informs,
    }
}

/// Module that reports for a source of PAUSE; others report for themselves.
fn witness_of(source: &str) -> Option<Witness> {
    if StopSource::is_of_line(source) {
        return Some(Witness::Power);
    }
    if StopSource::is_signal(source) {
        return Some(Witness::Io);
    }
    StopSource::is_lidar(source).then_some(Witness::Lidar)
}

fn measures_nothing(DataRanges { readings, .. }: &DataRanges) -> bool {
    !readings.is_empty() && readings.iter().all(|reading| reading.status == Reading::UNKNOWN)
}

fn permits_nothing(guard: &DataGuard) -> bool {
    let DataGuard { forward, backward, left, right, turn_left, turn_right, .. } = guard;
    [forward, backward, left, right, turn_left, turn_right].into_iter().all(|speed| *speed == 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::State;
    use messages::{common, highlevel, lowlevel, middlelevel};

    const WATCHDOG: u32 = 100;
    const POWER: u32 = 107;
    const GUARD: u32 = 108;
    const RANGING: u32 = 109;
    const LIDAR: u32 = 110;
    const IMU: u32 = 111;
    const IO: u32 = 114;
    const MOTION: u32 = 105;
    const ESTIMATOR: u32 = 112;
    const PLANNER: u32 = 113;
    const USER: u32 = 1000;

    fn user(pid: u32) -> Process {
        Process { pid, uid: USER }
    }

    fn by(way: Way, pid: u32) -> Sender {
        Sender { way, process: Some(user(pid)).filter(|process| process.pid != 0) }
    }

    fn list() -> Message {
        let process = |module: &str, pid| common::Process { module: module.into(), pid, ..Default::default() };
        let witnesses = [
            ("driver_power", POWER),
            ("guard", GUARD),
            ("driver_rs485a", RANGING),
            ("driver_lidar", LIDAR),
            ("driver_imu", IMU),
            ("driver_io", IO),
            ("estimator", ESTIMATOR),
            ("planner", PLANNER),
        ];
        let witnesses = witnesses.map(|(module, pid)| process(module, pid as i32));
        let processes = [vec![process("driver_canbus", MOTION as i32)], witnesses.to_vec()].concat();
        common::DataProcesses { timestamp: 0, processes }.into()
    }

    fn stop(engaged: bool) -> Message {
        lowlevel::EventStop { engaged, ..Default::default() }.into()
    }

    fn state(state: State) -> Message {
        CmdState { module: "*".into(), state: state as i8, manual: true, ..Default::default() }.into()
    }

    fn goal(count: usize) -> Message {
        let waypoints = vec![middlelevel::Waypoint::default(); count];
        middlelevel::CmdGoal { waypoints, ..Default::default() }.into()
    }

    fn mode(mode: i8) -> Message {
        CmdMode { mode, ..CmdMode::default() }.into()
    }

    fn policy(commands: Commands) -> Policy {
        let [power, guard, ranging, lidar, imu, io, motion] =
            ["driver_power", "guard", "driver_rs485a", "driver_lidar", "driver_imu", "driver_io", "driver_canbus"]
                .map(|name| Some(name.into()));
        let [estimator, planner] = ["estimator", "planner"].map(|name| Some(name.into()));
        let announcing = ["driver_power", "guard"].map(String::from).into();
        Policy { commands, power, guard, ranging, lidar, imu, io, motion, estimator, planner, announcing }
    }

    /// Bounds of the guard, ahead.
    fn bounds(forward: f64) -> Message {
        lowlevel::DataGuard { forward, ..Default::default() }.into()
    }

    /// Measured motion.
    fn motion(speed: f64) -> Message {
        lowlevel::DataMotion { speed, ..Default::default() }.into()
    }

    /// Measurements of two sonars.
    fn ranges(statuses: [i8; 2]) -> Message {
        let readings = statuses.map(|status| Reading { status, distance: 2.0, ..Reading::default() });
        DataRanges { timestamp: 0, readings: readings.into() }.into()
    }

    fn guarded(commands: Commands) -> Admission {
        Admission::new(policy(commands), Some(user(WATCHDOG)))
    }

    #[test]
    fn who_may_command_is_configured() {
        let commands: [Message; 15] = [
            lowlevel::CmdMotion::default().into(),
            lowlevel::CmdVelocity::default().into(),
            lowlevel::CmdHoming::default().into(),
            lowlevel::CmdSdo::default().into(),
            lowlevel::CmdPower::default().into(),
            lowlevel::DataActiveBeacons::default().into(),
            middlelevel::CmdEstimate::default().into(),
            highlevel::CmdAction::default().into(),
            goal(1),
            state(State::Run),
            mode(CmdMode::ROUTE),
            mode(CmdMode::WAIT),
            mode(CmdMode::APPROACH),
            mode(CmdMode::HOME),
            middlelevel::CmdParameter::default().into(),
        ];
        let senders = [by(Way::Memory, 300), by(Way::Host, 300), by(Way::Host, 0), by(Way::Network, 0)];
        let table = [
            (Commands::Memory, [true, false, false, false]),
            (Commands::Host, [true, true, true, false]),
            (Commands::Network, [true, true, true, true]),
        ];
        for (who, expected) in table {
            for command in &commands {
                let believed = senders.map(|sender| guarded(who).judge(command, sender) == Ok(()));
                assert_eq!(believed, expected, "{who:?} {command:?}");
            }
        }
    }

    #[test]
    fn another_source_ends_its_own_stop_if_it_may_command() {
        let open = |source: &str| lowlevel::EventStop { source: source.into(), ..Default::default() }.into();
        let mut admission = guarded(Commands::Host);
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
        assert_eq!(admission.judge(&open("crane"), by(Way::Host, 0)), Ok(()));
        assert_eq!(admission.judge(&open("crane"), by(Way::Network, 0)), Err(Refusal::Release));
        for of_line in ["", "button", "bumper3"] {
            assert_eq!(admission.judge(&open(of_line), by(Way::Host, 0)), Err(Refusal::Release), "{of_line}");
            assert_eq!(admission.judge(&open(of_line), by(Way::Memory, POWER)), Ok(()), "{of_line}");
        }
    }

    #[test]
    fn that_the_fields_of_a_lidar_are_free_is_believed_from_its_driver_alone() {
        is_believed_from_its_driver_alone("lidar.front", LIDAR);
    }

    #[test]
    fn that_an_input_is_closed_is_believed_from_its_driver_alone() {
        is_believed_from_its_driver_alone("io.estop", IO);
    }

    fn is_believed_from_its_driver_alone(source: &str, driver: u32) {
        let fields = |engaged| -> Message {
            lowlevel::EventStop { engaged, source: source.into(), ..Default::default() }.into()
        };
        let (driver, stranger) = (by(Way::Memory, driver), by(Way::Memory, 300));
        let mut admission = guarded(Commands::Network);
        assert_eq!(admission.judge(&fields(false), driver), Err(Refusal::NotYet), "nobody has listed it yet");
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
        for other in [stranger, by(Way::Memory, POWER), by(Way::Host, 0), by(Way::Network, 0)] {
            let mut admission = admission.clone();
            assert_eq!(admission.judge(&fields(false), other), Err(Refusal::Release), "{other:?}");
            assert_eq!(admission.judge(&fields(true), other), Ok(()), "it stops");
            assert!(!admission.origin(&fields(true), other).due);
        }
        for engaged in [true, false] {
            assert_eq!(admission.judge(&fields(engaged), driver), Ok(()));
            assert_eq!(admission.origin(&fields(engaged), driver), Origin { due: true, process: driver.process });
        }
    }

    #[test]
    fn pause_in_the_power_controllers_name_is_marked_as_of_another_sender_who_may_release_only_that() {
        let named = |engaged, source: &str| -> Message {
            lowlevel::EventStop { engaged, source: source.into(), ..Default::default() }.into()
        };
        let (power, stranger, unknown) = (by(Way::Memory, POWER), by(Way::Memory, 300), by(Way::Host, 0));
        for source in ["", "button", "bumper3", "sd1_front"] {
            let mut admission = guarded(Commands::Host);
            assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
            let (engaged, open) = (named(true, source), named(false, source));
            for sender in [stranger, unknown] {
                assert_eq!(admission.judge(&open, sender), Err(Refusal::Release), "it engaged nothing: {source}");
                assert_eq!(admission.judge(&engaged, sender), Ok(()));
                let origin = Origin { due: false, process: sender.process };
                assert_eq!(admission.origin(&engaged, sender), origin);
                assert_eq!(admission.judge(&open, sender), Ok(()));
                assert_eq!(admission.origin(&open, sender), origin, "it releases its own alone");
            }
            assert_eq!(admission.judge(&open, by(Way::Memory, 301)), Err(Refusal::Release), "another one");
            assert_eq!(admission.judge(&open, by(Way::Network, 0)), Err(Refusal::Release), "it may not command");
            for message in [&engaged, &open] {
                assert_eq!(admission.judge(message, power), Ok(()));
                assert_eq!(admission.origin(message, power), Origin { due: true, process: power.process });
            }
            for n in 0..100 {
                assert_eq!(admission.judge(&engaged, by(Way::Memory, 400 + n)), Ok(()));
            }
            assert_eq!(admission.engaging.len(), ENGAGING_MAX);
        }
        // Under a name of its own each sender reports for itself.
        let mut admission = guarded(Commands::Host);
        assert_eq!(admission.judge(&named(true, "crane"), stranger), Ok(()));
        let of_crane = admission.origin(&named(true, "crane"), stranger);
        assert_eq!(of_crane, Origin { due: true, process: stranger.process });
        // Before the watchdog has listed the power controller, its process is known, and it is not.
        assert_eq!(admission.origin(&stop(true), power), Origin { due: false, process: power.process });
        // Nobody is due.
        let alone = Admission::new(policy(Commands::Host), None);
        assert_eq!(alone.origin(&stop(true), stranger), Origin::DUE);
        let without = Admission::new(Policy::default(), Some(user(WATCHDOG)));
        assert!(without.origin(&stop(true), stranger).due);
    }

    #[test]
    fn bounds_of_another_sender_than_the_guard_are_marked() {
        let mut admission = guarded(Commands::Host);
        let (guard, stranger) = (by(Way::Memory, GUARD), by(Way::Memory, 300));
        assert!(!admission.origin(&bounds(0.0), guard).due, "nobody has listed it yet");
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
        for sender in [stranger, by(Way::Host, 0), by(Way::Network, 0), by(Way::Memory, WATCHDOG)] {
            assert_eq!(admission.judge(&bounds(0.0), sender), Ok(()), "it stops");
            assert_eq!(admission.origin(&bounds(0.0), sender), Origin { due: false, process: None });
        }
        assert_eq!(admission.origin(&bounds(0.0), guard), Origin::DUE);
        let without = Admission::new(Policy::default(), Some(user(WATCHDOG)));
        let alone = Admission::new(policy(Commands::Host), None);
        for admission in [without, alone] {
            assert_eq!(admission.origin(&bounds(0.0), stranger), Origin::DUE, "nobody is due");
        }
    }

    #[test]
    fn what_stops_is_believed_from_any_sender() {
        let states = [State::Pause, State::Stop, State::Terminate].map(state);
        let unknown = ranges([Reading::UNKNOWN; 2]);
        let stops = states.into_iter().chain([stop(true), goal(0), mode(CmdMode::MANUAL), bounds(0.0), unknown]);
        for message in stops {
            for way in [Way::Memory, Way::Host, Way::Network] {
                assert_eq!(guarded(Commands::Memory).judge(&message, by(way, 0)), Ok(()), "{message:?} {way:?}");
            }
        }
    }

    #[test]
    fn that_all_is_well_is_believed_from_whom_it_is_due() {
        let mut admission = guarded(Commands::Network);
        let (watchdog, power) = (by(Way::Memory, WATCHDOG), by(Way::Memory, POWER));
        assert_eq!(admission.judge(&stop(false), power), Err(Refusal::NotYet), "nobody has listed it yet");
        for other in [power, by(Way::Host, 0), by(Way::Host, POWER), by(Way::Network, 0)] {
            assert_eq!(admission.judge(&list(), other), Err(Refusal::SecondRobot), "{other:?}");
        }
        assert_eq!(admission.judge(&list(), watchdog), Ok(()));
        for other in [watchdog, by(Way::Memory, 300), by(Way::Host, 0), by(Way::Network, 0)] {
            assert_eq!(admission.judge(&stop(false), other), Err(Refusal::Release), "{other:?}");
        }
        // Also by a datagram whose socket is known to be its own.
        for way in [Way::Memory, Way::Host] {
            assert_eq!(admission.judge(&stop(false), by(way, POWER)), Ok(()));
        }
        // It is restarted, and then it is gone.
        let with = |pid| match list() {
            Message::CmDataProcesses(mut list) => {
                list.processes[1].pid = pid;
                Message::from(list)
            }
            _ => panic!(),
        };
        assert_eq!(admission.judge(&with(200), watchdog), Ok(()));
        assert_eq!(admission.judge(&stop(false), power), Err(Refusal::Release));
        assert_eq!(admission.judge(&stop(false), by(Way::Memory, 200)), Ok(()));
        assert_eq!(admission.judge(&with(0), watchdog), Ok(()));
        assert_eq!(admission.judge(&stop(false), by(Way::Memory, 200)), Err(Refusal::Release));
        assert_eq!(admission.judge(&stop(false), by(Way::Host, 0)), Err(Refusal::Release));
    }

    #[test]
    fn a_module_that_is_never_listed_is_due_only_while_the_robot_starts() {
        let mut admission = guarded(Commands::Network);
        let without: Message = DataProcesses::default().into();
        for _ in 1..STARTING_LISTS {
            assert_eq!(admission.judge(&without, by(Way::Memory, WATCHDOG)), Ok(()));
            assert_eq!(admission.judge(&stop(false), by(Way::Memory, POWER)), Err(Refusal::NotYet));
        }
        assert_eq!(admission.judge(&without, by(Way::Memory, WATCHDOG)), Ok(()));
        assert_eq!(admission.judge(&stop(false), by(Way::Memory, POWER)), Err(Refusal::Release), "said from now on");
    }

    #[test]
    fn a_process_of_another_user_is_not_the_one_whose_number_it_names() {
        let mut admission = guarded(Commands::Memory);
        let other = |pid| Sender { way: Way::Memory, process: Some(Process { pid, uid: USER + 1 }) };
        assert_eq!(admission.judge(&list(), other(WATCHDOG)), Err(Refusal::SecondRobot));
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
        for (message, due) in [(stop(false), POWER), (bounds(0.5), GUARD), (ranges([Reading::SILENT; 2]), RANGING)] {
            assert_eq!(admission.judge(&message, other(due)), Err(Refusal::Release));
            assert_eq!(admission.judge(&message, by(Way::Memory, due)), Ok(()));
        }
    }

    #[test]
    fn bounds_and_ranges_are_believed_from_the_modules_that_the_watchdog_lists() {
        let mut admission = guarded(Commands::Network);
        let measured = ranges([Reading::UNKNOWN, Reading::MEASURED]);
        let scan = Message::from(lowlevel::DataScan { ranges: vec![1.0], ..Default::default() });
        // One that measures nothing would take the place of a revolution.
        let nothing = Message::from(lowlevel::DataScan { ranges: vec![f32::NAN], ..Default::default() });
        // One that says nothing of use, too: what goes by it would go by that of nobody.
        let imu = |status| Message::from(lowlevel::DataImu { status, ..Default::default() });
        let table = [
            (bounds(0.5), GUARD),
            (bounds(f64::NAN), GUARD),
            (measured, RANGING),
            (scan, LIDAR),
            (nothing, LIDAR),
            (imu(lowlevel::DataImu::OK), IMU),
            (imu(lowlevel::DataImu::FAULT), IMU),
        ];
        for (message, due) in table {
            let mut believed = |pid| admission.judge(&message, by(Way::Memory, pid));
            assert_eq!(believed(due), Err(Refusal::NotYet), "nobody has listed it yet: {message:?}");
            assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
            let others = [0, 300, WATCHDOG, POWER, if due == GUARD { RANGING } else { GUARD }];
            for other in others {
                assert_eq!(admission.judge(&message, by(Way::Host, other)), Err(Refusal::Release), "{other}");
            }
            assert_eq!(admission.judge(&message, by(Way::Memory, due)), Ok(()), "{message:?}");
            admission = guarded(Commands::Network);
        }
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
        assert_eq!(admission.judge(&ranges([Reading::SILENT; 2]), by(Way::Host, 300)), Err(Refusal::Release));
        let empty = DataRanges::default().into();
        assert_eq!(admission.judge(&empty, by(Way::Host, 300)), Err(Refusal::Release), "it names no range finder");
    }

    #[test]
    fn the_measured_motion_is_believed_from_its_driver_alone_also_a_robot_that_stands() {
        let velocity = lowlevel::DataVelocity::default().into();
        for message in [motion(0.0), motion(0.5), motion(1e19), motion(f64::NAN), velocity] {
            let mut admission = guarded(Commands::Network);
            let mut believed = |pid, way| admission.judge(&message, by(way, pid));
            assert_eq!(believed(MOTION, Way::Memory), Err(Refusal::NotYet), "nobody has listed it yet");
            assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
            let mut believed = |pid, way| admission.judge(&message, by(way, pid));
            for other in [0, 300, WATCHDOG, POWER, GUARD, RANGING] {
                for way in [Way::Memory, Way::Host, Way::Network] {
                    assert_eq!(believed(other, way), Err(Refusal::Release), "{message:?} of {other}");
                }
            }
            assert_eq!(believed(MOTION, Way::Memory), Ok(()), "{message:?}");
        }
    }

    /// Estimate of this quality.
    fn estimate(quality: i8) -> Message {
        middlelevel::DataEstimate { quality, ..Default::default() }.into()
    }

    /// State of the motors' feed.
    fn power(on: bool) -> Message {
        let motors = lowlevel::Channel { name: "motors".into(), on, ..Default::default() };
        lowlevel::DataPower { channels: vec![motors], ..Default::default() }.into()
    }

    /// Value of a signal of a CANopen device.
    fn node_io(value: f64) -> Message {
        let values = vec![lowlevel::NodeValue { name: "gate".into(), value }];
        lowlevel::DataNodeIo { timestamp: 0, values }.into()
    }

    /// Empty list of causes of a module.
    fn holds(module: &str) -> Message {
        lowlevel::DataHold { module: module.into(), ..Default::default() }.into()
    }

    #[test]
    fn pose_power_signals_and_causes_are_believed_from_the_module_that_knows_them() {
        use messages::{GOAL_MODULE, MOTION_MODULE};
        let table = [
            (estimate(middlelevel::DataEstimate::FINE), ESTIMATOR),
            // It would stop the planner, and make the true ones come out of order.
            (estimate(middlelevel::DataEstimate::LOST), ESTIMATOR),
            (node_io(1.0), MOTION),
            (node_io(f64::NAN), MOTION),
            (power(false), POWER),
            (power(true), POWER),
            (lowlevel::DataPower::default().into(), POWER),
            (holds(MOTION_MODULE), MOTION),
            (holds(GOAL_MODULE), PLANNER),
        ];
        for (message, due) in table {
            let mut admission = guarded(Commands::Network);
            assert_eq!(admission.judge(&message, by(Way::Memory, due)), Err(Refusal::NotYet), "{message:?}");
            assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
            for other in [0, 300, WATCHDOG, POWER, GUARD, MOTION, ESTIMATOR, PLANNER] {
                for way in [Way::Memory, Way::Host, Way::Network] {
                    let expected = if other == due { Ok(()) } else { Err(Refusal::Release) };
                    assert_eq!(admission.judge(&message, by(way, other)), expected, "{message:?} of {other}");
                }
            }
            // A program in another language is that module, or the robot has none, or there is no watchdog.
            let policy = policy(Commands::Host);
            let foreign = Policy { power: None, motion: None, estimator: None, planner: None, ..policy.clone() };
            let mut without = Admission::new(foreign, Some(user(WATCHDOG)));
            assert_eq!(without.judge(&list(), by(Way::Memory, WATCHDOG)), Ok(()));
            for mut admission in [without, Admission::new(policy, None)] {
                assert_eq!(admission.judge(&message, by(Way::Host, 0)), Ok(()), "{message:?}");
                assert_eq!(admission.judge(&message, by(Way::Network, 0)), Err(Refusal::Release), "{message:?}");
            }
        }
        // Nobody decides by those of others.
        assert_eq!(guarded(Commands::Memory).judge(&holds("crane"), by(Way::Network, 0)), Ok(()));
    }

    #[test]
    fn that_a_module_works_is_believed_by_its_watchdog_from_its_process_alone() {
        let says = |module: &str, state: State| -> Message {
            DataState { module: module.into(), state: state as i8, ..Default::default() }.into()
        };
        let mut watchdog = Admission::new(policy(Commands::Host), None);
        let Message::CmDataProcesses(list) = list() else { unreachable!() };
        watchdog.on_own_list(&list, USER);
        let of_another_user = Sender { way: Way::Memory, process: Some(Process { pid: POWER, uid: USER + 1 }) };
        let others = [by(Way::Memory, 300), by(Way::Memory, GUARD), by(Way::Host, 0), by(Way::Network, 0)];
        let others = [&others[..], &[of_another_user]].concat();
        for works in [State::Run, State::Pause] {
            let message = says("driver_power", works);
            assert_eq!(watchdog.judge(&message, by(Way::Memory, POWER)), Ok(()), "{works}");
            for other in others.clone() {
                assert_eq!(watchdog.judge(&message, other), Err(Refusal::Release), "{works} {other:?}");
            }
        }
        // What makes it worse stops the robot.
        for worse in [State::Unknown, State::Init, State::Stop, State::Error, State::Terminate] {
            for other in others.clone() {
                assert_eq!(watchdog.judge(&says("driver_power", worse), other), Ok(()), "{worse} {other:?}");
            }
        }
        // A program in another language sends datagrams, without a process id.
        assert_eq!(watchdog.judge(&says("eyes.py", State::Run), by(Way::Host, 0)), Ok(()));
        assert_eq!(watchdog.judge(&says("eyes.py", State::Run), by(Way::Network, 0)), Err(Refusal::Release));
        // The watchdog reports a claim of the name of a module that it ended, and ignores it.
        assert!(!watchdog.is_early(&says("driver_power", State::Run)));
        watchdog.on_own_list(&DataProcesses::default(), USER);
        assert!(watchdog.is_early(&says("driver_power", State::Run)));
        assert!(!watchdog.is_early(&says("driver_power", State::Error)));
        assert_eq!(watchdog.judge(&says("driver_power", State::Run), by(Way::Host, 0)), Ok(()));
    }

    #[test]
    fn another_watchdog_is_believed_once_it_guards_this_process() {
        let mut admission = guarded(Commands::Host);
        assert_eq!(admission.judge(&list(), by(Way::Memory, 101)), Err(Refusal::SecondRobot));
        admission.set_watchdog(user(101));
        assert_eq!(admission.judge(&list(), by(Way::Memory, 101)), Ok(()));
        assert_eq!(admission.judge(&list(), by(Way::Memory, WATCHDOG)), Err(Refusal::SecondRobot));
    }

    #[test]
    fn without_a_watchdog_or_the_module_that_is_due_all_who_may_command_are_believed() {
        let mut alone = Admission::new(policy(Commands::Host), None);
        let mut without = Admission::new(Policy::default(), Some(user(WATCHDOG)));
        alone.set_watchdog(user(WATCHDOG));
        let frees = [stop(false), bounds(0.5), ranges([Reading::SILENT; 2]), motion(0.0)];
        let of_alone = [list()].into_iter().chain(frees.clone()).map(|message| (true, message));
        for (is_alone, message) in of_alone.chain(frees.map(|message| (false, message))) {
            let admission = if is_alone { &mut alone } else { &mut without };
            assert_eq!(admission.judge(&message, by(Way::Host, 0)), Ok(()), "{message:?}");
            assert_eq!(admission.judge(&message, by(Way::Network, 0)), Err(Refusal::Release), "{message:?}");
        }
        assert!(!alone.is_guarded() && without.is_guarded());
    }

    #[test]
    fn what_informs_is_believed_from_any_sender() {
        for message in [Message::from(lowlevel::DataOdo::default()), common::DataState::default().into()] {
            assert_eq!(guarded(Commands::Memory).judge(&message, by(Way::Network, 0)), Ok(()));
        }
    }
}
