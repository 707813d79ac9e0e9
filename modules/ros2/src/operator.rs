//! Services for operators (`std_srvs`): what `advee state`, `mode`, `home`, `power` and `io` command, by the same
//! messages.

use crate::NAME;
use crate::cdr::Reader;
use diagnostics::orders;
use lcm_gen::cdr::Writer;
use messages::Message;
use messages::lowlevel::CmdOutput;
use messages::middlelevel::CmdMode;
use module::State;

/// Module that drives: in PAUSE it holds the quick stop.
const DRIVER: &str = "driver_canbus";
const PLANNER: &str = "planner";
/// Outputs at most that have a service.
const OUTPUTS_MAX: usize = 64;

/// What a robot has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// An axis that has to be homed.
    pub steering: bool,
    /// A power controller.
    pub power: bool,
    /// Names of outputs.
    pub outputs: Vec<String>,
}

/// What a service commands.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Order {
    /// The drives stop and stay so, or may be commanded again.
    Pause,
    /// The planner that was stopped goes on.
    Release,
    /// An operation mode of the planner, by its name.
    Mode(&'static str),
    /// The axis is homed.
    Home,
    /// Feed of the motors.
    Motors,
    /// An output.
    Output(String),
}

/// A service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Service {
    /// Name below that of the node.
    pub name: String,
    order: Order,
}

/// The services of a robot.
#[must_use]
pub fn services(config: &Config) -> Vec<Service> {
    let service = |name: &str, order| Service { name: name.into(), order };
    let mut all = vec![service("pause", Order::Pause), service("release_planner", Order::Release)];
    all.extend(CmdMode::NAMES.map(|mode| service(&format!("mode_{mode}"), Order::Mode(mode))));
    all.extend(config.steering.then(|| service("home", Order::Home)));
    all.extend(config.power.then(|| service("motors_power", Order::Motors)));
    for output in config.outputs.iter().take(OUTPUTS_MAX) {
        let name = format!("output/{}", crate::node_name(output));
        if all.iter().all(|other| other.name != name) {
            all.push(service(&name, Order::Output(output.clone())));
        }
    }
    all
}

impl Service {
    /// Type in ROS.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self.order {
            Order::Release | Order::Mode(_) | Order::Home => "std_srvs/srv/Trigger",
            Order::Pause | Order::Motors | Order::Output(_) => "std_srvs/srv/SetBool",
        }
    }

    /// True if the request is one to stop the robot.
    #[must_use]
    pub fn stops(&self, sample: &[u8]) -> bool {
        let reader = Reader::new(sample);
        match self.order {
            Order::Pause => reader.and_then(|mut reader| reader.bool()) == Some(true),
            // In MANUAL the planner drives nowhere.
            Order::Mode(name) => CmdMode::from_name(name) == Some(CmdMode::MANUAL) && reader.is_some(),
            Order::Release | Order::Home | Order::Motors | Order::Output(_) => false,
        }
    }

    /// Message for the bus, and what the answer says; `None`: the request is malformed.
    #[must_use]
    pub fn order(&self, timestamp: i64, sample: &[u8]) -> Option<(Message, String)> {
        let mut reader = Reader::new(sample)?;
        let state = |module: &str, state| Message::from(orders::manual(timestamp, module, state, NAME));
        // A request without content.
        match self.order {
            Order::Release => return Some((state(PLANNER, State::Run), "planner is commanded to RUN".into())),
            Order::Home => {
                let home = orders::home(timestamp, "steering");
                return Some((home.into(), "homing of steering is commanded".into()));
            }
            Order::Mode(name) => {
                let mode = orders::mode(timestamp, name, NAME).ok()?;
                return Some((mode.into(), format!("mode {name} is commanded")));
            }
            Order::Pause | Order::Motors | Order::Output(_) => {}
        }
        let on = reader.bool()?;
        Some(match &self.order {
            Order::Motors => {
                let action = if on { "on" } else { "off" };
                let power = orders::power(timestamp, "motors", action).ok()?;
                (power.into(), format!("power channel motors is commanded {action}"))
            }
            Order::Output(name) => {
                let value = f64::from(u8::from(on));
                let output = CmdOutput { timestamp, name: name.clone(), value, source: NAME.into() };
                (output.into(), format!("output {name} is commanded to {value}"))
            }
            _ if on => (state(DRIVER, State::Pause), "driver_canbus is commanded into PAUSE: the robot stops".into()),
            _ => (state(DRIVER, State::Run), "driver_canbus is commanded to RUN".into()),
        })
    }
}

