//! What is in the way according to the lidars: the last revolutions of each, in the frame of the trail.
//!
//! **Unknown is not free.** A direction in which a lidar has measured nothing for `scan_age_max_s`, or in fewer than
//! `evaluations` revolutions in succession since, counts as occupied from the outline on. Something counts after that
//! many revolutions in succession have found it in the same place, as far as a person walks in one; then for two
//! revolutions more, so that one that misses it frees nothing, and where its direction is not measured any more, until
//! that is unknown. A single beam where a leg would be met by two is something thinner, or wild: it must be found again
//! where it was.

mod lone;

use crate::{Lidar, Obstacle, Rules, Source, Trail, Unseen};
use base::{Duration, Instant};
use kinematics::Polygon;
use lone::{Finding, Tail};
use messages::lowlevel::DataScan;
use navitools::{Point, wrap};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Part of the view that is known, or is not: at the reach of 2.5 m it is 9 cm wide, narrower than a leg.
const SLICE_RAD: f64 = TAU / 180.0;
/// Revolutions kept: enough for [`BASELINE`], and until a direction is unknown, at 40 Hz.
const TURNS_MAX: usize = 16;
/// Revolutions before the present one whose findings count, whatever was measured since.
const TURNS_COUNTED: usize = 2;
/// Findings of a revolution that are kept: more than any of these devices has beams.
const HITS_MAX: usize = 4096;
/// Accuracy of a finding against that of the revolution before, m: noise, and the robot's motion in between.
const SAME_M: f64 = 0.05;
/// Fastest walk, m/s (ISO 13855).
const WALK_MPS: f64 = 1.6;
/// Distance between two beams up to which a leg is met by two of them, m: a third of the test piece by which a device
/// is shown to detect legs (IEC 61496-3, 70 mm), because a beam that meets its edge may receive nothing, or what is
/// behind. An ankle of 50 mm, which is to be detected near the floor (ISO 13855), is met by two as well.
const LEG_SPACING_M: f64 = 0.07 / 3.0;
/// Longest time between two revolutions for which somebody walks, s.
const TURN_MAX_S: f64 = 0.2;
/// Ages, in revolutions, of what is compared with a finding. Who crosses the direction in which a revolution ends is
/// met twice in one, or in none: neither counts as two in succession, nor as one that missed it.
const EARLIER: (f64, f64) = (0.5, 1.5);
/// Revolutions in which something of that age is: the present one, and two before it.
const EARLIER_TURNS: usize = 3;
/// Directions into which findings are sorted, seen from the lidar.
const BINS: usize = 360;
/// Bins on either side of a beam in which something stood before if it has not come nearer.
const BESIDE: usize = 2;
/// Time over which something comes nearer.
const BASELINE: Duration = Duration::from_millis(250);
/// Speed, m/s, and distance, m, by which it must: lower values are noise, higher ones are two different things.
const APPROACH_MPS: std::ops::Range<f64> = 0.3..3.2;
const APPROACH_M: f64 = 0.08;
/// What is nearer to the end of the reach than this may have come into it by the robot's own motion, m.
const INTO_REACH_M: f64 = 0.8;
/// Age beyond which the timestamp of a sector is taken for that of another clock.
const AGE_MAX: Duration = Duration::from_millis(300);
/// Time within which a direction that is seen again is still seen in the same revolution: behind the edge of something
/// near, a lidar that measures by triangulation sees directions twice. It must be shorter than any revolution.
const OVERLAP: Duration = Duration::from_millis(10);
/// Steps in which the outline is looked for, m.
const OUTLINE_M: f64 = 0.01;
/// Distances along an unknown direction, from the outline on, m; the last one is the reach.
const COVERED_M: [f64; 6] = [0.02, 0.15, 0.4, 0.8, 1.3, 1.9];

/// Something that a beam met.
#[derive(Clone, Copy, Debug)]
struct Hit {
    /// Where, in the frame of the trail, m.
    at: Point,
    /// When its sector began.
    when: Instant,
    /// Revolutions in succession that have found it, up to `evaluations`.
    turns: u32,
    /// It came nearer by itself.
    approaches: bool,
    /// It came to a place that was free.
    moves: bool,
    /// The part of the view in which it was.
    slice: usize,
}

