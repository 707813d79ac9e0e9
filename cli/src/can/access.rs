//! Reading and writing objects of nodes: by own clients on a free bus, else through the module that holds it
//! (`LL_CMD_SDO`).

use super::decode::{Channel, Step};
use super::link::{Heard, Link};
use super::target::{Held, Target};
use crate::Failed;
use crate::bus::{Heard as Told, Tool};
use base::can::Frame;
use base::{Duration, Instant};
use canopen::sdo::{Client, Error};
use canopen::wire::{Service, decode_heartbeat};
use canopen::{Abort, NmtState};
use host::clock;
use messages::lowlevel::{CmdSdo, DataSdo};
use messages::{Channel as LcmChannel, Message};
use std::collections::BTreeMap;

/// Access to an object.
#[derive(Clone, Debug)]
pub struct Job {
    /// Node.
    pub node: u8,
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Data to write; `None` to read.
    pub data: Option<Vec<u8>>,
    /// By block transfer, where the node can.
    pub block: bool,
}

impl Job {
    /// Reads an object.
    pub fn read(node: u8, (index, sub): (u16, u8)) -> Self {
        Self { node, index, sub, data: None, block: false }
    }
}

/// An access that ended.
#[derive(Debug)]
pub struct Ended {
    /// Node.
    pub node: u8,
    /// Data read; empty after a write.
    pub result: Result<Vec<u8>, Error>,
    /// Duration.
    pub took: Duration,
}

/// The way to the objects.
pub struct Access {
    way: Way,
    /// Holder of the bus, if any.
    pub held: Option<Held>,
    /// Number of nodes that may be asked at once.
    pub at_once: usize,
}

enum Way {
    Direct(Box<Direct>),
    Through(Box<Through>),
}

/// Progress of a transfer: bytes so far, and the total if known. Through a module there are none: it tells that time
/// passes.
pub type Progress<'a> = &'a mut dyn FnMut(usize, Option<u32>);

impl Access {
    /// Opens the access. `timeout`: time limit of a node's answer, on a free bus.
    pub fn open(target: &Target, timeout: Duration) -> Result<Self, Failed> {
        let held = target.held();
        let way = match &held {
            None => Way::Direct(Box::new(Direct::open(target, timeout)?)),
            Some(held) => Way::Through(Box::new(Through::open(target, held)?)),
        };
        // Number of unconfigured nodes that the module asks at once.
        Ok(Self { way, held, at_once: 16 })
    }

    /// The module that does it for us, for people: `, through driver_canbus`.
    pub fn through(&self) -> Option<&str> {
        self.held.as_ref()?.holder.module.as_deref()
    }

    /// NMT states received in heartbeats since this was opened; listens for `within`, or until all of `nodes` were
    /// received.
    pub fn states(&mut self, nodes: &[u8], within: Duration) -> Result<&BTreeMap<u8, NmtState>, Failed> {
        let (link, states) = match &mut self.way {
            Way::Direct(direct) => (Some(&mut direct.link), &mut direct.states),
            Way::Through(through) => (through.ear.as_mut(), &mut through.states),
        };
        let until = clock::now() + within;
        if let Some(link) = link {
            loop {
                match link.receive(clock::now())? {
                    Heard::Frame { frame, .. } => note_state(states, &frame),
                    Heard::Notice(_) | Heard::Note(_) => {}
                    Heard::Nothing => {
                        let heard = nodes.iter().all(|node| states.contains_key(node));
                        if heard || clock::now() >= until || link.wait(until)? {
                            break;
                        }
                    }
                }
            }
        }
        Ok(states)
    }

    /// Begins an access; one at a time for each node.
    pub fn begin(&mut self, job: Job) -> Result<(), Failed> {
        match &mut self.way {
            Way::Direct(direct) => direct.begin(&job),
            Way::Through(through) => return through.begin(job),
        }
        Ok(())
    }

