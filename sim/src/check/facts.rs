//! Facts that several rules use: state of the processes, input served to the drives' driver, traffic on the wire.

use super::believed::Believed;
use super::life::Life;
use super::names::Names;
use super::pause_line::{By, PauseLine};
use super::sources::{Asked, ROUNDING_MPS, Source, Sources};
use super::wire::{Drive, Wheel, on_bus};
use super::{Base, Limits};
use crate::host::News;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use messages::{Message, common, lowlevel, middlelevel};
use module::State;
use module::admission::Sender;

/// Delay that the driver's queue, the bus and a frame on it may add to a decision without faults.
pub(super) const DELAY_MAX: Duration = Duration::from_millis(2);
/// Maximum age of a frame in a port's queue, unless it is retransmitted.
pub(super) const QUEUE_AGE: Duration = Duration::from_millis(60);
/// Time after a fault of a bus in which nodes recover from bus-off, queues drain, and delayed frames arrive.
const AFTERMATH: Duration = Duration::from_millis(100);
/// Time within which a driver that is on the bus has sent a frame: two of its heartbeats.
const SENDS_WITHIN: Duration = Duration::from_millis(100);
/// Time after a foreign command to a drive, or a fault of it, in which it is stopped or booted again.
const AFTERMATH_OF_COMMAND: Duration = Duration::from_secs(3);
/// Maximum time for which a controller that went bus-off repeatedly stays off.
const BUS_OFF_MAX: Duration = Duration::from_secs(6);
/// Time to standstill from top speed without power, at 0.17 m/s².
const COASTING_TIME: Duration = Duration::from_secs(10);

/// CiA 402-2, statusword: operation enabled, and the bits that show it.
pub(super) const OPERATION_ENABLED: u16 = 0x27;
pub(super) const STATE_MASK: u16 = 0x6F;
/// Period of the set-points of several wheels.
const STEP: Duration = Duration::from_millis(20);
/// Part of their ramp by which wheels slow down at least for a command to stand: a step that is late is a step of its
/// period all the same.
const RAMP_PART: f64 = 0.75;

/// The last RPDO of the propulsion: of one wheel, or of all of them together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetPoint {
    pub controlword: u8,
    moves: bool,
    mps: f64,
    is_stop: bool,
}

impl SetPoint {
    /// Speed at which it moves the robot, m/s; `None` if it does not move it.
    pub fn speed(self) -> Option<f64> {
        self.moves.then_some(self.mps)
    }

    pub fn is_stop(self) -> bool {
        self.is_stop
    }

    fn read(data: &[u8], wheel: &Wheel) -> Option<Self> {
        let command @ (controlword, target) = wheel.drive.commanded(data)?;
        let (moves, mps) = (Drive::moves(command), target / wheel.units_per_mps);
        Some(Self { controlword, moves, mps, is_stop: controlword == wheel.stop_word })
    }

    /// That of several wheels, the last of which was commanded by `last`. It moves the robot if one turns, at the speed
    /// of the fastest; it is a stop if all stop.
    fn of(wheels: &[Self], last: Self) -> Self {
        let [_, _, ..] = wheels else { return last };
        let moving = wheels.iter().filter_map(|wheel| wheel.speed());
        Self {
            moves: wheels.iter().any(|wheel| wheel.moves),
            mps: moving.fold(0.0, |fastest, mps| f64::max(fastest, mps.abs())),
            is_stop: wheels.iter().all(|wheel| wheel.is_stop),
            ..last
        }
    }
}

/// True for a mode by which an operator orders the robot to drive: to a person, or home.
pub(super) const fn orders_to_drive(command: &middlelevel::CmdMode) -> bool {
    matches!(command.mode, middlelevel::CmdMode::APPROACH | middlelevel::CmdMode::HOME)
}

impl Base {
    /// Longest time in which its wheels reach their speeds: from full speed one way to that of the other.
    pub fn ramp(&self, speed: f64) -> Duration {
        Duration::from_secs_f64(2.0 * speed / self.deceleration_mps2) + 2 * STEP
    }

