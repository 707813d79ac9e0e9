//! Content of a picture: collected from messages, in bounded memory.

use super::series::{Lane, Series, Ticks, Track};
use crate::Footprint;
use diagnostics::Subjects;
use messages::{Message, StopReports, common, lowlevel, middlelevel, simulation};
use navitools::{Point, Pose};
use simulator::people::Contact;
use simulator::world::World;
use std::collections::BTreeMap;

/// Initial interval between ellipses, s, and maximum number of ellipses.
const ELLIPSE_INTERVAL_S: f64 = 2.0;
const ELLIPSES_MAX: usize = 256;
/// Time without an announcement after which a module is considered absent, s.
const STATE_VALID_S: f64 = 2.5;
/// Time for which the reason not to move (5 Hz or more) and the PAUSE line (2 Hz) remain valid, s.
const REASON_VALID_S: f64 = 1.0;
/// Time before the end of the picture from which on the guard's fields are drawn, s: the guard sends them at 20 Hz.
const FIELDS_VALID_S: f64 = 0.5;
const PAUSE_VALID_S: f64 = 2.0;
/// Maximum numbers of entries; those left out are counted.
const MODULES_MAX: usize = 256;
const TEXTS_MAX: usize = 500;
const MARKS_MAX: usize = 100;
const CONTACTS_MAX: usize = 1000;
const CELLS_MAX: usize = 50_000;
const FIELDS_MAX: usize = 10;
const CORNERS_MAX: usize = 64;
/// Greatest distance of a corner from the robot along an axis, m.
const CORNER_MAX_M: f64 = 100.0;
/// Speed below which the robot stands, m/s.
const STANDSTILL_MPS: f64 = 0.01;
/// Maximum length of a text, characters.
const TEXT_CHARS_MAX: usize = 200;
/// Largest plausible distance of a timestamp from the first one, s.
const RUN_MAX_S: f64 = 31.0 * 86_400.0;

/// Headline of a picture.
#[derive(Clone, Debug, Default)]
pub struct Title {
    /// Name of the run.
    pub run: String,
    /// Name of the robot.
    pub robot: String,
    /// Program that recorded the run.
    pub program: String,
    /// Remarks of the run's reader: damage, missing data.
    pub remarks: Vec<String>,
}

/// Content of a picture of a run.
#[derive(Debug, Default)]
pub struct Picture {
    pub(super) title: Title,
    pub(super) world: World,
    pub(super) geometry: Option<Footprint>,
    /// First and last time, s since the UNIX epoch.
    pub(super) span: Option<(f64, f64)>,
    /// Number of messages with implausible timestamps.
    pub(super) implausible: u64,
    pub(super) truth: Track,
    pub(super) estimate: Track,
    pub(super) pose: Option<Pose>,
    pub(super) ellipses: Vec<Ellipse>,
    ellipse_every: f64,
    pub(super) plan: Vec<Point>,
    pub(super) cells: Vec<Point>,
    pub(super) cell: f64,
    pub(super) contacts: Vec<Point>,
    /// Number of contacts of the body, as counted by the simulation: first and last.
    collisions: Option<(i32, i32)>,
    pub(super) speed: Series,
    pub(super) speed_target: Series,
    /// Greatest speeds that the guard permits, forward and, negative, backward.
    pub(super) bounds: [Series; 2],
    /// Fields of the guard, and their time, s.
    fields: (f64, Vec<GuardField>),
    pub(super) steering: Series,
    pub(super) steering_target: Series,
    pub(super) voltage: Series,
    pub(super) charge: Series,
    /// Reports by severity.
    pub(super) errors: [Ticks; 3],
    pub(super) texts: Vec<ReportGroup>,
    subjects: Subjects,
    /// Number of reports whose text was left out.
    pub(super) texts_left_out: u64,
    pub(super) states: BTreeMap<String, Lane<i8>>,
    /// Number of announcements of modules that were left out.
    pub(super) announcements_left_out: u64,
    /// Causes that hold the robot, by number.
    holds: Lane<StandstillCause>,
    /// Same as text, for a log from before the numbers.
    reasons: Lane<StandstillCause>,
    /// Source of the PAUSE line.
    pub(super) pause: Lane<StandstillCause>,
    stops: StopReports,
    pub(super) marks: Vec<(f64, String)>,
    pub(super) unmarked: u64,
}

