//! A serial wire of 9-bit words, 11 bits each, with collisions.

use super::news::Traffic;
use super::owner::Owner;
use base::Instant;
use base::serial::Word;
use simulator::Random;
use simulator::disturbance::garbled;
use std::collections::VecDeque;

/// Number of words after which received data is delivered, also at the end of a transmission: like the receive FIFO of
/// a 16550 at its highest threshold.
const FIFO: usize = 14;
/// The same of an adapter on USB of full speed, which hands on packets of 64 bytes.
pub(super) const PACKET: usize = 64;

/// Words sent in one piece.
#[derive(Debug)]
struct Burst {
    owner: Owner,
    start: Instant,
    words: Vec<Word>,
    delivered: usize,
}

/// One wire.
#[derive(Debug)]
pub(super) struct SerialWire {
    pub baud: u32,
    /// Separate pairs of wires: simultaneous transmission does no harm.
    pub full_duplex: bool,
    /// Number of words after which received data is delivered.
    pub piece: usize,
    pub ports: Vec<Owner>,
    bursts: VecDeque<Burst>,
    random: Random,
    pub traffic: Traffic,
}

/// Words that have arrived.
pub(super) struct Arrival {
    pub owner: Owner,
    pub words: Vec<Word>,
    /// The last word ends a transmission.
    pub sent: bool,
}

impl SerialWire {
    pub fn new(baud: u32, full_duplex: bool, random: Random) -> Self {
        Self {
            baud: baud.max(1),
            full_duplex,
            piece: FIFO,
            ports: Vec::new(),
            bursts: VecDeque::new(),
            random,
            traffic: Traffic::default(),
        }
    }

    /// End of `count` words that began at `start`.
    fn after(&self, start: Instant, count: usize) -> Instant {
        let nanos = count as u64 * rs485::BITS_PER_WORD * 1_000_000_000 / u64::from(self.baud);
        Instant::from_nanos(start.as_nanos() + nanos)
    }

    pub fn send(&mut self, now: Instant, owner: Owner, words: Vec<Word>) {
        let own = self.bursts.iter().filter(|burst| burst.owner == owner);
        let start = own.map(|burst| self.after(burst.start, burst.words.len())).max().unwrap_or(now).max(now);
        let mut burst = Burst { owner, start, words, delivered: 0 };
        if !self.full_duplex {
            self.collide(&mut burst);
        }
        self.traffic.sent += burst.words.len() as u64;
        self.traffic.busy += self.after(start, burst.words.len()).since(start);
        self.bursts.push_back(burst);
    }

    /// Garbles every word that overlaps with another transmission.
    fn collide(&mut self, burst: &mut Burst) {
        let end = self.after(burst.start, burst.words.len());
        for place in 0..self.bursts.len() {
            let other = &self.bursts[place];
            let (other_start, other_end) = (other.start, self.after(other.start, other.words.len()));
            if other.owner == burst.owner || other_end <= burst.start || end <= other_start {
                continue;
            }
            self.traffic.collisions += 1;
            for i in 0..burst.words.len() {
                if self.after(burst.start, i) < other_end && other_start < self.after(burst.start, i + 1) {
                    burst.words[i] = garbled(&mut self.random, burst.words[i]);
                }
            }
            for i in self.bursts[place].delivered..self.bursts[place].words.len() {
                if self.after(other_start, i) < end && burst.start < self.after(other_start, i + 1) {
                    let word = self.bursts[place].words[i];
                    self.bursts[place].words[i] = garbled(&mut self.random, word);
                }
            }
        }
    }

    /// Number of words of a burst that have been delivered after its next piece.
    fn upto(&self, burst: &Burst) -> usize {
        burst.words.len().min(burst.delivered + self.piece)
    }

    fn due(&self, burst: &Burst) -> Instant {
        self.after(burst.start, self.upto(burst))
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.bursts.iter().map(|burst| self.due(burst)).min()
    }

