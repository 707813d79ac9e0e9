//! SDO client and server, on a line with errors and against invented answers.

use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Entry};
use canopen::sdo::{BLOCK_SIZE, Client, Error, Server};
use canopen::{Dictionary, Payload, drives};
use std::collections::VecDeque;

type Step = (u8, u16, [u8; 8]);

const INDEX: u16 = 0x2F00;
/// What block transfers and segments begin with, and aborts.
const COMMANDS: [u8; 16] =
    [0x01, 0x02, 0x81, 0x82, 0xA0, 0xA1, 0xA2, 0xA3, 0xA4, 0xC0, 0xC1, 0xC2, 0xC6, 0xD5, 0x80, 0x60];

/// An SDO client and a server, segmented and in blocks, with arbitrary, damaged, doubled, late and lost frames.
///
/// The client ends each transfer once, in bounded time; an undisturbed read returns the server's data. On a line
/// without arbitrary frames a block transfer is right or ends in an error, and the next one finds both ends free.
pub fn canopen_sdo(data: &[u8]) {
    let Some(input) = crate::input::<(bool, Vec<Step>)>(data) else { return };
    match input {
    (true, steps) => made_up(steps),
    (false, steps) => on_a_line(&steps),
}}

fn objects() -> Dictionary {
    drives::epos::dictionary(1).with(&[Entry::new(INDEX, 0, DataType::Domain, Access::ReadWrite, 0)])
}

/// Both ends hear whatever anyone may say.
fn made_up(steps: Vec<Step>) {
    let mut objects = objects();
    let (mut client, mut server) = (Client::new(Duration::from_millis(500)), Server::new(Duration::from_secs(2)));
    let mut now = Instant::from_millis(1000);
    let (mut open, mut disturbed, mut reads) = (0_u32, true, false);
    let mut answers: Vec<[u8; 8]> = Vec::new();
    for (what, number, mut data) in steps {
        let (index, sub) = match data[7] & 3 {
            0 => (INDEX, 0),
            1 => (0x1000 | number & 0x1F, data[6] & 7),
            _ => (number, data[6] & 7),
        };
        if what >= 128 {
            data[0] = COMMANDS[usize::from(data[0] % 16)];
            [data[1], data[2]] = index.to_le_bytes();
            data[3] = sub;
        }
        match what % 12 {
            0 | 1 => {
                let taken = match what % 12 {
                    0 => client.read(now, index, sub),
                    _ => client.read_block(now, index, sub),
                };
                (open, reads, disturbed) = (open + u32::from(taken), reads || taken, disturbed && !taken);
            }
            2 | 3 => {
                let payload = Payload::from(&vec![data[0]; usize::from(data[1]) << (data[2] % 5)][..]);
                let taken = match what % 12 {
                    2 => client.write(now, index, sub, payload),
                    _ => client.write_block(now, index, sub, payload),
                };
                (open, reads, disturbed) = (open + u32::from(taken), reads && !taken, disturbed || taken);
            }
            4 => {
                disturbed = true;
                client.handle_rx(now, &data[..8 - usize::from(number % 16 / 15)]);
            }
            5 => {
                disturbed = true;
                answers.extend(server.handle_rx(now, &data[..8 - usize::from(number % 16 / 15)], &mut objects));
            }
            // What is on the way arrives: well, damaged, twice, or not at all.
            6..=8 => {
                while let Some(request) = client.poll_tx() {
                    answers.extend(server.handle_rx(now, &request, &mut objects));
                }
                answers.extend(std::iter::from_fn(|| server.poll_tx()));
                for mut answer in std::mem::take(&mut answers) {
                    match what % 12 {
                        6 => client.handle_rx(now, &answer),
                        7 => {
                            disturbed = true;
                            answer[usize::from(number % 8)] ^= data[0];
                            client.handle_rx(now, &answer);
                        }
                        _ => {
                            disturbed = true;
                            client.handle_rx(now, &answer);
                            client.handle_rx(now, &answer);
                        }
                    }
                }
            }
            9 => {
                disturbed = true;
                (answers, _) = (Vec::new(), client.poll_tx());
            }
            10 => {
                open -= u32::from(!client.is_idle());
                client.cancel();
                server.reset();
                // What is on the way answers nobody.
                (answers, disturbed) = (Vec::new(), true);
            }
            _ => {
                disturbed = true;
                now += Duration::from_micros(u64::from(number) << (data[0] % 24));
                client.handle_timeout(now);
                answers.extend(server.handle_timeout(now));
                for due in [client.poll_timeout(), server.poll_timeout()].into_iter().flatten() {
                    assert!(due > now, "due at {due:?}, served at {now:?}");
                }
            }
        }
        answers.truncate(1000);
        while let Some(done) = client.poll_done() {
            open -= 1;
            if reads
                && !disturbed
                && let Ok(payload) = &done.result
            {
                let there = objects.read(done.index, done.sub).expect("it was read");
                assert_eq!(&payload[..], &there[..]);
            }
        }
        assert_eq!(open, u32::from(!client.is_idle()), "one end for each transfer");
    }
    for _ in 0..100 {
        let Some(due) = [client.poll_timeout(), server.poll_timeout()].into_iter().flatten().min() else { break };
        now = now.max(due);
        client.handle_timeout(now);
        server.handle_timeout(now);
        let left = std::iter::from_fn(|| client.poll_tx().or_else(|| server.poll_tx())).count();
        assert!(left <= 2 * usize::from(BLOCK_SIZE) + 4, "{left} frames without an acknowledge");
        while client.poll_done().is_some() {}
    }
    assert!(client.is_idle() && server.poll_timeout().is_none(), "it never ends");
}

