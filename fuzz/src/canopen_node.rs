//! CANopen node with LSS, driven by frames and calls.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Dictionary, Entry};
use canopen::lss::{Address, BitRate, Command, Event, Master, Mode, Range, Timing};
use canopen::{NmtCommand, Node, wire};

const SERIALS: [u32; 4] = [0x10, 0x11, 0x8000_0010, 0x7FFF_FFEF];

fn node(serial: u32, id: Option<u8>) -> Node {
    use Access::{ReadOnly, ReadWrite};
    use DataType::{Bool, I32, U8, U16, U32};
    let number = |index, sub, data_type, value| Entry::new(index, sub, data_type, ReadWrite, value);
    let objects = Dictionary::new(3)
        .with(&[
            number(0x1001, 0, U8, 0).mappable(),
            number(0x1003, 0, U8, 0),
            Entry::new(0x1003, 1, U32, ReadOnly, 0),
            number(0x1005, 0, U32, 0x80),
            number(0x1006, 0, U32, 0),
            number(0x100C, 0, U16, 0),
            number(0x100D, 0, U8, 0),
            number(0x1010, 1, U32, 1),
            number(0x1011, 1, U32, 1),
            number(0x1012, 0, U32, 0x8000_0100),
            number(0x1014, 0, U32, 0x80).plus_node_id(),
            number(0x1015, 0, U16, 0),
            number(0x1016, 1, U32, 0),
            number(0x1017, 0, U16, 0),
            Entry::new(0x1018, 4, U32, ReadOnly, serial.into()),
            number(0x1019, 0, U8, 0),
            number(0x1020, 1, U32, 0),
            number(0x1029, 1, U8, 0),
            number(0x1F80, 0, U32, 4),
            number(0x2000, 0, I32, 0).mappable(),
            number(0x2001, 0, Bool, 0).mappable(),
        ])
        .with_rpdo(1, 0x200, &[0x2000_0020, 0x2001_0001], true)
        .with_rpdo(2, 0x300, &[0x2001_0008], true)
        .with_tpdo(1, 0x180, &[0x2000_0020, 0x2001_0001], true)
        .with_tpdo(2, 0x280, &[0x1001_0008], true)
        .with(&[number(0x1800, 6, U8, 0)]);
    Node::new(objects, Duration::from_millis(3)).with_lss(id, BitRate::Kbit1000, &BitRate::ALL)
}

struct Bus {
    now: Instant,
    master: Master,
    nodes: [Node; 4],
    /// On the wire.
    frames: Vec<Frame>,
    /// LSS commands that have not ended.
    open: u32,
    /// Nothing but the frames of these engines has crossed the wire, and all of them.
    undisturbed: bool,
}

impl Bus {
    fn drain(&mut self) {
        self.frames.extend(std::iter::from_fn(|| self.master.poll_tx()));
        while let Some(event) = self.master.poll_event() {
            match event {
                Event::Done(_) | Event::Failed(..) => self.open -= 1,
                Event::Found(address) if self.undisturbed => {
                    assert!(SERIALS.map(|serial| Address { serial, ..Address::default() }).contains(&address));
                }
                _ => {}
            }
        }
        for node in &mut self.nodes {
            self.frames.extend(std::iter::from_fn(|| node.poll_tx()));
            while node.poll_event().is_some() {}
        }
        // As a full queue of a controller would. Slaves that say the same at one moment are heard once.
        self.frames.dedup();
        self.undisturbed &= self.frames.len() <= 256;
        self.frames.truncate(256);
    }

    fn due(&self) -> Option<Instant> {
        self.nodes.iter().map(Node::poll_timeout).chain([self.master.poll_timeout()]).flatten().min()
    }

    fn handle_timeout(&mut self) {
        self.master.handle_timeout(self.now);
        self.nodes.iter_mut().for_each(|node| node.handle_timeout(self.now));
        self.drain();
        assert!(self.due().is_none_or(|due| due > self.now), "due at {:?}, served at {:?}", self.due(), self.now);
    }

    fn receive(&mut self, frame: &Frame) {
        self.master.handle_rx(self.now, frame);
        self.nodes.iter_mut().for_each(|node| node.handle_rx(self.now, frame));
        self.drain();
    }

    /// Everything arrives at once, and what is said to it; `lose` of 8 frames do not.
    fn deliver(&mut self, lose: u8) {
        for _ in 0..16 {
            for (n, frame) in std::mem::take(&mut self.frames).into_iter().enumerate() {
                if lose >> (n % 8) & 1 == 0 {
                    self.receive(&frame);
                } else {
                    self.undisturbed = false;
                }
            }
        }
    }

    /// Lets time pass; at most `rounds` deadlines are served in time, then one late.
    fn pass(&mut self, duration: Duration, rounds: u32, lose: u8) {
        let end = self.now + duration;
        for _ in 0..rounds {
            let Some(due) = self.due().filter(|due| *due <= end) else { break };
            self.now = self.now.max(due);
            self.handle_timeout();
            self.deliver(lose);
        }
        self.undisturbed &= self.due().is_none_or(|due| due > end);
        self.now = end;
        self.handle_timeout();
    }

