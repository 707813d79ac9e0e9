//! Stuck talkers, babbling boards, two boards of one address: the others are served, and who disturbs is named.

use super::*;
use crate::boards::Instruction;
use crate::crc::Crc8;
use crate::frame::{Frame, Words};
use crate::node::Health;
use crate::schedule::{Schedule, Turn};
use std::format;
use std::string::String;

/// SD1 in front and rear and SO1, polled at 4, 4 and 20 Hz.
struct Robot {
    wire: Wire,
    schedule: Schedule<4>,
    /// Good answers by address, and when the last came.
    good: [u32; 256],
    said: String,
}

const BOARDS: [u8; 3] = [sd1::FRONT, sd1::REAR, so1::ADDRESS];

const fn poll_of(address: u8) -> Instruction {
    if address == so1::ADDRESS { so1::GET_TICKS } else { sd1::GET_BOTH_DATA }
}

impl Robot {
    fn new(addresses: &[u8]) -> Self {
        let mut schedule = Schedule::new();
        for (address, ms) in BOARDS.into_iter().zip([250, 250, 50]) {
            let turn = Turn { to: address, instruction: poll_of(address).code };
            assert!(schedule.poll(Instant::ZERO, Duration::from_millis(ms), turn));
        }
        Self { wire: Wire::with(addresses, None), schedule, good: [0; 256], said: String::new() }
    }

    fn run(&mut self, seconds: u64) -> [u32; 3] {
        self.good = [0; 256];
        let end = self.wire.now + Duration::from_secs(seconds);
        while self.wire.now < end {
            if self.wire.master.is_idle()
                && let Some(turn) = self.schedule.due(self.wire.now)
            {
                self.wire.master.request(poll_of(turn.to).ask(turn.to, &[])).unwrap();
                self.wire.run();
            } else {
                let next = self.schedule.next().expect("there are polls");
                self.wire.pass(next.min(end));
            }
            self.hear();
        }
        BOARDS.map(|address| self.good[usize::from(address)])
    }

    fn hear(&mut self) {
        let now = self.wire.now;
        for event in core::mem::take(&mut self.wire.events) {
            match event {
                Event::Reply { to, status: Status::Ok, .. } => self.good[usize::from(to)] += 1,
                Event::Lost { node } => self.schedule.lost(now, node),
                Event::Back { node } => self.schedule.back(now, node),
                Event::Babble { who } => self.said += &format!("babble {who:02x?}; "),
                Event::BabbleOver { who } => self.said += &format!("babble over {who:02x?}; "),
                Event::Clash { node, certain } => self.said += &format!("clash {node:02x} {certain}; "),
                Event::ClashOver { node } => self.said += &format!("clash over {node:02x}; "),
                _ => {}
            }
        }
    }

    fn said(&mut self) -> String {
        core::mem::take(&mut self.said)
    }

    fn talk(&mut self, words: Vec<Word>, every: Duration) {
        self.wire.talkers.push(Talker { words, every, next: self.wire.now });
    }
}

fn frame(address: u8, data: &[u8]) -> Vec<Word> {
    let mut words = Words::new();
    Frame { address, instruction: 0x01, flags: 0, data }.encode(Crc8::SAE_J1850, &mut words);
    words.to_vec()
}

const ALL: [u32; 3] = [20, 20, 100];

#[test]
fn where_nobody_disturbs_nobody_is_named() {
    let mut robot = Robot::new(&BOARDS);
    assert_eq!(robot.run(5), ALL);
    assert_eq!(robot.said(), "");
    assert_eq!(robot.wire.master.bus_statistics().surplus_words, 0);
}

#[test]
fn a_babbling_board_is_named_and_the_others_are_served() {
    let mut robot = Robot::new(&BOARDS);
    // The board in the rear says 25 words each 31 ms, asked or not: a thirteenth of the wire.
    robot.talk(frame(sd1::REAR, &[1; 20]), Duration::from_millis(31));
    let [front, _, so1] = robot.run(5);
    assert_eq!((front, so1), (ALL[0], ALL[2]), "{}", robot.said());
    assert_eq!(robot.said(), "babble Some(11); ");
    robot.wire.talkers.clear();
    assert_eq!(robot.run(5), ALL);
    assert_eq!(robot.said(), "babble over Some(11); ");
}

#[test]
fn a_device_of_an_address_that_nobody_knows_is_named_by_it() {
    let mut robot = Robot::new(&BOARDS);
    robot.talk(frame(0x77, &[]), Duration::from_millis(31));
    assert_eq!(robot.run(5), ALL);
    assert_eq!(robot.said(), "babble Some(77); ");
}

