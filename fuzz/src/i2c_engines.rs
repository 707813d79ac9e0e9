//! Bit-banged I2C master, fan controller, SMBus commands.

use base::i2c::{Address, Bytes, Error, Outcome, Read, Transfer};
use base::{Duration, Instant};
use i2c::bitbang::{Config, Levels, Master};
use i2c::max6615::chip::Chip;
use i2c::max6615::{self, Max6615};
use i2c::smbus::Command;
use i2c::target::answer;
use i2c::wire::Wire;
use arbitrary::Arbitrary;

#[derive(Arbitrary, Debug)]
enum Step {
    Request { address: u8, write: Vec<u8>, read: u8, block: bool },
    Run { steps: u8, late_us: u16 },
    Disturb { scl: bool, sda: bool },
    Stretch { ms: u8 },
    Restart,
    Round { outcomes: Vec<Option<Vec<u8>>> },
    Answer { code: u8, data: Vec<u8>, pec: bool, outcome: Vec<u8> },
}

struct Bench {
    wire: Wire<Chip>,
    master: Master,
    lines: Levels,
    now: Instant,
}

impl Bench {
    fn step(&mut self, late: Duration) -> bool {
        let Some(at) = self.master.poll_timeout() else { return false };
        self.now = self.now.max(at) + late;
        self.wire.advance(self.now);
        if let Some(lines) = self.master.handle_timeout(self.now, self.wire.levels()) {
            assert!(lines.scl == self.lines.scl || lines.sda == self.lines.sda, "one line at a time");
            self.lines = lines;
            self.wire.drive(lines);
        }
        true
    }

    fn finish(&mut self) -> Option<Outcome> {
        let mut steps = 0;
        while self.step(Duration::ZERO) {
            steps += 1;
            assert!(steps < 2_000_000, "a transfer ends");
        }
        self.master.poll_event()
    }
}

fn bytes(bytes: &[u8]) -> Bytes {
    bytes.iter().copied().take(36).collect()
}

/// The bit-banged master and the fan controller on lines that others pull too, at any time; driver and SMBus with
/// arbitrary outcomes.
///
/// Each request ends with one outcome in bounded work, and changes one line at a time. Undisturbed, the next read is
/// right. A round of the driver ends.
pub fn i2c_engines(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<Step>>(data) else { return };
    let address = Address::new(max6615::ADDRESS).unwrap();
    let mut bench = Bench {
        wire: Wire::new(Chip::new(address, [2400.0; 2])),
        master: Master::new(Config::default()),
        lines: Levels::HIGH,
        now: Instant::ZERO,
    };
    let mut driver = Max6615::new(max6615::Config::new(address)).unwrap();
    for step in steps {
        match step {
            Step::Request { address, write, read, block } => {
                bench.finish();
                let address = Address::new(address & 0x7F).unwrap();
                let read = if block { Read::Block { extra: read % 4 } } else { Read::Exactly(read % 37) };
                let write = bytes(&write);
                bench.master.request(bench.now, Transfer { address, write, read }).unwrap();
            }
            Step::Run { steps, late_us } => {
                (0..steps).for_each(|_| _ = bench.step(Duration::from_micros(late_us.into())));
            }
            Step::Disturb { scl, sda } => bench.wire.disturb(Levels { scl, sda }),
            Step::Stretch { ms } => bench.wire.slave.stretch = Duration::from_millis((ms % 64).into()),
            Step::Restart => {
                (bench.master, bench.lines) = (Master::new(Config::default()), Levels::HIGH);
                bench.wire.drive(Levels::HIGH);
            }
            Step::Round { outcomes } => {
                driver.begin();
                let (mut outcomes, mut count) = (outcomes.into_iter(), 0);
                while let Some(transfer) = driver.poll_transfer() {
                    let outcome = match outcomes.next() {
                        Some(Some(read)) => Ok(bytes(&read)),
                        Some(None) => Err(Error::Stretched),
                        None => answer(&mut [&mut bench.wire.slave.target], &transfer),
                    };
                    driver.handle_outcome(&outcome);
                    count += 1;
                    assert!(count < 200, "a round ends");
                }
                while driver.poll_event().is_some() {}
            }
            Step::Answer { code, data, pec, outcome } => {
                let commands = [
                    Command::ReadByte { code },
                    Command::ReadWord { code },
                    Command::BlockRead { code },
                    Command::BlockProcessCall { code, data: &data },
                    Command::Quick { read: pec },
                ];
                for command in commands {
                    let _ = command.transfer(address, pec);
                    let _ = command.answer(address, pec, &Ok(bytes(&outcome)));
                }
            }
        }
    }
    bench.wire.disturb(Levels::HIGH);
    bench.wire.slave.stretch = Duration::ZERO;
    bench.finish();
    bench.now += Duration::from_millis(100);
    bench.wire.advance(bench.now);
    let write = bytes(&[max6615::register::DEVICE]);
    bench.master.request(bench.now, Transfer { address, write, read: Read::Exactly(1) }).unwrap();
    assert_eq!(bench.finish(), Some(Ok(bytes(&[max6615::DEVICE]))));
}