    /// The next access that ended; none at Ctrl-C.
    pub fn next(&mut self, progress: Progress<'_>) -> Result<Option<Ended>, Failed> {
        match &mut self.way {
            Way::Direct(direct) => direct.next(progress),
            Way::Through(through) => through.next(progress),
        }
    }

    /// Makes one access.
    pub fn ask(&mut self, job: Job, progress: Progress<'_>) -> Result<Ended, Failed> {
        self.begin(job)?;
        self.next(progress)?.ok_or_else(|| "interrupted".into())
    }
}

/// On the bus.
struct Direct {
    link: Link,
    timeout: Duration,
    clients: BTreeMap<u8, (Client, Channel)>,
    states: BTreeMap<u8, NmtState>,
}

impl Direct {
    fn open(target: &Target, timeout: Duration) -> Result<Self, Failed> {
        Ok(Self { link: Link::open(target)?, timeout, clients: BTreeMap::new(), states: BTreeMap::new() })
    }

    fn begin(&mut self, job: &Job) {
        let timeout = self.timeout;
        let (client, _) = self.clients.entry(job.node).or_insert_with(|| (Client::new(timeout), Channel::default()));
        let (now, index, sub) = (clock::now(), job.index, job.sub);
        let begun = match (&job.data, job.block) {
            (None, false) => client.read(now, index, sub),
            (None, true) => client.read_block(now, index, sub),
            (Some(data), false) => client.write(now, index, sub, data.as_slice().into()),
            (Some(data), true) => client.write_block(now, index, sub, data.as_slice().into()),
        };
        debug_assert!(begun, "one at a time");
    }

    fn next(&mut self, progress: Progress<'_>) -> Result<Option<Ended>, Failed> {
        loop {
            let now = clock::now();
            self.receive(now, progress)?;
            self.clients.values_mut().for_each(|(client, _)| client.handle_timeout(now));
            self.send(now, progress)?;
            for (node, (client, _)) in &mut self.clients {
                if let Some(done) = client.poll_done() {
                    let result = done.result.map(|data| data.to_vec());
                    return Ok(Some(Ended { node: *node, result, took: done.took }));
                }
            }
            let due = self.clients.values().filter_map(|(client, _)| client.poll_timeout()).min();
            if self.link.wait(due.unwrap_or(now))? {
                return Ok(None);
            }
        }
    }

    fn receive(&mut self, now: Instant, progress: Progress<'_>) -> Result<(), Failed> {
        loop {
            let frame = match self.link.receive(now)? {
                Heard::Nothing => return Ok(()),
                Heard::Frame { frame, .. } => frame,
                Heard::Note(note) => {
                    self.link.tell(&note);
                    continue;
                }
                Heard::Notice(_) => continue,
            };
            match Service::of(&frame) {
                Some(Service::SdoResponse { node }) => {
                    if let Some((client, channel)) = self.clients.get_mut(&node) {
                        follow(channel, false, frame.data(), progress);
                        client.handle_rx(now, frame.data());
                    }
                }
                _ => note_state(&mut self.states, &frame),
            }
        }
    }

    fn send(&mut self, now: Instant, progress: Progress<'_>) -> Result<(), Failed> {
        self.link.flush(now)?;
        for (node, (client, channel)) in &mut self.clients {
            while !self.link.is_full()
                && let Some(data) = client.poll_tx()
            {
                follow(channel, true, &data, progress);
                let cob_id = Service::SdoRequest { node: *node }.cob_id();
                self.link.send(now, Frame::standard(cob_id, &data))?;
            }
        }
        Ok(())
    }
}

fn note_state(states: &mut BTreeMap<u8, NmtState>, frame: &Frame) {
    if let (Some(Service::ErrorControl { node }), Some(state)) = (Service::of(frame), decode_heartbeat(frame.data())) {
        states.insert(node, state);
    }
}

fn follow(channel: &mut Channel, is_request: bool, data: &[u8], progress: Progress<'_>) {
    if let Step::Moved { len, size, .. } | Step::Confirmed { len, size, .. } = channel.step(is_request, data) {
        progress(len, size);
    }
}

