//! SDO in virtual wire time.

use crate::line;
use crate::store::Store;
use base::can::{Frame, INTERMISSION, Id, frame_bits};
use base::{Duration, Instant};
use canopen::master::{Event, Master, MasterConfig};
use std::collections::VecDeque;

const BIT: Duration = Duration::from_micros(1);
const NODE: u8 = 1;
const INDEX: u16 = 0x2000;
/// Values of CANopenNode's published figures (docs/facts/canopen.md 7).
const LENGTH: usize = 100_000;
const REPEATED: u32 = 1000;

pub fn report() {
    println!("SDO at 1 Mbit/s, of the bound; zero device time, our master's heartbeat beside it");
    let data: Vec<u8> = (0..LENGTH).map(|n| (n * n / 7 + 31 * n) as u8).collect();
    let short: Vec<u8> = data[..1000].to_vec();
    let mut bench = Bench::new();
    let took = bench.run(|master, now| master.sdo_write_block(now, NODE, INDEX, 0, &data[..]).is_ok());
    row("block download, 100 000 bytes", took, block_download(&data), LENGTH);
    let took = bench.run(|master, now| master.sdo_read_block(now, NODE, INDEX, 0).is_ok());
    row("block upload, 100 000 bytes", took, block_upload(&data), LENGTH);
    let took = bench.run(|master, now| master.sdo_write(now, NODE, INDEX, 1, &short[..]).is_ok());
    row("segmented download, 1000 bytes", took, segmented(&short, true), short.len());
    let took = bench.run(|master, now| master.sdo_read(now, NODE, INDEX, 1).is_ok());
    row("segmented upload, 1000 bytes", took, segmented(&short, false), short.len());
    let value = 0x1234_5678u32.to_le_bytes();
    let took = bench.repeat(|master, now| master.sdo_write(now, NODE, INDEX, 2, &value[..]).is_ok());
    row("expedited download, 4 bytes, again and again", took, expedited(&value, true) * REPEATED, 0);
    let took = bench.repeat(|master, now| master.sdo_read(now, NODE, INDEX, 2).is_ok());
    row("expedited upload, 4 bytes, again and again", took, expedited(&value, false) * REPEATED, 0);
}

fn row(what: &str, took: Duration, bound: Duration, bytes: usize) {
    let rate = match bytes {
        0 => format!("{:.0}/s", f64::from(REPEATED) / took.as_secs_f64()),
        bytes => format!("{:.1} kB/s", bytes as f64 / took.as_secs_f64() / 1e3),
    };
    let share = 100.0 * bound.as_secs_f64() / took.as_secs_f64();
    line(what, &format!("{rate}, {share:.1} %"), "≥ 95 %");
}

/// Our master and a server, and the wire between them.
struct Bench {
    now: Instant,
    master: Master,
    server: Store,
    answers: VecDeque<Frame>,
}

impl Bench {
    fn new() -> Self {
        let master = Master::new(MasterConfig::default(), &[]).expect("a good configuration");
        Self { now: Instant::from_millis(1000), master, server: Store::new(NODE), answers: VecDeque::new() }
    }

    fn repeat(&mut self, ask: impl Fn(&mut Master, Instant) -> bool) -> Duration {
        (0..REPEATED).map(|_| self.run(&ask)).sum()
    }

    /// One transfer, from its request to its end.
    fn run(&mut self, ask: impl Fn(&mut Master, Instant) -> bool) -> Duration {
        let begin = self.now;
        assert!(ask(&mut self.master, self.now), "the master takes a request");
        loop {
            self.step();
            match self.master.poll_event() {
                Some(Event::SdoWritten { .. } | Event::SdoRead { .. }) => return self.now.since(begin),
                Some(Event::SdoFailed { error, .. }) => panic!("{error}"),
                _ => {}
            }
        }
    }

    /// Transmits the frame that wins arbitration, or advances the time to the next deadline.
    fn step(&mut self) {
        if self.master.poll_timeout().is_some_and(|due| due <= self.now) {
            self.master.handle_timeout(self.now);
        }
        // The server's identifiers are lower: its frames win.
        if let Some(frame) = self.answers.pop_front() {
            self.now += time(&frame);
            self.master.handle_rx(self.now, &frame);
        } else if let Some(frame) = self.master.poll_tx() {
            self.now += time(&frame);
            self.server.handle_rx(self.now, &frame);
        } else {
            self.now = self.now.max(self.master.poll_timeout().expect("a transfer has a deadline"));
        }
        while let Some(frame) = self.server.poll_tx() {
            self.answers.push_back(frame);
        }
    }
}