    /// Greatest set-point of its fastest wheel, m/s, that slows down from `speed` to zero for `time`. With the command
    /// to stand all wheels slow down in proportion, the fastest one on its ramp: it is decided in the next step, and
    /// the last of the wheels is sent its set-point a step later than the first.
    fn slowed(&self, speed: f64, time: Duration) -> f64 {
        let ramp = time.saturating_sub(3 * STEP).as_secs_f64() * RAMP_PART * self.deceleration_mps2;
        (speed - ramp).max(0.0)
    }
}

/// All facts.
#[derive(Debug)]
pub(super) struct Facts {
    pub limits: Limits,
    pub driver: Life,
    /// Other modules.
    pub others: Names<Life>,
    pub sources: Sources,
    /// Last set-point of each wheel.
    pub wheels: Vec<SetPoint>,
    pub set_point: SetPoint,
    /// The last set-point that a command asked for, of wheels that reach their speeds in steps.
    asked: (Instant, f64),
    /// The greatest priority of those whose commands did.
    asked_by: i8,
    /// The slowest set-point since then, m/s.
    slowest: f64,
    /// When the drive of each wheel last reported that it has power.
    powered: Vec<Instant>,
    /// Time of the last set-point that moved the robot.
    moved: Instant,
    /// State of the driver, and its begin.
    pub state: (State, Instant),
    pub pause: PauseLine,
    believed: Believed,
    /// Time of the last list of processes, and since when a critical one has been missing in it.
    pub list: Option<(Instant, Option<Instant>)>,
    /// Time at which the last command out of limits was served.
    pub refused: Option<Instant>,
    /// Last stop.
    pub stopped: Instant,
    /// Last stop for another reason than the planner's own silence.
    latched: Instant,
    /// Release of the planner by an operator.
    goal: Option<Instant>,
    /// Last estimate that was not lost.
    located: Option<Instant>,
    /// Instant at which the estimate was reported lost.
    lost: Instant,
    /// End of the disturbance of the drives' buses: that of one of them is one of the robot.
    disturbed: Instant,
    /// End of a cut, until the driver has sent a frame again.
    cut: Option<Instant>,
    /// Time of the driver's last frame on each bus, and the gap before the last one of all.
    sent: Vec<Instant>,
    gap: Duration,
    /// End of the last disturbance of LCM.
    lcm: Option<Instant>,
    /// Instant until which the propulsion receives nothing.
    deaf: Instant,
    /// End of the time in which the propulsion may roll without power.
    rolls: Instant,
    /// End of the time in which the propulsion may disobey its commands.
    disobeys: Instant,
    /// End of the effects of a fault of the steering.
    steering_ill: Instant,
}

impl Facts {
    pub fn new(limits: Limits) -> Self {
        Self {
            sources: Sources::new(limits.ttl),
            wheels: vec![SetPoint::default(); limits.wheels.len()],
            asked: (Instant::ZERO, 0.0),
            asked_by: 0,
            slowest: 0.0,
            powered: vec![Instant::ZERO; limits.wheels.len()],
            sent: vec![Instant::ZERO; limits.buses.len().max(1)],
            limits,
            driver: Life::default(),
            others: Names::default(),
            set_point: SetPoint::default(),
            moved: Instant::ZERO,
            state: (State::Unknown, Instant::ZERO),
            pause: PauseLine::default(),
            believed: Believed::default(),
            list: None,
            refused: None,
            stopped: Instant::ZERO,
            latched: Instant::ZERO,
            goal: None,
            located: None,
            lost: Instant::ZERO,
            disturbed: Instant::ZERO,
            cut: None,
            gap: Duration::ZERO,
            lcm: None,
            deaf: Instant::ZERO,
            rolls: Instant::ZERO,
            disobeys: Instant::ZERO,
            steering_ill: Instant::ZERO,
        }
    }

    /// Maximum latency with which a decision of the driver appears on the wire. At the end of a hang it processes all
    /// that has waited at once, and the frames of these decisions fill its port's queue.
    pub fn slack(&self, now: Instant) -> Duration {
        let queues = self.is_disturbed(now) || self.driver.has_resumed_within(now, QUEUE_AGE);
        if queues { QUEUE_AGE } else { DELAY_MAX }
    }