/// A module answers each request, at the latest when its own time is up; this long after the last sign that it works.
const MODULE_WITHIN: Duration = Duration::from_secs(5);
/// A long transfer takes its time: so long for each of its bytes at 10 kbit/s.
const FOR_EACH_BYTE: Duration = Duration::from_millis(4);
/// How often is told that time passes.
const TOLD: Duration = Duration::from_millis(100);
/// The length of a read is unknown beforehand.
const LONG: Duration = Duration::from_secs(120);

/// Through a module.
struct Through {
    tool: Tool,
    module: String,
    /// As of [`Target::numbers_from`].
    numbers_from: i32,
    pending: Vec<Pending>,
    number: i32,
    /// Listens on the bus itself, where that can be.
    ear: Option<Link>,
    states: BTreeMap<u8, NmtState>,
}

struct Pending {
    request: i32,
    node: u8,
    since: Instant,
    until: Instant,
}

impl Through {
    fn open(target: &Target, held: &Held) -> Result<Self, Failed> {
        // By its id alone the request would reach another node of the same id, on the first bus of the drives.
        let numbers_from = target.numbers_from.ok_or_else(|| {
            format!(
                "{} is held by {}, and is no bus of the drives: nobody asks its nodes",
                target.name,
                held.holder.text()
            )
        })?;
        let tool = Tool::join_at(&held.place.lcm_url, "can", &[LcmChannel::LlDataSdo])?;
        // A number that no other tool is likely to have chosen.
        let number = (clock::wall() as u32 ^ std::process::id() << 16) & 0x3FFF_FFFF;
        let module = held.holder.module.clone().unwrap_or_default();
        let (ear, number) = (Link::open(target).ok(), number.cast_signed());
        Ok(Self { tool, module, numbers_from, pending: Vec::new(), number, ear, states: BTreeMap::new() })
    }

    fn begin(&mut self, job: Job) -> Result<(), Failed> {
        self.number = self.number.wrapping_add(1);
        let now = clock::now();
        let len = job.data.as_ref().map_or(0, Vec::len);
        let patience = if job.block { LONG } else { MODULE_WITHIN + FOR_EACH_BYTE * len as u32 };
        let (request, node) = (self.number, job.node);
        self.pending.push(Pending { request, node, since: now, until: now + patience });
        self.tool.publish(CmdSdo {
            timestamp: self.tool.timestamp(),
            request,
            node: self.numbers_from + i32::from(node),
            index: i32::from(job.index),
            subindex: i32::from(job.sub),
            write: job.data.is_some(),
            data: job.data.unwrap_or_default(),
        })
    }

    fn next(&mut self, progress: Progress<'_>) -> Result<Option<Ended>, Failed> {
        loop {
            let until = self.pending.iter().map(|pending| pending.until).min().unwrap_or(Instant::ZERO);
            progress(0, None);
            match self.tool.hear(until.min(clock::now() + TOLD))? {
                Told::Interrupt => return Ok(None),
                Told::Nothing if clock::now() < until => {}
                Told::Nothing => {
                    let help = format!("(advee state {})", self.module);
                    return Err(format!("{} does not answer LL_CMD_SDO: is it running? {help}", self.module).into());
                }
                Told::Message(Message::LlDataSdo(answer)) => {
                    let place = self.pending.iter().position(|pending| pending.request == answer.request);
                    if let Some(Pending { node, since, .. }) = place.map(|at| self.pending.swap_remove(at)) {
                        let took = clock::now().since(since);
                        return Ok(Some(Ended { node, result: result(answer), took }));
                    }
                }
                Told::Message(_) => {}
            }
        }
    }
}

fn result(answer: DataSdo) -> Result<Vec<u8>, Error> {
    match Abort(answer.abort_code as u32) {
        Abort(0) => Ok(answer.data),
        Abort::TIMEOUT => Err(Error::Timeout),
        code => Err(Error::Refused(code)),
    }
}