fn time(frame: &Frame) -> Duration {
    BIT * (frame_bits(frame) + INTERMISSION)
}

/// Wire time of frames with these data, to the node or from it.
fn sum(frames: impl IntoIterator<Item = (bool, [u8; 8])>) -> Duration {
    let id = |to_node| Id::Standard(if to_node { 0x600 } else { 0x580 } + u16::from(NODE));
    frames.into_iter().map(|(to_node, data)| time(&Frame::new(id(to_node), &data).expect("8 bytes"))).sum()
}

/// Frame that names the object. CiA 301, 9.2.4.3.
fn named(command: u8, sub: u8, rest: [u8; 4]) -> [u8; 8] {
    let [low, high] = INDEX.to_le_bytes();
    let [a, b, c, d] = rest;
    [command, low, high, sub, a, b, c, d]
}

fn plain(bytes: &[u8]) -> [u8; 8] {
    let mut frame = [0; 8];
    frame[..bytes.len()].copy_from_slice(bytes);
    frame
}

fn expedited(value: &[u8; 4], write: bool) -> Duration {
    match write {
        true => sum([(true, named(0x23, 2, *value)), (false, named(0x60, 2, [0; 4]))]),
        false => sum([(true, named(0x40, 2, [0; 4])), (false, named(0x43, 2, *value))]),
    }
}

fn segmented(data: &[u8], write: bool) -> Duration {
    let size = (data.len() as u32).to_le_bytes();
    let mut frames = match write {
        true => vec![(true, named(0x21, 1, size)), (false, named(0x60, 1, [0; 4]))],
        false => vec![(true, named(0x40, 1, [0; 4])), (false, named(0x41, 1, size))],
    };
    let count = data.chunks(7).len();
    for (nth, chunk) in data.chunks(7).enumerate() {
        let toggle = (nth as u8 & 1) << 4;
        let last = u8::from(nth + 1 == count);
        let mut segment = plain(&[]);
        segment[0] = toggle | (7 - chunk.len() as u8) << 1 | last;
        segment[1..=chunk.len()].copy_from_slice(chunk);
        frames.push((write, if write { segment } else { plain(&[]) }));
        let answer = if write { plain(&[0x20 | toggle]) } else { segment };
        if !write {
            frames.pop();
            frames.push((true, plain(&[0x60 | toggle])));
        }
        frames.push((false, answer));
    }
    sum(frames)
}

fn block_download(data: &[u8]) -> Duration {
    let size = (data.len() as u32).to_le_bytes();
    let begin = [(true, named(0xC6, 0, size)), (false, named(0xA4, 0, [127, 0, 0, 0]))];
    let end = [(true, end_of(data)), (false, plain(&[0xA1]))];
    sum(begin) + blocks(data, true) + sum(end)
}

fn block_upload(data: &[u8]) -> Duration {
    let size = (data.len() as u32).to_le_bytes();
    let begin = [(true, named(0xA4, 0, [127, 0, 0, 0])), (false, named(0xC6, 0, size)), (true, plain(&[0xA3]))];
    let end = [(false, end_of(data)), (true, plain(&[0xA1]))];
    sum(begin) + blocks(data, false) + sum(end)
}

/// 127 segments and an acknowledgement, repeated.
fn blocks(data: &[u8], write: bool) -> Duration {
    let count = data.chunks(7).len();
    let mut frames = Vec::new();
    for (nth, chunk) in data.chunks(7).enumerate() {
        let (seqno, last) = ((nth % 127 + 1) as u8, nth + 1 == count);
        let mut segment = plain(&[]);
        segment[0] = seqno | u8::from(last) << 7;
        segment[1..=chunk.len()].copy_from_slice(chunk);
        frames.push((write, segment));
        if seqno == 127 || last {
            frames.push((!write, plain(&[0xA2, seqno, 127])));
        }
    }
    sum(frames)
}

fn end_of(data: &[u8]) -> [u8; 8] {
    let unused = (7 - (data.len() - 1) % 7 - 1) as u8;
    let crc = data.iter().fold(0u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| crc << 1 ^ if crc >> 15 == 1 { 0x1021 } else { 0 })
    });
    let [low, high] = crc.to_le_bytes();
    plain(&[0xC1 | unused << 2, low, high])
}
