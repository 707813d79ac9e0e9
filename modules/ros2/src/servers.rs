//! Actions, services, parameters and life cycle of the node: which service a request is for, and the way of its answer.

use crate::lifecycle::{self, Bond, Lifecycle};
use crate::navigate::{Kind, Navigator, Output, Part};
use crate::operator;
use crate::parameters::{self, Parameter};
use crate::service::{self, Caller, ServiceId, Services};
use crate::topics::{Quality, Topic};
use base::{Instant, earliest};
use messages::{Channel, Message};
use rtps::{Participant, ReaderId, Sample, WriterId};
use std::collections::VecDeque;

/// What the servers are.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// Services of operators; `None`: ROS may not command.
    pub operator: Option<operator::Config>,
    /// Parameters.
    pub parameters: Vec<Parameter>,
    /// A lifecycle manager activates the node.
    pub managed: bool,
}

/// The node, as its services are named.
#[derive(Clone, Copy, Debug)]
pub struct Of<'a> {
    /// Its name.
    pub name: &'a str,
    /// Empty, or as `/robot1`.
    pub namespace: &'a str,
}

/// What a service is for.
#[derive(Clone, Debug)]
enum Use {
    Action(Kind, Part),
    Operator(operator::Service),
    Parameters(parameters::Service),
    Lifecycle(lifecycle::Service),
}

/// What is to be done besides answers.
#[derive(Clone, Debug)]
pub enum Effect {
    /// Publish on the robot's bus.
    Message(Message),
    /// Publish in ROS.
    Topic(Topic, Vec<u8>),
    /// Say to people.
    Note(String),
}

/// Time of what happens: on the monotonic scale, and in µs since the UNIX epoch.
#[derive(Clone, Copy, Debug)]
pub struct Time {
    /// Monotonic.
    pub now: Instant,
    /// µs since the UNIX epoch.
    pub micros: i64,
}

/// The servers.
#[derive(Debug)]
pub struct Servers {
    services: Services,
    uses: Vec<(ServiceId, Use)>,
    navigator: Navigator,
    parameters: Vec<Parameter>,
    may_command: bool,
    lifecycle: Lifecycle,
    transitions: Topic,
    /// Where a lifecycle manager activates the node.
    bond: Option<Bond>,
    effects: VecDeque<Effect>,
}

/// Channels of the bus that are read besides those that are translated.
pub const CHANNELS: [Channel; 1] = [Channel::MlDataGoal];

/// Topic of the feedback of an action.
fn feedback_topic(kind: Kind) -> Topic {
    let type_name = format!("{}_FeedbackMessage", kind.type_name());
    Topic::new(&format!("{}/_action/feedback", kind.name()), &type_name, Quality::Reliable)
}

/// Topic of the states of the goals of an action.
fn status_topic(kind: Kind) -> Topic {
    Topic::new(&format!("{}/_action/status", kind.name()), "action_msgs/msg/GoalStatusArray", Quality::Latched)
}

impl Servers {
    /// Offers the services of a node.
    pub fn new(config: Config, participant: &mut Participant, now: Instant, of: Of<'_>) -> Self {
        let Of { name, namespace } = of;
        let node = format!("{namespace}/{name}");
        let mut services = Services::default();
        let mut uses = Vec::new();
        let mut add = |name: &str, type_name: &str, what: Use| {
            let service = services.add(participant, now, name, type_name);
            uses.extend(service.map(|service| (service, what)));
        };
        for kind in Kind::ALL {
            for part in Part::ALL {
                let (name, type_name) = part.service(kind);
                add(&format!("{namespace}{name}"), &type_name, Use::Action(kind, part));
            }
        }
        for service in parameters::Service::ALL {
            let (name, type_name) = service.names();
            add(&format!("{node}/{name}"), type_name, Use::Parameters(service));
        }
        for service in config.operator.iter().flat_map(operator::services) {
            add(&format!("{node}/{}", service.name), service.type_name(), Use::Operator(service));
        }
        for service in lifecycle::Service::ALL {
            let (name, type_name) = service.names();
            add(&format!("{node}/{name}"), type_name, Use::Lifecycle(service));
        }
        let may_command = config.operator.is_some();
        let instance = participant.guid().bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        Self {
            services,
            uses,
            navigator: Navigator::default(),
            parameters: config.parameters,
            may_command,
            lifecycle: Lifecycle::new(may_command, config.managed),
            transitions: lifecycle::topic(name),
            bond: (may_command && config.managed).then(|| Bond::new(name, instance)),
            effects: VecDeque::new(),
        }
    }

    /// Topics that are there from the start, since a client looks for them.
    pub fn topics(&self) -> Vec<Topic> {
        let actions = Kind::ALL.into_iter().flat_map(|kind| [feedback_topic(kind), status_topic(kind)]);
        let bond = self.bond.as_ref().map(|_| Bond::topic());
        actions.chain([self.transitions.clone()]).chain(bond).collect()
    }

