//! Engines of motor controllers and their emulated devices on disturbed lines.

use arbitrary::Arbitrary;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use motorctl::odrive::wire::Command;
use motorctl::odrive::{self, Odrive};
use motorctl::roboclaw::wire::{Asked, Request};
use motorctl::roboclaw::{self, RoboClaw};
use motorctl::vesc::{self, VescCan, VescUart};
use motorctl::{Axis, Config, State};

const AXIS: Axis = Axis { gear: -12.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
const HOST: u8 = 254;

#[derive(Arbitrary, Debug)]
enum Step {
    /// A frame, or bytes, from nowhere.
    Receive { to_device: bool, id: u16, data: [u8; 8], len: u8 },
    /// Time passes; what is sent arrives, or does not.
    Pass { ms: u8, lost: bool },
    /// Time passes without a call of the engine.
    Hang { ms: u16 },
    Command { velocity: i8 },
    Stop,
    QuickStop,
    Release,
    Disarm,
    Restart,
    Fault { number: u8, on: bool },
}

/// A frame for CAN Simple, node 0.
fn standard(id: u16, data: &[u8]) -> Frame {
    Frame::standard(id % 64, data)
}

/// A frame of VESC to the host or to the device.
fn extended(id: u16, data: &[u8]) -> Frame {
    let to = if id & 1 == 0 { HOST } else { vesc::Device::EXAMPLE.id };
    Frame::new(Id::Extended((u32::from(id >> 1) % 12) << 8 | u32::from(to)), data).unwrap()
}

/// Runs the steps with an engine and its device, which differ in the types of what is exchanged.
macro_rules! run {
    (
        $steps:expr, $engine:expr, $device:expr, axes: $axes:literal,
        input: $input:expr, moves: $moves:expr, poll: $poll:expr, fault: $fault:expr
    ) => {{
        let mut engine = $engine;
        let mut device = $device;
        let mut now = Instant::from_millis(1000);
        for step in $steps {
            match step {
                Step::Receive { to_device, id, data, len } => {
                    let rx = $input(*id, &data[..usize::from(*len) % 9]);
                    if *to_device { device.handle_rx(now, &rx) } else { engine.handle_rx(now, &rx) }
                }
                Step::Pass { ms, lost } => {
                    for _ in 0..*ms {
                        run!(@pass engine, device, now, *lost, $moves, $poll);
                    }
                }
                Step::Hang { ms } => now += Duration::from_millis(u64::from(*ms)),
                Step::Command { velocity } => _ = engine.command(now, [f64::from(*velocity) / 10.0; $axes]),
                Step::Stop => engine.stop(),
                Step::QuickStop => engine.quick_stop(),
                Step::Release => _ = engine.release(now),
                Step::Disarm => engine.disarm(now),
                Step::Restart => engine.restart(now),
                Step::Fault { number, on } => $fault(&mut device, *number, *on),
            }
            while engine.poll_event().is_some() {}
        }
        // Whatever came before: with a device at power-on the next start-up succeeds.
        device = $device;
        engine.restart(now);
        for _ in 0..3000 {
            run!(@pass engine, device, now, false, $moves, $poll);
        }
        assert_eq!(engine.state(), State::Ready);
    }};
    (@pass $engine:ident, $device:ident, $now:ident, $lost:expr, $moves:expr, $poll:expr) => {
        $now += Duration::from_millis(1);
        let before = $engine.state();
        $engine.handle_timeout($now);
        $device.handle_timeout($now);
        while let Some(tx) = $engine.poll_tx($now) {
            let is_ready = before == State::Ready || $engine.state() == State::Ready;
            assert!(is_ready || !$moves(&tx), "motion before the start-up has ended: {tx:?}");
            if !$lost {
                $device.handle_rx($now, &tx);
            }
        }
        assert!($engine.poll_timeout().is_none_or(|due| due > $now), "due after it was served");
        while let Some(tx) = $poll(&mut $device, $now) {
            if !$lost {
                $engine.handle_rx($now, &tx);
            }
        }
    };
}

fn is_setpoint(frame: &Frame) -> bool {
    matches!(Command::decode(frame), Some((_, Command::SetInputVel(velocity))) if velocity != 0.0)
}

/// Engines of motor controllers with arbitrary frames and bytes, lost ones, commands and faults, at any time.
///
/// No setpoint but zero leaves before the start-up has ended. After a call and its draining nothing is due. A start-up
/// with a device at power-on succeeds.
pub fn motorctl_engines(data: &[u8]) {
    let Some((kind, steps)) = crate::input::<(u8, Vec<Step>)>(data) else { return };
    let steps = &steps[..steps.len().min(200)];
    let one = Config::new([AXIS]);
    let two = Config { second_way: true, ..Config::new([AXIS; 2]) };
    match kind % 4 {
        0 => run!(
            steps, Odrive::new(&one, odrive::Device::EXAMPLE).unwrap(),
            odrive::device::Device::new(odrive::Device::EXAMPLE), axes: 1,
            input: standard,
            moves: is_setpoint,
            poll: |device: &mut odrive::device::Device, _| device.poll_tx(),
            fault: |device: &mut odrive::device::Device, number, on| {
                let odrive::device::Faults { unplugged, mute, watchdog_dead, read_only } = &mut device.faults;
                *[unplugged, mute, watchdog_dead, read_only][usize::from(number) % 4] = on;
            }
        ),
        1 => run!(
            steps, RoboClaw::new(&two, roboclaw::Device::EXAMPLE).unwrap(),
            roboclaw::device::Device::new(roboclaw::Device::EXAMPLE), axes: 2,
            input: |_, data: &[u8]| data.to_vec(),
            moves: |packet: &roboclaw::wire::Packet| {
                let asked = Request::decode(roboclaw::Device::EXAMPLE.address, packet);
                matches!(asked, Asked::Request(Request::Drive(speeds)) if speeds != [0; 2])
            },
            poll: |device: &mut roboclaw::device::Device, now| device.poll_tx(now),
            fault: |device: &mut roboclaw::device::Device, number, on| {
                let roboclaw::device::Faults { unplugged, mute, deaf, garbled, read_only } = &mut device.faults;
                *[unplugged, mute, deaf, garbled, read_only][usize::from(number) % 5] = on;
            }
        ),
        2 => run!(
            steps, VescCan::can(&one, vesc::Device::EXAMPLE, HOST).unwrap(),
            vesc::device::Device::new(vesc::Device::EXAMPLE, vesc::can::Link::device(vesc::Device::EXAMPLE.id)),
            axes: 1,
            input: extended,
            moves: |frame: &Frame| matches!(frame.id(), Id::Extended(id) if id >> 8 == 3),
            poll: |device: &mut vesc::device::Device<vesc::can::Link>, _| vesc::device::Device::poll_tx(device),
            fault: vesc_fault
        ),
        _ => run!(
            steps, VescUart::uart(&one, vesc::Device::EXAMPLE).unwrap(),
            vesc::device::Device::new(vesc::Device::EXAMPLE, vesc::uart::Link::new()), axes: 1,
            input: |_, data: &[u8]| data.to_vec(),
            // The first packet of what is sent at once is the command.
            moves: |bytes: &vesc::uart::Bytes| bytes.starts_with(&[2, 5, 8]),
            poll: |device: &mut vesc::device::Device<vesc::uart::Link>, _| vesc::device::Device::poll_tx(device),
            fault: vesc_fault
        ),
    }
}

fn vesc_fault<L>(device: &mut vesc::device::Device<L>, number: u8, on: bool) {
    let vesc::device::Faults { unplugged, mute, timeout_dead, deaf } = &mut device.faults;
    *[unplugged, mute, timeout_dead, deaf][usize::from(number) % 4] = on;
}
