//! CANopen devices with inputs and outputs (`[io.canopen]`) on the bus of the drives: its master serves them.
//!
//! Protocol  CiA 401 by its indices, any other object by its own. Inputs by the device's TPDOs as it has mapped them,
//!           and by SDO; outputs by SDO, so that each order is acknowledged
//! Timing    inputs are asked in their period, one request of a device at a time; outputs are written at each change,
//!           and refreshed; none while another master is on the bus, since a request would end its transfer
//! Silence   a device whose heartbeat is missing, or that restarts, is lost: its values are unknown, and an input of
//!           `[stop]` stops the robot at once. A value that nothing has confirmed for its greatest age is unknown, too:
//!           an event-driven TPDO sends changes only, so its silence proves nothing. Without `LL_CMD_NODE_IO` for
//!           [`ORDER_TTL`] outputs get their safe values
//! Mapping   read at each start, and again after another master. A TPDO is taken only if its identifier is the one of
//!           the pre-defined connection set: a frame under that identifier is of another node otherwise. A read of it
//!           without an answer is repeated, up to [`MAPPING_UNANSWERED_MAX`] for a TPDO. Until its mapping is known a
//! TPDO           is dropped, and inputs are what answers to SDO requests prove: unknown 0.5 s after the last one
//! Length    an answer or a TPDO that has not the length of its object or mapping is dropped and reported
//! Stops     an input of `[stop]` goes to the PAUSE line as it is received; see `pause`
//!
//! `driver_io` publishes the values, and commands the outputs. The stop does not depend on it.

use super::config::Stop;
use super::net::NodeAt;
use super::pause::PauseLine;
use crate::io::{Canopen, CanopenKeys, ObjectKeys, ObjectKind, ObjectPlace};
use base::{Duration, Fault, Instant, Level, Severity};
use canopen::master::{BootError, ConfigWrite, Expect, LostReason, Step, Ticket};
use canopen::pdo::{self, Reading};
use canopen::wire::{Emergency, Service};
use canopen::{Master, NodeConfig, Payload, sdo};
use messages::lowlevel::{CmdNodeIo, DataNodeIo, NodeValue};
use module::Actions;

/// Longest period of `LL_DATA_NODE_IO`.
const PUBLISH_PERIOD: Duration = Duration::from_millis(100);
/// `LL_DATA_NODE_IO` follows a change at most this often.
const CHANGE_PAUSE: Duration = Duration::from_millis(10);
/// `driver_io` orders outputs every 200 ms; after this time without it they get their safe values.
const ORDER_TTL: Duration = Duration::from_secs(1);
/// Time without the master's heartbeat after which a device sets its outputs by itself (0x1016).
const MASTER_LIMIT: Duration = Duration::from_millis(500);
/// What a device refused is tried again after this time.
const RETRY: Duration = Duration::from_secs(1);
/// Emergency messages of a device are reported at most this often.
const EMERGENCY_PAUSE: Duration = Duration::from_secs(1);
/// Requests in a row without an answer after which a device is reported.
const UNANSWERED_MAX: u8 = 2;
/// TPDOs with an identifier of the pre-defined connection set.
const TPDOS: usize = 4;
/// Communication record of the first TPDO.
const TPDO_COMMUNICATION: u16 = 0x1800;
/// Bit of an identifier that forbids remote frames.
const NO_RTR: u32 = 1 << 30;
/// Reads without an answer after which a TPDO is given up, until the device starts again.
const MAPPING_UNANSWERED_MAX: u8 = 3;

/// A signal.
#[derive(Debug)]
struct Value {
    name: String,
    place: ObjectPlace,
    /// Place among the inputs that stop the robot.
    stop: Option<usize>,
    /// Value while nobody commands another, of an output.
    safe: Option<f64>,
    order: Option<f64>,
    value: f64,
    /// When it was read or confirmed; absent while it is unknown.
    at: Option<Instant>,
}

impl Value {
    /// Number that an output is to have.
    fn bits(&self) -> u32 {
        self.order.or(self.safe).and_then(|value| self.place.bits(value)).unwrap_or_default()
    }
}

