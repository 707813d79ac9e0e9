//! CPU time and allocations per frame in the engines.

use crate::sys::cpu_ns;
use crate::{MEMORY, line, median};
use base::can::Frame;
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Dictionary, Entry};
use canopen::master::{Event, Master, MasterConfig, NodeConfig, State};
use canopen::wire::{self, Service};
use canopen::{Node, NodeEvent};
use std::hint::black_box;

/// Number of nodes on the bus.
pub const NODES: u8 = 8;
/// Frames per second on a full bus: 6 bytes at 1 Mbit/s with maximum bit stuffing.
pub const FULL: u32 = 8700;
const CALLS: u32 = 200_000;
const ROUNDS: usize = 9;

/// Drive with few objects: RPDO4 is controlword and target velocity, TPDO4 statusword and actual velocity.
pub fn drive(id: u8) -> Node {
    use Access::{ReadOnly, ReadWrite};
    use DataType::{I32, U16, U32};
    let dictionary = Dictionary::new(id)
        .with(&[
            Entry::new(0x1000, 0, U32, ReadOnly, 0x0002_0192),
            Entry::new(0x1017, 0, U16, ReadWrite, 0),
            Entry::new(0x6040, 0, U16, ReadWrite, 0).mappable(),
            Entry::new(0x6041, 0, U16, ReadOnly, 0).mappable(),
            Entry::new(0x606C, 0, I32, ReadOnly, 0).mappable(),
            Entry::new(0x60FF, 0, I32, ReadWrite, 0).mappable(),
        ])
        .with_rpdo(4, 0x500, &[0x6040_0010, 0x60FF_0020], false)
        .with_tpdo(4, 0x4000_0480, &[0x6041_0010, 0x606C_0020], false);
    Node::new(dictionary, Duration::from_millis(1))
}

/// Master for all of them; none is lost during a measurement.
pub fn master() -> Master {
    let long = Duration::from_secs(60);
    let node = |id| NodeConfig { heartbeat_limit: long, ..NodeConfig::new(id, "drive") };
    let nodes: Vec<_> = (1..=NODES).map(node).collect();
    Master::new(MasterConfig::default(), &nodes).expect("a good configuration")
}

/// Booted bus in virtual time.
struct Bus {
    now: Instant,
    master: Master,
    nodes: Vec<Node>,
    count: u32,
}

impl Bus {
    fn booted() -> Self {
        let nodes = (1..=NODES).map(drive).collect();
        let mut bus = Self { now: Instant::from_millis(1000), master: master(), nodes, count: 0 };
        bus.nodes.iter_mut().for_each(|node| node.power_on(bus.now));
        while (1..=NODES).any(|id| bus.master.state(id) != Some(State::Operational)) {
            bus.now += Duration::from_micros(500);
            assert!(bus.now < Instant::from_millis(20_000), "the nodes boot");
            bus.step();
        }
        bus
    }

    fn step(&mut self) {
        self.master.handle_timeout(self.now);
        while let Some(frame) = self.master.poll_tx() {
            self.nodes.iter_mut().for_each(|node| node.handle_rx(self.now, &frame));
        }
        for node in &mut self.nodes {
            node.handle_timeout(self.now);
            while let Some(frame) = node.poll_tx() {
                self.master.handle_rx(self.now, &frame);
            }
            while node.poll_event().is_some() {}
        }
        while self.master.poll_event().is_some() {}
    }

    /// Next frame of a full bus: advances the time and returns the node. Heartbeats are interspersed, so that no node
    /// is lost.
    fn next(&mut self) -> u8 {
        self.now += Duration::from_secs(1) / FULL;
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(FULL) {
            for node in 1..=NODES {
                self.master.handle_rx(self.now, &wire::heartbeat(node, canopen::NmtState::Operational));
            }
        }
        (self.count % u32::from(NODES)) as u8 + 1
    }

    /// Calls of a driver after each input.
    fn drain(&mut self) -> Option<Event> {
        let event = self.master.poll_event();
        while black_box(self.master.poll_tx()).is_some() {}
        if black_box(self.master.poll_timeout()).is_some_and(|due| due <= self.now) {
            self.master.handle_timeout(self.now);
        }
        event
    }
}

pub fn report() {
    println!("\nengines: CPU time of a frame with all that a driver calls for it, median of {ROUNDS} rounds");
    let mut bus = Bus::booted();
    measure("master, a TPDO comes", 1, || {
        let node = bus.next();
        let [a, b, c, d] = bus.count.to_le_bytes();
        let frame = Frame::standard(Service::Tpdo { node, number: 4 }.cob_id(), &[0x37, 0x02, a, b, c, d]);
        bus.master.handle_rx(bus.now, black_box(&frame));
        assert!(matches!(bus.drain(), Some(Event::Pdo { .. })));
    });
    measure("master, a heartbeat comes", 1, || {
        let node = bus.next();
        bus.master.handle_rx(bus.now, black_box(&wire::heartbeat(node, canopen::NmtState::Operational)));
        bus.drain();
    });
    measure("master, an RPDO goes", 1, || {
        let node = bus.next();
        bus.master.send_pdo(node, 4, black_box(&[0x0F, 0, 1, 2, 3, 4])).expect("it is Operational");
        bus.drain();
    });
    let answer = Frame::standard(0x581, &[0x43, 0x6C, 0x60, 0, 1, 2, 3, 4]);
    measure("master, SDO expedited: request and answer", 2, || {
        // Two frames of 8 bytes take a little longer than two of 6.
        for _ in 0..3 {
            bus.next();
        }
        bus.master.sdo_read(bus.now, 1, 0x606C, 0).expect("the node is there");
        // The master's heartbeat precedes if it is due.
        while bus.master.poll_tx().expect("a request").data().len() < 8 {}
        bus.master.handle_rx(bus.now, black_box(&answer));
        assert!(matches!(bus.drain(), Some(Event::SdoRead { .. })));
    });
    let (mut count, every) = (0u32, Duration::from_secs(1) / FULL);
    let mut node = Bus::booted().nodes.remove(0);
    let mut now = Instant::from_millis(30_000);
    let rpdo = |n: u32| {
        let [a, b, c, d] = n.to_le_bytes();
        Frame::standard(0x501, &[0x0F, 0, a, b, c, d])
    };
    measure("node, an RPDO comes and is told", 1, || {
        count = count.wrapping_add(1);
        now += every;
        node.handle_rx(now, black_box(&rpdo(count)));
        while let Some(NodeEvent::ObjectWritten { .. }) = black_box(node.poll_event()) {}
        black_box(node.poll_timeout());
    });
    measure("node, a value changes and its TPDO goes", 1, || {
        count = count.wrapping_add(1);
        now += every;
        node.set(0x606C, 0, i64::from(count as i32));
        node.handle_timeout(now);
        assert!(black_box(node.poll_tx()).is_some());
        while node.poll_tx().is_some() {}
        black_box(node.poll_timeout());
    });
}

fn measure(what: &str, frames: u32, mut call: impl FnMut()) {
    (0..1000).for_each(|_| call());
    let before = MEMORY.allocations();
    (0..1000).for_each(|_| call());
    let allocations = MEMORY.allocations() - before;
    let round = |_| {
        let begin = cpu_ns();
        (0..CALLS).for_each(|_| call());
        (cpu_ns() - begin) as f64 / f64::from(CALLS * frames)
    };
    let ns = median((0..ROUNDS).map(round).collect());
    line(what, &format!("{ns:.0} ns, {allocations} allocations"), "≤ 1000 ns, 0");
}
