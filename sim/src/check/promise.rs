//! The guard's promise against the truth (docs/guard.md): the robot drives into nothing that stands where an intact
//! sonar has answered for as long as the robot needs to stop.
//!
//! The evidence is the wire, with the answers of each sonar, the true pose, and the simulator's report of a contact. A
//! sonar is a witness of what was touched if each of its answers within the time to stop, computed from the true speed
//! at its beginning, is the distance of what was touched. If the sonar missed the echo once in that time, nothing is
//! proven: by the guard's law one echo counts until the next reading.
//!
//! Not judged: contacts below [`CONTACT_MPS`], with somebody who walks, in whatever direction, of a robot that creeps
//! or rolls without power, and after a disturbance on the way from the sonar to the wheel.

use super::Verdict;
use super::blind::answer;
use super::facts::Facts;
use base::serial::Word;
use base::{Duration, Instant};
use messages::simulation::DataTruth;
use navitools::{Point, Pose};
use rs485::boards::sd1::{NO_ECHO, SWEEP};
use rs485::reader::{Reader, Received};
use simulator::people::{Contact, Mover};
use std::collections::VecDeque;

/// Speed of the robot along the normal above which a contact counts, m/s (docs/navigation.md).
pub(super) const CONTACT_MPS: f64 = 0.05;
/// Speed below which a person counts as standing, m/s.
pub(super) const STANDS_MPS: f64 = 0.1;
/// From the middle of a person to the leg that answers, m.
const LEG_M: f64 = 0.15;
/// Accuracy of a distance, m: age of the answer at the greatest speed, legs at a stride, the true pose.
const SAME_M: f64 = 0.3;
/// By this much the answer of a leg may be longer, m, beyond what the robot drives within a sweep: the uncertainty that
/// the guard allows for. A leg that is farther away is the rear one of a stride, or the other one; nothing has answered
/// for the body before it.
const LONGER_M: f64 = 0.05;
/// Number of answers that are sufficient as evidence: as many sweeps.
const ANSWERS_MIN: usize = 3;
/// Time for which answers are kept: more than the longest stop.
const KEPT_FOR: Duration = Duration::from_secs(4);

/// What a guard promises.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// From an obstacle's appearance to the beginning of the deceleration, s.
    pub reaction_s: f64,
    /// Deceleration of a commanded stop, m/s².
    pub braking_mps2: f64,
    /// Full opening angle of a sonar's beam, rad.
    pub beam_rad: f64,
}

/// Answer of a sonar.
#[derive(Clone, Copy, Debug)]
struct Answer {
    at: Instant,
    /// Board and channel.
    sonar: (usize, usize),
    /// Pose of the sonar in the world, and speed of the robot, m/s.
    pose: Pose,
    speed: f64,
    /// Distance, m; 0 without an echo.
    distance: f64,
}

/// What the sonars answered.
#[derive(Debug)]
pub(super) struct Rule {
    readers: Vec<Reader>,
    answers: VecDeque<Answer>,
    truth: Option<(Pose, f64)>,
    /// Last instant at which a person crept past the guard.
    crept: Instant,
}

impl Rule {
    pub fn new(boards: &[super::RangingBoard]) -> Self {
        let readers = boards.iter().map(|board| Reader::new(board.crc, None)).collect();
        Self { readers, answers: VecDeque::new(), truth: None, crept: Instant::ZERO }
    }

    /// Processes a sample of the body's motion.
    pub fn on_truth(&mut self, truth: &DataTruth) {
        self.truth = Some((Pose::new(truth.x, truth.y, truth.theta), truth.speed));
    }

    /// A person creeps past the guard.
    pub fn on_creep(&mut self, now: Instant) {
        self.crept = now;
    }

