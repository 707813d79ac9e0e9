//! What a bus does to what is sent on it, while a fault lasts: the LCM bus, a CAN bus, a serial line.

use crate::faults::InjectedFault;
use crate::random::Random;
use base::serial::Word;
use base::{Duration, Instant};

/// Active disturbances, each with the instant of its end.
#[derive(Debug, Default)]
pub struct Disturbance {
    /// Probability that a receiver (LCM), or everybody, does not get it.
    loss: (Instant, f64),
    /// Probability that it comes twice.
    duplicate: (Instant, f64),
    /// Additional delay.
    delay: (Instant, Duration),
    /// Additional random delay up to this, which may change the order.
    reorder: (Instant, Duration),
    /// Probability that a bit is wrong.
    noise: (Instant, f64),
    /// Earliest next arrival: a delayed message is not overtaken.
    not_before: Instant,
}

impl Disturbance {
    /// Injects a fault until an instant; false if it is none of these.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Loss(chance) => self.loss = (until, chance),
            InjectedFault::Duplicate(chance) => self.duplicate = (until, chance),
            InjectedFault::Delay(delay) => self.delay = (until, delay),
            InjectedFault::Reorder(within) => self.reorder = (until, within),
            InjectedFault::Noise(rate) => self.noise = (until, rate),
            InjectedFault::None => {
                let ends = [&mut self.loss.0, &mut self.duplicate.0, &mut self.noise.0];
                ends.into_iter().chain([&mut self.delay.0, &mut self.reorder.0]).for_each(|until| *until = now);
            }
            _ => return false,
        }
        true
    }

    /// Probability of a loss.
    pub fn loss(&self, now: Instant) -> f64 {
        if now < self.loss.0 { self.loss.1 } else { 0.0 }
    }

    /// Present delay.
    pub fn delay(&self, now: Instant) -> Duration {
        if now < self.delay.0 { self.delay.1 } else { Duration::ZERO }
    }

    /// Random delay of this message, where the order may change.
    pub fn reorder(&self, now: Instant, random: &mut Random) -> Option<Duration> {
        (now < self.reorder.0).then(|| part(self.reorder.1, random))
    }

    /// True if this one comes twice.
    pub fn duplicates(&self, now: Instant, random: &mut Random) -> bool {
        now < self.duplicate.0 && random.chance(self.duplicate.1)
    }

    /// Probability of an error within this number of bits.
    fn noise(&self, now: Instant, bits: f64) -> f64 {
        if now < self.noise.0 { 1.0 - libm::pow(1.0 - self.noise.1, bits) } else { 0.0 }
    }

    /// Noise on a serial line.
    pub fn garble(&self, now: Instant, words: &mut [Word], random: &mut Random) {
        let chance = self.noise(now, rs485::BITS_PER_WORD as f64);
        for word in words {
            if random.chance(chance) {
                *word = garbled(random, *word);
            }
        }
    }

    /// Arrival of a message due at `at`: delayed, and not before earlier ones.
    pub fn arrival(&mut self, now: Instant, at: Instant) -> Instant {
        self.not_before = self.not_before.max(at + self.delay(now));
        self.not_before
    }
}

/// Another word than what was sent: a disturbance that does no harm would hide.
pub fn garbled(random: &mut Random, word: Word) -> Word {
    let bits = random.bits();
    Word { byte: word.byte ^ ((bits as u8) | 1), ninth: bits >> 8 & 7 == 0 }
}

/// A part of a time, each as likely as the other.
pub fn part(of: Duration, random: &mut Random) -> Duration {
    Duration::from_nanos((of.as_nanos() as f64 * random.uniform()) as u64)
}
