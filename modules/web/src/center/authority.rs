//! Motion authority among web users, and the validity of their commands.
//!
//! A pure state machine, independent of sockets, bus and JSON: time is passed in, output is drained with
//! [`Authority::poll`], the deadline is [`Authority::poll_timeout`].
//!
//! One client holds the authority; it ends with its socket. It drives by holds, one for each press of the pad: commands
//! at 20 Hz that carry the page's clock. Their age follows from the minimum difference of both clocks observed so far:
//! commands that the network delayed beyond that count as late. A hold that has ended is not resumed.
//!
//! A command also says whether the second input is held, by which its user creeps past the guard (docs/guard.md).
//! Creeping is not independent of driving: it is forwarded with commands that move the robot, and ends with the first
//! command that does not say so, or with the hold.

use super::access::{Role, text};
use base::{Duration, Instant};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Arc;

/// Validity of a command from its creation: 250 ms less the time to wake up and send.
pub const COMMAND_TTL: Duration = Duration::from_millis(240);
/// Time without a valid command after which a hold ends.
pub const SILENCE_MAX: Duration = Duration::from_millis(200);
/// Interval of the zeros at the end, and their number after the first.
const ZEROS_PERIOD: Duration = Duration::from_millis(50);
const ZEROS_COUNT: u8 = 2;
/// Delays at which the resume command for the planner is repeated: the drives do not acknowledge that they are ready.
const RESUME_DELAYS: [Duration; 4] =
    [Duration::from_millis(100), Duration::from_millis(300), Duration::from_millis(700), Duration::from_millis(1500)];
/// Rate at which the minimum difference of the clocks is relaxed, s per s: two quartz clocks differ by less.
const DRIFT_S_PER_S: f64 = 2e-4;
/// Greatest value of a page's clock, ms: 300 years.
const CLOCK_MAX: f64 = 1e13;

/// Number of a socket; new for each connection.
pub type ClientId = u32;

/// Limits of commands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Limits {
    /// Maximum speed, m/s.
    pub speed: f64,
    /// Maximum steering angle, rad.
    pub steering: f64,
    /// Maximum speed to either side, m/s; 0 for a base that does not go sideways.
    pub sideways: f64,
    /// Maximum rotation, rad/s; 0 for a base that steers.
    pub rotation: f64,
}

impl Limits {
    /// True if a motion is within them; false if any of it is not a number.
    fn permit(&self, motion: Motion) -> bool {
        match motion {
            Motion::Curve { speed, steering } => speed.abs() <= self.speed && steering.abs() <= self.steering,
            Motion::Velocity { vx, vy, omega } => {
                vx.abs() <= self.speed && vy.abs() <= self.sideways && omega.abs() <= self.rotation
            }
        }
    }

    /// Reason why a motion beyond them is refused.
    fn refusal(&self, motion: Motion) -> String {
        match motion {
            Motion::Curve { speed, steering } => {
                format!("{speed} m/s, {steering} rad are refused: at most {} m/s and {} rad", self.speed, self.steering)
            }
            Motion::Velocity { vx, vy, omega } => format!(
                "{vx} m/s, {vy} m/s to the left, {omega} rad/s are refused: at most {} m/s, {} m/s and {} rad/s",
                self.speed, self.sideways, self.rotation
            ),
        }
    }
}

/// Motion that a hand demands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Along a curve, of any base: `LL_CMD_MOTION`.
    Curve {
        /// Speed, m/s.
        speed: f64,
        /// Steering angle, rad.
        steering: f64,
    },
    /// Velocity of a base that does not steer: `LL_CMD_VELOCITY`.
    Velocity {
        /// Forward, m/s.
        vx: f64,
        /// To the left, m/s.
        vy: f64,
        /// Counter-clockwise, rad/s.
        omega: f64,
    },
}

impl Motion {
    /// Standstill that begins this motion: its steering angle is kept.
    #[must_use]
    pub fn at_rest(self) -> Self {
        match self {
            Self::Curve { steering, .. } => Self::Curve { speed: 0.0, steering },
            Self::Velocity { .. } => Self::Velocity { vx: 0.0, vy: 0.0, omega: 0.0 },
        }
    }
}