/// A revolution: it ends where a part of the view is seen again after [`OVERLAP`], whatever number the device gives it.
#[derive(Debug)]
struct Turn {
    since: Instant,
    /// When it has seen the parts of the view first, those at the ends of sectors left out.
    seen: Vec<Option<Instant>>,
    hits: Vec<Hit>,
}

/// A part of the view.
#[derive(Clone, Debug, Default)]
struct Slice {
    /// First measurement in it in the last revolution that has one.
    at: Instant,
    /// That revolution, and how many there were in succession, up to `evaluations`.
    number: u64,
    turns: u32,
    /// The points that it covers while it is unknown, in the robot's frame, m.
    cover: Vec<Point>,
}

/// What one lidar has seen.
#[derive(Debug)]
struct Eye {
    lidar: Lidar,
    place: usize,
    slices: Vec<Slice>,
    turns: VecDeque<Turn>,
    /// Number of the last revolution; the first one is 1.
    count: u64,
    /// The end of the last sector.
    tail: Option<Tail>,
}

/// What the lidars have seen.
#[derive(Debug)]
pub struct Scans {
    rules: Rules,
    eyes: Vec<Eye>,
}

impl Scans {
    /// Creates a memory of these lidars on a robot with this outline; nothing is known yet.
    #[must_use]
    pub fn new(rules: Rules, lidars: &[Lidar], body: &Polygon) -> Self {
        let eye = |(place, lidar): (usize, &Lidar)| Eye {
            lidar: lidar.clone(),
            place,
            slices: slices(lidar, body, rules.reach),
            turns: VecDeque::new(),
            count: 0,
            tail: None,
        };
        Self { rules, eyes: lidars.iter().enumerate().map(eye).collect() }
    }

    /// Name of a lidar.
    #[must_use]
    pub fn name(&self, place: usize) -> &str {
        self.eyes.get(place).map_or("", |eye| &eye.lidar.name)
    }

    /// Processes a sector received at `received`, whose first beam was measured `age` before. Returns the distance from
    /// the robot's reference point to the nearest thing that counts from now on, m.
    pub fn on_scan(&mut self, received: Instant, age: Duration, scan: &DataScan, trail: &Trail) -> Option<f64> {
        let eye = self.eyes.iter_mut().find(|eye| eye.lidar.name == scan.name)?;
        let duration = scan.beam_time * scan.ranges.len() as f64;
        if !(0.0..=TURN_MAX_S).contains(&duration) || !(scan.angle_min + scan.angle_step).is_finite() {
            return None;
        }
        let age = if age > AGE_MAX { Duration::from_secs_f64(duration) } else { age };
        eye.see(received, received - age, scan, trail, &self.rules)
    }

    /// Forgets everything: each direction is unknown until it has been measured again.
    pub fn forget(&mut self) {
        for eye in &mut self.eyes {
            eye.turns.clear();
            eye.tail = None;
            eye.slices.iter_mut().for_each(|slice| slice.turns = 0);
        }
    }

    /// Adds everything that may be in the way at `now`.
    pub fn obstacles(&self, now: Instant, trail: &Trail, found: &mut Vec<Obstacle>) {
        let to_trail = trail.pose(now).to_outer();
        let Rules { evaluations, scan_age_max, .. } = self.rules;
        let kept_for = scan_age_max + Duration::from_secs_f64(TURN_MAX_S);
        for eye in &self.eyes {
            let source = Source::Lidar(eye.place);
            let kept = |(back, turn): &(usize, &Turn)| *back <= TURNS_COUNTED || now.since(turn.since) <= kept_for;
            let turns = eye.turns.iter().rev().enumerate().take_while(kept);
            let counted = turns.flat_map(|(back, turn)| turn.hits.iter().map(move |hit| (back, hit)));
            let sensed = counted.filter(|(_, hit)| hit.turns >= evaluations);
            let sensed = sensed.filter(|(back, hit)| *back <= TURNS_COUNTED || self.is_kept(now, eye, *back, hit));
            let sensed = sensed.map(|(_, hit)| hit);
            found.extend(sensed.map(|hit| {
                let Hit { at, approaches, moves, .. } = *hit;
                Obstacle { at, source, sensed: true, approaches, moves }
            }));
            let unknown = eye.slices.iter().filter(|slice| !slice.is_known(now, &self.rules));
            let covered = unknown.flat_map(|slice| &slice.cover);
            found.extend(covered.map(|at| Obstacle {
                at: to_trail(*at),
                source,
                sensed: false,
                approaches: true,
                moves: false,
            }));
        }
    }