/// An object of a device, with the signals in it.
#[derive(Debug)]
struct Object {
    index: u16,
    sub: u8,
    len: usize,
    output: bool,
    /// Indices in the device's list.
    values: Vec<usize>,
    due: Instant,
    /// When it was asked or written last.
    tried: Instant,
    /// Number that the device confirmed.
    written: Option<u32>,
    refused: bool,
}

/// An object of ours in a TPDO.
#[derive(Clone, Copy, Debug)]
struct Mapped {
    object: usize,
    /// First byte, and number of bytes.
    first: usize,
    len: usize,
}

/// A TPDO as the device has mapped it.
#[derive(Clone, Debug, Default)]
struct Map {
    /// Bytes; 0: it is not known, or empty.
    len: usize,
    objects: Vec<Mapped>,
}

/// The mapping that is being read.
#[derive(Clone, Debug)]
struct Learning {
    /// The TPDO, from 0.
    tpdo: usize,
    reading: Reading,
    /// Reads without an answer.
    unanswered: u8,
    /// Nothing of it is read before.
    due: Instant,
}

impl Learning {
    /// `None`: there is no such TPDO.
    fn of(tpdo: usize) -> Option<Self> {
        let reading = pdo::read_plan(TPDO_COMMUNICATION + tpdo as u16);
        (tpdo < TPDOS).then_some(Self { tpdo, reading, unanswered: 0, due: Instant::ZERO })
    }
}

/// What is asked.
#[derive(Clone, Copy, Debug)]
enum Asked {
    Read(usize),
    Write(usize, u32),
    /// The next object of [`Learning`].
    Mapping,
}

/// A device.
#[derive(Debug)]
struct Device {
    name: String,
    /// Number of its CAN bus.
    bus: usize,
    keys: CanopenKeys,
    values: Vec<Value>,
    objects: Vec<Object>,
    booted: bool,
    asked: Option<(Ticket, Instant, Asked)>,
    maps: [Map; TPDOS],
    learning: Option<Learning>,
    /// The mapping was asked last: it takes turns with the values.
    learned: bool,
    /// Nothing is asked before: the master's queue was full.
    gate: Instant,
    unanswered: u8,
    lost: bool,
    /// TPDOs of another length than their mapping.
    misfits: u32,
    /// Emergency messages since the last report, and when the next one may be.
    emergencies: u32,
    report: Instant,
}

/// All devices.
#[derive(Debug)]
pub(super) struct Devices {
    all: Vec<Device>,
    ordered: Instant,
    publish: Instant,
    published: Instant,
    shown: Vec<f64>,
    ends: bool,
}

/// Signals of devices that stop the robot are read by this driver itself.
pub(super) fn has_signal(devices: &[Canopen], name: &str) -> bool {
    devices.iter().any(|device| device.keys.signals.iter().any(|keys| keys.name == name))
}

impl Devices {
    /// `bus_of`: number of the bus of this name.
    pub(super) fn new(devices: &[Canopen], stop: &Stop, bus_of: impl Fn(Option<&str>) -> usize) -> Self {
        let device = |device: &Canopen| Device::new(device, stop, bus_of(device.keys.bus.as_deref()));
        Self {
            all: devices.iter().map(device).collect(),
            ordered: Instant::ZERO,
            publish: Instant::ZERO,
            published: Instant::ZERO,
            shown: Vec::new(),
            ends: false,
        }
    }