/// Cause of a standstill.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StandstillCause {
    /// Text; empty while the robot may move.
    pub words: String,
    /// True if nothing is wrong: there is no command to move.
    pub idle: bool,
}

impl StandstillCause {
    fn of(words: &str) -> Self {
        Self { words: brief(words), idle: false }
    }
}

/// Estimated position with its uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse {
    at: f64,
    /// Position, m.
    pub middle: Point,
    /// Covariance of x and y, m²: xx, xy, yy.
    pub covariance: [f64; 3],
}

/// Field of the guard, in the robot's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct GuardField {
    /// What is in it stops the robot; else it slows the robot.
    pub protective: bool,
    /// Something is in it.
    pub occupied: bool,
    /// Corners, m.
    pub corners: Vec<Point>,
}

/// Reports of the same fault with the same subject; with the same text if the subject is unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportGroup {
    /// First report, s.
    pub first: f64,
    /// Last report, s.
    pub last: f64,
    /// Number of reports.
    pub times: u64,
    /// 0 NOTICE, 1 WARNING, 2 ERROR.
    pub severity: usize,
    /// Reporting module.
    pub module: String,
    /// Number of the fault.
    pub number: i32,
    /// Subject, if known.
    pub subject: Option<String>,
    /// Text of the first report.
    pub message: String,
}

impl Picture {
    /// Creates an empty picture of this world, for a robot of this geometry if known.
    #[must_use]
    pub fn new(world: World, geometry: Option<Footprint>) -> Self {
        Self {
            world,
            geometry,
            ellipse_every: ELLIPSE_INTERVAL_S,
            fields: (f64::NEG_INFINITY, Vec::new()),
            ..Self::default()
        }
    }

    /// Sets the headline.
    pub fn entitle(&mut self, title: Title) {
        self.title = title;
    }

