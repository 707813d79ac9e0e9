//! CANopen devices with inputs and outputs, served by the driver of the drives.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Dictionary, Entry};
use canopen::drives::{epos, icla};
use canopen::{NmtCommand, Node, wire};
use messages::lowlevel::{CmdNodeIo, DataHold, DataNodeIo, NodeTarget};
use messages::{Hold, Message};
use module::bench::Bench;
use module::{Action, Output, PortId, State};
use robot::place::RobotLocation;
use robot::topology;
use std::path::Path;

/// Bus of the drives.
const BUS: PortId = PortId(0);
const NODE: u8 = 20;
/// Names of the signals, outputs last.
const SIGNALS: [&str; 5] = ["gate", "level", "hours", "lamp", "valve"];
/// Rounds of frames and answers in one instant.
const ROUNDS: u32 = 64;

/// The shipped robot with a device whose gate stops it.
fn sets() -> Vec<String> {
    let signals = [
        r#"{ name = "gate", kind = "digital-in", channel = 4 }"#,
        r#"{ name = "level", kind = "analogue-in", channel = 1, scale = 0.01 }"#,
        r#"{ name = "hours", kind = "object", index = 0x2010, subindex = 1, format = "u32" }"#,
        r#"{ name = "lamp", kind = "digital-out", channel = 0, safe = 1 }"#,
        r#"{ name = "valve", kind = "analogue-out", channel = 0, scale = 0.5, safe = 0 }"#,
    ];
    let signals = format!("io.canopen.plc.signals=[{}]", signals.join(", "));
    let stop = r#"stop.inputs=[{ signal = "gate" }]"#.into();
    vec![format!("io.canopen.plc.node={NODE}"), signals, stop]
}

/// The device; `mapped`: what its TPDOs have, where it is not what is usual.
fn device(mapped: [u32; 3], cob_id: u32) -> Node {
    let number = |index, sub, data_type, value| Entry::new(index, sub, data_type, Access::ReadWrite, value);
    let objects = Dictionary::new(NODE)
        .with(&[
            number(0x1000, 0, DataType::U32, 0x000F_0191),
            number(0x1016, 1, DataType::U32, 0),
            number(0x1017, 0, DataType::U16, 0),
            number(0x2010, 1, DataType::U32, 7).mappable(),
            number(0x6000, 1, DataType::U8, 0x10).mappable(),
            number(0x6200, 1, DataType::U8, 0),
            number(0x6206, 1, DataType::U8, 0),
            number(0x6207, 1, DataType::U8, 0),
            number(0x6401, 2, DataType::I16, -150).mappable(),
            number(0x6411, 1, DataType::I16, 0),
            number(0x6423, 0, DataType::Bool, 0),
            number(0x6443, 1, DataType::U8, 0),
            number(0x6444, 1, DataType::I32, 0),
        ])
        .with_tpdo(1, cob_id, &mapped, false)
        .with_tpdo(2, 0x280, &[0x6401_0210], false);
    Node::new(objects, Duration::from_millis(1))
}

/// The driver, its drives and the device, on one bus.
struct Bus {
    bench: Bench,
    nodes: [Node; 3],
    values: Option<DataNodeIo>,
    holds: DataHold,
}

impl Bus {
    /// Passes frames to and fro; `lose` of 8 do not arrive.
    fn exchange(&mut self, lose: u8) {
        for _ in 0..ROUNDS {
            let sent = self.actions();
            let mut quiet = sent.is_empty();
            let now = self.bench.now();
            for (n, frame) in sent.iter().enumerate() {
                if lose >> (n % 8) & 1 == 0 {
                    self.nodes.iter_mut().for_each(|node| node.handle_rx(now, frame));
                }
            }
            for node in 0..self.nodes.len() {
                while let Some(frame) = self.nodes[node].poll_tx() {
                    quiet = false;
                    if lose >> node & 1 == 0 {
                        self.receive(frame);
                    }
                }
                while self.nodes[node].poll_event().is_some() {}
            }
            if quiet {
                return;
            }
        }
    }

    fn receive(&mut self, frame: Frame) {
        self.bench.can(BUS, frame);
    }

    /// Frames that the driver sends; what it publishes is kept, and judged.
    fn actions(&mut self) -> Vec<Frame> {
        let mut frames = Vec::new();
        for (_, action) in self.bench.done() {
            match action {
                Action::Send(BUS, Output::Can(frame)) => frames.push(frame),
                Action::Publish(message) => {
                    message.encode(&mut Vec::new()).expect("what a module publishes can be sent");
                    match message {
                        Message::LlDataNodeIo(values) => {
                            let names: Vec<&str> = values.values.iter().map(|value| &*value.name).collect();
                            assert_eq!(names, SIGNALS);
                            assert!(values.values.iter().all(|value| !value.value.is_infinite()), "{values:?}");
                            self.values = Some(values);
                        }
                        Message::LlDataHold(holds) => self.holds = holds,
                        _ => {}
                    }
                }
                Action::Report(report) => assert!(!report.message.is_empty()),
                _ => {}
            }
        }
        frames
    }

    /// Lets time pass in steps of a millisecond.
    fn pass(&mut self, duration: Duration, lose: u8) {
        let end = self.bench.now() + duration;
        while self.bench.now() < end {
            let left = end.since(self.bench.now());
            self.bench.pass(left.min(Duration::from_millis(1)));
            self.serve(lose);
        }
    }

    fn serve(&mut self, lose: u8) {
        let now: Instant = self.bench.now();
        self.nodes.iter_mut().for_each(|node| node.handle_timeout(now));
        self.exchange(lose);
    }