#[test]
fn who_sends_words_that_are_no_frames_cannot_be_named() {
    let mut robot = Robot::new(&BOARDS);
    robot.talk([0x55; 20].map(Word::data).to_vec(), Duration::from_millis(31));
    assert_eq!(robot.run(5), ALL);
    assert_eq!(robot.said(), "babble None; ");
    robot.wire.talkers.clear();
    assert_eq!(robot.run(5), ALL);
    assert_eq!(robot.said(), "babble over None; ");
}

#[test]
fn a_talker_that_never_stops_takes_the_bus_and_gives_it_back() {
    let mut robot = Robot::new(&BOARDS);
    robot.talk([0x55; 20].map(Word::data).to_vec(), word_time(BAUD) * 20);
    let served = robot.run(30);
    assert_eq!(served.iter().sum::<u32>(), 0, "physics: two at once are nobody");
    assert_eq!(robot.said(), "babble None; ");
    assert!(BOARDS.iter().all(|board| robot.wire.master.health(*board) == Health::Lost));
    robot.wire.talkers.clear();
    robot.run(3);
    assert_eq!(robot.said(), "babble over None; ");
    assert_eq!(robot.run(5), ALL);
}

/// Answers that overlap, whether they begin together or a word apart.
fn overlap(delay: Duration) {
    let mut robot = Robot::new(&[sd1::FRONT, sd1::REAR, so1::ADDRESS, so1::ADDRESS]);
    robot.wire.slaves[3].set_delay(delay);
    let served = robot.run(5);
    assert_eq!(served, [ALL[0], ALL[1], 0], "{}", robot.said());
    assert_eq!(robot.said(), "clash 20 false; ");
    robot.wire.slaves.pop();
    robot.run(1);
    assert_eq!(robot.said(), "clash over 20; ");
    assert_eq!(robot.run(5), ALL);
}

#[test]
fn a_board_whose_answers_alone_are_damaged_clashes_perhaps() {
    overlap(Duration::from_micros(200));
    overlap(Duration::from_micros(300));
}

#[test]
fn two_boards_of_one_address_that_answer_each_other_babble_under_it() {
    let mut robot = Robot::new(&[sd1::FRONT, sd1::REAR, so1::ADDRESS, so1::ADDRESS]);
    robot.wire.slaves[3].set_delay(Duration::from_millis(3));
    robot.run(5);
    assert_eq!(robot.said(), "babble Some(20); ");
}

#[test]
fn a_silent_board_does_not_starve_the_others() {
    let mut robot = Robot::new(&[sd1::FRONT, sd1::REAR, so1::ADDRESS]);
    robot.wire.slaves.remove(1);
    // 62 ms of three timeouts cost the fast poll one turn each time, one timeout costs it none.
    let [front, rear, so1] = robot.run(3);
    assert_eq!((front, rear), (12, 0));
    assert!(so1 >= 60 - 12, "{so1}");
    let [front, _, so1] = robot.run(5);
    assert_eq!((front, so1), (ALL[0], ALL[2]));
    assert_eq!(robot.said(), "");
}

#[test]
fn noise_blames_nobody() {
    for flips in [1000, 600, 300, 200, 100, 50] {
        let mut robot = Robot::new(&BOARDS);
        robot.wire.flips = Some(flips);
        let served = robot.run(300);
        assert_eq!(robot.said(), "", "one bit in {flips}");
        // At 1e-3 one transaction in a hundred fails, after three attempts.
        let asked = ALL.map(|polls| polls * 60);
        let most = served.iter().zip(asked).all(|(served, asked)| *served > asked * 97 / 100);
        assert!(most || flips < 1000, "{served:?} of {asked:?}");
    }
}

#[test]
fn who_disturbs_a_noisy_wire_is_named_all_the_same() {
    let mut robot = Robot::new(&BOARDS);
    robot.wire.flips = Some(10_000);
    robot.talk(frame(sd1::REAR, &[1; 20]), Duration::from_millis(31));
    robot.run(5);
    assert_eq!(robot.said(), "babble Some(11); ");

    let mut robot = Robot::new(&[sd1::FRONT, sd1::REAR, so1::ADDRESS, sd1::REAR]);
    robot.wire.flips = Some(10_000);
    robot.run(5);
    assert_eq!(robot.said(), "clash 11 false; ");
}