/// Holder of the motion authority.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Holder {
    /// Number of its socket.
    pub id: ClientId,
    /// Name.
    #[serde(serialize_with = "text")]
    pub name: Arc<str>,
    /// Role.
    pub role: Role,
    /// True during a hold.
    pub driving: bool,
    /// Time since it took the authority, s.
    pub since: f64,
}

/// A command of a hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Number of the press of the pad.
    pub hold: u64,
    /// Sequence number.
    pub seq: u64,
    /// Time of creation, ms on the page's clock.
    pub t: f64,
    /// Motion.
    pub motion: Motion,
    /// True while the second input is held.
    pub creep: bool,
}

/// Output; `source` is the user's name on the bus.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// A motion command.
    Motion {
        /// User.
        source: Arc<str>,
        /// Motion, within the limits.
        motion: Motion,
        /// True for the first one of a hold, which is sent after a zero.
        begins: bool,
    },
    /// The second input, by which the user creeps past the guard: before each motion command of a hold while it is
    /// held, and once when it is not any more.
    Creep {
        /// User.
        source: Arc<str>,
        /// True while it is held.
        held: bool,
    },
    /// Zero command.
    Zero {
        /// User.
        source: Arc<str>,
    },
    /// Commands the drives to hold the quick stop.
    Pause {
        /// User.
        source: Arc<str>,
    },
    /// Permits the drives to move again.
    Run {
        /// User.
        source: Arc<str>,
    },
    /// Permits the planner to continue.
    Planner {
        /// User.
        source: Arc<str>,
    },
    /// Informs a client of the holder.
    Authority {
        /// Addressee.
        to: ClientId,
        /// Reason of the change; empty at the start.
        why: String,
    },
    /// A client's hold has ended.
    Ended {
        /// Addressee.
        to: ClientId,
        /// Number of the hold.
        hold: u64,
        /// Reason.
        why: String,
    },
}

/// Counters of rejected commands, and of changes of authority.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Motion commands forwarded.
    pub passed: u64,
    /// Late commands.
    pub late: u64,
    /// Commands repeated or out of order.
    pub repeated: u64,
    /// Commands of an ended hold.
    pub over: u64,
    /// Commands of users without authority.
    pub not_holder: u64,
    /// Commands out of limits or not a number.
    pub refused: u64,
    /// Holds that the server has ended.
    pub ended: u64,
    /// Number of takeovers of the authority.
    pub taken: u64,
    /// Of these, from another user.
    pub taken_over: u64,
    /// Stops requested.
    pub stops: u64,
}

/// Minimum difference of two clocks.
#[derive(Clone, Copy, Debug)]
struct Offset {
    least_ms: f64,
    at: Instant,
}

#[derive(Debug)]
struct Client {
    id: ClientId,
    name: Arc<str>,
    role: Role,
    source: Arc<str>,
    seq: Option<u64>,
    /// Newest hold that has begun or ended.
    hold: u64,
    /// Newest hold whose rejection has been reported.
    told: Option<u64>,
    offset: Option<Offset>,
}

impl Client {
    /// Age of a message created at `t`; `None` if `t` is invalid.
    fn age(&mut self, now: Instant, t: f64) -> Option<Duration> {
        if !(0.0..=CLOCK_MAX).contains(&t) {
            return None;
        }
        let offset = now.as_nanos() as f64 / 1e6 - t;
        let before = self
            .offset
            .map_or(offset, |Offset { least_ms, at }| least_ms + now.since(at).as_secs_f64() * 1e3 * DRIFT_S_PER_S);
        let least_ms = offset.min(before);
        self.offset = Some(Offset { least_ms, at: now });
        Some(Duration::from_secs_f64((offset - least_ms).max(0.0) / 1e3))
    }
}

#[derive(Clone, Copy, Debug)]
struct Hold {
    number: u64,
    /// Deadline unless a command comes; true if for silence, false if for the age of its last command.
    until: Instant,
    silent: bool,
    /// The second input was held at its last command.
    creeps: bool,
}

/// Zero commands still to be sent.
#[derive(Debug)]
struct Ending {
    source: Arc<str>,
    pause: bool,
    left: u8,
    next: Instant,
}