    /// True if it contains no data of a robot.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let nowhere = self.truth.spots().is_empty() && self.estimate.spots().is_empty();
        nowhere && self.speed.range().is_none() && self.states.is_empty()
    }

    /// Adds a message sent or received at this time, microseconds since the UNIX epoch. Messages that a picture does
    /// not show are ignored. Per channel and sender they must be in order; earlier ones are left out.
    pub fn take(&mut self, at_us: i64, message: &Message) {
        let at = at_us as f64 / 1e6;
        match message {
            Message::SimDataTruth(truth) => self.at(at).map(|this| this.on_truth(at, truth)),
            Message::MlDataEstimate(estimate) => self.at(at).map(|this| this.on_estimate(at, estimate)),
            Message::MlDataPlan(plan) => self.at(at).map(|this| this.plan = path(&plan.x, &plan.y)),
            Message::MlDataObstacles(obstacles) => self.at(at).map(|this| {
                this.cells = path(&obstacles.x, &obstacles.y);
                this.cell = obstacles.size;
            }),
            Message::LlDataMotion(motion) => self.at(at).map(|this| this.on_motion(at, motion)),
            Message::LlDataGuard(guard) => self.at(at).map(|this| this.on_guard(at, guard)),
            Message::LlDataPower(power) => self.at(at).map(|this| {
                this.voltage.push(at, power.voltage);
                this.charge.push(at, 100.0 * power.charge);
            }),
            Message::LlDataHold(list) if list.is_of_motion() => self.at(at).map(|this| {
                // A bound is a cause of standstill only while the robot stands.
                let stands = this.speed.ends().is_none_or(|(_, last)| last.abs() < STANDSTILL_MPS);
                let is_notice = |hold: &lowlevel::Hold| hold.cause().is_some_and(messages::Hold::is_notice);
                let hold = list.holds.iter().find(|hold| stands || !is_notice(hold));
                let words = hold.map_or(String::new(), lowlevel::Hold::words);
                this.holds.push(
                    at,
                    StandstillCause { idle: list.is_idle(), ..StandstillCause::of(&words) },
                    REASON_VALID_S,
                );
            }),
            Message::LlEventStop(stop) => self.at(at).and_then(|this| {
                let stop = this.stops.on_report(stop)?;
                let source = if stop.source.is_empty() { "engaged" } else { &stop.source };
                let stand = if stop.engaged { StandstillCause::of(source) } else { StandstillCause::default() };
                this.pause.push(at, stand, PAUSE_VALID_S);
                Some(())
            }),
            Message::CmDataState(state) => self.at(at).map(|this| this.on_state(at, state)),
            Message::CmEventError(error) => self.at(at).map(|this| this.on_error(at, error)),
            Message::CmDataFaults(list) => {
                self.subjects.on_list(list);
                None
            }
            Message::CmCmdLog(log) if log.action == common::CmdLog::MARK => {
                self.mark(at_us, &log.text);
                None
            }
            _ => None,
        };
    }

    /// Adds a mark set at this time, microseconds since the UNIX epoch.
    pub fn mark(&mut self, at_us: i64, text: &str) {
        let at = at_us as f64 / 1e6;
        let Some(this) = self.at(at) else { return };
        let mark = (at, brief(text));
        if this.marks.contains(&mark) {
            return;
        }
        match this.marks.len() < MARKS_MAX {
            true => this.marks.push(mark),
            false => this.unmarked += 1,
        }
    }

    /// Adds a line printed by a module: the simulation reports contacts so.
    pub fn note(&mut self, line: &str) {
        if let Ok(contact) = line.parse::<Contact>()
            && self.contacts.len() < CONTACTS_MAX
        {
            self.contacts.push(contact.at);
        }
    }

    /// Causes of standstill: by number, or the text of a log without numbers.
    pub(super) fn stands(&self) -> &Lane<StandstillCause> {
        if self.holds.spans().is_empty() { &self.reasons } else { &self.holds }
    }

    /// Number of contacts of the body.
    #[must_use]
    pub fn contacts(&self) -> u64 {
        let counted = self.collisions.map_or(0, |(first, last)| i64::from(last) - i64::from(first));
        (self.contacts.len() as u64).max(u64::try_from(counted).unwrap_or(0))
    }

    /// Returns `self` if the time is plausible for the run.
    fn at(&mut self, at: f64) -> Option<&mut Self> {
        let (from, to) = self.span.unwrap_or((at, at));
        if (at - from).abs() > RUN_MAX_S || (at - to).abs() > RUN_MAX_S {
            self.implausible += 1;
            return None;
        }
        self.span = Some((from.min(at), to.max(at)));
        Some(self)
    }

    fn on_truth(&mut self, at: f64, truth: &simulation::DataTruth) {
        let pose = Pose::new(truth.x, truth.y, truth.theta);
        let sound = truth.x.is_finite() && truth.y.is_finite() && truth.theta.is_finite();
        self.pose = if sound { Some(pose) } else { self.pose };
        self.truth.push(at, pose.point());
        let first = self.collisions.map_or(truth.collisions, |(first, _)| first);
        self.collisions = Some((first, truth.collisions));
    }

    fn on_estimate(&mut self, at: f64, estimate: &middlelevel::DataEstimate) {
        if estimate.quality < middlelevel::DataEstimate::COARSE {
            return;
        }
        let middle = Point { x: estimate.x, y: estimate.y };
        self.estimate.push(at, middle);
        // A real robot has no truth.
        if self.truth.spots().is_empty() && middle.x.is_finite() && middle.y.is_finite() && estimate.theta.is_finite() {
            self.pose = Some(Pose::new(estimate.x, estimate.y, estimate.theta));
        }
        if self.ellipses.last().is_some_and(|last| at - last.at < self.ellipse_every) {
            return;
        }
        let [[xx, xy, _], [_, yy, _], _] = estimate.covariance;
        self.ellipses.push(Ellipse { at, middle, covariance: [xx, xy, yy] });
        if self.ellipses.len() > ELLIPSES_MAX {
            self.ellipse_every *= 2.0;
            let mut n = 0;
            self.ellipses.retain(|_| {
                n += 1;
                n % 2 == 1
            });
        }
    }

    fn on_motion(&mut self, at: f64, motion: &lowlevel::DataMotion) {
        self.speed.push(at, motion.speed);
        self.speed_target.push(at, motion.speed_target);
        self.steering.push(at, motion.steering);
        self.steering_target.push(at, motion.steering_target);
        self.reasons.push(at, StandstillCause::of(&motion.reason), REASON_VALID_S);
    }

    fn on_guard(&mut self, at: f64, guard: &lowlevel::DataGuard) {
        let [forward, backward] = &mut self.bounds;
        forward.push(at, guard.forward);
        backward.push(at, -guard.backward);
        let field = |field: &lowlevel::Field| GuardField {
            protective: field.kind == lowlevel::Field::PROTECTIVE,
            occupied: field.occupied,
            corners: path(&field.x, &field.y),
        };
        let near = |place: &f64| place.abs() <= CORNER_MAX_M;
        let sound = |field: &&lowlevel::Field| {
            (3..=CORNERS_MAX).contains(&field.x.len())
                && field.x.len() == field.y.len()
                && field.x.iter().chain(&field.y).all(near)
        };
        self.fields = (at, guard.fields.iter().filter(sound).take(FIELDS_MAX).map(field).collect());
    }

    /// Fields of the guard at the end of the picture.
    pub(super) fn fields(&self) -> &[GuardField] {
        let end = self.span.map_or(f64::INFINITY, |(_, to)| to);
        if end - self.fields.0 <= FIELDS_VALID_S { &self.fields.1 } else { &[] }
    }

    fn on_state(&mut self, at: f64, state: &common::DataState) {
        let module = brief(&state.module);
        if self.states.len() >= MODULES_MAX && !self.states.contains_key(&module) {
            self.announcements_left_out += 1;
            return;
        }
        self.states.entry(module).or_default().push(at, state.state, STATE_VALID_S);
    }

    fn on_error(&mut self, at: f64, error: &common::Error) {
        let severity = usize::try_from(error.severity).map_or(2, |severity| severity.min(2));
        self.errors[severity].push(at);
        let (module, message) = (brief(&error.module), brief(&error.message));
        let subject = self.subjects.of(error).map(|subject| brief(&subject));
        let same = |told: &&mut ReportGroup| {
            (told.number, told.severity) == (error.number, severity)
                && told.module == module
                && told.subject == subject
                && (subject.is_some() || told.message == message)
        };
        if let Some(told) = self.texts.iter_mut().find(same) {
            (told.first, told.last) = (told.first.min(at), told.last.max(at));
            told.times += 1;
        } else if self.texts.len() < TEXTS_MAX {
            let number = error.number;
            self.texts.push(ReportGroup { first: at, last: at, times: 1, severity, module, number, subject, message });
        } else {
            self.texts_left_out += 1;
        }
    }
}

fn path(x: &[f64], y: &[f64]) -> Vec<Point> {
    let sound = |point: &Point| point.x.is_finite() && point.y.is_finite();
    x.iter().zip(y).map(|(x, y)| Point { x: *x, y: *y }).filter(sound).take(CELLS_MAX).collect()
}

/// First line of a text, shortened.
fn brief(text: &str) -> String {
    text.chars().take(TEXT_CHARS_MAX).map(|c| if c.is_control() { ' ' } else { c }).collect()
}