    /// True if something that was found `back` revolutions ago, more than [`TURNS_COUNTED`], still counts: its
    /// direction was not measured in the last one that may miss it, nor since, and is not unknown yet.
    fn is_kept(&self, now: Instant, eye: &Eye, back: usize, hit: &Hit) -> bool {
        let found = eye.count.saturating_sub(back as u64);
        let missed = |slice: &Slice| slice.number >= found + TURNS_COUNTED as u64;
        eye.slices.get(hit.slice).is_some_and(|slice| !missed(slice) && slice.is_known(now, &self.rules))
    }

    /// Adds the parts of the views of which nothing is known at `now`: what [`Self::obstacles`] covers with points.
    pub fn unseen(&self, now: Instant, found: &mut Vec<Unseen>) {
        for eye in &self.eyes {
            let (source, mount) = (Source::Lidar(eye.place), eye.lidar.mount.point());
            let unknown = eye.slices.iter().filter(|slice| !slice.is_known(now, &self.rules));
            let line = |slice: &Slice| {
                let (from, to) = (*slice.cover.first()?, *slice.cover.last()?);
                Some(Unseen { from, to, half: libm::tan(SLICE_RAD / 2.0) * to.distance(mount), source })
            };
            found.extend(unknown.filter_map(line));
        }
    }
}

impl Eye {
    /// Processes a sector whose first beam was measured at `at`. Returns the distance from the robot's reference point
    /// to the nearest thing that counts from now on, m.
    fn see(&mut self, now: Instant, at: Instant, scan: &DataScan, trail: &Trail, rules: &Rules) -> Option<f64> {
        let angle = |k: usize| wrap(scan.angle_min + k as f64 * scan.angle_step);
        let slices: Vec<Option<usize>> = (0..scan.ranges.len()).map(|k| slice_of(&self.lidar, angle(k))).collect();
        self.begin(at, scan.beam_time, &slices);
        let robot = trail.pose(at);
        let here = (robot * self.lidar.mount).point();
        let period = self.period()?;
        let same = SAME_M + WALK_MPS * period;
        let looks = Looks { here, same, slices: &slices, trail, rules };
        let met = self.meet(now, at, scan, &looks)?;
        let (begun, old) = self.old()?;
        let baseline = old.map_or(f64::INFINITY, |old| begun.since(old.since).as_secs_f64());
        let arc = Arc::around(&met, same);
        let turns = self.turns.iter().rev().take(EARLIER_TURNS).flat_map(|turn| &turn.hits);
        let ago = |turns: f64| at - Duration::from_secs_f64(turns * period);
        let (from, to) = (ago(EARLIER.1), ago(EARLIER.0));
        let before = View::new(here, turns.filter(|hit| from < hit.when && hit.when <= to), &arc);
        let old = View::new(here, old.into_iter().flat_map(|turn| &turn.hits), &arc);
        let (mut hits, mut nearest, mut nears) = (Vec::with_capacity(met.len()), f64::INFINITY, false);
        for Met { at: point, bin, distance, follows, finding, slice } in met {
            let found = match finding {
                Finding::Beside => before.turns(bin, distance, same),
                Finding::Alone { across } => before.turns_alone(here, point, across),
            };
            let closing = old.nearest(bin) - distance;
            let comes_nearer = closing > APPROACH_M && closing / baseline > APPROACH_MPS.start;
            // Noise seldom brings two beams nearer, one beside the other.
            let changed = comes_nearer && nears && follows;
            let moves = changed && distance < rules.reach - INTO_REACH_M;
            let approaches = changed && APPROACH_MPS.contains(&(closing / baseline));
            nears = comes_nearer;
            let hit = Hit { at: point, when: at, turns: rules.evaluations.min(found + 1), approaches, moves, slice };
            if approaches || hit.turns == rules.evaluations && found < hit.turns {
                nearest = nearest.min(robot.point().distance(point));
            }
            hits.push(hit);
        }
        self.turns.back_mut()?.hits.append(&mut hits);
        self.tail = Some(Tail::of(scan, at));
        nearest.is_finite().then_some(nearest)
    }

