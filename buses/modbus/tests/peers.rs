//! Master and device against pymodbus over a TCP connection: frames of TCP, and of RTU, which pymodbus sends there too.

#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a test uses real sockets"
)]

use base::Instant;
use heapless::Vec as Words;
use modbus::device::Device;
use modbus::pdu::{Bits, Data};
use modbus::{Config, Exception, Failure, Line, Master, Request, Table};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant as Clock};
use testing::{peer_or_skip, python};

const UNIT: u8 = 17;
const KINDS: [(&str, Line); 2] = [("tcp", Line::Tcp), ("rtu", Line::Rtu { baud: 115_200 })];
/// Time limit of everything.
const PATIENCE: Duration = Duration::from_secs(60);

struct Peer(Child);

impl Peer {
    fn start(role: &str, kind: &str, port: u16) -> Option<Self> {
        let python = peer_or_skip(python(&["pymodbus"]))?;
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer.py");
        let mut command = Command::new(python);
        command.arg(script).args([role, kind, &port.to_string()]).stdout(Stdio::piped());
        Some(Self(command.spawn().unwrap()))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Monotonic time and a connection.
struct Wire {
    start: Clock,
    socket: TcpStream,
}

impl Wire {
    fn new(socket: TcpStream) -> Self {
        socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        Self { start: Clock::now(), socket }
    }

    fn now(&self) -> Instant {
        assert!(self.start.elapsed() < PATIENCE, "too long");
        Instant::ZERO + Duration::from_millis(1000) + self.start.elapsed()
    }

    /// What came within a millisecond; `None`: the peer has closed the connection.
    fn read(&mut self) -> Option<Vec<u8>> {
        let mut bytes = [0; 300];
        match self.socket.read(&mut bytes) {
            Ok(0) => None,
            Ok(count) => Some(bytes[..count].to_vec()),
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => Some(Vec::new()),
            Err(error) => panic!("{error}"),
        }
    }
}

fn connect(port: u16) -> TcpStream {
    let begin = Clock::now();
    loop {
        match TcpStream::connect((Ipv4Addr::LOCALHOST, port)) {
            Ok(socket) => return socket,
            Err(error) => assert!(begin.elapsed() < PATIENCE, "the peer does not listen: {error}"),
        }
        std::thread::yield_now();
    }
}

fn ask(master: &mut Master, wire: &mut Wire, request: Request) -> Result<Data, Failure> {
    master.request(UNIT, request).unwrap();
    loop {
        let now = wire.now();
        master.handle_timeout(now);
        if let Some(frame) = master.poll_tx(now) {
            wire.socket.write_all(&frame).unwrap();
        }
        let bytes = wire.read().expect("it stays connected");
        if !bytes.is_empty() {
            master.handle_rx(wire.now(), &bytes);
        }
        if let Some(event) = master.poll_event() {
            return event.result;
        }
    }
}

#[test]
fn the_master_reads_and_writes_a_device_of_pymodbus() {
    for (kind, line) in KINDS {
        let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap().port();
        let Some(_peer) = Peer::start("server", kind, free) else { return };
        let mut wire = Wire::new(connect(free));
        let limit = Duration::from_secs(5);
        let mut master = Master::new(Config { time_limit: limit, retries: 0, ..Config::new(line) }).unwrap();
        let mut ask = |request| ask(&mut master, &mut wire, request);
        let read = |table, address, count| Request::Read { table, address, count };
        let words = |data: Data| [0, 1, 2].map(|n| data.word(n).unwrap());
        let bits = |data: Data| [0, 1, 2, 3].map(|n| data.bit(n).unwrap());

        assert_eq!(words(ask(read(Table::InputRegisters, 5, 3)).unwrap()), [105, 106, 107], "{kind}");
        assert_eq!(bits(ask(read(Table::DiscreteInputs, 1, 19)).unwrap()), [true, false, true, false]);
        ask(Request::WriteCoil { address: 0, on: true }).unwrap();
        let mut several = Bits::default();
        [false, true, false].into_iter().for_each(|bit| assert!(several.push(bit)));
        ask(Request::WriteCoils { address: 1, bits: several }).unwrap();
        assert_eq!(bits(ask(read(Table::Coils, 0, 4)).unwrap()), [true, false, true, false]);
        ask(Request::WriteRegister { address: 7, word: 0xFFFE }).unwrap();
        ask(Request::WriteRegisters { address: 8, words: Words::from_slice(&[1, 0x8000]).unwrap() }).unwrap();
        assert_eq!(words(ask(read(Table::HoldingRegisters, 7, 3)).unwrap()), [0xFFFE, 1, 0x8000]);
        let beyond = ask(read(Table::HoldingRegisters, 19, 2));
        assert_eq!(beyond, Err(Failure::Exception(Exception::ILLEGAL_ADDRESS)));
        let counters = *master.counters();
        assert_eq!((counters.answers, counters.exceptions, counters.rejected()), (8, 1, 0), "{kind}");
    }
}

#[test]
fn a_client_of_pymodbus_reads_and_writes_the_emulated_device() {
    for (kind, line) in KINDS {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let Some(mut peer) = Peer::start("client", kind, listener.local_addr().unwrap().port()) else { return };
        let mut device = Device::new(line, UNIT);
        for (table, address) in Table::ALL.into_iter().flat_map(|table| (0..20).map(move |address| (table, address))) {
            let word = if table.is_bits() { address % 2 } else { address + 100 };
            assert!(device.set(table, address, word));
        }
        let mut wire = Wire::new(listener.accept().unwrap().0);
        while let Some(bytes) = wire.read() {
            if !bytes.is_empty() {
                device.handle_rx(wire.now(), &bytes);
            }
            while let Some(frame) = device.poll_tx(wire.now()) {
                wire.socket.write_all(&frame).unwrap();
            }
        }
        assert!(peer.0.wait().unwrap().success(), "{kind}");
        assert_eq!(device.get(Table::HoldingRegisters, 0), Some(0xBEEF));
        assert_eq!(device.writes(), 4);
    }
}