    /// Configurations of the nodes on a bus.
    pub(super) fn node_configs(&self, bus: usize) -> impl Iterator<Item = NodeConfig> + '_ {
        self.all.iter().filter(move |device| device.bus == bus).map(Device::node_config)
    }

    /// Name and node of each.
    pub(super) fn nodes(&self) -> impl Iterator<Item = (&str, NodeAt)> {
        self.all.iter().map(|device| (device.name.as_str(), device.at()))
    }

    /// Name of the device with this node.
    pub(super) fn name(&self, node: NodeAt) -> Option<&str> {
        self.nodes().find(|(_, own)| *own == node).map(|(name, _)| name)
    }

    fn of_mut(&mut self, node: NodeAt) -> Option<&mut Device> {
        self.all.iter_mut().find(|device| device.at() == node)
    }

    pub(super) fn on_booted(&mut self, now: Instant, node: NodeAt, out: &mut Actions) {
        if let Some(device) = self.of_mut(node) {
            device.on_booted(now, out);
        }
    }

    pub(super) fn on_boot_failed(
        &mut self,
        node: NodeAt,
        step: Step,
        reason: BootError,
        line: &mut PauseLine,
        out: &mut Actions,
    ) {
        if let Some(device) = self.of_mut(node) {
            let message = format!("{} (node {}) does not start, {step}: {reason}; retrying", device.name, node.id);
            device.on_lost(message, line, out);
        }
    }

    pub(super) fn on_lost(&mut self, node: NodeAt, reason: LostReason, line: &mut PauseLine, out: &mut Actions) {
        if let Some(device) = self.of_mut(node) {
            let message = format!("{} (node {}) is lost: {reason}; its values are unknown", device.name, node.id);
            device.on_lost(message, line, out);
        }
    }

    pub(super) fn on_emergency(
        &mut self,
        now: Instant,
        node: NodeAt,
        emergency: &Emergency,
        suppressed: u32,
        out: &mut Actions,
    ) {
        let Some(device) = self.of_mut(node) else { return };
        device.emergencies = device.emergencies.saturating_add(1).saturating_add(suppressed);
        if device.report <= now {
            device.report = now + EMERGENCY_PAUSE;
            let (code, count) = (emergency.code, std::mem::take(&mut device.emergencies));
            let text = format!("{}: emergency 0x{code:04X}, {count} since the last report", device.name);
            out.say(Level::Warning, text);
        }
    }

    /// A TPDO that was received now.
    pub(super) fn on_pdo(
        &mut self,
        now: Instant,
        (node, number): (NodeAt, u8),
        data: &[u8],
        line: &mut PauseLine,
        out: &mut Actions,
    ) {
        if let Some(device) = self.of_mut(node).filter(|device| device.booted) {
            device.on_pdo(now, number, data, line, out);
        }
    }

    /// A transfer has ended; false if it is not one of these.
    pub(super) fn on_sdo(
        &mut self,
        now: Instant,
        ticket: Ticket,
        result: Result<&[u8], sdo::Error>,
        line: &mut PauseLine,
        out: &mut Actions,
    ) -> bool {
        for device in &mut self.all {
            if let Some((_, at, asked)) = device.asked.take_if(|(own, ..)| *own == ticket) {
                device.on_answer(now, at, asked, result, line, out);
                return true;
            }
        }
        false
    }

    /// What all outputs are to have, received at `at`. One that is missing, or is to have what it does not take, gets
    /// its safe value: any program that may command can send this message.
    pub(super) fn on_order(&mut self, at: Instant, order: &CmdNodeIo) {
        self.ordered = at;
        for device in &mut self.all {
            for (value, keys) in device.values.iter_mut().zip(&device.keys.signals) {
                let own = order.outputs.iter().find(|output| output.name == value.name);
                value.order = own.map(|output| output.target).filter(|target| keys.takes(*target));
            }
        }
    }

    /// The module ends: outputs get their safe values.
    pub(super) fn end(&mut self) {
        self.ends = true;
        self.release();
    }

    fn release(&mut self) {
        self.all.iter_mut().flat_map(|device| &mut device.values).for_each(|value| value.order = None);
    }

    /// True if all outputs of devices that answer have been confirmed as they are to be.
    pub(super) fn are_settled(&self) -> bool {
        let settled = |device: &Device| {
            !device.booted
                || device.objects.iter().all(|object| object.refused || !object.output || !device.has_changed(object))
        };
        self.all.iter().all(settled)
    }

    /// Asks and writes what is due on a bus; `alone`: there is no other master.
    pub(super) fn advance(&mut self, now: Instant, (bus, alone): (usize, bool), master: &mut Master) {
        if self.ends || now.since(self.ordered) >= ORDER_TTL {
            self.release();
        }
        for device in self.all.iter_mut().filter(|device| device.bus == bus) {
            if alone {
                device.ask(now, master);
            } else {
                device.unlearn();
            }
        }
    }

    /// Publishes the values in their period, and when they change.
    pub(super) fn publish(&mut self, now: Instant, out: &mut Actions) {
        if self.all.is_empty() {
            return;
        }
        let shown = |device: &Device, value: &Value| {
            let known = value.at.is_some_and(|at| now.since(at) <= device.keys.age_max);
            if known { value.value } else { f64::NAN }
        };
        let values = || self.all.iter().flat_map(|device| device.values.iter().map(move |value| (device, value)));
        let now_shown: Vec<f64> = values().map(|(device, value)| shown(device, value)).collect();
        let same = now_shown.iter().map(|value| value.to_bits()).eq(self.shown.iter().map(|value| value.to_bits()));
        if !same {
            self.publish = self.publish.min(self.published + CHANGE_PAUSE);
        }
        if now < self.publish {
            return;
        }
        let names = values().map(|(_, value)| value.name.clone());
        let values = names.zip(&now_shown).map(|(name, value)| NodeValue { name, value: *value }).collect();
        out.publish(DataNodeIo { timestamp: out.timestamp(now), values });
        (self.published, self.publish, self.shown) = (now, now + PUBLISH_PERIOD, now_shown);
    }

    /// `alone`: there is no other master on the bus of this number, which is up.
    pub(super) fn poll_timeout(&self, alone: impl Fn(usize) -> bool) -> Option<Instant> {
        let due = self.all.iter().filter(|device| alone(device.bus)).filter_map(Device::poll_timeout);
        due.chain((!self.all.is_empty()).then_some(self.publish)).min()
    }
}

