//! Modules in their shells, driven by a hostile host.

use base::can::Frame;
use base::serial::Word;
use base::{Duration, Instant, gamepad};
use lcm::reassembly::Buffer;
use lcm::receiver::Receiver;
use lcm::subscription::Queue;
use lcm::udpm::{self, DATAGRAM_MAX};
use messages::{Channel, Message};
use module::bench::Bench;
use module::{Action, Event, ExitStatus, Input, Line, PortId, ProcessEvent, State};
use robot::place::RobotLocation;
use robot::topology;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::Path;

const MODULES: [&str; 6] = ["driver_rs485a", "driver_canbus", "simulator", "watchdog", "estimator", "driver_aux"];

/// Datagrams to messages, and frames, words, I2C outcomes, process events and time steps, into each module in its
/// shell.
///
/// No deadline is due twice at one instant; what is published can be encoded; a module that is terminated ends.
pub fn modules(data: &[u8]) {
    let Some(input) = crate::input::<(u8, Vec<(u8, u16, Vec<u8>)>)>(data) else { return };
    let (which, steps) = input;
    let place = RobotLocation {
        config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
        run_dir: "/nowhere".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: Vec::new(),
        sim: true,
        world: None,
    };
    let name = MODULES[usize::from(which) % MODULES.len()];
    let (shell, _) = topology::module(&place, name, State::Run).expect("the shipped robot");
    let lines: Vec<Line> = shell.module().ports().iter().map(|port| port.line).collect();
    let mut receiver = Receiver::default();
    receiver.subscribe(".*", Queue::Transport).expect("a good pattern");
    let mut bench = Bench::new(shell);
    bench.start();
    let from = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1);
    for (n, (what, number, bytes)) in steps.into_iter().take(200).enumerate() {
        match what % 8 {
            // A datagram as it comes, or with the header and the fingerprint of a channel.
            0 => receive(&mut bench, &mut receiver, from, &bytes),
            1 | 2 => {
                let channel = Channel::ALL[usize::from(number) % Channel::ALL.len()];
                let payload = [&channel.fingerprint().to_be_bytes()[..], &bytes].concat();
                let message = udpm::Message::new(n as u32, channel.name(), &payload, DATAGRAM_MAX);
                let message = message.expect("it can be sent");
                for number in 0..message.count() {
                    let (header, rest) = message.datagram(number);
                    receive(&mut bench, &mut receiver, from, &[&header[..], rest].concat());
                }
            }
            3 | 4 if !lines.is_empty() => {
                let port = PortId((usize::from(number >> 12) % lines.len()) as u8);
                match lines[usize::from(port.0)] {
                    Line::Can { .. } => bench.can(port, Frame::standard(number, &bytes)),
                    Line::Serial { .. } => {
                        let words: Vec<Word> = bytes
                            .chunks(2)
                            .map(|pair| Word { byte: pair[0], ninth: pair.len() > 1 && pair[1] & 1 != 0 })
                            .collect();
                        bench.words(port, &words);
                    }
                    Line::I2c { .. } if number & 1 == 0 => {
                        let read = base::i2c::Bytes::from_slice(&bytes[..bytes.len().min(base::i2c::MAX)]);
                        bench.i2c(port, &read.map_err(|_| base::i2c::Error::Other));
                    }
                    Line::I2c { .. } => bench.i2c(port, &Err(base::i2c::Error::NoData { at: number as u8 })),
                    Line::OneWire => {
                        let rom = base::w1::Rom::new(0x28, u64::from(number & 3)).expect("a small number");
                        bench.w1(
                            port,
                            &match number & 4 {
                                0 => base::w1::Answer::List([rom].into_iter().collect()),
                                _ if number & 8 != 0 => base::w1::Answer::Switch(rom, Ok(number as u8)),
                                _ => base::w1::Answer::Temperature(rom, Ok(i32::from(number) * 2 - 40_000)),
                            },
                        );
                    }
                    Line::Thermal => {
                        let mut state = base::thermal::State::default();
                        for (n, byte) in bytes.iter().enumerate() {
                            state.push(["cpu-thermal", "gpu-thermal", ""][n % 3], i32::from(*byte) * 1000 - 50_000);
                        }
                        let (slowed, under_voltage) = (number & 1 != 0, number & 2 != 0);
                        state.throttle = (number & 4 != 0).then_some(base::thermal::Throttle { slowed, under_voltage });
                        bench.event(Event::Port { port, input: Input::Thermal(&state) });
                    }
                    Line::Store => bench.store(port, &base::store::Answer::Done { free: u64::from(number) }),
                    Line::Gpio => {
                        let signal = base::gpio::Signal::Level(number & 1 != 0);
                        bench.event(Event::Port { port, input: Input::Gpio(signal) });
                    }
                    Line::Gamepad => bench.event(Event::Port { port, input: Input::Gamepad(gamepad::Input::Frame) }),
                }
            }
            5 => {
                let port = PortId((number >> 8) as u8 % 3);
                let input = match number % 8 {
                    0 => Input::Down("gone"),
                    1..=4 => Input::Up,
                    _ => Input::Sent,
                };
                bench.event(Event::Port { port, input });
            }
            6 if name == "watchdog" => {
                let (module, pid) = (MODULES[usize::from(number) % MODULES.len()], u32::from(number >> 4));
                bench.event(Event::Process(match number % 4 {
                    0 => ProcessEvent::Started { module, pid },
                    1 => ProcessEvent::Unstartable { module, reason: "nothing there" },
                    2 => ProcessEvent::Exited { pid, status: ExitStatus::Code(i32::from(what)) },
                    _ => ProcessEvent::Usage { pid, cpu: f64::from(number), rss: -1 },
                }));
            }
            _ => bench.pass(Duration::from_micros(u64::from(number) << (what / 8 % 5))),
        }
        check(&mut bench);
    }
    // Told to end, it ends.
    let mut out = module::Actions::new(base::Epoch::default());
    let now: Instant = bench.now();
    bench.shell.terminate(now, &mut out);
    bench.pass(Duration::from_secs(7));
    assert_eq!(bench.shell.poll_timeout(), None, "{name} does not end");
}

fn receive(bench: &mut Bench, receiver: &mut Receiver, from: SocketAddrV4, datagram: &[u8]) {
    let mut buffer = Buffer::default();
    let datagram = &datagram[..datagram.len().min(DATAGRAM_MAX)];
    buffer.room()[..datagram.len()].copy_from_slice(datagram);
    if let Some(place) = receiver.handle_rx(0, from, &mut buffer, datagram.len()) {
        let (channel, payload) = receiver.message(place, &buffer);
        if let Some(Ok(message)) = Message::receive(channel, payload) {
            bench.message(message);
        }
    }
    assert!(receiver.rejections().len() <= 8);
}

fn check(bench: &mut Bench) {
    for (_, action) in bench.done() {
        match action {
            Action::Publish(message) => {
                let mut bytes = Vec::new();
                message.encode(&mut bytes).expect("what a module says can be sent");
            }
            Action::Report(report) => assert!(!report.message.is_empty()),
            _ => {}
        }
    }
}