/// The answer of both types of service.
#[must_use]
pub fn response(success: bool, text: &str) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut to = Writer::new(&mut cdr);
    to.bool(success);
    to.string(text);
    cdr
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::common::CmdState;
    use messages::lowlevel::{CmdHoming, CmdPower};

    fn robot() -> Vec<Service> {
        let outputs = vec!["horn".into(), "lamp 1".into(), "lamp-1".into()];
        services(&Config { steering: true, power: true, outputs })
    }

    fn ordered(name: &str, sample: &[u8]) -> Option<Message> {
        let all = robot();
        let service = all.iter().find(|service| service.name == name).unwrap();
        service.order(5, sample).map(|(message, _)| message)
    }

    #[test]
    fn a_robot_has_the_services_of_what_it_has() {
        let names: Vec<String> = robot().into_iter().map(|service| service.name).collect();
        let always = ["pause", "release_planner"];
        let modes = ["mode_manual", "mode_route", "mode_wait", "mode_approach", "mode_home"];
        let by_configuration = ["home", "motors_power", "output/horn", "output/lamp_1"];
        assert_eq!(names, [&always[..], &modes, &by_configuration].concat());
        let least: Vec<String> = services(&Config::default()).into_iter().map(|service| service.name).collect();
        assert_eq!(least, [&always[..], &modes].concat());
        let many = (0..500).map(|n| format!("o{n}")).collect();
        assert_eq!(services(&Config { outputs: many, ..Config::default() }).len(), 2 + modes.len() + OUTPUTS_MAX);
    }

    #[test]
    fn requests_become_the_messages_of_operators() {
        let (on, off) = ([0, 1, 0, 0, 1], [0, 1, 0, 0, 0]);
        let state = |module: &str, state: State| CmdState {
            timestamp: 5,
            module: module.into(),
            state: state as i8,
            manual: true,
            source: NAME.into(),
        };
        let stopping: Vec<_> = robot().into_iter().filter(|service| service.stops(&on)).map(|it| it.name).collect();
        assert_eq!(stopping, ["pause", "mode_manual"]);
        let stopping: Vec<_> = robot().into_iter().filter(|service| service.stops(&off)).map(|it| it.name).collect();
        assert_eq!(stopping, ["mode_manual"], "whose request has no content");
        assert_eq!(ordered("pause", &on), Some(state(DRIVER, State::Pause).into()));
        assert_eq!(ordered("pause", &off), Some(state(DRIVER, State::Run).into()));
        assert_eq!(ordered("release_planner", &on), Some(state(PLANNER, State::Run).into()));
        let mode = |mode| Message::from(CmdMode { timestamp: 5, mode, source: NAME.into() });
        for (name, number) in [("mode_manual", CmdMode::MANUAL), ("mode_route", CmdMode::ROUTE)] {
            assert_eq!(ordered(name, &[0, 1, 0, 0]), Some(mode(number)));
        }
        assert_eq!(ordered("mode_wait", &off), Some(mode(CmdMode::WAIT)));
        assert_eq!(ordered("mode_approach", &off), Some(mode(CmdMode::APPROACH)));
        assert_eq!(ordered("mode_home", &off), Some(mode(CmdMode::HOME)));
        assert_eq!(ordered("mode_home", &[9, 9, 9, 9]), None);
        assert_eq!(ordered("home", &on), Some(CmdHoming { timestamp: 5, axis: "steering".into() }.into()));
        let power = |action| Message::from(CmdPower { timestamp: 5, device: 3, action });
        assert_eq!(ordered("motors_power", &on), Some(power(CmdPower::ON)));
        assert_eq!(ordered("motors_power", &off), Some(power(CmdPower::OFF)));
        let Some(Message::LlCmdOutput(output)) = ordered("output/lamp_1", &on) else { panic!() };
        assert_eq!((&*output.name, output.value), ("lamp 1", 1.0));
    }

    #[test]
    fn what_is_neither_true_nor_false_or_cut_off_commands_nothing() {
        for sample in [&[0, 1, 0, 0, 2][..], &[0, 1, 0, 0], &[0, 1], &[9, 9, 9, 9, 1]] {
            for name in ["pause", "motors_power", "output/horn"] {
                assert_eq!(ordered(name, sample), None, "{sample:?}");
            }
        }
        assert_eq!(response(true, "x"), [0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, b'x', 0]);
    }
}