    /// What the beams of a sector met, up to the reach.
    fn meet(&mut self, now: Instant, at: Instant, scan: &DataScan, looks: &Looks<'_>) -> Option<Vec<Met>> {
        let Looks { here, same, slices, trail, rules } = *looks;
        let tail = self.tail.take();
        let gap = tail.as_ref().and_then(|tail| tail.gap(scan, at));
        let (mut met, mut follows) = (Vec::with_capacity(scan.ranges.len()), false);
        let room = HITS_MAX.saturating_sub(self.turns.back()?.hits.len());
        let before = tail.as_ref().zip(gap);
        // Nothing was received: that frees no more than the range at which dark things are seen.
        let frees = |range: f32| range < f32::INFINITY || f64::from(scan.range_max) >= rules.reach;
        for (k, range) in scan.ranges.iter().enumerate().filter(|(_, range)| !range.is_nan()) {
            // What there is no room for would be in the way unseen: from there on nothing is known.
            if met.len() == room {
                break;
            }
            let Some(slice) = slices[k] else { continue };
            if let Some(slice) = self.slices.get_mut(slice)
                && scan.status == DataScan::OK
                && frees(*range)
            {
                slice.measured(now, self.count, rules);
            }
            // What is too near to be measured is right before the lidar.
            let range = f64::from(if *range < 0.0 { scan.range_min } else { *range });
            if range > rules.reach + same {
                follows = false;
                continue;
            }
            let finding = lone::finding(scan, k, range, same, before);
            let angle = wrap(scan.angle_min + k as f64 * scan.angle_step);
            let pose = trail.pose(at + Duration::from_secs_f64(k as f64 * scan.beam_time)) * self.lidar.mount;
            let (sin, cos) = (pose.theta + angle).sin_cos();
            let point = Point { x: pose.x + range * cos, y: pose.y + range * sin };
            let (bin, distance) = seen_from(here, point);
            met.push(Met { at: point, bin, distance, follows, finding, slice });
            follows = true;
        }
        Some(met)
    }

    /// Begins a new revolution if the middle of the sector was seen in this one, [`OVERLAP`] before; `slices` are those
    /// of its beams.
    fn begin(&mut self, at: Instant, beam_time: f64, slices: &[Option<usize>]) {
        let beams = slices.iter().enumerate();
        let beams: Vec<_> = beams.filter_map(|(k, slice)| slice.map(|slice| (k, slice))).collect();
        let (Some((_, first)), Some((_, last))) = (beams.first(), beams.last()) else { return };
        let measured = |k: usize| at + Duration::from_secs_f64(k as f64 * beam_time);
        let (middle_k, middle) = beams[beams.len() / 2];
        let again = |seen: &Option<Instant>| seen.is_some_and(|seen| measured(middle_k).since(seen) > OVERLAP);
        if self.turns.back().is_none_or(|turn| turn.seen.get(middle).is_none_or(again)) {
            let oldest = if self.turns.len() == TURNS_MAX { self.turns.pop_front() } else { None };
            let mut hits = oldest.map_or_else(Vec::new, |oldest| oldest.hits);
            hits.clear();
            self.count += 1;
            let seen = vec![None; self.slices.len()];
            self.turns.push_back(Turn { since: at, seen, hits });
        }
        let Some(turn) = self.turns.back_mut() else { return };
        for (k, slice) in beams.iter().filter(|(_, slice)| slice != first && slice != last) {
            if let Some(seen) = turn.seen.get_mut(*slice) {
                seen.get_or_insert(measured(*k));
            }
        }
    }

    /// Time that the last whole revolution took, s; the longest one before that.
    fn period(&self) -> Option<f64> {
        let mut turns = self.turns.iter().rev().map(|turn| turn.since);
        let since = turns.next()?;
        Some(turns.next().map_or(TURN_MAX_S, |before| since.since(before).as_secs_f64().min(TURN_MAX_S)))
    }

