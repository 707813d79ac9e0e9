//! Driving with arrow keys: hold to run.
//!
//! A terminal tells when a key goes down and, while it is held, again and again; most do not tell when it comes up. So
//! a press runs the robot until the first repeat is due (a keyboard waits up to [`FIRST`] before it), each repeat for
//! [`NEXT`] more; where the terminal tells of releases (the kitty protocol), that is the end at once. While the drive
//! is taken zero is sent otherwise, so that no other source of this priority or below moves the robot; given back it
//! ends with zeros, and then silence.

use base::{Duration, Instant, Ticker};

/// Commands go out this often.
const PERIOD: Duration = Duration::from_millis(50);
/// Duration of a press before its first repeat.
const FIRST: Duration = Duration::from_millis(660);
/// Duration of a repeat.
const NEXT: Duration = Duration::from_millis(200);
/// Zeros at the end.
const ZEROS: u32 = 10;
/// Steps of the speed, m/s, and of the steering, rad.
const SPEED_STEP: f64 = 0.05;
const STEERING_STEP: f64 = 0.05;
/// The first speed, m/s.
const SPEED: f64 = 0.2;

/// Command of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrow {
    /// Up.
    Forward,
    /// Down.
    Back,
    /// Left.
    Left,
    /// Right.
    Right,
}

/// True if the drive is taken, and what is held.
#[derive(Debug)]
pub struct Drive {
    /// Speed sent while a key is held, m/s.
    pub speed: f64,
    /// Steering angle sent, rad; kept until it is changed.
    pub steering: f64,
    limits: (f64, f64),
    taken: bool,
    /// 1 forward, -1 back, and until when.
    held: Option<(f64, Instant)>,
    /// The key that was pressed last, and when: its next event is a repeat.
    pressed: Option<(Arrow, Instant)>,
    zeros: u32,
    grid: Ticker,
}

impl Drive {
    /// Makes an inactive drive; `limits` of speed, m/s, and steering, rad.
    pub fn new(now: Instant, limits: (f64, f64)) -> Self {
        Self {
            speed: SPEED.min(limits.0),
            steering: 0.0,
            limits,
            taken: false,
            held: None,
            pressed: None,
            zeros: 0,
            grid: Ticker::new(now, PERIOD),
        }
    }

    /// True if it is taken.
    pub fn is_taken(&self) -> bool {
        self.taken
    }

    /// Remaining time of motion; `None` if none is commanded.
    pub fn runs_for(&self, now: Instant) -> Option<Duration> {
        self.held.filter(|(_, until)| now < *until).map(|(_, until)| until.since(now))
    }

    /// The speed of the key that is held, m/s.
    pub fn command(&self) -> f64 {
        self.held.map_or(0.0, |(direction, _)| direction * self.speed)
    }

    /// Takes it, or gives it back.
    pub fn toggle(&mut self) {
        self.stop();
        self.taken = !self.taken;
        self.zeros = if self.taken { 0 } else { ZEROS };
        self.steering = 0.0;
    }

    /// Gives it back.
    pub fn give_back(&mut self) {
        if self.taken {
            self.toggle();
        }
    }

    /// Zero from now on.
    pub fn stop(&mut self) {
        (self.held, self.pressed) = (None, None);
    }

    /// Key down, or repeated.
    pub fn press(&mut self, now: Instant, arrow: Arrow) {
        if !self.taken {
            return;
        }
        let repeats = self.pressed.is_some_and(|(last, at)| last == arrow && now.since(at) < FIRST);
        self.pressed = Some((arrow, now));
        let time = if repeats { NEXT } else { FIRST };
        match arrow {
            Arrow::Forward => self.held = Some((1.0, now + time)),
            Arrow::Back => self.held = Some((-1.0, now + time)),
            Arrow::Left | Arrow::Right => {
                let step = if arrow == Arrow::Left { STEERING_STEP } else { -STEERING_STEP };
                self.steering = (self.steering + step).clamp(-self.limits.1, self.limits.1);
                // Only the last key repeats: while one steers, one goes on.
                if let Some((_, until)) = self.held.as_mut().filter(|(_, until)| now < *until) {
                    *until = now + time;
                }
            }
        }
    }