    /// Readers and writers, for the graph of ROS.
    pub fn endpoints(&self) -> impl Iterator<Item = (ReaderId, WriterId)> + '_ {
        self.services.endpoints()
    }

    /// True if the node is active: ROS may command, as far as its life cycle is concerned.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.lifecycle.is_active()
    }

    /// True if the sample was a request. `acts`: the module acts. `refusal`: why the module does not act at present.
    pub fn on_sample(
        &mut self,
        participant: &mut Participant,
        time: Time,
        sample: &Sample,
        acts: bool,
        refusal: Option<&'static str>,
    ) -> bool {
        let Some(service) = self.services.find(sample.reader) else { return false };
        let of_service = self.uses.iter().find(|(id, _)| *id == service).map(|(_, what)| what.clone());
        let (Some(what), Some((caller, cdr))) = (of_service, service::request(participant, sample)) else {
            return true;
        };
        let refusal = if self.may_command { refusal } else { Some("ROS may not command: [ros2] commands is false") };
        // Of an inactive node as well, what stops the robot is obeyed.
        let not_now = refusal.or((!self.is_active()).then_some("the node is not active"));
        match what {
            Use::Action(kind, part) => {
                self.navigator.on_request(time.now, time.micros, (kind, part), caller, &cdr, not_now);
            }
            Use::Parameters(which) => {
                if let Some(answer) = which.answer(&self.parameters, &cdr) {
                    self.services.answer(participant, time.now, time.micros, service, caller, answer);
                }
            }
            Use::Lifecycle(which) => {
                let was_active = self.is_active();
                if let Some(answer) = self.lifecycle.answer(which, &cdr, acts && self.may_command) {
                    self.services.answer(participant, time.now, time.micros, service, caller, answer);
                }
                self.on_life(time, was_active);
            }
            Use::Operator(which) => {
                let (is_obeyed, text) =
                    match (if which.stops(&cdr) { refusal } else { not_now }, which.order(time.micros, &cdr)) {
                        (Some(why), _) => (false, why.to_owned()),
                        (None, None) => (false, "the request is malformed".to_owned()),
                        (None, Some((message, text))) => {
                            self.effects.push_back(Effect::Message(message));
                            (true, text)
                        }
                    };
                let answer = operator::response(is_obeyed, &text);
                self.services.answer(participant, time.now, time.micros, service, caller, answer);
            }
        }
        self.carry_out(participant, time);
        true
    }

    /// Publishes what became of the node's state; a goal of a node that is no longer active ends.
    fn on_life(&mut self, time: Time, was_active: bool) {
        if was_active && !self.is_active() {
            self.navigator.withdraw(time.now, time.micros, "the node was deactivated");
        }
        for event in self.lifecycle.take_events(time.micros) {
            self.effects.push_back(Effect::Topic(self.transitions.clone(), event));
        }
        self.beat(time, self.is_active());
    }

    fn beat(&mut self, time: Time, holds: bool) {
        let status = self.bond.as_mut().and_then(|bond| bond.poll(time.now, time.micros, holds));
        self.effects.extend(status.map(|status| Effect::Topic(Bond::topic(), status)));
    }

    /// The node ends: its manager learns it at once.
    pub fn leave(&mut self, time: Time) {
        self.beat(time, false);
    }

    /// A message of the robot's bus.
    pub fn on_bus(&mut self, participant: &mut Participant, time: Time, channel: &str, data: &[u8]) {
        const READ: [Channel; 3] = [Channel::MlDataGoal, Channel::MlDataEstimate, Channel::LlDataHold];
        let listed = Channel::from_name(channel).filter(|channel| READ.contains(channel));
        let Some(listed) = listed.filter(|_| self.navigator.is_busy()) else { return };
        match Message::decode(listed, data) {
            Ok(Message::MlDataGoal(goal)) => self.navigator.on_planner(time.now, time.micros, &goal),
            Ok(Message::MlDataEstimate(estimate)) => self.navigator.on_estimate(time.now, &estimate),
            Ok(Message::LlDataHold(holds)) => self.navigator.on_holds(&holds),
            _ => {}
        }
        self.carry_out(participant, time);
    }

    /// Writes the answers that wait for a client to be known, after a datagram or at a time that is due.
    pub fn flush(&mut self, participant: &mut Participant, time: Time) {
        self.services.flush(participant, time.now, time.micros);
        let lost = self.services.take_lost();
        if lost > 0 {
            self.effects.push_back(Effect::Note(format!("{lost} answers are dropped: their clients are gone")));
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, participant: &mut Participant, time: Time) {
        self.flush(participant, time);
        self.navigator.handle_timeout(time.now);
        self.beat(time, self.is_active());
        self.carry_out(participant, time);
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let bond = self.bond.as_ref().and_then(Bond::poll_timeout);
        earliest([self.services.poll_timeout(), self.navigator.poll_timeout(), bond])
    }

    /// The next thing to be done.
    pub fn poll(&mut self) -> Option<Effect> {
        self.effects.pop_front()
    }

    fn carry_out(&mut self, participant: &mut Participant, time: Time) {
        while let Some(output) = self.navigator.poll() {
            let effect = match output {
                Output::Answer(kind, part, caller, cdr) => {
                    self.answer(participant, time, (kind, part), caller, cdr);
                    continue;
                }
                Output::Feedback(kind, cdr) => Effect::Topic(feedback_topic(kind), cdr),
                Output::Status(kind, cdr) => Effect::Topic(status_topic(kind), cdr),
                Output::Command(goal) => Effect::Message(goal.into()),
                Output::Note(text) => Effect::Note(text),
            };
            self.effects.push_back(effect);
        }
    }

    fn answer(
        &mut self,
        participant: &mut Participant,
        Time { now, micros }: Time,
        of: (Kind, Part),
        caller: Caller,
        cdr: Vec<u8>,
    ) {
        let is_it = |what: &Use| matches!(what, Use::Action(kind, part) if (*kind, *part) == of);
        if let Some((service, _)) = self.uses.iter().find(|(_, what)| is_it(what)) {
            self.services.answer(participant, now, micros, *service, caller, cdr);
        }
    }
}