/// Client and server on a line that keeps the order of its frames.
struct Line {
    now: Instant,
    client: Client,
    server: Server,
    objects: Dictionary,
    greedy: bool,
    /// Whether to the server, and what.
    wire: VecDeque<(bool, [u8; 8])>,
}

impl Line {
    fn drain(&mut self) {
        while self.greedy || self.wire.is_empty() {
            let request = self.client.poll_tx().map(|frame| (true, frame));
            let Some(frame) = request.or_else(|| self.server.poll_tx().map(|frame| (false, frame))) else { return };
            self.wire.push_back(frame);
        }
    }

    fn arrive(&mut self, (to_server, frame): (bool, [u8; 8])) {
        if to_server {
            let answer = self.server.handle_rx(self.now, &frame, &mut self.objects);
            self.wire.extend(answer.map(|answer| (false, answer)));
        } else {
            self.client.handle_rx(self.now, &frame);
        }
    }

    fn timers(&mut self) {
        self.client.handle_timeout(self.now);
        let answer = self.server.handle_timeout(self.now);
        self.wire.extend(answer.map(|answer| (false, answer)));
    }

    /// To the end of all that was begun. Gives how the client's transfer ended, and how many frames were lost or
    /// doubled, and damaged.
    fn run(&mut self, steps: &[Step]) -> (Result<Payload, Error>, usize, usize) {
        let (mut done, mut steps, mut at) = (None, steps.iter(), 0);
        let (mut spoiled, mut damaged) = (0, 0);
        loop {
            self.drain();
            done = done.or(self.client.poll_done());
            if let Some((to_server, mut frame)) = self.wire.pop_front() {
                self.now += Duration::from_micros(100);
                let (what, number, data) = steps.next().copied().unwrap_or((255, 0, [0; 8]));
                match what % 32 {
                    0 => spoiled += 1,
                    1 => {
                        spoiled += 1;
                        self.arrive((to_server, frame));
                        self.arrive((to_server, frame));
                    }
                    2 => {
                        // What begins a transfer may become another beginning, which no CRC covers.
                        damaged += if at < 3 { 2 } else { 1 };
                        frame[usize::from(number % 8)] ^= data[0];
                        self.arrive((to_server, frame));
                    }
                    what => {
                        if what == 3 {
                            self.now += Duration::from_millis(u64::from(number % 1024));
                            self.timers();
                        }
                        self.arrive((to_server, frame));
                    }
                }
                at += 1;
                assert!(at < 100_000, "frames for ever");
            } else {
                let due = [self.client.poll_timeout(), self.server.poll_timeout()].into_iter().flatten().min();
                let Some(due) = due else {
                    return (done.expect("it ended").result, spoiled, damaged);
                };
                self.now = self.now.max(due);
                self.timers();
            }
        }
    }
}

fn on_a_line(steps: &[Step]) {
    let Some(((what, number, [blksize, seed, ..]), steps)) = steps.split_first() else { return };
    let (write, mut pattern) = (what & 1 != 0, u32::from(*seed));
    let data: Vec<u8> = (0..number % 2500)
        .map(|_| {
            pattern = pattern.wrapping_mul(1_664_525).wrapping_add(u32::from(*seed));
            (pattern >> 24) as u8
        })
        .collect();
    let mut line = Line {
        now: Instant::from_millis(1000),
        client: Client::new(Duration::from_millis(500)).with_block_size(*blksize),
        server: Server::new(Duration::from_millis(800)).with_block_size(*blksize),
        objects: objects(),
        greedy: what & 2 != 0,
        wire: VecDeque::new(),
    };
    let begun = if write {
        line.client.write_block(line.now, INDEX, 0, Payload::from(&data[..]))
    } else {
        line.objects.set_bytes(INDEX, 0, &data);
        line.client.read_block(line.now, INDEX, 0)
    };
    assert!(begun);
    let (result, spoiled, damaged) = line.run(steps);
    // The size and a CRC of 16 bits tell two frames lost or doubled, or one damaged byte, for certain, and more only
    // nearly always. Little is read without a CRC.
    let guarded = write || data.len() > 28;
    if damaged == 0 && spoiled <= 2 || damaged == 1 && spoiled == 0 && guarded {
        let there = line.objects.read(INDEX, 0).expect("it is there");
        let server = there[..] == data[..] || write && there.is_empty() && result.is_err();
        assert!(server, "the server has {} bytes of {}", there.len(), data.len());
        if let Ok(read) = &result {
            assert!(if write { read.is_empty() } else { read[..] == data[..] }, "the client has other data");
        }
    }
    line.now += Duration::from_secs(5);
    assert!(line.client.write_block(line.now, INDEX, 0, Payload::from(&data[..])));
    assert_eq!(line.run(&[]).0, Ok(Payload::EMPTY));
}