    /// True if a bus of the drives is disturbed, or was within [`AFTERMATH`].
    pub fn is_disturbed(&self, now: Instant) -> bool {
        now < self.disturbed
    }

    /// True if a bus of the drives is disturbed, or was so recently that a controller may still be off.
    pub fn was_disturbed(&self, now: Instant) -> bool {
        self.disturbed > Instant::ZERO && now < self.disturbed + BUS_OFF_MAX
    }

    /// True if the driver's controller of a bus may still be off since the bus was disturbed: it sends nothing, and
    /// receives nothing.
    pub fn driver_may_be_off(&self, now: Instant) -> bool {
        self.was_disturbed(now) && self.sent.iter().any(|sent| now.since(*sent) > SENDS_WITHIN)
    }

    /// True if this set-point is a frame that was on the wire when the cable was cut, or when all nodes went bus-off: a
    /// controller retransmits it until it is acknowledged, whatever its age, and sends nothing else. A drive without
    /// heartbeats for 200 ms ignores it.
    pub fn is_left_over(&mut self, now: Instant) -> bool {
        let repaired = self.cut.take_if(|until| *until <= now).is_some_and(|until| now.since(until) < DELAY_MAX);
        repaired || self.gap > QUEUE_AGE && self.was_disturbed(now)
    }

    /// Instant of the last deliberate loss or delay of messages; now, while it lasts; `None` if never.
    pub fn lcm_disturbed(&self, now: Instant) -> Option<Instant> {
        self.lcm.map(|until| until.min(now))
    }

    /// True if the propulsion may not receive its commands.
    pub fn is_cut_off(&self, now: Instant) -> bool {
        now < self.deaf
    }

    /// True if the propulsion may roll without power.
    pub fn may_roll(&self, now: Instant) -> bool {
        now < self.rolls
    }

    /// Last instant at which the drives may have missed commands.
    pub fn missed(&self, now: Instant) -> Instant {
        self.driver.ill(now).max(self.disturbed.min(now))
    }

    /// Deceleration, m/s², of a robot that has to stop from `speed` since the instant `since`: that of a quick stop, or
    /// that of rolling if its drives roll without commands and may have missed commands about that time. `missed`: the
    /// last instant at which they may have, and the speed then: without power from then on, it may still roll.
    pub fn braking(&self, since: Instant, speed: f64, missed: (Instant, f64)) -> f64 {
        let (at, speed_then) = missed;
        let unpowered = self.powered.iter().any(|powered| *powered <= at);
        let speed_then = if unpowered { speed_then.max(speed) } else { speed };
        let rolls = |coasting: &f64| at + Duration::from_secs_f64(speed_then / coasting) >= since;
        self.limits.coasting.filter(rolls).unwrap_or(self.limits.quick_stop)
    }

    /// True if the propulsion may disobey its commands: by a fault, or because another master commands it.
    pub fn may_disobey(&self, now: Instant) -> bool {
        now < self.disobeys
    }

    /// True if the steering has a fault, or had one a moment ago.
    pub fn is_steering_ill(&self, now: Instant) -> bool {
        now < self.steering_ill
    }

    /// State of a module's process.
    pub fn life(&self, module: &str) -> Option<&Life> {
        if module == self.limits.driver { Some(&self.driver) } else { self.others.get(module) }
    }

    /// True if a source commands this speed, or a higher one that is limited to it; of wheels that reach their speeds
    /// in steps also if it commands anything and they are on their way, not faster than they were.
    pub fn asks(&self, now: Instant, source: &Source, speed: f64) -> bool {
        let slack = self.slack(now);
        match &self.limits.base {
            None => source.asks(now, slack, speed / self.limits.tread_ratio, self.limits.cap(source.priority)),
            // The speeds of its wheels have the limit in them.
            Some(base) => {
                let (since, fastest) = self.asked;
                let slows = speed <= fastest + ROUNDING_MPS && now.since(since) <= base.ramp(self.limits.speed);
                let since = self.slack_of_command(now, source);
                source.asks(now, since, speed, f64::INFINITY) || slows && source.lives(now, slack)
            }
        }
    }

