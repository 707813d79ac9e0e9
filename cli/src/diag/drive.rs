//! Driving with keys: hold to run. The arrows to the sides set the steering angle, which is kept; of a base that does
//! not steer they turn it while they are held, and two more keys move it sideways if it can.
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

/// Command of a key. `AsideLeft`, `AsideRight`: the base goes sideways.
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
    /// Sideways to the left.
    AsideLeft,
    /// Sideways to the right.
    AsideRight,
}

/// Motions that are held, as places in [`Drive::held`].
const AHEAD: usize = 0;
const TURN: usize = 1;
const ASIDE: usize = 2;

/// What is to be sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Speed, m/s, and steering angle, rad.
    Curve(f64, f64),
    /// Forward and to the left, m/s, and counter-clockwise, rad/s.
    Velocity(f64, f64, f64),
}

/// What a base that does not steer does beside driving straight ahead.
#[derive(Clone, Copy, Debug)]
struct Free {
    /// Greatest rotation, rad/s.
    rotation: f64,
    /// It goes sideways.
    sideways: bool,
}

/// True if the drive is taken, and what is held.
#[derive(Debug)]
pub struct Drive {
    /// Speed sent while a key is held, m/s.
    pub speed: f64,
    /// Steering angle sent, rad; kept until it is changed.
    pub steering: f64,
    limits: (f64, f64),
    /// The base does not steer.
    free: Option<Free>,
    taken: bool,
    /// 1 forward or to the left, -1 back or to the right, and until when.
    held: [Option<(f64, Instant)>; 3],
    /// The key that was pressed last, and when: its next event is a repeat.
    pressed: Option<(Arrow, Instant)>,
    /// The terminal has reported a release.
    reports_releases: bool,
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
            free: None,
            taken: false,
            held: [None; 3],
            pressed: None,
            reports_releases: false,
            zeros: 0,
            grid: Ticker::new(now, PERIOD),
        }
    }

    /// The same of a base that does not steer; its greatest `rotation`, rad/s.
    #[must_use]
    pub fn free(self, rotation: f64, sideways: bool) -> Self {
        Self { free: Some(Free { rotation, sideways }), ..self }
    }

    /// True for a base that does not steer.
    pub fn is_free(&self) -> bool {
        self.free.is_some()
    }

    /// True for a base that goes sideways.
    pub fn goes_sideways(&self) -> bool {
        self.free.is_some_and(|free| free.sideways)
    }

    /// True if it is taken.
    pub fn is_taken(&self) -> bool {
        self.taken
    }

    /// Remaining time of motion; `None` if none is commanded.
    pub fn runs_for(&self, now: Instant) -> Option<Duration> {
        self.held.iter().flatten().map(|(_, until)| *until).filter(|until| now < *until).max().map(|end| end.since(now))
    }

    /// The speed of the key that is held, m/s.
    pub fn command(&self) -> f64 {
        self.share(AHEAD) * self.speed
    }

    /// Motion of the keys that are held. A rotation has the share of its limit that the speed has.
    pub fn motion(&self) -> Motion {
        match self.free {
            None => Motion::Curve(self.command(), self.steering),
            Some(Free { rotation, .. }) => Motion::Velocity(
                self.command(),
                self.share(ASIDE) * self.speed,
                self.share(TURN) * rotation * self.speed / self.limits.0,
            ),
        }
    }

    fn share(&self, place: usize) -> f64 {
        self.held[place].map_or(0.0, |(direction, _)| direction)
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
        (self.held, self.pressed) = ([None; 3], None);
    }

    /// Key down, or repeated.
    pub fn press(&mut self, now: Instant, arrow: Arrow) {
        if !self.taken {
            return;
        }
        let repeats = self.pressed.is_some_and(|(last, at)| last == arrow && now.since(at) < FIRST);
        self.pressed = Some((arrow, now));
        let time = if repeats { NEXT } else { FIRST };
        // Only the last key repeats: what else is held goes on. A rotation and a motion sideways do so only where their
        // release is reported: the key may be up.
        let turns = arrow.place() == TURN && self.free.is_none();
        if turns || self.free.is_some() {
            let known = if self.reports_releases { self.held.len() } else { AHEAD + 1 };
            for (_, until) in self.held[..known].iter_mut().flatten().filter(|(_, until)| now < *until) {
                *until = now + time;
            }
        }
        if turns {
            self.steering = (self.steering + arrow.direction() * STEERING_STEP).clamp(-self.limits.1, self.limits.1);
        } else if arrow.place() != ASIDE || self.goes_sideways() {
            self.held[arrow.place()] = Some((arrow.direction(), now + time));
        }
    }

    /// Key up, where the terminal reports it.
    pub fn release(&mut self, arrow: Arrow) {
        self.reports_releases = true;
        match arrow.place() {
            AHEAD => self.stop(),
            place => {
                self.held[place] = None;
                // What follows it is a press.
                self.pressed = self.pressed.filter(|(last, _)| self.free.is_none() || *last != arrow);
            }
        }
    }

    /// Faster or slower.
    pub fn faster(&mut self, steps: f64) {
        self.speed = (self.speed + steps * SPEED_STEP).clamp(SPEED_STEP, self.limits.0);
    }

    /// Motion to send now, if any.
    pub fn poll(&mut self, now: Instant) -> Option<Motion> {
        if self.held.iter().any(Option::is_some) && self.runs_for(now).is_none() {
            self.stop();
        }
        for held in &mut self.held {
            *held = held.filter(|(_, until)| now < *until);
        }
        if !self.grid.due(now) {
            return None;
        }
        if self.taken {
            return Some(self.motion());
        }
        self.zeros.checked_sub(1).map(|left| {
            self.zeros = left;
            self.motion()
        })
    }
}

