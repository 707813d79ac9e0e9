//! An I2C bus: one transfer after the other, each as long as its bits take. The process that emulates the chips
//! receives the transfer at the START and answers at once; the master receives the outcome after the STOP.

use super::news::Traffic;
use super::owner::Owner;
use base::i2c::{Error, Outcome, Transfer};
use base::{Duration, Instant};
use i2c::{STRETCH_MAX, duration};
use module::OUTSTANDING;
use std::collections::VecDeque;

/// One wire.
#[derive(Debug)]
pub(super) struct I2cWire {
    pub hz: u32,
    pub ports: Vec<Owner>,
    /// Port of the process that emulates the chips.
    chips: Option<Owner>,
    queue: VecDeque<(Owner, Transfer)>,
    now: Now,
    /// Number of abandoned requests whose answers may still arrive.
    stale: u32,
    pub traffic: Traffic,
}

/// Current state of the wire.
#[derive(Debug)]
enum Now {
    Nothing,
    /// A request to the chips: its time, and the time at which it is abandoned.
    Asked(Instant, Instant),
    /// End of the transfer, and its outcome.
    Answered(Instant, Outcome),
}

/// Event of the bus.
#[derive(Debug, PartialEq)]
pub(super) enum I2cEvent {
    /// For the emulator of the chips: a transfer of the master.
    Asked(Owner, Transfer),
    /// For a master: the outcome of its transfer.
    Over(Owner, Transfer, Outcome),
}

impl I2cWire {
    pub fn new(hz: u32) -> Self {
        let (ports, queue) = (Vec::new(), VecDeque::new());
        Self { hz: hz.max(1), ports, chips: None, queue, now: Now::Nothing, stale: 0, traffic: Traffic::default() }
    }

    pub fn join(&mut self, owner: Owner, emulates: bool) {
        self.ports.push(owner);
        if emulates {
            (self.chips, self.stale) = (Some(owner), 0);
        }
    }

    pub fn send(&mut self, owner: Owner, transfer: Transfer) {
        if self.queue.iter().filter(|(own, _)| *own == owner).count() < OUTSTANDING {
            self.queue.push_back((owner, transfer));
        } else {
            self.traffic.dropped += 1;
        }
    }

    /// Processes the chips' answer to the current transfer.
    pub fn answer(&mut self, now: Instant, owner: Owner, outcome: Outcome) {
        if self.chips != Some(owner) {
            return;
        }
        if self.stale > 0 {
            self.stale -= 1;
        } else if let (Now::Asked(start, _), Some((_, transfer))) = (&self.now, self.queue.front()) {
            let over = (*start + duration(transfer, &outcome, self.hz)).max(now);
            self.now = Now::Answered(over, outcome);
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.now {
            // At once.
            Now::Nothing => (!self.queue.is_empty()).then_some(Instant::ZERO),
            Now::Asked(_, until) | Now::Answered(until, _) => Some(*until),
        }
    }

    /// Next event at `now`; called until `None`.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<I2cEvent> {
        match &self.now {
            Now::Nothing => self.start(now),
            Now::Asked(_, until) if *until <= now => {
                self.stale += 1;
                self.finish(STRETCH_MAX, Err(Error::Stretched))
            }
            Now::Answered(until, outcome) if *until <= now => {
                let outcome = outcome.clone();
                let busy = self.queue.front().map_or(Duration::ZERO, |(_, t)| duration(t, &outcome, self.hz));
                self.finish(busy, outcome)
            }
            Now::Asked(..) | Now::Answered(..) => None,
        }
    }

    fn start(&mut self, now: Instant) -> Option<I2cEvent> {
        let (_, transfer) = self.queue.front()?;
        match self.chips {
            Some(chips) => {
                self.now = Now::Asked(now, now + STRETCH_MAX);
                Some(I2cEvent::Asked(chips, transfer.clone()))
            }
            None => {
                let outcome = Err(Error::NoAddress);
                self.now = Now::Answered(now + duration(transfer, &outcome, self.hz), outcome);
                None
            }
        }
    }

