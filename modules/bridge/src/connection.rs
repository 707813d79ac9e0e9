//! One connection to the other computer: handshake, records, signs of life, clocks. Reads no clock and owns no port:
//! the caller passes bytes and time, then drains.

use crate::auth::{Key, NONCE_LEN, Role, Session, TAG_LEN, Transcript};
use crate::clocks::{Answer, Clocks};
use crate::wire::{BODY_MAX, Body, Decoder, HANDSHAKE_MAX, MAGIC, WireError, record, record_len};
use base::{Duration, Instant};
use std::collections::VecDeque;
use std::mem;

/// Time limit of the handshake.
pub const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(2);
/// Period of the questions, which are the signs of life too.
pub const PING_PERIOD: Duration = Duration::from_millis(100);
/// Silence of the other end after which the connection is lost.
pub const SILENCE_MAX: Duration = Duration::from_millis(400);
/// Maximum number of bytes that wait for the cable; a message that does not fit is left out.
pub const TX_MAX: usize = 2 * record_len(BODY_MAX);
/// Part of them that messages leave free, for signs of life and for messages that stop the robot.
const TX_RESERVE: usize = 16 << 10;

/// Time of a call, on both clocks of this computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time {
    /// Monotonic clock; never decreases.
    pub now: Instant,
    /// Wall clock, ns since the UNIX epoch.
    pub wall_ns: u64,
}

/// Why a connection ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The other end did not finish the handshake in time.
    Unfinished,
    /// The other end does not speak this protocol, or another version of it.
    Protocol,
    /// The other end does not have the key.
    Key,
    /// A record was changed, repeated, left out, or is of another session.
    Record,
    /// Bytes that are no record.
    Wire(WireError),
    /// The other end is silent for [`SILENCE_MAX`].
    Silent,
}

impl Refusal {
    /// What happened, for people.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Unfinished => "did not identify itself in time",
            Self::Protocol => "does not speak the protocol of the bridge",
            Self::Key => "does not have the key",
            Self::Record => "sent a record that was changed, repeated or left out",
            Self::Wire(_) => "sent what is no record",
            Self::Silent => "is silent",
        }
    }

    /// True for what no computer of the robot does; false for a loss of the connection.
    #[must_use]
    pub fn is_foreign(self) -> bool {
        self != Self::Silent
    }
}

/// What a connection reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The other end has the key: the session is open.
    Opened,
    /// A message arrived.
    Message {
        /// Greatest possible age since its publication; `None`: not known.
        age: Option<Duration>,
        /// Name of its channel.
        channel: String,
        /// Encoded message.
        payload: Vec<u8>,
    },
    /// Modules that the other watchdog guards, and whether each works.
    Modules(Vec<(String, bool)>),
}

enum Stage {
    /// Listener: waits for the hello. Connector: waits for the answer.
    Greeting,
    /// Listener: waits for the proof.
    Proving(Transcript),
    Open(Box<Session>),
}

/// A connection, from the first byte on.
pub struct Connection {
    role: Role,
    key: Key,
    nonce: [u8; NONCE_LEN],
    stage: Stage,
    decoder: Decoder,
    tx: Vec<u8>,
    events: VecDeque<Event>,
    clocks: Clocks,
    /// Deadline of the handshake; in an open session of the next record of the other end.
    until: Instant,
    next_ping: Instant,
}

impl Connection {
    /// Connection that this end opens; `nonce` is random and used once.
    #[must_use]
    pub fn connect(key: Key, nonce: [u8; NONCE_LEN], time: Time) -> Self {
        let mut connection = Self::new(Role::Connector, key, nonce, time);
        record(&mut connection.tx, &[&MAGIC[..], &nonce].concat(), &[]);
        connection
    }

    /// Connection that this end accepted.
    #[must_use]
    pub fn listen(key: Key, nonce: [u8; NONCE_LEN], time: Time) -> Self {
        Self::new(Role::Listener, key, nonce, time)
    }

    fn new(role: Role, key: Key, nonce: [u8; NONCE_LEN], time: Time) -> Self {
        Self {
            role,
            key,
            nonce,
            stage: Stage::Greeting,
            decoder: Decoder::default(),
            tx: Vec::new(),
            events: VecDeque::new(),
            clocks: Clocks::default(),
            until: time.now + HANDSHAKE_TIMEOUT,
            next_ping: Instant::NEVER,
        }
    }

    /// True if the other end has proved that it has the key.
    #[must_use]
    pub fn is_open(&self) -> bool {
        matches!(self.stage, Stage::Open(_))
    }

    /// Clocks of both computers.
    #[must_use]
    pub fn clocks(&self) -> &Clocks {
        &self.clocks
    }

    /// Processes received bytes.
    ///
    /// # Errors
    /// The connection is to be closed: nothing that follows is trusted.
    pub fn handle_rx(&mut self, time: Time, bytes: &[u8]) -> Result<(), Refusal> {
        self.decoder.push(bytes);
        loop {
            let (max, tag) = if self.is_open() { (BODY_MAX, TAG_LEN) } else { (HANDSHAKE_MAX, 0) };
            let refused = |error| if tag == 0 { Refusal::Protocol } else { Refusal::Wire(error) };
            let Some(record) = self.decoder.next_record(max, tag).map_err(refused)? else { return Ok(()) };
            match mem::replace(&mut self.stage, Stage::Greeting) {
                Stage::Greeting => self.on_greeting(time, &record)?,
                Stage::Proving(transcript) => self.on_proof(time, transcript, &record)?,
                Stage::Open(session) => {
                    self.stage = Stage::Open(session);
                    self.on_record(time, &record)?;
                }
            }
        }
    }