impl Device {
    fn new(config: &Canopen, stop: &Stop, bus: usize) -> Self {
        let keys = config.keys.clone();
        let value = |keys: &ObjectKeys| Value {
            name: keys.name.clone(),
            place: keys.place(),
            stop: stop.inputs.iter().position(|input| input.signal.as_ref() == Some(&keys.name)),
            safe: keys.is_output().then(|| keys.limits.safe.unwrap_or_default()),
            order: None,
            value: f64::NAN,
            at: None,
        };
        let values: Vec<Value> = keys.signals.iter().map(value).collect();
        let mut objects: Vec<Object> = Vec::new();
        for (n, value) in values.iter().enumerate() {
            let ObjectPlace { index, sub, format, .. } = value.place;
            let output = value.safe.is_some();
            let same = |object: &&mut Object| (object.index, object.sub, object.output) == (index, sub, output);
            match objects.iter_mut().find(same) {
                Some(object) => object.values.push(n),
                None => objects.push(Object {
                    index,
                    sub,
                    len: format.size(),
                    output,
                    values: vec![n],
                    due: Instant::ZERO,
                    tried: Instant::ZERO,
                    written: None,
                    refused: false,
                }),
            }
        }
        Self {
            name: config.name.clone(),
            bus,
            keys,
            values,
            objects,
            booted: false,
            asked: None,
            maps: Default::default(),
            learning: None,
            learned: false,
            gate: Instant::ZERO,
            unanswered: 0,
            lost: false,
            misfits: 0,
            emergencies: 0,
            report: Instant::ZERO,
        }
    }

    fn at(&self) -> NodeAt {
        NodeAt { bus: self.bus, id: self.keys.node }
    }