    fn finish(&mut self, busy: Duration, outcome: Outcome) -> Option<I2cEvent> {
        self.now = Now::Nothing;
        self.traffic.sent += 1;
        self.traffic.errors += u64::from(outcome.is_err());
        self.traffic.busy += busy;
        self.queue.pop_front().map(|(owner, transfer)| I2cEvent::Over(owner, transfer, outcome))
    }

    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
        let busy = !matches!(self.now, Now::Nothing);
        if busy && self.queue.front().is_some_and(|(owner, _)| owner.pid == pid) {
            // The lines are free again; the late answer is ignored.
            self.stale += u32::from(matches!(self.now, Now::Asked(..)));
            self.now = Now::Nothing;
        }
        self.queue.retain(|(owner, _)| owner.pid != pid);
        if self.chips.take_if(|chips| chips.pid == pid).is_some() && matches!(self.now, Now::Asked(..)) {
            self.now = Now::Nothing;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::i2c::{Address, Bytes, Read};
    use module::PortId;

    fn owner(pid: u32) -> Owner {
        Owner { pid, port: PortId(0) }
    }

    fn read_byte() -> Transfer {
        let write = Bytes::from_slice(&[0x00]).unwrap();
        Transfer { address: Address::new(0x18).unwrap(), write, read: Read::Exactly(1) }
    }

    fn at(us: u64) -> Instant {
        Instant::from_nanos(us * 1000)
    }

    fn wire() -> I2cWire {
        let mut wire = I2cWire::new(100_000);
        wire.join(owner(1), true);
        wire.join(owner(2), false);
        wire
    }

    #[test]
    fn reading_a_byte_takes_forty_clocks() {
        let mut wire = wire();
        wire.send(owner(2), read_byte());
        assert_eq!(wire.handle_timeout(at(100)), Some(I2cEvent::Asked(owner(1), read_byte())));
        let outcome = Ok(Bytes::from_slice(&[41]).unwrap());
        wire.answer(at(100), owner(1), outcome.clone());
        // Two STARTs, four bytes, STOP and the pause.
        assert_eq!(wire.poll_timeout(), Some(at(100 + 400)));
        assert_eq!(wire.handle_timeout(at(499)), None);
        assert_eq!(wire.handle_timeout(at(500)), Some(I2cEvent::Over(owner(2), read_byte(), outcome)));
        assert_eq!((wire.poll_timeout(), wire.traffic.busy), (None, Duration::from_micros(400)));
    }

    #[test]
    fn without_chips_no_address_is_acknowledged_and_a_gone_master_gets_no_answer() {
        let mut wire = wire();
        wire.close(1);
        wire.send(owner(2), read_byte());
        assert_eq!(wire.handle_timeout(at(0)), None);
        let over = wire.poll_timeout().unwrap();
        assert_eq!(wire.handle_timeout(over), Some(I2cEvent::Over(owner(2), read_byte(), Err(Error::NoAddress))));
        wire.send(owner(2), read_byte());
        assert_eq!(wire.handle_timeout(at(1000)), None);
        wire.close(2);
        assert_eq!(wire.poll_timeout(), None);
    }

    #[test]
    fn a_late_answer_is_not_taken_for_that_of_the_next_transfer() {
        let mut wire = wire();
        wire.send(owner(2), read_byte());
        wire.send(owner(2), read_byte());
        assert!(matches!(wire.handle_timeout(at(0)), Some(I2cEvent::Asked(..))));
        assert_eq!(wire.handle_timeout(at(35_000)), Some(I2cEvent::Over(owner(2), read_byte(), Err(Error::Stretched))));
        assert!(matches!(wire.handle_timeout(at(35_000)), Some(I2cEvent::Asked(..))));
        wire.answer(at(36_000), owner(1), Ok(Bytes::from_slice(&[1]).unwrap()));
        wire.answer(at(36_000), owner(1), Ok(Bytes::from_slice(&[2]).unwrap()));
        let told = wire.handle_timeout(at(37_000));
        assert_eq!(told, Some(I2cEvent::Over(owner(2), read_byte(), Ok(Bytes::from_slice(&[2]).unwrap()))));
    }

    #[test]
    fn few_transfers_may_wait() {
        let mut wire = wire();
        (0..20).for_each(|_| wire.send(owner(2), read_byte()));
        assert_eq!((wire.queue.len(), wire.traffic.dropped), (OUTSTANDING, 12));
    }
}