    fn on_greeting(&mut self, time: Time, record_: &[u8]) -> Result<(), Refusal> {
        match self.role {
            Role::Listener => {
                let nonce = record_.strip_prefix(MAGIC).and_then(|nonce| nonce.try_into().ok());
                let connector = nonce.ok_or(Refusal::Protocol)?;
                let transcript = Transcript { connector, listener: self.nonce };
                let proof = transcript.proof(&self.key, Role::Listener);
                record(&mut self.tx, &[self.nonce, proof].concat(), &[]);
                self.stage = Stage::Proving(transcript);
            }
            Role::Connector => {
                let (listener, proof) = record_.split_first_chunk::<NONCE_LEN>().ok_or(Refusal::Protocol)?;
                let transcript = Transcript { connector: self.nonce, listener: *listener };
                if !transcript.is_proof(&self.key, Role::Listener, proof) {
                    return Err(Refusal::Key);
                }
                record(&mut self.tx, &transcript.proof(&self.key, Role::Connector), &[]);
                self.open(time, &transcript);
            }
        }
        Ok(())
    }

    fn on_proof(&mut self, time: Time, transcript: Transcript, proof: &[u8]) -> Result<(), Refusal> {
        if !transcript.is_proof(&self.key, Role::Connector, proof) {
            return Err(Refusal::Key);
        }
        self.open(time, &transcript);
        Ok(())
    }

    fn open(&mut self, time: Time, transcript: &Transcript) {
        self.stage = Stage::Open(Box::new(transcript.session(&self.key, self.role)));
        (self.until, self.next_ping) = (time.now + SILENCE_MAX, time.now);
        self.events.push_back(Event::Opened);
    }

    fn on_record(&mut self, time: Time, record: &[u8]) -> Result<(), Refusal> {
        let Stage::Open(session) = &mut self.stage else { return Err(Refusal::Protocol) };
        let (body, tag) = record.split_at(record.len().saturating_sub(TAG_LEN));
        if !session.open(body, tag) {
            return Err(Refusal::Record);
        }
        self.until = time.now + SILENCE_MAX;
        match Body::decode(body).map_err(Refusal::Wire)? {
            Body::Message { published, channel, payload } => {
                let age = self.clocks.age_max(time.now, published);
                self.events.push_back(Event::Message { age, channel: channel.into(), payload: payload.into() });
            }
            Body::Ping { sent } => {
                let now = time.now.as_nanos();
                self.queue(&Body::Pong { sent, received: now, answered: now, wall: time.wall_ns });
            }
            Body::Pong { sent, received, answered, wall } => {
                self.clocks.on_answer(time.now, time.wall_ns, Answer { sent, received, answered, wall });
            }
            Body::Modules(modules) => {
                let modules = modules.into_iter().map(|(name, works)| (name.to_owned(), works)).collect();
                self.events.push_back(Event::Modules(modules));
            }
        }
        Ok(())
    }

    /// Sends a message that was published at `published`; false if it was left out: the session is not open, too much
    /// waits, or the message is too long.
    pub fn send(&mut self, published: Instant, channel: &str, payload: &[u8]) -> bool {
        self.queue_within(TX_MAX - TX_RESERVE, &Body::Message { published: published.as_nanos(), channel, payload })
    }

    /// Sends a message that stops the robot: as [`Connection::send`], with room that other messages leave free.
    pub fn send_stop(&mut self, published: Instant, channel: &str, payload: &[u8]) -> bool {
        self.queue(&Body::Message { published: published.as_nanos(), channel, payload })
    }

    /// Sends the list of this computer's modules; false if it was left out.
    pub fn send_modules(&mut self, modules: &[(String, bool)]) -> bool {
        self.queue(&Body::Modules(modules.iter().map(|(name, works)| (name.as_str(), *works)).collect()))
    }

    fn queue(&mut self, body: &Body<'_>) -> bool {
        self.queue_within(TX_MAX, body)
    }

    fn queue_within(&mut self, max: usize, body: &Body<'_>) -> bool {
        let Stage::Open(session) = &mut self.stage else { return false };
        if !body.is_sendable() {
            return false;
        }
        let mut bytes = Vec::new();
        body.encode(&mut bytes);
        if self.tx.len() + record_len(bytes.len()) > max {
            return false;
        }
        // Sealed last: a record without a place in the stream would break the order of the counter.
        let tag = session.seal(&bytes);
        record(&mut self.tx, &bytes, &tag);
        true
    }

    /// Serves what is due; late and needless calls do no harm.
    ///
    /// # Errors
    /// The connection is to be closed.
    pub fn handle_timeout(&mut self, time: Time) -> Result<(), Refusal> {
        if time.now >= self.until {
            return Err(if self.is_open() { Refusal::Silent } else { Refusal::Unfinished });
        }
        if time.now >= self.next_ping {
            self.next_ping = time.now + PING_PERIOD;
            self.queue(&Body::Ping { sent: time.now.as_nanos() });
        }
        Ok(())
    }

    /// Next deadline.
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        self.until.min(self.next_ping)
    }

    /// Next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Bytes that are to be sent; [`Connection::handle_tx`] removes those that were.
    #[must_use]
    pub fn poll_tx(&self) -> &[u8] {
        &self.tx
    }

    /// The first `len` bytes of [`Connection::poll_tx`] were sent.
    pub fn handle_tx(&mut self, len: usize) {
        self.tx.drain(..len.min(self.tx.len()));
    }

    /// Removes all bytes that are to be sent.
    pub fn take_tx(&mut self) -> Vec<u8> {
        mem::take(&mut self.tx)
    }
}
