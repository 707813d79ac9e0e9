//! The node as a module: started, supervised, reported and ended here.

use crate::description::Description;
use crate::drive;
use crate::node;
use crate::operator;
use crate::outgoing;
use crate::parameters::Parameter;
use crate::servers;
use crate::settings::Ros2 as Section;
use crate::topics::Topic;
use crate::transport::Transport;
use crate::type_hashes;
use crate::{NAME, node_name};
use base::{Duration, Fault, Instant, Level, Severity};
use host::clock;
use module::{Actions, Event, Module, State, exit};
use rtps::{Limits, Prefix};

/// Period of checks on the thread, and of retries for an address that is not there yet.
const PERIOD: Duration = Duration::from_secs(1);
/// Period of checks while the thread ends.
const END_CHECK_PERIOD: Duration = Duration::from_millis(20);
/// Checks without a turn of the thread after which it counts as hung.
const MISSED_TURNS_MAX: u32 = 3;
/// Period of the announcements, and the time after which others take the robot for gone.
const ANNOUNCE_PERIOD: Duration = Duration::from_secs(3);
const LEASE: Duration = Duration::from_secs(20);

/// Parameters of the node.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The robot's name.
    pub robot: String,
    /// The LCM bus.
    pub lcm_url: String,
    /// `[ros2]`.
    pub ros2: Section,
    /// What is told of the robot.
    pub outgoing: outgoing::Config,
    /// `/map`, where the robot has one.
    pub map: Option<(Topic, Vec<u8>)>,
    /// Services of operators that the robot has, where ROS may command.
    pub operator: operator::Config,
    /// Parameters of the node.
    pub parameters: Vec<Parameter>,
    /// Silence after which the robot's driver stops a source: `limits.command_ttl_s`.
    pub driver_ttl: Duration,
}

/// The module.
#[derive(Debug)]
pub struct Ros2 {
    settings: Settings,
    transport: Option<Transport>,
    state: Option<State>,
    next: Option<Instant>,
    /// Turns of the thread when they last changed, and checks since.
    turns: (u32, u32),
}

impl Ros2 {
    /// Creates the module; the node is not started yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, transport: None, state: None, next: None, turns: (0, 0) }
    }

    fn open(&mut self, now: Instant, out: &mut Actions) {
        self.next = Some(now + PERIOD);
        let Settings { robot, lcm_url, ros2, outgoing, map, operator, parameters, driver_ttl } = &self.settings;
        let name = node_name(robot);
        let participant = rtps::Config {
            domain: ros2.domain,
            prefix: Prefix::default(),
            locators: Vec::new(),
            announce_to: Vec::new(),
            announce_period: ANNOUNCE_PERIOD,
            lease: LEASE,
            name: name.clone(),
            user_data: b"enclave=/;".to_vec(),
            endpoint_data: type_hashes::user_data,
            limits: Limits::default(),
        };
        let drive =
            drive::Config { priority: ros2.priority, ttl: ros2.command_ttl.max(*driver_ttl), driver_ttl: *driver_ttl };
        let config = node::Config {
            name,
            namespace: ros2.namespace.clone(),
            participant,
            outgoing: outgoing.clone(),
            fixed: map.iter().cloned().chain([(Description::topic(), outgoing.description.message())]).collect(),
            drive: ros2.commands.then_some(drive),
            servers: servers::Config {
                operator: ros2.commands.then(|| operator.clone()),
                parameters: parameters.clone(),
                managed: ros2.managed,
            },
            epoch: clock::epoch(),
        };
        match Transport::start(ros2, lcm_url, config) {
            Ok((transport, own)) => {
                transport.set_acts(self.state.is_none_or(|state| state == State::Run));
                self.transport = Some(transport);
                self.turns = (0, 0);
                out.clear(Fault::PortDown, NAME, format!("{own}: the node is there"));
                out.working();
                let may = if ros2.commands { "ROS may command the robot" } else { "ROS may not command the robot" };
                out.note(format!("domain {} at {own}; {may}", ros2.domain));
            }
            Err(why) => {
                out.raise(Severity::Warning, Fault::PortDown, NAME, why);
                out.failed();
            }
        }
    }

    fn look(&mut self, now: Instant, out: &mut Actions) {
        let Some(transport) = &self.transport else { return self.open(now, out) };
        self.next = Some(now + PERIOD);
        transport.take_notes().into_iter().for_each(|line| out.say(Level::Warning, line));
        let (seen, silent) = self.turns;
        let turns = transport.turns();
        self.turns = if turns == seen { (seen, silent + 1) } else { (turns, 0) };
        if transport.has_ended() || silent >= MISSED_TURNS_MAX {
            let why = "the node stands still: it is started again";
            out.fatal(Fault::PortDown, NAME, why, exit::SERVER_STALLED);
        }
    }
}

impl Module for Ros2 {
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.open(now, out),
            Event::Timer if self.next.is_some_and(|next| next <= now) => match &self.transport {
                Some(transport) if transport.is_ending() => self.next = Some(now + END_CHECK_PERIOD),
                _ => self.look(now, out),
            },
            Event::State(state) => {
                self.state = Some(state);
                if let Some(transport) = &self.transport {
                    transport.set_acts(state == State::Run);
                    if state == State::Terminate {
                        transport.end();
                        self.next = Some(now + END_CHECK_PERIOD);
                    }
                }
            }
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }

    fn finished(&self) -> bool {
        self.transport.as_ref().is_none_or(Transport::has_ended)
    }
}
