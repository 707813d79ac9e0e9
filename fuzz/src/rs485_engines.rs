//! EIA-485 master and boards on a disturbed line.

use base::serial::Word;
use base::{Duration, Instant};
use rs485::boards::psc1;
use rs485::frame::Status;
use rs485::master::{self, Event, Lengths, Master, Request};
use rs485::slave::{self, Slave};

const NODE: u8 = 0x20;

struct Wire {
    now: Instant,
    master: Master,
    slave: Slave,
    /// Requests without their event, and whether one has been made since.
    open: u32,
    to_slave: Vec<Word>,
    to_master: Vec<Word>,
}

impl Wire {
    fn drain(&mut self) {
        self.to_slave.extend(self.master.poll_tx(self.now).into_iter().flat_map(|transmit| transmit.words));
        assert!(self.master.poll_tx(self.now).is_none(), "sent twice");
        while let Some(event) = self.master.poll_event() {
            match event {
                Event::Reply { .. }
                | Event::Sent { .. }
                | Event::Silent { .. }
                | Event::Garbled { .. }
                | Event::Unsent { .. } => self.open -= 1,
                Event::Degraded { .. } | Event::Recovered { .. } | Event::Lost { .. } | Event::Back { .. } => {}
                Event::Unasked { instruction, data, .. } => {
                    assert!(
                        psc1::UNASKED.iter().any(|known| known.code == instruction && known.answer.allow(data.len()))
                    );
                }
                Event::Babble { .. } | Event::BabbleOver { .. } | Event::Clash { .. } | Event::ClashOver { .. } => {}
            }
        }
        assert_eq!(self.open, u32::from(!self.master.is_idle()), "one event for each request");
        self.to_master.extend(self.slave.poll_tx(self.now).into_iter().flat_map(|transmit| transmit.words));
    }

    fn handle_timeout(&mut self) {
        self.master.handle_timeout(self.now);
        self.slave.handle_timeout(self.now);
        self.drain();
        for due in [self.master.poll_timeout(), self.slave.poll_timeout()].into_iter().flatten() {
            assert!(due > self.now, "due at {due:?}, served at {:?}", self.now);
        }
    }

    fn pass(&mut self, duration: Duration) {
        let end = self.now + duration;
        while let Some(due) = [self.master.poll_timeout(), self.slave.poll_timeout()]
            .into_iter()
            .flatten()
            .min()
            .filter(|due| *due <= end)
        {
            self.now = self.now.max(due);
            self.handle_timeout();
        }
        self.now = end;
        self.handle_timeout();
    }
}

/// An EIA-485 master and a slave with arbitrary, damaged and lost words and time steps.
///
/// Each request ends with one event. After each call and its draining the next deadline lies ahead. The request after
/// the disturbance is answered.
pub fn rs485_engines(data: &[u8]) {
    let Some(input) = crate::input::<(bool, bool, Vec<(u8, u16, [u8; 4])>)>(data) else { return };
    let (full_duplex, talks, steps) = input;
    let unasked = if talks { psc1::UNASKED } else { &[] };
    let mut master = Master::new(master::Config { full_duplex, unasked, ..master::Config::default() });
    master.add_node(NODE, Duration::from_millis(20));
    let mut wire = Wire {
        now: Instant::from_millis(1000),
        master,
        slave: Slave::new(slave::Config::new(NODE)),
        open: 0,
        to_slave: Vec::new(),
        to_master: Vec::new(),
    };
    for (what, number, bytes) in steps {
        let word = Word { byte: bytes[0], ninth: bytes[1] & 1 != 0 };
        match what % 12 {
            0 => {
                let to = if bytes[1] & 1 != 0 { NODE } else { bytes[1] };
                let data = vec![bytes[2]; usize::from(number) % 300];
                let answer = if bytes[3] & 1 != 0 { Lengths::ANY } else { Lengths::between(bytes[2], bytes[3]) };
                let request = Request { to, instruction: bytes[0], data: &data, no_ack: bytes[3] & 2 != 0, answer };
                wire.open += u32::from(wire.master.request(request).is_ok());
            }
            1 => wire.master.handle_rx(wire.now, &[word]),
            2 => wire.slave.handle_rx(wire.now, &[word]),
            3 => wire.slave.handle_rx(wire.now, &bytes.map(Word::data)),
            4 => wire.master.handle_tx_done(wire.now),
            // What was sent arrives, all of it, or not all.
            5 | 6 => {
                let mut words = std::mem::take(&mut wire.to_slave);
                damage(&mut words, what % 12 == 6, bytes);
                wire.slave.handle_rx(wire.now, &words);
                wire.master.handle_tx_done(wire.now);
            }
            7 | 8 => {
                let mut words = std::mem::take(&mut wire.to_master);
                damage(&mut words, what % 12 == 8, bytes);
                wire.master.handle_rx(wire.now, &words);
            }
            9 => {
                while let Some(asked) = wire.slave.poll_request() {
                    assert!(asked.data.len() <= 255);
                    let status = Status::from_byte(bytes[0] % 5).unwrap_or(Status::Ok);
                    wire.slave.respond(status, &vec![bytes[1]; usize::from(number) % 300]);
                }
            }
            10 if bytes[0] == 0 => {
                wire.master.cancel();
                wire.open = 0;
            }
            10 => wire.pass(Duration::from_micros(u64::from(number))),
            _ => wire.pass(Duration::from_micros(u64::from(number) << (bytes[0] % 24))),
        }
        wire.drain();
    }
    wire.pass(Duration::from_secs(10));
    assert!(wire.master.is_idle(), "it never ends");
    // Whatever came before: on a wire that is whole, what is asked is answered.
    wire.to_slave.clear();
    wire.to_master.clear();
    wire.slave.reset();
    wire.master.request(Request::new(NODE, 1, &[])).expect("it is idle");
    wire.open += 1;
    wire.pass(Duration::from_millis(1));
    let request = std::mem::take(&mut wire.to_slave);
    wire.now += Duration::from_millis(1);
    wire.slave.handle_rx(wire.now, &request);
    wire.master.handle_tx_done(wire.now);
    assert!(wire.slave.poll_request().is_some_and(|asked| asked.instruction == 1));
    wire.slave.respond(Status::Ok, &[7]);
    wire.pass(Duration::from_millis(1));
    let answer = std::mem::take(&mut wire.to_master);
    wire.master.handle_rx(wire.now, &answer);
    assert!(
        std::iter::from_fn(|| wire.master.poll_event())
            .any(|event| matches!(event, Event::Reply { status: Status::Ok, data, .. } if data[..] == [7])),
        "not understood"
    );
}

fn damage(words: &mut Vec<Word>, damaged: bool, bytes: [u8; 4]) {
    if damaged && !words.is_empty() {
        let at = usize::from(bytes[0]) % words.len();
        match bytes[1] % 3 {
            0 => words.truncate(at),
            1 => words[at].byte ^= bytes[2],
            _ => words[at].ninth ^= true,
        }
    }
}