    fn is_known(&self, name: &str) -> bool {
        let mut values = self.values.iter().flat_map(|values| &values.values);
        values.any(|value| value.name == name && !value.value.is_nan())
    }

    fn holds(&self, cause: Hold) -> bool {
        self.holds.holds.iter().filter_map(messages::lowlevel::Hold::cause).any(|held| held == cause)
    }
}

/// Driver of the drives with a CANopen device, whose mapping may be any, with arbitrary and lost frames, power cycles,
/// orders and time steps.
///
/// An undisturbed device is known. What is published names all signals and has no infinite value. Once the bus is
/// silent, every value is unknown, and so is the input that stops the robot.
pub fn canopen_io(data: &[u8]) {
    let Some(input) = crate::input::<(u8, [u32; 3], Vec<(u8, u16, [u8; 8])>)>(data) else { return };
    let (options, mapped, steps) = input;
    let place = RobotLocation {
        config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
        run_dir: "/nowhere".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: sets(),
        sim: true,
        world: None,
    };
    let (shell, _) = topology::module(&place, "driver_canbus", State::Run).expect("the shipped robot with a device");
    let usual = options & 1 == 0;
    let mapped = if usual { [0x6000_0108, 0x2010_0120, 0x6401_0210] } else { mapped };
    let cob_id = if options & 2 == 0 { 0x180 } else { 0x4000_0180 };
    let drives = [epos::dictionary(1), icla::dictionary(2)].map(|objects| Node::new(objects, Duration::from_millis(1)));
    let [propulsion, steering] = drives;
    let mut bus = Bus {
        bench: Bench::new(shell),
        nodes: [propulsion, steering, device(mapped, cob_id)],
        values: None,
        holds: DataHold::default(),
    };
    bus.bench.start();
    let now = bus.bench.now();
    bus.nodes.iter_mut().for_each(|node| node.power_on(now));
    if options & 4 == 0 {
        bus.pass(Duration::from_secs(2), 0);
        // A device that sends an object in another length is not always known.
        assert!(!usual || SIGNALS.iter().all(|name| bus.is_known(name)), "{:?}", bus.values);
    }
    for (what, number, data) in steps.into_iter().take(200) {
        let len = usize::from(data[7] % 9);
        let now = bus.bench.now();
        match what % 16 {
            0 => bus.receive(Frame::standard(number, &data[..len])),
            // Of the device: any service, a TPDO, an answer about its mapping or an input.
            1 => bus.receive(Frame::standard(number & 0x780 | u16::from(NODE), &data[..len])),
            2 => bus.receive(Frame::standard(0x180 + 0x100 * (number & 3) + u16::from(NODE), &data[..len])),
            3 | 4 => {
                let objects = [
                    0x0018_0001,
                    0x001A_0000,
                    0x001A_0001,
                    0x001A_0100,
                    0x0060_0001,
                    0x0064_0102,
                    0x0020_1001,
                    0x0062_0001_u32,
                ];
                let object = objects[usize::from(data[0]) % objects.len()];
                let [sub, low, high, _] = object.to_le_bytes();
                let command = [0x43, 0x4B, 0x4F, 0x60, 0x80, 0x41, 0x42, data[1]][usize::from(number) % 8];
                let answer = [command, low, high, sub, data[2], data[3], data[4], data[5]];
                bus.receive(Frame::standard(0x580 + u16::from(NODE), &answer));
            }
            5 => {
                let id = Id::Extended(u32::from_le_bytes([data[0], data[1], data[2], data[3]]) & 0x1FFF_FFFF);
                bus.receive(Frame::new(id, &data[4..]).expect("in range"));
            }
            6 => {
                let command = NmtCommand::ALL[usize::from(data[0]) % 5];
                bus.nodes[2].handle_rx(now, &wire::nmt(command, NODE));
            }
            7 if data[0] & 3 != 0 => bus.nodes[2].power_on(now),
            7 => bus.nodes[2].power_off(),
            8 => bus.nodes[2].emergency(number, data[0], [data[1]; 5]),
            9 => {
                let (index, sub) = [(0x6000, 1), (0x6401, 2), (0x2010, 1)][usize::from(number) % 3];
                bus.nodes[2].set(index, sub, data[0].into());
            }
            10 | 11 => {
                let target = f64::from_bits(u64::from_le_bytes(data));
                let target = if number & 1 == 0 { target } else { f64::from(data[0]) };
                let name = SIGNALS[usize::from(number >> 1) % SIGNALS.len()].into();
                bus.bench.message(CmdNodeIo { timestamp: 0, outputs: vec![NodeTarget { name, target }] });
            }
            12 => bus.pass(Duration::from_millis(u64::from(number % 500)), 0),
            13 => bus.pass(Duration::from_millis(u64::from(number % 500)), data[0]),
            14 => bus.pass(Duration::from_micros(u64::from(number) << (data[0] % 10)), 0xFF),
            _ => bus.serve(data[0]),
        }
        bus.exchange(0);
    }
    // Silence.
    bus.nodes.iter_mut().for_each(Node::power_off);
    bus.pass(Duration::from_secs(2), 0xFF);
    bus.bench.pass(Duration::from_millis(200));
    bus.exchange(0xFF);
    for name in SIGNALS {
        assert!(!bus.is_known(name), "{name} of a device that is silent: {:?}", bus.values);
    }
    assert!(bus.holds(Hold::PauseInputUnknown), "{:?}", bus.holds);
}