    /// Words have arrived on a serial bus.
    pub fn on_words(&mut self, now: Instant, bus: &str, words: &[Word], facts: &Facts) {
        let Some((robot, speed)) = self.truth.filter(|_| facts.limits.promise.is_some()) else { return };
        for (place, (board, reader)) in facts.limits.ranging.iter().zip(&mut self.readers).enumerate() {
            for word in words.iter().filter(|_| board.bus == *bus) {
                let Some(Received::Frame(frame)) = reader.push(now, *word) else { continue };
                let Some(both) = answer(&frame, board.address) else { continue };
                for (channel, mount) in &board.sonars {
                    let Some(distance) = both.srfs.get(*channel) else { continue };
                    let distance = if *distance == NO_ECHO { 0.0 } else { f64::from(*distance) / 1000.0 };
                    let sonar = (place, *channel);
                    self.answers.push_back(Answer { at: now, sonar, pose: robot * *mount, speed, distance });
                }
            }
        }
        while self.answers.front().is_some_and(|old| now.since(old.at) > KEPT_FOR) {
            self.answers.pop_front();
        }
    }

    /// The simulator has reported a contact.
    pub fn on_contact(&self, now: Instant, contact: &Contact, facts: &Facts) -> Verdict {
        let Some(promise) = &facts.limits.promise else { return Ok(()) };
        let stands = contact.person.is_none_or(|person| person.speed_mps < STANDS_MPS);
        if contact.mover != Mover::Robot || contact.robot_mps <= CONTACT_MPS || !stands {
            return Ok(());
        }
        let since = now.since(disturbed(now, facts).max(self.crept)).as_secs_f64();
        let Some((robot, _)) = self.truth else { return Ok(()) };
        for (place, board) in facts.limits.ranging.iter().enumerate() {
            for (channel, mount) in &board.sonars {
                // A wall is reported without its position: it answers the sonars that look at it from close by.
                let touched = contact.person.map_or((robot * *mount).point(), |_| contact.at);
                let leg = if contact.person.is_some() { LEG_M } else { 0.0 };
                let answers = self.answers.iter().rev().filter(|one| one.sonar == (place, *channel));
                let (mut count, mut sweep) = (0, now);
                for one in answers.take_while(|one| one.is_of(touched, leg, promise.beam_rad)) {
                    if sweep.since(one.at) >= SWEEP {
                        (count, sweep) = (count + 1, one.at);
                    }
                    let needs = promise.reaction_s + one.speed.abs() / promise.braking_mps2 + SWEEP.as_secs_f64();
                    let vouches = now.since(one.at).as_secs_f64();
                    if count >= ANSWERS_MIN && vouches > needs && since > vouches {
                        let name = &board.name;
                        return Err(format!("{contact}, and {name} {channel} has answered it for {vouches:.2} s"));
                    }
                }
            }
        }
        Ok(())
    }
}

impl Answer {
    /// True if it is the distance of something at a point, or of a leg that is nearer by `leg`, m.
    fn is_of(&self, point: Point, leg: f64, beam: f64) -> bool {
        let from = self.pose.point();
        let distance = from.distance(point);
        let bearing = libm::atan2(point.y - from.y, point.x - from.x);
        let within = (self.pose.theta + -bearing).radians().abs() < beam / 2.0;
        let longer = self.distance - (distance - leg);
        let most = if leg > 0.0 { LONGER_M + self.speed.abs() * SWEEP.as_secs_f64() } else { SAME_M };
        self.distance > 0.0 && longer > -SAME_M && longer < most && (within || distance < SAME_M)
    }
}

/// End of the last disturbance on the way from the sonars to the wheels; `now` while one lasts.
fn disturbed(now: Instant, facts: &Facts) -> Instant {
    let boards = facts.limits.ranging.iter().map(|board| ill(&board.module, now, facts));
    boards.chain([undisturbed_since(now, facts)]).max().unwrap_or(now)
}

/// End of the last disturbance on the way from the guard to the wheels; `now` while one lasts.
pub(super) fn undisturbed_since(now: Instant, facts: &Facts) -> Instant {
    if facts.may_roll(now) || facts.is_cut_off(now) || facts.was_disturbed(now) {
        return now;
    }
    let guard = facts.limits.guard.as_ref().map_or(now, |guard| ill(&guard.module, now, facts));
    guard.max(facts.driver.ill(now)).max(facts.lcm_disturbed(now).unwrap_or_default())
}

/// Instant at which a module was last dead, hung or late; `now` while it is, or is unknown.
fn ill(module: &str, now: Instant, facts: &Facts) -> Instant {
    facts.life(module).map_or(now, |life| life.ill(now))
}