    /// True if the wheels slow down on their ramp since a command last asked for their motion, without a stop since
    /// then, and not faster than they were, for a source that had overruled by its zero the source of that command,
    /// which commanded without a gap until then, and still commands zero: it ends a motion that was permitted, and
    /// begins none. To others the silence of the source that moved them is a stop.
    pub fn ends_motion(&self, now: Instant, speed: f64) -> bool {
        let Some(base) = &self.limits.base else { return false };
        let (since, fastest) = self.asked;
        // A driver that was late, or hung, went on from where it was.
        let held_up = self.driver.ill(now).max(since) + self.slack(now);
        let permitted = self.slowest.min(base.slowed(fastest, now.since(held_up)));
        let slows = speed <= permitted + ROUNDING_MPS && now.since(since) <= base.ramp(self.limits.speed);
        let asked_by =
            self.sources.iter().filter(|source| source.priority == self.asked_by && source.unbroken <= since);
        let obeyed = asked_by.map(Source::expires).fold(since, Instant::max);
        let overruled = |source: &Source| {
            let before = source.ended.is_some_and(|at| at <= obeyed) && source.unbroken <= obeyed;
            before && source.priority > self.asked_by && source.lives(now, self.slack(now))
        };
        slows && since > self.stopped && self.sources.iter().any(overruled)
    }

    /// [`Self::slack`] of a command that another one of its source has superseded: a motor controller is sent its
    /// set-point in each period, which may be that of the last step of the wheels.
    fn slack_of_command(&self, now: Instant, source: &Source) -> Duration {
        let slack = self.slack(now);
        if self.limits.repeats() && source.lives(now, slack) { slack.max(STEP + DELAY_MAX) } else { slack }
    }

    /// True if a source was released since the last stop; the planner also needs an estimate.
    pub fn may(&self, now: Instant, source: &Source) -> bool {
        let slack = self.slack(now);
        if source.is_planner() {
            let old = Duration::from_millis(200) + slack;
            let located = self.located.is_some_and(|at| now.since(at) <= old) || now.since(self.lost) <= slack;
            return located && self.goal.is_some_and(|at| at + slack >= self.latched);
        }
        self.has_begun(now, source) || now.since(self.stopped) <= slack
    }

    fn has_begun(&self, now: Instant, source: &Source) -> bool {
        let slack = self.slack(now);
        let ramp = self.limits.base.as_ref().map_or(Duration::ZERO, |base| base.ramp(self.limits.speed));
        let ended = source.ended.is_some_and(|at| now.since(at) > slack.max(ramp));
        !ended && source.begun.is_some_and(|at| at + slack >= self.stopped)
    }