    /// Words that have arrived by `now`, one piece at a time.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<Arrival> {
        let place = (0..self.bursts.len()).find(|place| self.due(&self.bursts[*place]) <= now)?;
        let upto = self.upto(&self.bursts[place]);
        let burst = &mut self.bursts[place];
        let words = burst.words[burst.delivered..upto].to_vec();
        burst.delivered = upto;
        let (owner, sent) = (burst.owner, upto == burst.words.len());
        if sent {
            self.bursts.remove(place);
        }
        Some(Arrival { owner, words, sent })
    }

    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use module::PortId;

    fn owner(pid: u32) -> Owner {
        Owner { pid, port: PortId(0) }
    }

    fn arrivals(wire: &mut SerialWire) -> Vec<(u64, u32, Vec<Word>, bool)> {
        let mut all = Vec::new();
        while let Some(due) = wire.poll_timeout() {
            let arrival = wire.handle_timeout(due).unwrap();
            all.push((due.as_nanos(), arrival.owner.pid, arrival.words, arrival.sent));
        }
        all
    }

    #[test]
    fn words_arrive_when_their_eleven_bits_are_over() {
        let mut wire = SerialWire::new(115_200, false, Random::new(1));
        let words: Vec<Word> = (0..20).map(Word::data).collect();
        wire.send(Instant::from_nanos(1000), owner(1), words.clone());
        let all = arrivals(&mut wire);
        // 14 and 20 words of 11 bits at 115200 Bd.
        assert_eq!(all[0], (1000 + 1_336_805, 1, words[..14].to_vec(), false));
        assert_eq!(all[1], (1000 + 1_909_722, 1, words[14..].to_vec(), true));
        assert_eq!(all.len(), 2);
    }

    #[test]
    fn output_queued_while_sending_follows_without_a_gap() {
        let mut wire = SerialWire::new(110_000, false, Random::new(1));
        wire.send(Instant::ZERO, owner(1), vec![Word::address(1); 3]);
        wire.send(Instant::from_nanos(50_000), owner(1), vec![Word::data(2); 2]);
        let times: Vec<_> = arrivals(&mut wire).iter().map(|arrival| arrival.0).collect();
        assert_eq!(times, [300_000, 500_000]);
    }

    #[test]
    fn an_adapter_on_usb_delivers_a_packet_at_once() {
        let mut wire = SerialWire::new(230_400, true, Random::new(1));
        wire.piece = PACKET;
        let words: Vec<Word> = (0..100).map(Word::data).collect();
        wire.send(Instant::ZERO, owner(1), words.clone());
        let all = arrivals(&mut wire);
        // 64 and 100 words of 11 bits at 230400 Bd.
        assert_eq!(all[0], (3_055_555, 1, words[..64].to_vec(), false));
        assert_eq!(all[1], (4_774_305, 1, words[64..].to_vec(), true));
        assert_eq!(all.len(), 2);
    }

    #[test]
    fn two_simultaneous_senders_garble_exactly_the_overlap() {
        let mut wire = SerialWire::new(110_000, false, Random::new(1));
        wire.send(Instant::ZERO, owner(1), vec![Word::data(0x55); 5]);
        wire.send(Instant::from_nanos(350_000), owner(2), vec![Word::data(0xAA); 5]);
        let all = arrivals(&mut wire);
        let wrong = |words: &[Word], good| words.iter().map(|word| *word != Word::data(good)).collect::<Vec<_>>();
        assert_eq!(wrong(&all[0].2, 0x55), [false, false, false, true, true]);
        assert_eq!(wrong(&all[1].2, 0xAA), [true, true, false, false, false]);
        assert_eq!(wire.traffic.collisions, 1);
    }

    #[test]
    fn on_two_pairs_nothing_collides() {
        let mut wire = SerialWire::new(110_000, true, Random::new(1));
        wire.send(Instant::ZERO, owner(1), vec![Word::data(0x55); 5]);
        wire.send(Instant::ZERO, owner(2), vec![Word::data(0xAA); 5]);
        assert!(arrivals(&mut wire).iter().all(|(_, _, words, _)| words.iter().all(|word| !word.ninth)));
        assert_eq!(wire.traffic.collisions, 0);
    }
}