    /// Beginning of the present revolution, and one that is earlier by [`BASELINE`].
    fn old(&self) -> Option<(Instant, Option<&Turn>)> {
        let mut turns = self.turns.iter().rev();
        let since = turns.next()?.since;
        Some((since, turns.find(|turn| since.since(turn.since) >= BASELINE)))
    }
}

impl Slice {
    /// Something was measured in it, or that nothing is there.
    fn measured(&mut self, now: Instant, number: u64, rules: &Rules) {
        if self.number == number {
            return;
        }
        let follows = now.since(self.at) <= rules.scan_age_max;
        self.turns = if follows { rules.evaluations.min(self.turns + 1) } else { 1 };
        (self.at, self.number) = (now, number);
    }

    fn is_known(&self, now: Instant, rules: &Rules) -> bool {
        self.turns >= rules.evaluations && now.since(self.at) <= rules.scan_age_max
    }
}

/// How a sector is looked at.
struct Looks<'a> {
    /// Where the lidar was when it began.
    here: Point,
    /// Distance within which a finding may be that of the revolution before, m.
    same: f64,
    /// The parts of the view in which its beams are.
    slices: &'a [Option<usize>],
    trail: &'a Trail,
    rules: &'a Rules,
}

/// Something that a beam of the present sector met.
#[derive(Clone, Copy, Debug)]
struct Met {
    /// Where, in the frame of the trail, m.
    at: Point,
    /// Its direction and its distance, m, from where the lidar's sector began.
    bin: usize,
    distance: f64,
    /// The measuring beam before it met something, too.
    follows: bool,
    finding: Finding,
    /// The part of the view in which it is.
    slice: usize,
}

/// Directions around those of a sector. Nothing outside of it is compared with the sector, so that the angles of most
/// findings of a revolution need not be computed.
struct Arc {
    /// Its middle: cosine and sine.
    middle: (f64, f64),
    /// Cosine of half of it; `None`: all directions.
    half: Option<f64>,
}

impl Arc {
    /// Half of the widest one, in bins: a wider one has directions behind its middle.
    const WIDEST: usize = BINS / 4 - 5;

    /// The directions in which [`View::turns`] and [`View::nearest`] look for these.
    fn around(met: &[Met], same: f64) -> Self {
        let all = Self { middle: (1.0, 0.0), half: None };
        let Some(middle) = met.get(met.len() / 2).map(|met| met.bin) else { return all };
        let off = |bin: usize| bin.abs_diff(middle).min(BINS - bin.abs_diff(middle));
        let farthest = met.iter().map(|met| off(met.bin)).max().unwrap_or(0);
        let nearest = met.iter().map(|met| met.distance).fold(f64::INFINITY, f64::min);
        // Two more for the widths of bins, one for rounding.
        let half = farthest + beside(nearest, same).max(BESIDE) + 3;
        if half > Self::WIDEST {
            return all;
        }
        let (sin, cos) = libm::sincos((middle as f64 + 0.5) * TAU / BINS as f64);
        Self { middle: (cos, sin), half: Some(libm::cos(half as f64 * TAU / BINS as f64)) }
    }

    /// True unless a point, seen from another one, is in none of these directions.
    fn may_contain(&self, from: Point, point: Point) -> bool {
        let Some(half) = self.half else { return true };
        let (x, y) = (point.x - from.x, point.y - from.y);
        let along = x * self.middle.0 + y * self.middle.1;
        along >= 0.0 && along * along >= half * half * (x * x + y * y)
    }
}

/// Bins on either side of a beam within `same` m of what it met.
fn beside(distance: f64, same: f64) -> usize {
    (libm::asin((same / distance).min(1.0)) / TAU * BINS as f64) as usize
}

/// Findings as they look from somewhere: the nearest one in each direction.
struct View([Nearest; BINS]);

/// The nearest finding in a direction.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    /// Its distance, m; infinite without one.
    distance: f64,
    turns: u32,
    at: Point,
}