#[derive(Debug)]
struct Resume {
    source: Arc<str>,
    since: Instant,
    step: usize,
}

impl Resume {
    fn next(&self) -> Instant {
        self.since + RESUME_DELAYS[self.step.min(RESUME_DELAYS.len() - 1)]
    }
}

/// State.
#[derive(Debug)]
pub struct Authority {
    limits: Limits,
    clients: Vec<Client>,
    next: ClientId,
    holder: Option<(ClientId, Instant)>,
    /// Current hold of the holder.
    hold: Option<Hold>,
    endings: Vec<Ending>,
    resume: Option<Resume>,
    out: VecDeque<Output>,
    counts: Counts,
}

impl Authority {
    /// Creates an authority without users.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            clients: Vec::new(),
            next: 1,
            holder: None,
            hold: None,
            endings: Vec::new(),
            resume: None,
            out: VecDeque::new(),
            counts: Counts::default(),
        }
    }

    /// Limits of commands.
    #[must_use]
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Current holder.
    #[must_use]
    pub fn holder(&self, now: Instant) -> Option<Holder> {
        let (id, since) = self.holder?;
        let Client { name, role, .. } = self.clients.iter().find(|client| client.id == id)?;
        let since = now.since(since).as_secs_f64();
        Some(Holder { id, name: name.clone(), role: *role, driving: self.hold.is_some(), since })
    }

    /// True if this client holds the authority.
    #[must_use]
    pub fn holds(&self, client: ClientId) -> bool {
        self.holder.is_some_and(|(id, _)| id == client)
    }

    /// Adds a user; `source` is its name on the bus.
    pub fn join(&mut self, name: Arc<str>, role: Role, source: Arc<str>) -> ClientId {
        let id = self.next;
        self.next = self.next.wrapping_add(1).max(1);
        self.clients.push(Client { id, name, role, source, seq: None, hold: 0, told: None, offset: None });
        self.out.push_back(Output::Authority { to: id, why: String::new() });
        id
    }

    /// Removes a user, and releases its authority.
    pub fn leave(&mut self, now: Instant, client: ClientId) {
        self.handle_timeout(now);
        if self.holds(client) {
            self.end_hold(now, None);
            let name = self.name(client);
            self.hand_to(now, None, |_| format!("{name} has gone: nobody holds the robot"));
        }
        self.clients.retain(|other| other.id != client);
    }

    /// Processes a ping, created at `t` on the client's clock and received now.
    pub fn ping(&mut self, now: Instant, client: ClientId, t: f64) {
        self.handle_timeout(now);
        if let Some(client) = self.client(client) {
            client.age(now, t);
        }
    }

    /// Takes the authority, from no holder or from exactly the holder that the user was shown.
    ///
    /// # Errors
    /// Reason of the refusal.
    pub fn take(&mut self, now: Instant, client: ClientId, from: Option<ClientId>) -> Result<(), String> {
        self.handle_timeout(now);
        let name = self.name(client);
        match self.holder {
            Some((id, _)) if id == client => return Ok(()),
            Some((id, _)) if from != Some(id) => {
                return Err(format!("{} holds the robot now: look again, then take over", self.name(id)));
            }
            Some((loser, _)) => {
                self.end_hold(now, Some(format!("{name} has taken over")));
                self.counts.taken_over += 1;
                self.counts.taken += 1;
                self.hand_to(now, Some(client), |to| match to {
                    to if to == loser => format!("{name} has taken over from you"),
                    to if to == client => "you have taken over".into(),
                    _ => format!("{name} has taken over"),
                });
            }
            None => {
                self.counts.taken += 1;
                self.hand_to(now, Some(client), |to| match to {
                    to if to == client => "the robot is yours".into(),
                    _ => format!("{name} holds the robot"),
                });
            }
        }
        Ok(())
    }

    /// Returns the authority.
    ///
    /// # Errors
    /// The client does not hold it.
    pub fn release(&mut self, now: Instant, client: ClientId) -> Result<(), String> {
        self.handle_timeout(now);
        if !self.holds(client) {
            return Err("the robot is not yours".into());
        }
        self.end_hold(now, None);
        let name = self.name(client);
        self.hand_to(now, None, |to| match to {
            to if to == client => "you have released the robot".into(),
            _ => format!("{name} has released the robot"),
        });
        Ok(())
    }

    /// Processes a command of a hold: forwards it, or counts the reason of its rejection. An invalid command ends the
    /// hold.
    pub fn drive(&mut self, now: Instant, id: ClientId, drive: Drive) {
        self.handle_timeout(now);
        let (holds, limits) = (self.holds(id), self.limits);
        let active = self.hold.filter(|_| holds);
        let Some(client) = self.clients.iter_mut().find(|client| client.id == id) else { return };
        let age = client.age(now, drive.t);
        if client.seq.is_some_and(|last| drive.seq <= last) {
            self.counts.repeated += 1;
            return;
        }
        client.seq = Some(drive.seq);
        if !holds {
            self.counts.not_holder += 1;
            client.hold = client.hold.max(drive.hold);
            return self.tell(id, drive.hold, "the robot is not yours: take it first");
        }
        let Some(age) = age.filter(|_| limits.permit(drive.motion)) else {
            self.counts.refused += 1;
            client.hold = client.hold.max(drive.hold);
            let why = limits.refusal(drive.motion);
            return match active {
                Some(_) => self.end_hold(now, Some(why)),
                None => self.tell(id, drive.hold, &why),
            };
        };
        if age >= COMMAND_TTL {
            self.counts.late += 1;
            if active.is_none() {
                client.hold = client.hold.max(drive.hold);
                self.tell(id, drive.hold, "what was heard came too late: press anew");
            }
            return;
        }
        let begins = active.is_none_or(|active| active.number != drive.hold);
        if begins {
            if drive.hold <= client.hold {
                self.counts.over += 1;
                return self.tell(id, drive.hold, "this hold is over: press anew");
            }
            client.hold = drive.hold;
        }
        let source = client.source.clone();
        // A new command replaces its pending zeros; manual driving does not resume the planner.
        self.endings.retain(|ending| ending.source != source || ending.pause);
        self.resume = None;
        let (silence, valid) = (now + SILENCE_MAX, now + (COMMAND_TTL - age));
        let creeps = drive.creep;
        self.hold = Some(Hold { number: drive.hold, until: silence.min(valid), silent: silence <= valid, creeps });
        self.counts.passed += 1;
        if creeps || active.is_some_and(|active| active.creeps) {
            self.out.push_back(Output::Creep { source: source.clone(), held: creeps });
        }
        self.out.push_back(Output::Motion { source, motion: drive.motion, begins });
    }

    /// The user released the pad.
    pub fn zero(&mut self, now: Instant, id: ClientId, hold: u64, seq: u64) {
        self.handle_timeout(now);
        let Some(client) = self.client(id) else { return };
        client.seq = client.seq.max(Some(seq));
        client.hold = client.hold.max(hold);
        if self.holds(id) && self.hold.is_some_and(|active| active.number <= hold) {
            self.end_hold(now, None);
        }
    }

    /// Processes an unintelligible message: its intent is unknown, so its hold ends.
    pub fn nonsense(&mut self, now: Instant, id: ClientId) {
        self.handle_timeout(now);
        if self.holds(id) && self.hold.is_some() {
            self.end_hold(now, Some("what this page says is not understood".into()));
        }
    }

    /// Stops the robot, whatever moves it.
    pub fn stop(&mut self, now: Instant, id: ClientId) {
        self.handle_timeout(now);
        let Some(client) = self.clients.iter().find(|client| client.id == id) else { return };
        let (name, source) = (client.name.clone(), client.source.clone());
        self.counts.stops += 1;
        self.resume = None;
        self.out.push_back(Output::Pause { source: source.clone() });
        self.end_hold(now, Some(format!("{name} has stopped the robot")));
        if !self.endings.iter().any(|ending| ending.source == source && ending.next == now + ZEROS_PERIOD) {
            self.begin_zeros(now, source.clone());
        }
        self.endings.iter_mut().filter(|ending| ending.source == source).for_each(|ending| ending.pause = true);
    }

    /// Permits the drives, and then the planner, to continue. The caller has checked that the client holds the
    /// authority.
    pub fn resume(&mut self, now: Instant, id: ClientId) {
        self.handle_timeout(now);
        let Some(source) = self.client(id).map(|client| client.source.clone()) else { return };
        self.endings.iter_mut().for_each(|ending| ending.pause = false);
        self.out.push_back(Output::Run { source: source.clone() });
        self.resume = Some(Resume { source, since: now, step: 0 });
    }

    /// Ends holds whose deadline has passed; late and needless calls are harmless.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(hold) = self.hold.filter(|hold| hold.until <= now) {
            let why = if hold.silent { "nothing was heard for 0.2 s" } else { "what was heard came too late" };
            self.end_hold(now, Some(why.into()));
        }
        for Ending { source, pause, left, next } in &mut self.endings {
            if *next <= now {
                self.out.push_back(Output::Zero { source: source.clone() });
                if *pause {
                    self.out.push_back(Output::Pause { source: source.clone() });
                }
                (*left, *next) = (*left - 1, now + ZEROS_PERIOD);
            }
        }
        self.endings.retain(|ending| ending.left > 0);
        if let Some(resume) = self.resume.as_mut().filter(|resume| resume.next() <= now) {
            self.out.push_back(Output::Planner { source: resume.source.clone() });
            // Missed repetitions are skipped.
            resume.step = RESUME_DELAYS.iter().filter(|after| resume.since + **after <= now).count();
        }
        self.resume.take_if(|resume| resume.step >= RESUME_DELAYS.len());
    }

    /// Deadline of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let endings = self.endings.iter().map(|ending| ending.next);
        let others = [self.hold.map(|hold| hold.until), self.resume.as_ref().map(Resume::next)];
        endings.chain(others.into_iter().flatten()).min()
    }

    /// Next output, in order.
    pub fn poll(&mut self) -> Option<Output> {
        self.out.pop_front()
    }

    /// Ends the current hold, if any, with zero; reports the reason, if any, to its user.
    fn end_hold(&mut self, now: Instant, why: Option<String>) {
        let (Some(hold), Some((id, _))) = (self.hold.take(), self.holder) else { return };
        let Some(source) = self.client(id).map(|client| client.source.clone()) else { return };
        self.begin_zeros(now, source.clone());
        if hold.creeps {
            self.out.push_back(Output::Creep { source, held: false });
        }
        if let Some(why) = why {
            self.counts.ended += 1;
            self.out.push_back(Output::Ended { to: id, hold: hold.number, why });
            if let Some(client) = self.client(id) {
                client.told = Some(hold.number);
            }
        }
    }

    fn begin_zeros(&mut self, now: Instant, source: Arc<str>) {
        self.out.push_back(Output::Zero { source: source.clone() });
        let pause = self.endings.iter().any(|ending| ending.source == source && ending.pause);
        self.endings.retain(|ending| ending.source != source);
        self.endings.push(Ending { source, pause, left: ZEROS_COUNT, next: now + ZEROS_PERIOD });
    }

    /// Gives the authority to a user, or to nobody; informs all.
    fn hand_to(&mut self, now: Instant, client: Option<ClientId>, why: impl Fn(ClientId) -> String) {
        self.holder = client.map(|id| (id, now));
        self.resume = None;
        for Client { id, .. } in &self.clients {
            self.out.push_back(Output::Authority { to: *id, why: why(*id) });
        }
    }

    /// Reports once for each hold that it does not move the robot.
    fn tell(&mut self, to: ClientId, hold: u64, why: &str) {
        let Some(client) = self.client(to) else { return };
        if client.told.replace(hold) != Some(hold) {
            self.out.push_back(Output::Ended { to, hold, why: why.into() });
        }
    }

    fn client(&mut self, id: ClientId) -> Option<&mut Client> {
        self.clients.iter_mut().find(|client| client.id == id)
    }

    fn name(&self, id: ClientId) -> Arc<str> {
        self.clients.iter().find(|client| client.id == id).map_or_else(|| "nobody".into(), |client| client.name.clone())
    }
}

#[cfg(test)]
mod tests;
