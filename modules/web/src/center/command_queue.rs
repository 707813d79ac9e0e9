//! Output of the authority to the bus and the sockets. A separate thread serves its deadlines, so that a hold ends in
//! time even if the server is busy or hangs.

use super::access::Role;
use super::authority::{Authority, ClientId, Counts, Holder, Motion, Output};
use super::command::{Answer, Robot};
use base::{Epoch, Instant};
use diagnostics::orders;
use drivers::canbus;
use host::bus::Bus;
use host::clock;
use messages::Message;
use messages::lowlevel::{CmdCreep, CmdMotion, CmdVelocity};
use module::State;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use tokio::sync::mpsc;

/// Maximum number of answers waiting for a page; beyond it the page is disconnected.
const WAITING_MAX: usize = 64;

/// Queue of the commands to the bus.
pub struct CommandQueue {
    /// Data of the robot for checking commands.
    pub robot: Robot,
    inner: Mutex<Inner>,
    wake: Condvar,
}

struct Inner {
    authority: Authority,
    bus: Bus,
    epoch: Epoch,
    /// Session of the creep commands: the start time of the server.
    session: i64,
    pages: Vec<(ClientId, mpsc::Sender<String>)>,
    /// Wake-up time of the thread; `None`: until notified.
    sleeps_until: Option<Instant>,
    closed: bool,
}

impl CommandQueue {
    /// Joins the bus without subscriptions, and starts the thread.
    ///
    /// # Errors
    /// One line: the bus cannot be joined, or no thread can be created.
    pub fn open(url: &str, robot: Robot) -> Result<Arc<Self>, String> {
        let epoch = clock::epoch();
        let inner = Inner {
            authority: Authority::new(robot.limits),
            bus: Bus::open(url, &[])?,
            epoch,
            session: epoch.timestamp(clock::now()),
            pages: Vec::new(),
            sleeps_until: None,
            closed: false,
        };
        let command_queue = Arc::new(Self { robot, inner: Mutex::new(inner), wake: Condvar::new() });
        let keeps = command_queue.clone();
        let started = std::thread::Builder::new().name("web hold".into()).spawn(move || keeps.keep_deadlines());
        started.map_err(|error: io::Error| format!("the web server: {error}"))?;
        Ok(command_queue)
    }

    /// Adds a user; returns its channel of answers.
    pub fn join(&self, name: Arc<str>, role: Role, source: Arc<str>) -> QueueHandle {
        let (tell, told) = mpsc::channel(WAITING_MAX);
        let mut inner = self.lock();
        let id = inner.authority.join(name, role, source);
        inner.pages.push((id, tell.clone()));
        // First output to an empty queue.
        let _ = inner.drain(clock::now());
        QueueHandle { id, tell, told }
    }

    /// Removes a user.
    pub fn leave(&self, id: ClientId) {
        let mut inner = self.lock();
        let now = clock::now();
        inner.pages.retain(|(other, _)| *other != id);
        inner.authority.leave(now, id);
        let _ = inner.drain(now);
        self.wake.notify_one();
    }

    /// Stops the robot for a user without a socket.
    ///
    /// # Errors
    /// One line: it cannot be published.
    pub fn stop(&self, name: Arc<str>, role: Role, source: Arc<str>) -> Result<(), String> {
        let mut inner = self.lock();
        let now = clock::now();
        let id = inner.authority.join(name, role, source);
        inner.authority.stop(now, id);
        // The repetitions go on when the user has gone.
        inner.authority.leave(now, id);
        let said = inner.drain(now);
        self.wake.notify_one();
        said
    }

    /// Runs a function on the authority, and sends its output.
    ///
    /// # Errors
    /// One line: a message cannot be published.
    pub fn with<T>(&self, hear: impl FnOnce(Instant, &mut Authority) -> T) -> Result<T, String> {
        let mut inner = self.lock();
        let now = clock::now();
        let heard = hear(now, &mut inner.authority);
        let said = inner.drain(now);
        let due = inner.authority.poll_timeout();
        if due.is_some_and(|due| inner.sleeps_until.is_none_or(|until| due < until)) {
            self.wake.notify_one();
        }
        said.map(|()| heard)
    }

    /// Publishes a message outside of the authority.
    ///
    /// # Errors
    /// One line: it cannot be published.
    pub fn publish(&self, message: &Message) -> Result<(), String> {
        self.lock().bus.publish(message)
    }

