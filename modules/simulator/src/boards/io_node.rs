//! CANopen device with inputs and outputs, as an I/O module (CiA 401) or a battery is on the wire: boot-up, identity,
//! heartbeats, TPDOs, SDO.
//!
//! Power-up  inputs have the values that they are given, outputs are 0; digital inputs are in TPDO 1, other inputs in
//!           TPDO 2, both event driven, those of 0x6401 only with the global interrupt enable (0x6423)
//! Silence   of the master: outputs whose error mode (0x6206, 0x6443) is set get their error value (0x6207, 0x6444)

use crate::faults::InjectedFault;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Entry};
use canopen::{Dictionary, NmtState, Node, NodeEvent};

/// From power or reset to the boot-up message.
const BOOT_TIME: Duration = Duration::from_millis(100);
/// Bytes of a PDO.
const PDO_LEN: usize = 8;

/// An object with inputs or outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectConfig {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Bytes: 1, 2 or 4.
    pub len: usize,
    /// Number of an input, of an output the one at the start.
    pub value: u32,
    /// It is written.
    pub output: bool,
}

/// A device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoNodeConfig {
    /// Name, the target of faults: `canopen.plc`.
    pub name: String,
    /// Node id.
    pub node: u8,
    /// Low 16 bits of 0x1000.
    pub profile: u16,
    /// 0x1018:1.
    pub vendor: u32,
    /// 0x1018:2.
    pub product: u32,
    /// Its objects.
    pub objects: Vec<ObjectConfig>,
}

/// The device.
pub(crate) struct IoNode {
    pub config: IoNodeConfig,
    /// Number of its CAN bus: set by what makes it.
    pub bus: usize,
    node: Node,
    /// It neither receives nor sends until this instant.
    silent_until: Instant,
    /// Its TPDOs and answers have a wrong length until this instant.
    misfit_until: Instant,
    /// A digital input that is open, and until when.
    opened: Option<(u8, Instant)>,
    /// It is another product.
    other: bool,
}

impl IoNode {
    pub fn new(config: IoNodeConfig, now: Instant) -> Self {
        let node = powered(&config, false, now);
        let (silent_until, misfit_until) = (Instant::ZERO, Instant::ZERO);
        Self { config, bus: 0, node, silent_until, misfit_until, opened: None, other: false }
    }

    /// Injects a fault until an instant; false if it does not have this fault.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Silent => self.silent_until = until,
            InjectedFault::BadLength => self.misfit_until = until,
            InjectedFault::Reboot => self.restart(now),
            InjectedFault::Layout => {
                self.other = true;
                self.restart(now);
            }
            InjectedFault::Opened(bit) => {
                if self.digital_input(bit).is_none() {
                    return false;
                }
                self.open(None);
                self.opened = Some((bit, until));
                self.open(Some(bit));
                self.node.handle_timeout(now);
            }
            InjectedFault::None => {
                (self.silent_until, self.misfit_until) = (now, now);
                self.close(now);
                if std::mem::take(&mut self.other) {
                    self.restart(now);
                }
            }
            _ => return false,
        }
        true
    }

    fn restart(&mut self, now: Instant) {
        self.node = powered(&self.config, self.other, now);
        self.open(self.opened.map(|(bit, _)| bit));
    }

    /// The object with this digital input, from 0.
    fn digital_input(&self, bit: u8) -> Option<ObjectConfig> {
        let sub = bit / 8 + 1;
        self.config.objects.iter().copied().find(|object| (object.index, object.sub) == (0x6000, sub))
    }

    /// Opens a digital input, or closes the one that is open.
    fn open(&mut self, bit: Option<u8>) {
        let Some(object) = bit.or(self.opened.map(|(bit, _)| bit)).and_then(|bit| self.digital_input(bit)) else {
            return;
        };
        let mask = bit.map_or(0, |bit| 1 << (bit % 8));
        self.node.set(object.index, object.sub, i64::from(object.value & !mask));
    }

    fn close(&mut self, now: Instant) {
        if self.opened.is_some() {
            self.open(None);
            self.opened = None;
            self.node.handle_timeout(now);
        }
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        if self.silent_until <= now {
            self.node.handle_rx(now, frame);
            self.react();
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        if self.opened.is_some_and(|(_, until)| until <= now) {
            self.close(now);
        }
        self.node.handle_timeout(now);
        self.react();
    }

    /// Outputs of which that is set get their error values when the master is lost.
    fn react(&mut self) {
        while let Some(event) = self.node.poll_event() {
            let lost = matches!(event, NodeEvent::HeartbeatLost { .. } | NodeEvent::NmtState(NmtState::Stopped));
            for object in self.config.objects.iter().filter(|object| lost && object.output) {
                let (index, sub) = (object.index, object.sub);
                let get = |index| self.node.get(index, sub).unwrap_or_default();
                let value = match index {
                    0x6200 => get(index) & !get(0x6206) | get(0x6207) & get(0x6206),
                    0x6411 if get(0x6443) == 1 => get(0x6444),
                    _ => continue,
                };
                self.node.set(index, sub, value);
            }
        }
    }

    /// Next frame to send.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Frame> {
        while let Some(frame) = self.node.poll_tx() {
            if self.silent_until <= now {
                return Some(if now < self.misfit_until { misfit(&frame) } else { frame });
            }
        }
        None
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let closes = self.opened.map(|(_, until)| until).filter(|until| *until != Instant::NEVER);
        closes.into_iter().chain(self.node.poll_timeout()).min()
    }
}