    fn node_config(&self) -> NodeConfig {
        let CanopenKeys { node, profile, vendor, product, pdo, .. } = self.keys;
        let profile = (profile != 0).then(|| Expect::masked(0x1000, 0, 0xFFFF, profile.into()));
        let vendor = vendor.map(|vendor| Expect::equal(0x1018, 1, vendor));
        let product = product.map(|product| Expect::equal(0x1018, 2, product));
        let by_profile = |kind| self.keys.signals.iter().any(|keys| keys.kind == kind);
        let mut writes = Vec::new();
        if pdo && by_profile(ObjectKind::AnalogueIn) {
            // Without the global interrupt enable no TPDO follows an analogue input (CiA 401).
            writes.push(ConfigWrite::new(0x6423, 0, 1_u8).where_there());
        }
        let sets = self.keys.sets_error_values();
        for object in self.objects.iter().filter(|object| sets && object.output) {
            match object.index {
                0x6200 => {
                    let safe = |n: &usize| self.values[*n].place.bits(self.values[*n].safe?);
                    let bits = object.values.iter().filter_map(safe).fold(0, |all, bits| all | bits);
                    writes.push(ConfigWrite::new(0x6206, object.sub, 0xFF_u8));
                    writes.push(ConfigWrite::new(0x6207, object.sub, bits as u8));
                }
                0x6411 => {
                    writes.push(ConfigWrite::new(0x6443, object.sub, 1_u8));
                    writes.push(ConfigWrite::new(0x6444, object.sub, 0_i32));
                }
                _ => {}
            }
        }
        NodeConfig {
            mandatory: false,
            identity: [profile, vendor, product].into_iter().flatten().collect(),
            writes,
            master_limit: sets.then_some(MASTER_LIMIT),
            heartbeat: self.keys.heartbeat,
            heartbeat_limit: self.keys.heartbeat_limit,
            ..NodeConfig::new(node, &self.name)
        }
    }

    fn on_booted(&mut self, now: Instant, out: &mut Actions) {
        self.booted = true;
        self.forget();
        self.objects.iter_mut().for_each(|object| object.due = now);
        self.is_there(out);
    }

    fn on_lost(&mut self, message: String, line: &mut PauseLine, out: &mut Actions) {
        self.booted = false;
        self.forget();
        self.values.iter().filter_map(|value| value.stop).for_each(|stop| line.on_input_lost(stop));
        self.lost = true;
        out.raise(Severity::Error, Fault::IoDeviceLost, self.name.as_str(), message);
    }

    /// It may be another device, or was switched off: nothing is known of it.
    fn forget(&mut self) {
        (self.asked, self.unanswered) = (None, 0);
        self.unlearn();
        self.values.iter_mut().for_each(|value| value.at = None);
        self.objects.iter_mut().for_each(|object| object.written = None);
    }

    /// Its TPDOs may be mapped in another way, as by another master: none is taken before its mapping is read.
    fn unlearn(&mut self) {
        self.maps = Default::default();
        self.learning = Learning::of(0).filter(|_| self.keys.pdo);
        // An answer that is on its way is of the mapping that was read before.
        self.asked.take_if(|(.., asked)| matches!(asked, Asked::Mapping));
    }

    fn is_there(&mut self, out: &mut Actions) {
        self.unanswered = 0;
        if std::mem::take(&mut self.lost) {
            out.clear(Fault::IoDeviceLost, self.name.as_str(), format!("{} answers", self.name));
        }
    }

    fn has_changed(&self, object: &Object) -> bool {
        object.written != Some(self.target(object))
    }

    fn target(&self, object: &Object) -> u32 {
        object.values.iter().fold(0, |all, n| all | self.values[*n].bits())
    }

    /// When an object is to be asked or written. An output that changes again and again takes turns with the others.
    fn due(&self, object: &Object) -> Instant {
        let urgent = object.output && !object.refused && self.has_changed(object);
        if urgent { object.tried } else { object.due }
    }