    /// Publishes the bytes of a message that is not one of the commands.
    ///
    /// # Errors
    /// One line: it cannot be published.
    pub fn publish_raw(&self, channel: &str, bytes: &[u8]) -> Result<(), String> {
        self.lock().bus.publish_raw(channel, bytes)
    }

    /// Current message timestamp.
    pub fn timestamp(&self) -> i64 {
        self.lock().epoch.timestamp(clock::now())
    }

    /// Holder of the motion authority.
    pub fn holder(&self) -> Option<Holder> {
        self.lock().authority.holder(clock::now())
    }

    /// True if this client holds it.
    pub fn holds(&self, id: ClientId) -> bool {
        self.lock().authority.holds(id)
    }

    /// Counters.
    pub fn counts(&self) -> Counts {
        self.lock().authority.counts()
    }

    /// Ends the thread; all clients have left before.
    pub fn close(&self) {
        self.lock().closed = true;
        self.wake.notify_one();
    }

    fn keep_deadlines(&self) {
        let mut inner = self.lock();
        while !inner.closed {
            let now = clock::now();
            inner.authority.handle_timeout(now);
            // A failure needs no retry here: zeros are sent three times, then the drives' own timeout applies.
            let _ = inner.drain(now);
            inner.sleeps_until = inner.authority.poll_timeout();
            inner = match inner.sleeps_until {
                None => self.wake.wait(inner).unwrap_or_else(PoisonError::into_inner),
                Some(due) => {
                    let waited = self.wake.wait_timeout(inner, due.since(clock::now()));
                    waited.unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Handle of a page.
pub struct QueueHandle {
    /// Number.
    pub id: ClientId,
    /// Sender of its answers.
    pub tell: mpsc::Sender<String>,
    /// Answers for the page; closed if it does not read them.
    pub told: mpsc::Receiver<String>,
}

impl Inner {
    /// Sends all output; returns the first failure on the bus.
    fn drain(&mut self, now: Instant) -> Result<(), String> {
        let mut result = Ok(());
        while let Some(say) = self.authority.poll() {
            let said = self.say(now, say);
            result = result.and(said);
        }
        result
    }

    fn say(&mut self, now: Instant, say: Output) -> Result<(), String> {
        let timestamp = self.epoch.timestamp(now);
        let session = self.session;
        let motion = |source: Arc<str>, motion: Motion| -> Message {
            let (priority, source) = (CmdMotion::REMOTE, source.to_string());
            match motion {
                Motion::Curve { speed, steering } => CmdMotion { timestamp, speed, steering, priority, source }.into(),
                Motion::Velocity { vx, vy, omega } => {
                    CmdVelocity { timestamp, vx, vy, omega, priority, source, session }.into()
                }
            }
        };
        let state = |module, state, source: Arc<str>| orders::manual(timestamp, module, state, &source).into();
        let message: Message = match say {
            Output::Motion { source, motion: wanted, begins } => {
                // A press is a release: the driver obeys no source whose last command was motion.
                if begins {
                    self.bus.publish(&motion(source.clone(), wanted.at_rest()))?;
                }
                motion(source, wanted)
            }
            Output::Creep { source, held } => CmdCreep { timestamp, source: source.to_string(), session, held }.into(),
            Output::Zero { source } => motion(source, Motion::Curve { speed: 0.0, steering: 0.0 }),
            Output::Pause { source } => state(canbus::NAME, State::Pause, source),
            Output::Run { source } => state(canbus::NAME, State::Run, source),
            Output::Planner { source } => state(planner::NAME, State::Run, source),
            Output::Authority { to, why } => {
                let holder = self.authority.holder(now);
                let yours = self.authority.holds(to);
                self.tell(to, Answer::Authority { holder, yours, why: &why });
                return Ok(());
            }
            Output::Ended { to, hold, why } => {
                self.tell(to, Answer::Ended { hold, why: &why });
                return Ok(());
            }
        };
        self.bus.publish(&message)
    }

    fn tell(&mut self, to: ClientId, answer: Answer<'_>) {
        let Some(place) = self.pages.iter().position(|(id, _)| *id == to) else { return };
        if self.pages[place].1.try_send(answer.text()).is_err() {
            // The page does not read: closing its channel ends its socket.
            self.pages.swap_remove(place);
        }
    }
}
