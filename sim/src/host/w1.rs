//! A 1-Wire bus as the kernel serves it: one request after the other, each as long as the slow bus takes.

use super::Owner;
use super::news::Traffic;
use base::w1::{Answer, Error, List, Request, Rom};
use base::{Duration, Instant};
use module::OUTSTANDING;
use std::collections::{BTreeMap, VecDeque};

/// Reset and presence, 8 bits of the search command, and 64 bits of three slots for each device.
const SEARCH: (Duration, Duration) = (Duration::from_micros(1500), Duration::from_micros(13_440));
/// A conversion of 12 bits, and the scratchpad to be read then.
const CONVERSION: Duration = Duration::from_micros(765_000);

/// One wire.
#[derive(Debug, Default)]
pub(super) struct W1Wire {
    pub ports: Vec<Owner>,
    /// Who emulates the thermometers.
    devices: Option<Owner>,
    there: List,
    said: BTreeMap<Rom, Result<i32, Error>>,
    queue: VecDeque<(Owner, Request)>,
    until: Option<Instant>,
    pub traffic: Traffic,
}

impl W1Wire {
    pub fn join(&mut self, owner: Owner, emulates: bool) {
        self.ports.push(owner);
        if emulates {
            self.devices = Some(owner);
        }
    }

    pub fn send(&mut self, now: Instant, owner: Owner, request: Request) {
        if self.queue.iter().filter(|(own, _)| *own == owner).count() >= OUTSTANDING {
            self.traffic.dropped += 1;
            return;
        }
        self.queue.push_back((owner, request));
        self.go_on(now);
    }

    /// What the thermometers are from now on.
    pub fn is(&mut self, owner: Owner, answer: Answer) {
        if self.devices == Some(owner) {
            match answer {
                Answer::List(list) => self.there = list,
                Answer::Temperature(rom, said) => {
                    // As many as can be on the bus.
                    if self.there.contains(&rom) {
                        self.said.insert(rom, said);
                    }
                }
            }
        }
    }

    fn go_on(&mut self, now: Instant) {
        if self.until.is_none()
            && let Some((_, request)) = self.queue.front()
        {
            let takes = match request {
                Request::List => SEARCH.0 + SEARCH.1 * self.there.len() as u32,
                Request::Temperature(rom) if self.there.contains(rom) => CONVERSION,
                Request::Temperature(_) => Duration::ZERO,
            };
            self.traffic.busy += takes;
            self.until = Some(now + takes);
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.until
    }

    /// What came of a request that is over at `now`.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<(Owner, Answer)> {
        self.until.take_if(|until| *until <= now)?;
        let (owner, request) = self.queue.pop_front()?;
        self.traffic.sent += 1;
        let answer = match request {
            Request::List => Answer::List(self.there.clone()),
            Request::Temperature(rom) => {
                let said = self.said.get(&rom).filter(|_| self.there.contains(&rom));
                Answer::Temperature(rom, said.copied().unwrap_or(Err(Error::Absent)))
            }
        };
        self.go_on(now);
        Some((owner, answer))
    }

    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
        let first = self.queue.front().is_some_and(|(owner, _)| owner.pid == pid);
        self.queue.retain(|(owner, _)| owner.pid != pid);
        if self.devices.take_if(|devices| devices.pid == pid).is_some() {
            self.there.clear();
            self.said.clear();
        }
        if first && let Some(until) = self.until.take() {
            // The next one begins when the bus is free.
            self.go_on(until);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use module::PortId;

    #[test]
    fn a_thermometer_takes_its_time_and_one_that_leaves_meanwhile_is_absent() {
        let [kernel, master] = [1, 2].map(|pid| Owner { pid, port: PortId(0) });
        let [rom, other] = [1, 2].map(|serial| Rom::new(0x28, serial).unwrap());
        let mut wire = W1Wire::default();
        wire.join(kernel, true);
        wire.join(master, false);
        wire.is(kernel, Answer::List([rom].into_iter().collect()));
        wire.is(kernel, Answer::Temperature(rom, Ok(21_500)));
        let ask = |wire: &mut W1Wire, request| {
            wire.send(Instant::ZERO, master, request);
            let over = wire.poll_timeout().unwrap();
            (over.as_nanos() / 1_000_000, wire.handle_timeout(over).unwrap().1)
        };
        assert_eq!(ask(&mut wire, Request::List), (14, Answer::List([rom].into_iter().collect())));
        assert_eq!(ask(&mut wire, Request::Temperature(rom)), (765, Answer::Temperature(rom, Ok(21_500))));
        assert_eq!(ask(&mut wire, Request::Temperature(other)), (0, Answer::Temperature(other, Err(Error::Absent))));
        wire.send(Instant::ZERO, master, Request::Temperature(rom));
        wire.is(kernel, Answer::List(List::new()));
        let over = wire.poll_timeout().unwrap();
        assert_eq!(wire.handle_timeout(over), Some((master, Answer::Temperature(rom, Err(Error::Absent)))));
        wire.close(1);
        assert_eq!(ask(&mut wire, Request::List).1, Answer::List(List::new()));
    }
}