    fn command(&mut self, [what, a, b, c, ..]: [u8; 8]) {
        let address = Address { serial: SERIALS[usize::from(a % 4)], ..Address::default() };
        let command = match what % 12 {
            0 => Command::SwitchGlobal(if a & 1 == 0 { Mode::Waiting } else { Mode::Configuration }),
            1 => Command::Select(address),
            2 => Command::Find,
            3 => Command::FindAll,
            4 => Command::Identify(Range {
                vendor: 0,
                product: 0,
                revision: (0, a.into()),
                serial: (b.into(), c.into()),
            }),
            5 => Command::IdentifyNonConfigured,
            6 => Command::InquireAddress,
            7 => Command::InquireNodeId,
            8 => Command::SetNodeId(a),
            9 => Command::SetBitRate(BitRate::ALL[usize::from(a % 9)]),
            10 => Command::Activate { delay_ms: a.into() },
            _ => Command::Store,
        };
        self.open += u32::from(self.master.start(self.now, command).is_ok());
    }
}

/// A node with the whole communication profile, three nodes that LSS can name, and an LSS master, with arbitrary, lost
/// and doubled frames and time steps.
///
/// After each call and its draining the next deadline lies ahead. Each LSS command ends once. An address that an
/// undisturbed scan finds exists.
pub fn canopen_node(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<(u8, u16, [u8; 8])>>(data) else { return };
    let [a, b, c, d] = SERIALS;
    let mut bus = Bus {
        now: Instant::from_millis(1000),
        master: Master::new(Timing::default()),
        nodes: [node(a, Some(3)), node(b, None), node(c, None), node(d, None)],
        frames: Vec::new(),
        open: 0,
        undisturbed: true,
    };
    for node in &mut bus.nodes {
        node.power_on(bus.now);
    }
    bus.pass(Duration::from_millis(10), 10, 0);
    for (what, number, data) in steps.into_iter().take(300) {
        let at = usize::from(number % 4);
        let len = usize::from(data[7] % 9);
        bus.undisturbed &= what % 16 > 6;
        match what % 16 {
            0 => bus.receive(&Frame::standard(number, &data[..len])),
            // Of the first node: any service, SDO writes to objects that it has.
            1 => bus.receive(&Frame::standard(number & 0x780 | 3, &data[..len])),
            2 => {
                let indices = [0x1005, 0x1006, 0x100C, 0x100D, 0x1012, 0x1014, 0x1015, 0x1016, 0x1017, 0x1019, 0x1029];
                let records = [0x1400, 0x1401, 0x1600, 0x1601, 0x1800, 0x1801, 0x1A00, 0x1A01, 0x1F80, 0x1010, 0x1011];
                let index: u16 = [indices, records][at & 1][usize::from(data[0]) % 11];
                let [low, high] = index.to_le_bytes();
                let write = [[0x23, 0x2B, 0x2F, 0x22][at], low, high, data[1] % 10, data[2], data[3], data[4], data[5]];
                bus.receive(&Frame::standard(0x603, &write));
            }
            3 => bus.receive(&Frame::standard_remote([0x183, 0x283, 0x703, 0x203][at], 1)),
            4 => bus.receive(&Frame::standard([0x080, 0x100, 0x203, 0x303][at], &data[..len])),
            // LSS, both ways.
            5 => bus.receive(&Frame::standard(0x7E4 + (number & 1), &[&[number as u8], &data[1..]].concat())),
            6 => {
                let id = Id::Extended(u32::from_le_bytes([data[0], data[1], data[2], data[3]]) & 0x1FFF_FFFF);
                bus.receive(&Frame::new(id, &data[4..]).expect("in range"));
            }
            7 | 8 => bus.command(data),
            9 => {
                let command = NmtCommand::ALL[usize::from(data[0]) % 5];
                bus.receive(&wire::nmt(command, if at == 0 { 0 } else { 3 }));
            }
            10 if data[0] & 3 != 0 => bus.nodes[at].power_on(bus.now),
            10 => bus.nodes[at].power_off(),
            11 => bus.nodes[at].emergency(number, data[0], [data[1]; 5]),
            12 => bus.nodes[at].set(0x2000, 0, data[0].into()),
            13 => bus.deliver(if at == 0 { data[0] } else { 0 }),
            14 => bus.pass(Duration::from_millis(number.into()), 2000, 0),
            _ => bus.pass(Duration::from_micros(u64::from(number) << (data[0] % 20)), 50, data[1]),
        }
        bus.drain();
    }
    // Left alone, what was asked ends; nodes that send SYNC would never be.
    bus.frames.clear();
    bus.nodes.iter_mut().for_each(Node::power_off);
    bus.pass(Duration::from_secs(300), 10_000, 0xFF);
    assert_eq!((bus.open, bus.master.is_idle()), (0, true), "an LSS command that never ends");
}
