//! CANopen master and two drives on a disturbed bus.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::drives::{epos, icla};
use canopen::master::{Event, Guarding, Master, MasterConfig, Stamp, State, Target};
use canopen::{NmtCommand, NmtState, Node};

/// What one call may bring forth.
const BURST: usize = 64;

struct Bus {
    now: Instant,
    master: Master,
    nodes: [Node; 2],
    /// On the wire.
    frames: Vec<Frame>,
    /// SDO requests that were taken and have not ended.
    open: u32,
}

impl Bus {
    fn drain(&mut self) {
        let sent: Vec<Frame> = std::iter::from_fn(|| self.master.poll_tx()).collect();
        assert!(sent.len() <= BURST, "{} frames", sent.len());
        self.frames.extend(sent);
        while let Some(event) = self.master.poll_event() {
            match event {
                Event::SdoRead { .. } | Event::SdoWritten { .. } | Event::SdoFailed { .. } => self.open -= 1,
                Event::Pdo { len, .. } => assert!(len <= 8),
                _ => {}
            }
        }
        assert_eq!(self.master.dropped(), 0);
        for node in &mut self.nodes {
            let sent: Vec<Frame> = std::iter::from_fn(|| node.poll_tx()).collect();
            assert!(sent.len() <= BURST, "{} frames", sent.len());
            self.frames.extend(sent);
            while node.poll_event().is_some() {}
        }
        // As a full queue of a controller would.
        self.frames.truncate(4 * BURST);
    }

    fn handle_timeout(&mut self) {
        self.master.handle_timeout(self.now);
        self.nodes.iter_mut().for_each(|node| node.handle_timeout(self.now));
        self.drain();
        for due in self.nodes.iter().map(Node::poll_timeout).chain([self.master.poll_timeout()]).flatten() {
            assert!(due > self.now, "due at {due:?}, served at {:?}", self.now);
        }
    }

    fn due(&self) -> Option<Instant> {
        self.nodes.iter().map(Node::poll_timeout).chain([self.master.poll_timeout()]).flatten().min()
    }

    /// Everything arrives at once, and what is said to it; `lose` of 8 frames do not.
    fn deliver(&mut self, lose: u8) {
        for _ in 0..BURST {
            let frames = std::mem::take(&mut self.frames);
            if frames.is_empty() {
                return;
            }
            for (n, frame) in frames.into_iter().enumerate() {
                if lose >> (n % 8) & 1 == 0 {
                    self.receive(&frame);
                    self.drain();
                }
            }
        }
    }

    fn receive(&mut self, frame: &Frame) {
        self.master.handle_rx(self.now, frame);
        self.nodes.iter_mut().for_each(|node| node.handle_rx(self.now, frame));
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
        self.now = end;
        self.handle_timeout();
    }
}