/// A device that was just switched on.
fn powered(config: &IoNodeConfig, other: bool, now: Instant) -> Node {
    let mut node = Node::new(dictionary(config, other), BOOT_TIME).without_block();
    node.power_on(now);
    node
}

/// The frame with another length: a TPDO without its last byte, an answer with a number of another size.
fn misfit(frame: &Frame) -> Frame {
    let Id::Standard(id) = frame.id() else { return *frame };
    let data = frame.data();
    match (id & 0x780, data) {
        (0x180 | 0x280 | 0x380 | 0x480, [data @ .., _]) => Frame::standard(id, data),
        (0x580, [command @ (0x43 | 0x4B | 0x4F), rest @ ..]) => {
            let other = if *command == 0x43 { 0x4F } else { 0x43 };
            let mut data = vec![other];
            data.extend_from_slice(rest);
            Frame::standard(id, &data)
        }
        _ => *frame,
    }
}

fn dictionary(config: &IoNodeConfig, other: bool) -> Dictionary {
    let IoNodeConfig { node, profile, vendor, product, ref objects, .. } = *config;
    let number = |index, sub, data_type, value| Entry::new(index, sub, data_type, Access::ReadWrite, value);
    let fixed = |index, sub, data_type, value| Entry::new(index, sub, data_type, Access::ReadOnly, value);
    let mut entries = vec![
        fixed(0x1000, 0, DataType::U32, profile.into()),
        fixed(0x1001, 0, DataType::U8, 0),
        fixed(0x1016, 0, DataType::U8, 1),
        number(0x1016, 1, DataType::U32, 0),
        number(0x1017, 0, DataType::U16, 0),
        fixed(0x1018, 0, DataType::U8, 4),
        fixed(0x1018, 1, DataType::U32, vendor.into()),
        fixed(0x1018, 2, DataType::U32, i64::from(product) + i64::from(other)),
        fixed(0x1018, 3, DataType::U32, 1),
        fixed(0x1018, 4, DataType::U32, 1),
        number(0x1029, 1, DataType::U8, 0),
    ];
    for object in objects {
        let ObjectConfig { index, sub, len, value, output } = *object;
        let data_type = match len {
            1 => DataType::U8,
            2 => DataType::U16,
            _ => DataType::U32,
        };
        let access = if output { Access::ReadWrite } else { Access::ReadOnly };
        entries.push(Entry::new(index, sub, data_type, access, value.into()).mappable());
        match index {
            0x6200 => entries.extend([number(0x6206, sub, DataType::U8, 0xFF), number(0x6207, sub, DataType::U8, 0)]),
            0x6411 => entries.extend([number(0x6443, sub, DataType::U8, 1), number(0x6444, sub, DataType::I32, 0)]),
            _ => {}
        }
    }
    if objects.iter().any(|object| object.index == 0x6401) {
        entries.push(number(0x6423, 0, DataType::Bool, 0));
    }
    let mapped = |digital: bool| {
        let own = objects.iter().filter(|object| !object.output && (object.index == 0x6000) == digital);
        let mut len = 0;
        let fits = own.take_while(|object| {
            len += object.len;
            len <= PDO_LEN
        });
        let entry = |object: &ObjectConfig| {
            u32::from(object.index) << 16 | u32::from(object.sub) << 8 | (8 * object.len as u32)
        };
        fits.map(entry).collect::<Vec<u32>>()
    };
    let dictionary = Dictionary::new(node).with(&entries);
    dictionary.with_tpdo(1, 0x180, &mapped(true), false).with_tpdo(2, 0x280, &mapped(false), false)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODE: u8 = 5;

    fn object(index: u16, len: usize, value: u32, output: bool) -> ObjectConfig {
        ObjectConfig { index, sub: 1, len, value, output }
    }

    fn device() -> IoNode {
        let objects = vec![object(0x6000, 1, 0x0F, false), object(0x6200, 1, 0, true), object(0x6401, 2, 500, false)];
        let (name, vendor, product) = ("canopen.plc".into(), 1, 2);
        IoNode::new(IoNodeConfig { name, node: NODE, profile: 401, vendor, product, objects }, Instant::ZERO)
    }

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn sent(device: &mut IoNode, now: Instant) -> Vec<(Id, Vec<u8>)> {
        device.handle_timeout(now);
        std::iter::from_fn(|| device.poll_tx(now)).map(|frame| (frame.id(), frame.data().to_vec())).collect()
    }

    fn write(device: &mut IoNode, index: u16, sub: u8, command: u8, value: u32) {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        device.handle_rx(at(200), &Frame::standard(0x600 + u16::from(NODE), &[command, low, high, sub, a, b, c, d]));
    }

    fn started() -> IoNode {
        let mut device = device();
        assert_eq!(sent(&mut device, at(100)), [(Id::Standard(0x705), vec![0])], "its boot-up message");
        device.handle_rx(at(150), &Frame::standard(0, &[1, NODE]));
        device
    }

    #[test]
    fn an_input_that_opens_is_sent_at_once_and_has_its_length_unless_it_lies() {
        let mut device = started();
        assert!(sent(&mut device, at(150)).contains(&(Id::Standard(0x185), vec![0x0F])));
        assert!(device.inject(at(160), InjectedFault::Opened(3), Instant::NEVER));
        assert!(!device.inject(at(160), InjectedFault::Opened(9), Instant::NEVER), "it has eight");
        assert_eq!(sent(&mut device, at(160)), [(Id::Standard(0x185), vec![0x07])]);
        assert!(device.inject(at(170), InjectedFault::BadLength, Instant::NEVER));
        device.handle_rx(at(180), &Frame::standard(0x605, &[0x40, 0x00, 0x60, 1, 0, 0, 0, 0]));
        assert_eq!(sent(&mut device, at(180)), [(Id::Standard(0x585), vec![0x43, 0x00, 0x60, 1, 7, 0, 0, 0])]);
        assert!(device.inject(at(190), InjectedFault::None, at(190)));
        assert_eq!(sent(&mut device, at(190)), [(Id::Standard(0x185), vec![0x0F])]);
    }

    #[test]
    fn an_output_gets_its_error_value_when_the_master_is_lost() {
        let mut device = started();
        write(&mut device, 0x1016, 1, 0x23, 127 << 16 | 300);
        write(&mut device, 0x6206, 1, 0x2F, 0x03);
        write(&mut device, 0x6207, 1, 0x2F, 0x02);
        write(&mut device, 0x6200, 1, 0x2F, 0x05);
        device.handle_rx(at(210), &Frame::standard(0x77F, &[5]));
        sent(&mut device, at(500));
        assert_eq!(device.node.get(0x6200, 1), Some(0x05));
        sent(&mut device, at(520));
        assert_eq!(device.node.get(0x6200, 1), Some(0x06), "bits 0 and 1 by their mode, the others as they were");
    }
}
