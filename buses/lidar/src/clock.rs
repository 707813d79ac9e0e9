//! The clock of a device, seen from the host: instants of measurements without the jitter of the line.

use base::Instant;

/// How much slower the device's clock is taken to run, whatever arrives: 500 ppm.
const DRIFT_DIVISOR: u64 = 2000;
/// Time of the device, ns, in which no message arrives as early as the estimate lets expect if the clock is slower than
/// that: the estimate then follows the earliest one of this time.
const WINDOW_NS: u64 = 2_000_000_000;
/// It follows by a twentieth of the time that passes.
const FOLLOW_DIVISOR: u64 = 20;
/// A message later than this by the estimate begins a new estimate, ns: the device's clock was set.
const JUMP_NS: u64 = 500_000_000;

/// Maps a counter of the device to instants of the host.
///
/// The least delay that was observed is taken as that of the line: messages that the host read late do not move their
/// measurements. A clock that is slow by a hundredth makes them up to 50 ms older. The result is never later than the
/// arrival.
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
    /// The earliest such instant by the messages of the last whole [`WINDOW_NS`], and by those of the present one.
    goal: Instant,
    least: Instant,
    /// Time of the device at which the present one began, ns.
    since_ns: u64,
}

impl Last {
    /// A new estimate by a message that arrived at `now`.
    const fn begin(counter: u64, now: Instant) -> Self {
        Self { counter, device_ns: 0, origin: now, goal: Instant::ZERO, least: Instant::NEVER, since_ns: 0 }
    }
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
            self.last = Some(Last::begin(counter, now));
            return Some(now);
        };
        let ticks = (counter + self.modulus - last.counter) % self.modulus;
        if ticks == 0 {
            return None;
        }
        if ticks > self.modulus / 2 {
            // The device started again.
            self.last = Some(Last::begin(counter, now));
            return None;
        }
        let elapsed_ns = ticks * self.tick_ns;
        if last.device_ns + elapsed_ns > now.as_nanos() {
            // The device's clock was set to a time that the host has not reached.
            self.last = Some(Last::begin(counter, now));
            return Some(now);
        }
        last.counter = counter;
        last.device_ns += elapsed_ns;
        let device = base::Duration::from_nanos(last.device_ns);
        let latest = now - device;
        let [drifted, followed] = [DRIFT_DIVISOR, FOLLOW_DIVISOR]
            .map(|divisor| last.origin + base::Duration::from_nanos(elapsed_ns / divisor));
        last.origin = latest.min(drifted.max(followed.min(last.goal)));
        last.least = last.least.min(latest);
        if last.device_ns - last.since_ns >= WINDOW_NS {
            (last.goal, last.least, last.since_ns) = (last.least, Instant::NEVER, last.device_ns);
        }
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
    fn a_clock_that_is_a_hundredth_slow_or_fast_makes_no_measurement_much_older() {
        for per_10_ms in [99, 101] {
            let mut clock = Clock::new(30_000, 1_000_000);
            let mut worst = Duration::ZERO;
            for n in 0..30_000_u64 {
                // Every fourth message is not late.
                let now = Instant::from_millis(1000 + n * 10 + n % 4 * 2);
                let at = clock.at(now, n * per_10_ms / 10).unwrap();
                worst = worst.max(now.since(at));
            }
            assert!(worst < Duration::from_millis(60), "{per_10_ms}: {worst:?}");
        }
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