/// A master and two drives on a bus with arbitrary and lost frames, NMT, SDO, PDO, power cycles and time steps.
///
/// Undisturbed drives boot. After each call and its draining the next deadline lies ahead, and no event is dropped.
/// Each SDO request ends once.
pub fn canopen_engines(data: &[u8]) {
    let Some(input) = crate::input::<(u8, Vec<(u8, u16, [u8; 8])>)>(data) else { return };
    let (options, steps) = input;
    let option = |bit: u8| options >> bit & 1 == 1;
    let booted = option(0);
    let mut configs = [
        epos::node_config("propulsion", &epos::parameters(1)),
        icla::node_config("steering", &icla::parameters(2)),
    ];
    if option(1) {
        configs[1].stamp = Some(Stamp { date: 1, time: 2, store: option(2) });
        configs[1].mappings.iter_mut().for_each(|mapping| mapping.adjust = true);
        configs[1].mandatory = option(3);
    }
    if option(4) && !booted {
        configs[1].guarding = Some(Guarding { period: Duration::from_millis(70), factor: 1 + (options >> 5) });
    }
    let config = MasterConfig {
        sync: Some(Duration::from_millis(100)),
        sync_overflow: option(2).then_some(5),
        time: option(3).then_some(Duration::from_millis(300)),
        together: option(5),
        own_frames_return: option(6),
        bit_rate: if option(7) { 1_000_000 } else { 20_000 },
        ..MasterConfig::default()
    };
    let mut bus = Bus {
        now: Instant::from_millis(1000),
        master: Master::new(config, &configs).expect("two good nodes"),
        nodes: [epos::dictionary(1), icla::dictionary(2)].map(|objects| Node::new(objects, Duration::from_millis(100))),
        frames: Vec::new(),
        open: 0,
    };
    if booted {
        bus.nodes.iter_mut().for_each(|node| node.power_on(bus.now));
        bus.pass(Duration::from_secs(3), 1000, 0);
        assert!([1, 2].iter().all(|node| bus.master.state(*node) == Some(State::Operational)));
    }
    for (what, number, data) in steps.into_iter().take(300) {
        let node = (number % 3) as u8;
        let (index, sub) = (u16::from_le_bytes([data[0], data[1]]), data[2]);
        match what % 23 {
            0 => bus.receive(&Frame::standard(number, &data[..usize::from(data[7] % 9)])),
            // Of the two nodes.
            1..=3 => bus.receive(&Frame::standard((number & 0x780) | (1 + (number & 1)), &data)),
            // SDO, both ways.
            4 => bus.receive(&Frame::standard(0x581 + u16::from(node & 1), &data)),
            5 => bus.receive(&Frame::standard(0x601 + u16::from(node & 1), &data)),
            6 => {
                let id = Id::Extended(u32::from_le_bytes([data[0], data[1], data[2], data[3]]) & 0x1FFF_FFFF);
                bus.receive(&Frame::new(id, &data[4..]).expect("in range"));
                bus.receive(&Frame::remote(Id::Standard(number & 0x7FF), data[7] % 9).expect("in range"));
            }
            7 => bus.open += u32::from(bus.master.sdo_read(bus.now, node, index, sub).is_ok()),
            8 => {
                let len = usize::from(data[3]);
                bus.open += u32::from(bus.master.sdo_write(bus.now, node, index, sub, &vec![data[4]; len][..]).is_ok());
            }
            // Of nodes that nobody configured, too; in blocks.
            20 => {
                bus.open += u32::from(bus.master.sdo_read_block(bus.now, (number & 0x0F) as u8, index, sub).is_ok());
            }
            21 => {
                let (node, len) = ((number & 0x0F) as u8, 4 * usize::from(data[3]));
                let data = vec![data[4]; len];
                bus.open += u32::from(bus.master.sdo_write_block(bus.now, node, index, sub, &data[..]).is_ok());
            }
            22 => match data[0] % 3 {
                0 => bus.master.set_time(bus.now, i64::from_le_bytes(data)),
                1 => bus.master.set_own_state([NmtState::Operational, NmtState::Stopped][usize::from(data[1] & 1)]),
                _ => bus.receive(&Frame::standard(number & 0x780 | u16::from(data[1] & 0x0F), &data[2..])),
            },
            9 => drop(bus.master.send_pdo(node, data[0] % 6, &data[..usize::from(data[1] % 9)])),
            10 => {
                let commands = [
                    NmtCommand::Start,
                    NmtCommand::Stop,
                    NmtCommand::EnterPreOperational,
                    NmtCommand::ResetNode,
                    NmtCommand::ResetCommunication,
                ];
                let target = if node == 0 { Target::All } else { Target::Node(node) };
                bus.master.nmt(target, commands[usize::from(data[0]) % commands.len()]);
            }
            11 => drop(bus.master.reboot(bus.now, node)),
            12 if data[0] == 0 => bus.master.handle_bus_down(bus.now),
            12 => bus.nodes[usize::from(node & 1)].power_on(bus.now),
            13 if data[0] == 0 => bus.nodes[usize::from(node & 1)].power_off(),
            13 => bus.nodes[usize::from(node & 1)].emergency(number, data[0], [data[1]; 5]),
            14 => bus.nodes[usize::from(node & 1)].set(index, sub, i64::from(data[3])),
            15 => bus.deliver(data[0]),
            16 => bus.deliver(0),
            17 => bus.pass(Duration::from_millis(u64::from(number)), 200, 0),
            18 => bus.pass(Duration::from_millis(u64::from(number)), 50, data[0]),
            _ => bus.pass(Duration::from_micros(u64::from(number) << (data[0] % 24)), 5, data[1]),
        }
        bus.drain();
    }
    // Left alone, everything that was asked ends.
    bus.frames.clear();
    bus.pass(Duration::from_secs(90), 6_000, 0xFF);
    assert_eq!(bus.open, 0, "SDO requests that never end");
}