impl View {
    fn new<'a>(from: Point, hits: impl Iterator<Item = &'a Hit>, arc: &Arc) -> Self {
        let mut nearest = [Nearest { distance: f64::INFINITY, turns: 0, at: Point::default() }; BINS];
        for Hit { at, turns, .. } in hits.filter(|hit| arc.may_contain(from, hit.at)) {
            let (bin, distance) = seen_from(from, *at);
            if distance < nearest[bin].distance {
                nearest[bin] = Nearest { distance, turns: *turns, at: *at };
            }
        }
        Self(nearest)
    }

    /// Bins up to `beside` places off.
    fn around(&self, bin: usize, beside: usize) -> impl Iterator<Item = &Nearest> {
        let first = BINS + bin - beside;
        (first..=first + 2 * beside).map(|bin| &self.0[bin % BINS])
    }

    /// What was found at a place, or up to `same` m from it.
    fn near(&self, bin: usize, distance: f64, same: f64) -> impl Iterator<Item = &Nearest> {
        // One more: the bins of two directions differ by up to one more than the angle between them.
        let around = self.around(bin, beside(distance, same) + 1);
        around.filter(move |other| (other.distance - distance).abs() <= same)
    }

    /// Most revolutions that have found something at a place, or up to `same` m from it; 0: none.
    fn turns(&self, bin: usize, distance: f64, same: f64) -> u32 {
        self.near(bin, distance, same).map(|other| other.turns).max().unwrap_or(0)
    }

    /// Most revolutions that have found what a beam of a lidar at `from` met alone at a place: up to [`SAME_M`] from it
    /// along the beam, and up to `across` m from the beam; 0: none.
    fn turns_alone(&self, from: Point, at: Point, across: f64) -> u32 {
        let (bin, distance) = seen_from(from, at);
        let (x, y) = (at.x - from.x, at.y - from.y);
        // A place at the lidar has no direction.
        let off = |other: &Nearest| ((other.at.x - from.x) * y - (other.at.y - from.y) * x).abs();
        let near = self.near(bin, distance, SAME_M).filter(|other| off(other) <= across * distance);
        near.map(|other| other.turns).max().unwrap_or(0)
    }

    /// The nearest in a direction, m.
    fn nearest(&self, bin: usize) -> f64 {
        self.around(bin, BESIDE).map(|other| other.distance).fold(f64::INFINITY, f64::min)
    }
}

/// Direction and distance of a point from another.
fn seen_from(from: Point, point: Point) -> (usize, f64) {
    let (x, y) = (point.x - from.x, point.y - from.y);
    let part = (libm::atan2(y, x) / TAU + 1.0) * BINS as f64;
    (part as usize % BINS, libm::hypot(x, y))
}

/// The part of a lidar's view in which a direction is, from its front; `None` outside of its view.
fn slice_of(lidar: &Lidar, angle: f64) -> Option<usize> {
    (angle.abs() <= lidar.view / 2.0).then_some(((angle + lidar.view / 2.0) / SLICE_RAD) as usize)
}

/// The parts of a lidar's view, of which nothing is known yet.
fn slices(lidar: &Lidar, body: &Polygon, reach: f64) -> Vec<Slice> {
    let count = libm::ceil(lidar.view.clamp(0.0, TAU) / SLICE_RAD) as usize;
    let to_robot = lidar.mount.to_outer();
    let farthest = body.radius(lidar.mount.point());
    let slice = |n: usize| {
        let (sin, cos) = libm::sincos((n as f64 + 0.5) * SLICE_RAD - lidar.view / 2.0);
        let at = |distance: f64| to_robot(Point { x: distance * cos, y: distance * sin });
        // It begins where the ray leaves the robot.
        let within = (0..=(farthest / OUTLINE_M) as u32).map(|n| f64::from(n) * OUTLINE_M);
        let outline = within.filter(|distance| body.outside(at(*distance)) <= 0.0).fold(0.0, f64::max);
        let covered = COVERED_M.into_iter().chain([reach]).map(|beyond| at(outline + beyond));
        Slice { cover: covered.collect(), ..Slice::default() }
    };
    (0..count).map(slice).collect()
}

#[cfg(test)]
mod tests;
