//! The clock of a device, seen from the host: instants of measurements without the jitter of the line.

use base::Instant;

/// How much faster or slower the device's clock may run, and the delay of the line may shrink: 500 ppm.
const DRIFT_DIVISOR: u64 = 2000;
/// A message later than this by the estimate begins a new estimate, ns: the device's clock was set.
const JUMP_NS: u64 = 500_000_000;

/// Maps a counter of the device to instants of the host.
///
/// The least delay that was observed is taken as that of the line: messages that the host read late do not move their
/// measurements. The result is never later than the arrival.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    modulus: u64,
    tick_ns: u64,
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    counter: u64,
    /// Time of the device since the estimate began, ns.
    device_ns: u64,
    /// Instant of the device's time 0 on the host's scale.
    origin: Instant,
}

impl Clock {
    /// A counter of `tick_ns` that wraps at `modulus`.
    pub const fn new(modulus: u64, tick_ns: u64) -> Self {
        Self { modulus, tick_ns, last: None }
    }

    /// Forgets the device's time.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// Instant of a counter that arrived at `now`. `None`: it has not advanced since the last one, or went back.
    pub fn at(&mut self, now: Instant, counter: u64) -> Option<Instant> {
        let counter = counter % self.modulus;
        let Some(last) = &mut self.last else {
            self.last = Some(Last { counter, device_ns: 0, origin: now });
            return Some(now);
        };
        let ticks = (counter + self.modulus - last.counter) % self.modulus;
        if ticks == 0 {
            return None;
        }
        if ticks > self.modulus / 2 {
            // The device started again.
            self.last = Some(Last { counter, device_ns: 0, origin: now });
            return None;
        }
        let elapsed_ns = ticks * self.tick_ns;
        if last.device_ns + elapsed_ns > now.as_nanos() {
            // The device's clock was set to a time that the host has not reached.
            self.last = Some(Last { counter, device_ns: 0, origin: now });
            return Some(now);
        }
        last.counter = counter;
        last.device_ns += elapsed_ns;
        let device = base::Duration::from_nanos(last.device_ns);
        let latest = now - device;
        let drifted = last.origin + base::Duration::from_nanos(elapsed_ns / DRIFT_DIVISOR);
        last.origin = latest.min(drifted);
        if latest.since(last.origin).as_nanos() > u128::from(JUMP_NS) {
            last.origin = latest;
        }
        Some(last.origin + device)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Duration;

    #[test]
    fn late_messages_do_not_move_their_measurements() {
        let mut clock = Clock::new(30_000, 1_000_000);
        let mut worst = Duration::ZERO;
        for n in 0..100_u64 {
            let true_ms = 1000 + n * 10;
            // Delays of 2 ms to 8 ms; the shortest is the third.
            let late = [5, 7, 2, 8][(n % 4) as usize];
            let now = Instant::from_millis(true_ms + late);
            let at = clock.at(now, 29_500 + n * 10).unwrap();
            assert!(at <= now);
            if n > 4 {
                worst = worst.max(at.since(Instant::from_millis(true_ms + 2)));
            }
        }
        assert!(worst < Duration::from_micros(100), "{worst:?}");
    }

    #[test]
    fn a_counter_that_stands_or_goes_back_is_refused() {
        let mut clock = Clock::new(1 << 24, 1_000_000);
        let now = Instant::from_millis(1000);
        assert_eq!(clock.at(now, 500), Some(now));
        assert_eq!(clock.at(now, 500), None);
        assert_eq!(clock.at(now, 3), None);
        assert!(clock.at(now + Duration::from_millis(4), 7).is_some());
    }

    #[test]
    fn a_clock_that_was_set_forward_gives_no_instant_in_the_future() {
        let mut clock = Clock::new(1 << 32, 1000);
        let now = Instant::from_millis(10_000);
        clock.at(now, 0).unwrap();
        for n in 1..10 {
            let now = now + Duration::from_millis(n);
            assert!(clock.at(now, n * 9_000_000).unwrap() <= now);
        }
    }

    #[test]
    fn a_clock_that_was_set_begins_a_new_estimate() {
        let mut clock = Clock::new(1 << 24, 1_000_000);
        clock.at(Instant::from_millis(1000), 0).unwrap();
        let now = Instant::from_millis(3000);
        assert_eq!(clock.at(now, 10), Some(now));
    }
}