    pub fn observe(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Can { bus, pid, frame } => {
                if let Some(bus) = self.limits.bus(bus) {
                    self.on_can(now, bus, *pid, frame);
                }
            }
            News::Heard { pid, at, sender, message }
                if self.driver.pid == Some(*pid) && self.believes(*sender, message) =>
            {
                self.on_heard(now, *at, *sender, message);
            }
            News::Message { sender, message: Message::LlCmdPower(_) } if sender.pid() == self.driver.pid => {
                self.rolls = self.rolls.max(now + COASTING_TIME);
            }
            News::Started { module, .. }
            | News::Exited { module, .. }
            | News::Hung { module, .. }
            | News::Resumed { module, .. }
            | News::Crawls { module, .. } => self.on_process(now, module, news),
            News::State { module, state } if *module == self.limits.driver => self.state = (*state, now),
            News::Fault { target, fault, until } => self.on_fault(now, target, fault, *until),
            _ => {}
        }
    }

    /// A frame on a bus of the drives; process 0: a node that is not the robot's.
    fn on_can(&mut self, now: Instant, bus: u8, pid: u32, frame: &Frame) {
        if pid != 0 {
            if self.driver.pid == Some(pid)
                && let Some(sent) = self.sent.get_mut(usize::from(bus))
            {
                self.gap = now.since(std::mem::replace(sent, now));
            }
            if let Id::Standard(id) = frame.id() {
                self.on_frame(now, on_bus(bus, id), frame.data());
            }
        } else if self.is_command(bus, frame) {
            self.disobeys = self.disobeys.max(now + AFTERMATH_OF_COMMAND);
            self.steering_ill = self.steering_ill.max(now + AFTERMATH_OF_COMMAND);
            if self.limits.coasting.is_some() {
                self.rolls = self.rolls.max(now + COASTING_TIME);
            }
        }
    }

    /// True if the robot may accept this sender.
    pub fn believes(&self, sender: Sender, message: &Message) -> bool {
        let releases_its_own = |stop: &lowlevel::EventStop| {
            let commands = self.believed.may_command(sender, &self.limits);
            !stop.engaged && commands && self.pause.is_engaged_by(By::Process(sender.pid()), &stop.source)
        };
        self.believed.believes(sender, message, &self.limits)
            || matches!(message, Message::LlEventStop(stop) if releases_its_own(stop))
    }

    fn on_process(&mut self, now: Instant, module: &str, news: &News<'_>) {
        if let News::Started { pid, .. } = news {
            self.believed.on_started(module, *pid, &self.limits);
        }
        if module != self.limits.driver {
            self.others.of(module).observe(now, news);
            return;
        }
        self.driver.observe(now, news);
        if matches!(news, News::Started { .. }) {
            // A new process knows nothing.
            self.sources.on_driver();
            (self.pause, self.list, self.refused) = (PauseLine::default(), None, None);
            (self.state, self.located, self.goal) = ((State::Init, now), None, None);
        }
    }

    fn on_fault(&mut self, now: Instant, target: &str, fault: &str, until: Instant) {
        let over = fault == "none";
        let is_wheel = self.limits.wheels.iter().any(|wheel| wheel.name == target);
        let is_drive = self.limits.drives().any(|(name, _)| name == target);
        if is_drive && ["babble", "clash"].contains(&fault) {
            self.disturbed = self.disturbed.max(until + AFTERMATH);
        }
        if self.limits.is_bus(target) {
            let until = if over { now } else { until };
            self.disturbed = if over { now + AFTERMATH } else { self.disturbed.max(until + AFTERMATH) };
            // A serial line repeats nothing.
            if self.limits.bus(target).is_some() && (over || fault == "cut") {
                self.cut = Some(until);
            }
        } else if target == "lcm" {
            let until = if over { now } else { until };
            self.lcm = Some(self.lcm.filter(|_| !over).map_or(until, |before| before.max(until)));
        } else if is_wheel {
            match fault {
                "garbled" => self.disturbed = self.disturbed.max(until + AFTERMATH),
                "silent" => self.deaf = until + AFTERMATH,
                "none" => self.deaf = now + AFTERMATH,
                _ => {}
            }
            let until = if until == Instant::NEVER { now } else { until };
            self.rolls = self.rolls.max(until + COASTING_TIME);
            if ["unbraked", "runaway", "encoder", "swapped"].contains(&fault) {
                self.disobeys = self.disobeys.max(until + AFTERMATH_OF_COMMAND);
            }
        } else if is_drive {
            let until = if until == Instant::NEVER { now } else { until };
            self.steering_ill = self.steering_ill.max(until + AFTERMATH_OF_COMMAND);
        } else if !self.limits.is_lidar(target) {
            // A board: the power controller may switch the motors off for many reasons.
            let until = if until == Instant::NEVER { now } else { until };
            self.rolls = self.rolls.max(until + COASTING_TIME);
        }
    }

    /// A frame on a bus of the drives, or a telegram of one.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8]) {
        if let Some((number, status)) = self.limits.reported(id, data)
            && status & STATE_MASK == OPERATION_ENABLED
        {
            self.powered[number] = now;
        }
        if let Some(number) = self.limits.disarmed(id, data) {
            // Its last set-point moves nothing any more.
            self.wheels[number] = SetPoint::default();
            self.set_point = SetPoint::of(&self.wheels, self.wheels[number]);
            return;
        }
        let Some(number) = self.limits.wheel(id) else { return };
        let Some(of_wheel) = SetPoint::read(data, &self.limits.wheels[number]) else { return };
        self.wheels[number] = of_wheel;
        let set_point = SetPoint::of(&self.wheels, of_wheel);
        let was = std::mem::replace(&mut self.set_point, set_point);
        if set_point.is_stop() {
            // A motor controller is commanded in each period: that is the same stop.
            if !was.is_stop() || !self.limits.repeats() {
                self.on_stop(now, was);
            }
        } else if let Some(speed) = set_point.speed().filter(|_| of_wheel.speed().is_some()) {
            self.moved = now;
            let asks = |source: &&Source| source.asks(now, self.slack_of_command(now, source), speed, f64::INFINITY);
            let asking = self.sources.iter().filter(asks).map(|source| source.priority).max();
            if let Some(priority) = asking.filter(|_| self.limits.base.is_some()) {
                (self.asked, self.asked_by, self.slowest) = ((now, speed), priority, speed);
            }
            self.slowest = self.slowest.min(speed);
        }
    }

    fn on_stop(&mut self, now: Instant, was: SetPoint) {
        let latches = |source: &Source| {
            // The planner's own silence does not latch it; the takeover by a manual source did. One that began under a
            // stop, and must send zero first, has not taken over: the robot stood.
            if source.is_planner() {
                // A stop for its silence is decided before its next command is served, and may leave the wire after it:
                // then no set-point has left the wire in between.
                let silent = now.since(source.resumed) <= self.slack(now) && self.moved < source.resumed;
                !was.is_stop() && source.lives(now, Duration::ZERO) && !silent
            } else {
                let stood = !was.is_stop() && was.speed().is_none();
                !stood && source.lives(now, DELAY_MAX) && self.has_begun(now, source)
            }
        };
        if self.sources.iter().any(latches) {
            self.latched = now;
        }
        self.stopped = now;
    }

    fn on_heard(&mut self, now: Instant, at: Instant, sender: Sender, message: &Message) {
        if let Some(asked) = Asked::of(message, &self.limits) {
            // Older commands have expired.
            if now.since(at) >= self.limits.ttl {
                return;
            }
            if asked.is_in_limits(message, &self.limits) {
                self.sources.said(now, at, asked);
            } else {
                self.refused = Some(now);
            }
        }
        match message {
            Message::LlEventStop(stop) => {
                let is_due = self.believed.reports_the_line(sender, &self.limits);
                let is_modules = self.believed.reports_the_source(sender, &stop.source, &self.limits);
                let by = if is_modules { By::Module } else { By::Process(sender.pid()) };
                self.pause.on_report(now, at, by, is_due, stop);
            }
            Message::CmDataProcesses(list) => self.on_list(now, at, list),
            Message::MlCmdGoal(goal) if !goal.waypoints.is_empty() => self.goal = Some(now),
            Message::MlCmdMode(command) if orders_to_drive(command) => self.goal = Some(now),
            Message::CmCmdState(command) => self.on_command(now, command),
            Message::MlDataEstimate(estimate) if estimate.quality >= middlelevel::DataEstimate::COARSE => {
                self.located = Some(at);
            }
            Message::MlDataEstimate(_) => (self.located, self.lost) = (None, now),
            _ => {}
        }
    }

    fn on_command(&mut self, now: Instant, command: &common::CmdState) {
        let planner = command.module == "*" || command.module == self.limits.planner;
        let runs = command.manual && command.state == State::Run as i8;
        if planner && runs {
            self.goal = Some(now);
        }
        if runs && (command.module == "*" || command.module == self.limits.driver) {
            self.pause.overrule(now, self.limits.power.is_some());
        }
    }

    fn on_list(&mut self, now: Instant, at: Instant, list: &common::DataProcesses) {
        let runs = |name: &String| {
            list.processes.iter().any(|row| row.module == *name && row.phase == common::Process::RUNNING)
        };
        let missing = self.limits.critical.iter().any(|name| *name != self.limits.driver && !runs(name));
        let since = self.list.and_then(|(_, since)| since);
        self.list = Some((at, missing.then(|| since.unwrap_or(now))));
    }
}