impl Arrow {
    /// Motion that it holds.
    const fn place(self) -> usize {
        match self {
            Self::Forward | Self::Back => AHEAD,
            Self::Left | Self::Right => TURN,
            Self::AsideLeft | Self::AsideRight => ASIDE,
        }
    }

    const fn direction(self) -> f64 {
        match self {
            Self::Forward | Self::Left | Self::AsideLeft => 1.0,
            Self::Back | Self::Right | Self::AsideRight => -1.0,
        }
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
            let speed = |motion| match motion {
                Motion::Curve(speed, _) | Motion::Velocity(speed, ..) => (ms, speed),
            };
            sent.extend(drive.poll(at(ms)).map(speed));
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
            count +=
                usize::from(drive.poll(at(ms)).inspect(|sent| assert_eq!(*sent, Motion::Curve(0.0, 0.0))).is_some());
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
        assert_eq!(drive.poll(at(3000)), Some(Motion::Curve(0.0, 0.0)));
    }

    #[test]
    fn a_base_that_does_not_steer_turns_and_goes_sideways_while_a_key_is_held() {
        let mut drive = Drive::new(at(0), (0.4, 0.4)).free(1.2, true);
        drive.toggle();
        assert_eq!(drive.poll(at(0)), Some(Motion::Velocity(0.0, 0.0, 0.0)));
        drive.press(at(10), Arrow::Left);
        // Half of the speed's limit, half of the rotation's.
        assert_eq!((drive.speed, drive.poll(at(50))), (0.2, Some(Motion::Velocity(0.0, 0.0, 0.6))));
        drive.press(at(60), Arrow::Forward);
        drive.press(at(70), Arrow::AsideRight);
        assert_eq!(drive.poll(at(100)), Some(Motion::Velocity(0.2, -0.2, 0.6)));
        drive.release(Arrow::Left);
        assert_eq!(drive.poll(at(150)), Some(Motion::Velocity(0.2, -0.2, 0.0)));
        drive.release(Arrow::Forward);
        assert_eq!(drive.poll(at(200)), Some(Motion::Velocity(0.0, 0.0, 0.0)), "no key leads: all ends");
        // One press ends by itself, and a differential base does not go sideways.
        drive.press(at(1000), Arrow::Right);
        assert_eq!(drive.poll(at(1600)), Some(Motion::Velocity(0.0, 0.0, -0.6)));
        assert_eq!(drive.poll(at(1700)), Some(Motion::Velocity(0.0, 0.0, 0.0)));
        let mut drive = Drive::new(at(0), (0.4, 0.4)).free(1.2, false);
        drive.toggle();
        drive.press(at(10), Arrow::AsideLeft);
        assert_eq!(drive.poll(at(10)), Some(Motion::Velocity(0.0, 0.0, 0.0)));
    }

    #[test]
    fn another_key_prolongs_a_rotation_only_where_releases_are_reported() {
        let mut drive = Drive::new(at(0), (0.4, 0.4)).free(1.2, true);
        drive.toggle();
        let turn_then_ahead = |drive: &mut Drive, from: u64| {
            drive.press(at(from), Arrow::Left);
            drive.press(at(from + 100), Arrow::Forward);
            // Its repeats, the last at 690.
            (600..700).step_by(30).for_each(|ms| drive.press(at(from + ms), Arrow::Forward));
        };
        turn_then_ahead(&mut drive, 0);
        assert_eq!(drive.poll(at(700)), Some(Motion::Velocity(0.2, 0.0, 0.0)));
        drive.stop();
        drive.release(Arrow::Left);
        turn_then_ahead(&mut drive, 1000);
        assert_eq!(drive.poll(at(1700)), Some(Motion::Velocity(0.2, 0.0, 0.6)));
        assert_eq!(drive.poll(at(1900)), Some(Motion::Velocity(0.0, 0.0, 0.0)));
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