    fn ask(&mut self, now: Instant, master: &mut Master) {
        if !self.booted || self.asked.is_some() || now < self.gate {
            return;
        }
        let next = self.objects.iter().enumerate().map(|(n, object)| (self.due(object), n)).min();
        let next = next.filter(|(due, _)| *due <= now).map(|(_, n)| n);
        let learning =
            self.learning.as_ref().filter(|learning| learning.due <= now && (next.is_none() || !self.learned));
        let mapping = learning.and_then(|learning| learning.reading.object());
        self.learned = mapping.is_some();
        let node = self.keys.node;
        let asked = match (mapping, next) {
            (Some((index, sub)), _) => master.sdo_read(now, node, index, sub).map(|ticket| (ticket, Asked::Mapping)),
            (None, Some(n)) => {
                let object = &self.objects[n];
                let (bits, period) =
                    (self.target(object), if object.output { self.keys.refresh } else { self.keys.period });
                let object = &mut self.objects[n];
                (object.due, object.tried) = (object.due.next_on_grid(now, period), now);
                if object.output {
                    let data = Payload::from(&bits.to_le_bytes()[..object.len]);
                    let asked = master.sdo_write(now, node, object.index, object.sub, data);
                    asked.map(|ticket| (ticket, Asked::Write(n, bits)))
                } else {
                    master.sdo_read(now, node, object.index, object.sub).map(|ticket| (ticket, Asked::Read(n)))
                }
            }
            (None, None) => return,
        };
        if asked.is_err() {
            self.gate = now + self.keys.period;
        }
        self.asked = asked.ok().map(|(ticket, asked)| (ticket, now, asked));
    }

    fn poll_timeout(&self) -> Option<Instant> {
        if !self.booted || self.asked.is_some() {
            return None;
        }
        let due = self.objects.iter().map(|object| self.due(object));
        due.chain(self.learning.as_ref().map(|learning| learning.due)).min().map(|due| due.max(self.gate))
    }

    /// The answer to what was asked at `at`.
    fn on_answer(
        &mut self,
        now: Instant,
        at: Instant,
        asked: Asked,
        result: Result<&[u8], sdo::Error>,
        line: &mut PauseLine,
        out: &mut Actions,
    ) {
        match result {
            Ok(_) | Err(sdo::Error::Refused(_) | sdo::Error::Protocol(_)) => self.is_there(out),
            // Its loss is reported.
            Err(sdo::Error::Cancelled) => {}
            Err(error @ sdo::Error::Timeout) => {
                self.unanswered = self.unanswered.saturating_add(1);
                if self.unanswered == UNANSWERED_MAX {
                    self.lost = true;
                    let message = format!("{} (node {}): {error}", self.name, self.keys.node);
                    out.raise(Severity::Error, Fault::IoDeviceLost, self.name.as_str(), message);
                }
            }
        }
        match (asked, result) {
            (Asked::Mapping, Ok(data)) => self.on_mapping(Some(data)),
            (Asked::Mapping, Err(sdo::Error::Refused(_))) => self.on_mapping(None),
            (Asked::Mapping, Err(_)) => self.on_mapping_unanswered(now, out),
            (Asked::Read(n), Ok(data)) => {
                let fits = self.take(at, n, data, line);
                self.judge(now, n, if fits { None } else { Some("an answer of another length or value".into()) }, out);
            }
            (Asked::Write(n, bits), Ok(_)) => {
                self.objects[n].written = Some(bits);
                for value in self.objects[n].values.clone() {
                    let value = &mut self.values[value];
                    let confirmed = value.place.value(&bits.to_le_bytes()[..value.place.format.size()]);
                    (value.value, value.at) = (confirmed.unwrap_or(f64::NAN), Some(at));
                }
                self.judge(now, n, None, out);
            }
            (Asked::Read(n) | Asked::Write(n, _), Err(error @ (sdo::Error::Refused(_) | sdo::Error::Protocol(_)))) => {
                self.judge(now, n, Some(error.to_string()), out);
            }
            (Asked::Write(n, _), Err(_)) => self.objects[n].written = None,
            (Asked::Read(_), Err(_)) => {}
        }
    }

    /// Reports that a device refuses an object, or that it does not any more.
    fn judge(&mut self, now: Instant, n: usize, wrong: Option<String>, out: &mut Actions) {
        let Object { index, sub, .. } = self.objects[n];
        let subject = format!("{} 0x{index:04X}:{sub}", self.name);
        let object = &mut self.objects[n];
        let refused = std::mem::replace(&mut object.refused, wrong.is_some());
        match wrong {
            Some(why) => {
                (object.due, object.written) = (now + RETRY, None);
                let message = format!("{subject}: {why}; tried once a second");
                out.raise(Severity::Error, Fault::IoDeviceRefused, subject, message);
            }
            None if refused => out.clear(Fault::IoDeviceRefused, subject.as_str(), format!("{subject}: accepted")),
            None => {}
        }
    }