    /// Key up, where the terminal reports it.
    pub fn release(&mut self, arrow: Arrow) {
        if matches!(arrow, Arrow::Forward | Arrow::Back) {
            self.stop();
        }
    }

    /// Faster or slower.
    pub fn faster(&mut self, steps: f64) {
        self.speed = (self.speed + steps * SPEED_STEP).clamp(SPEED_STEP, self.limits.0);
    }

    /// Speed and steering to send now, if any.
    pub fn poll(&mut self, now: Instant) -> Option<(f64, f64)> {
        if self.held.is_some_and(|(_, until)| until <= now) {
            self.stop();
        }
        if !self.grid.due(now) {
            return None;
        }
        if self.taken {
            return Some((self.command(), self.steering));
        }
        self.zeros.checked_sub(1).map(|left| {
            self.zeros = left;
            (0.0, 0.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(1000 + millis)
    }

    /// Commands sent in a while, with key events at some instants.
    fn sent(drive: &mut Drive, until: u64, presses: &[(u64, Arrow)]) -> Vec<(u64, f64)> {
        let mut sent = Vec::new();
        for ms in 0..until {
            for (_, arrow) in presses.iter().filter(|(at, _)| *at == ms) {
                drive.press(at(ms), *arrow);
            }
            sent.extend(drive.poll(at(ms)).map(|(speed, _)| (ms, speed)));
        }
        sent
    }

    #[test]
    fn nothing_is_sent_before_it_is_taken_and_zeros_then_silence_after() {
        let mut drive = Drive::new(at(0), (0.5, 0.4));
        assert!(sent(&mut drive, 1000, &[(10, Arrow::Forward)]).is_empty());
        drive.toggle();
        assert!(sent(&mut drive, 300, &[]).iter().all(|(_, speed)| *speed == 0.0));
        drive.toggle();
        let mut count = 0;
        for ms in 300..3000 {
            count += usize::from(drive.poll(at(ms)).inspect(|sent| assert_eq!(*sent, (0.0, 0.0))).is_some());
        }
        assert_eq!(count, 10);
    }

    #[test]
    fn a_key_that_is_let_go_stops_within_the_time_of_a_repeat() {
        let mut drive = Drive::new(at(0), (0.5, 0.4));
        drive.toggle();
        // Pressed at 100, repeats from 600 on each 33 ms, the last at 996.
        let mut presses = vec![(100, Arrow::Forward)];
        presses.extend((600..1000).step_by(33).map(|ms| (ms, Arrow::Forward)));
        let sent = sent(&mut drive, 2000, &presses);
        let moved: Vec<u64> = sent.iter().filter(|(_, speed)| *speed > 0.0).map(|(ms, _)| *ms).collect();
        assert_eq!((moved.first(), moved.last()), (Some(&100), Some(&1150)));
        assert_eq!(moved.len(), 22, "without a gap");
    }

    #[test]
    fn a_single_press_ends_by_itself_and_a_release_at_once() {
        let mut drive = Drive::new(at(0), (0.5, 0.4));
        drive.toggle();
        let moved = sent(&mut drive, 2000, &[(0, Arrow::Back)]).iter().filter(|(_, speed)| *speed < 0.0).count();
        assert_eq!(moved, 14);
        drive.press(at(3000), Arrow::Forward);
        drive.release(Arrow::Forward);
        assert_eq!(drive.poll(at(3000)), Some((0.0, 0.0)));
    }

    #[test]
    fn limits_hold() {
        let mut drive = Drive::new(at(0), (0.3, 0.12));
        drive.toggle();
        drive.faster(100.0);
        (0..9).for_each(|n| drive.press(at(n), Arrow::Left));
        assert_eq!((drive.speed, drive.steering), (0.3, 0.12));
        drive.faster(-100.0);
        assert_eq!(drive.speed, 0.05);
    }
}