    /// Takes the bytes of an input, which are not older than `at`; false if they are not its type's.
    fn take(&mut self, at: Instant, object: usize, bytes: &[u8], line: &mut PauseLine) -> bool {
        let mut fits = true;
        for n in &self.objects[object].values {
            let value = &mut self.values[*n];
            let Some(known) = value.place.value(bytes) else {
                fits = false;
                value.at = None;
                continue;
            };
            // An answer may be older than a TPDO that came meanwhile. One by which an input of a stop is open counts.
            let opens = value.stop.is_some() && known != 1.0;
            if !opens && value.at.is_some_and(|newest| at < newest) {
                continue;
            }
            (value.value, value.at) = (known, Some(at));
            if let Some(stop) = value.stop {
                line.on_input(at, stop, known != 1.0);
            }
        }
        fits
    }

    /// An object of a TPDO; `None`: the device has not got it.
    fn on_mapping(&mut self, data: Option<&[u8]>) {
        let Some(Learning { tpdo, reading, .. }) = &mut self.learning else { return };
        let tpdo = *tpdo;
        reading.found(data);
        let service = Service::Tpdo { node: self.keys.node, number: tpdo as u8 + 1 };
        let is_own = reading.cob_id() & !NO_RTR == u32::from(service.cob_id());
        if is_own && reading.object().is_some() {
            return;
        }
        let read = self.learning.take().filter(|_| is_own).and_then(|learning| learning.reading.finish());
        if let Some(layout) = read.and_then(|pdo| pdo.layout().ok()) {
            let place = |item: &pdo::Item| {
                let pdo::Mapped { index, sub, bits } = item.mapped;
                let own = |object: &Object| (object.index, object.sub, object.output) == (index, sub, false);
                let object = self
                    .objects
                    .iter()
                    .position(own)
                    .filter(|_| item.offset.is_multiple_of(8) && bits.is_multiple_of(8))?;
                Some(Mapped { object, first: usize::from(item.offset / 8), len: usize::from(bits / 8) })
            };
            let objects = layout.items().iter().filter_map(place).collect();
            self.maps[tpdo] = Map { len: layout.len(), objects };
        }
        self.learning = Learning::of(tpdo + 1);
    }

    /// An object of a TPDO was asked in vain: it is asked again, or the TPDO is given up.
    fn on_mapping_unanswered(&mut self, now: Instant, out: &mut Actions) {
        let Some(learning) = &mut self.learning else { return };
        learning.unanswered += 1;
        learning.due = now + RETRY;
        if learning.unanswered >= MAPPING_UNANSWERED_MAX {
            let (name, number) = (&self.name, learning.tpdo + 1);
            let text = format!("{name}: no answer about the mapping of TPDO {number}: not used until the next start");
            out.say(Level::Warning, text);
            self.learning = Learning::of(learning.tpdo + 1);
        }
    }

    fn on_pdo(&mut self, now: Instant, number: u8, data: &[u8], line: &mut PauseLine, out: &mut Actions) {
        let Some(map) = usize::from(number).checked_sub(1).and_then(|n| self.maps.get(n)).cloned() else { return };
        if map.len == 0 || map.objects.is_empty() {
            return;
        }
        if map.len != data.len() {
            self.misfits = self.misfits.saturating_add(1);
            // Reported at 1, 2, 4, 8 and so on.
            if self.misfits.is_power_of_two() {
                let (got, len, count) = (data.len(), map.len, self.misfits);
                let name = &self.name;
                let text = format!("{name}: TPDO {number} has {got} bytes, its mapping {len}: dropped, {count} so far");
                out.report(Severity::Warning, Fault::CanMalformed, name.as_str(), text);
            }
            return;
        }
        for Mapped { object, first, len } in map.objects {
            if let Some(bytes) = data.get(first..first + len) {
                self.take(now, object, bytes, line);
            }
        }
    }
}
