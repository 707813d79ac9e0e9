//! BR-PSC1: channels that start and stop one after the other, currents, the battery, the PAUSE line, the end of supply.
//!
//! Start-up runs from slaves to masters, power-off the other way round (`ORDER`). Whoever wrote what this answers is
//! already running, so at the start all channels are on, unless it is started cold. Channels are bistable relays: a
//! reset of the processor leaves them as they are, as `docs/facts/robot.md` 1.1 has it of the relay in the motor feed.

use super::battery::{Battery, BatteryConfig};
use crate::scene::Scene;
use base::{Deadlines, Duration, Instant, earliest};
use kinematics::Shape;
use navitools::{Point, Pose};
use rs485::boards::psc1::{
    CHANNELS, Currents, GET_CURRENTS, GET_PWR_STATUS, SET_PWR_STATUS, Unasked, build_currents, build_status, parse_set,
};
use rs485::slave::Asked;
use rs485::{Data, frame::Status};
use std::collections::VecDeque;

/// Between two channels that start.
const START: Duration = Duration::from_millis(500);
/// Between two channels that stop.
const STOP: Duration = Duration::from_secs(1);
/// Channels from slaves to masters: sensors, motors, switch, audio, monitor, both computers, host.
const ORDER: [u8; CHANNELS.len()] = [6, 3, 7, 5, 4, 2, 1, 0];
/// Period of messages on the PAUSE line's state; also sent on each change.
const TELL: Duration = Duration::from_millis(500);
/// Period of announcements of the end of supply, which are not acknowledged.
const ANNOUNCE: Duration = Duration::from_secs(1);
/// Delay of power-off after switching the host off, or with an empty battery.
const GRACE: u8 = 30;
/// A bumper's foam spreads again, and pushes the powerless robot off, within this time.
const SPRING: Duration = Duration::from_millis(500);
/// A bumper is pressed that is nearer to what was touched than the nearest one and this, m.
const TOGETHER: f64 = 0.005;
/// The stop button's number on the wire.
const BUTTON: u8 = 0x20;

const HOST: u8 = 0;
/// The channel that feeds the motors.
pub const MOTORS: u8 = 3;
/// The channel that feeds the boards.
pub const SENSORS: u8 = 6;

base::deadlines! {
    /// What the board waits for, beside switches and channels.
    enum Timer {
        /// The state of the PAUSE line is sent.
        Tell,
        /// The supply is cut. Set after a power-off.
        Cut,
        /// The end of supply is announced. Set after a power-off.
        Announce,
    }
}

/// The board.
#[derive(Debug)]
pub struct Psc1 {
    /// Channels that are on, and that will be when all have been switched.
    on: u8,
    target: u8,
    /// Earliest instant of the next start, and stop.
    next_start: Instant,
    next_stop: Instant,
    battery: Battery,
    /// Until when each bumper is pressed.
    bumpers: [Instant; 8],
    button: Instant,
    /// Other source that pulls the line.
    others: Option<u8>,
    engaged: bool,
    source: u8,
    deadlines: Deadlines<Timer>,
    says: VecDeque<Unasked>,
}

impl Psc1 {
    /// A board that is in use at `start`.
    #[must_use]
    pub fn new(battery: BatteryConfig, start: Instant) -> Self {
        Self {
            on: 0xFF,
            target: 0xFF,
            next_start: start,
            next_stop: start,
            battery: Battery::new(battery, start),
            bumpers: [Instant::ZERO; 8],
            button: Instant::ZERO,
            others: None,
            engaged: false,
            source: 0,
            deadlines: Deadlines::new().with(Timer::Tell, start),
            says: VecDeque::new(),
        }
    }

    /// The main switch is turned on at `now`, and was off: all channels are off, and start one after the other.
    pub fn start_cold(&mut self, now: Instant) {
        self.reset(now);
        (self.on, self.target) = (0, 0xFF);
        (self.next_start, self.next_stop) = (now + START, now + START);
    }

    /// A channel switches itself off, as at an over-current; it stays so until it is switched on. False for the host,
    /// and for a channel that does not exist.
    pub fn trip(&mut self, channel: u8) -> bool {
        let is_one = channel != HOST && usize::from(channel) < CHANNELS.len();
        if is_one {
            self.on &= !(1 << channel);
            self.target &= !(1 << channel);
        }
        is_one
    }

    /// A channel draws 12 A more until an instant; false if there is no such channel.
    pub fn overload(&mut self, channel: u8, until: Instant) -> bool {
        let is_one = usize::from(channel) < CHANNELS.len();
        if is_one {
            self.battery.overload(channel, until);
        }
        is_one
    }

    /// Resets the processor: pending actions are dropped, the relays stay.
    pub fn reset(&mut self, now: Instant) {
        self.target = self.on;
        self.says.clear();
        (self.engaged, self.source) = (false, 0);
        self.deadlines = Deadlines::new().with(Timer::Tell, now);
    }

    /// The main switch is turned on again: all channels start.
    pub fn supply(&mut self) {
        self.keep_supply();
        self.target = 0xFF;
    }

    /// The main switch is turned off.
    pub fn power_off(&mut self, now: Instant, seconds: u8) {
        if !self.deadlines.is_set(Timer::Cut) {
            self.deadlines.set(Timer::Cut, now + Duration::from_secs(seconds.into()));
            self.deadlines.set(Timer::Announce, now);
        }
    }

    /// Keeps the supply: no power cut is pending.
    fn keep_supply(&mut self) {
        self.deadlines.clear(Timer::Cut);
        self.deadlines.clear(Timer::Announce);
    }

    /// True if a channel is on.
    #[must_use]
    pub fn feeds(&self, channel: u8) -> bool {
        self.on & 1 << channel != 0
    }

    /// True if the PAUSE line is pulled, by whomever.
    #[must_use]
    pub fn is_engaged(&self) -> bool {
        self.engaged
    }

    /// Sets another source that pulls the PAUSE line, by its number on the wire.
    pub fn pull(&mut self, others: Option<u8>) {
        self.others = others;
    }

    /// A bumper switch, 1 to 8, is pressed until then.
    pub fn press(&mut self, number: u8, until: Instant) {
        if let Some(bumper) = self.bumpers.get_mut(usize::from(number).wrapping_sub(1)) {
            *bumper = until;
        }
    }

    /// The body ran into something: presses the bumpers that are nearest to it.
    pub fn bump(&mut self, now: Instant, scene: &Scene) {
        let gaps = bumper_gaps(scene);
        let nearest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
        for (number, gap) in (1..).zip(gaps) {
            if gap <= nearest + TOGETHER {
                let until = self.bumpers[usize::from(number) - 1].max(now + SPRING);
                self.press(number, until);
            }
        }
    }

    /// The stop button is pressed until then.
    pub fn push_button(&mut self, until: Instant) {
        self.button = until;
    }

    /// The battery has this voltage at rest until then, V.
    pub fn set_battery(&mut self, volts: f64, until: Instant) {
        self.battery.force(volts, until);
    }

    /// Releases all switches, restores the battery.
    pub fn let_go(&mut self, now: Instant) {
        self.bumpers = [Instant::ZERO; 8];
        self.button = Instant::ZERO;
        self.battery.force(0.0, now);
        self.battery.overload(HOST, now);
    }

    /// Answers a request.
    pub fn answer(&mut self, now: Instant, asked: &Asked, scene: &Scene) -> (Status, Data) {
        match asked.instruction {
            code if code == GET_PWR_STATUS.code => (Status::Ok, build_status(self.on).into_iter().collect()),
            code if code == SET_PWR_STATUS.code => match parse_set(&asked.data) {
                Ok((mask, states)) => {
                    self.set(now, mask, states);
                    (Status::Ok, build_status(self.target).into_iter().collect())
                }
                Err(_) => (Status::Error, Data::new()),
            },
            code if code == GET_CURRENTS.code => {
                (Status::Ok, build_currents(&self.currents(now, scene)).into_iter().collect())
            }
            _ => (Status::UnknownInstruction, Data::new()),
        }
    }

    /// Switching the host off grants it time to halt: then all is cut.
    fn set(&mut self, now: Instant, mask: u8, states: u8) {
        let target = self.target & !mask | states & mask;
        if target & 1 << HOST == 0 && self.on & 1 << HOST != 0 {
            self.power_off(now, GRACE);
        }
        self.target = target | self.on & 1 << HOST;
    }

    /// Currents of the channels and state of the battery, with the noise of the current sensors.
    fn currents(&mut self, now: Instant, scene: &Scene) -> Currents {
        self.battery.pass(now, self.on, scene);
        self.battery.measure(now, self.on, scene)
    }

    /// Handles what is due, and sends a change of the PAUSE line; to be called after every event.
    pub fn handle_timeout(&mut self, now: Instant, scene: &Scene) {
        self.count_down(now);
        self.switch(now);
        self.watch_line(now);
        if self.deadlines.tick(Timer::Tell, now, TELL) {
            self.says.push_back(Unasked::PauseChanged { engaged: self.engaged, source: self.source });
            self.battery.pass(now, self.on, scene);
            if self.battery.is_empty(now, self.on, scene) && self.feeds(HOST) {
                self.power_off(now, GRACE);
                self.count_down(now);
            }
        }
    }

    fn switch(&mut self, now: Instant) {
        let first = |order: &mut dyn Iterator<Item = &u8>, of: u8| {
            order.map(|channel| 1u8 << channel).find(|bit| of & bit != 0)
        };
        if let Some(bit) = first(&mut ORDER.iter().rev(), self.on & !self.target) {
            if self.next_stop <= now {
                self.on &= !bit;
                (self.next_start, self.next_stop) = (now + START, now + STOP);
            }
        } else if let Some(bit) = first(&mut ORDER.iter(), self.target & !self.on)
            && self.next_start <= now
        {
            self.on |= bit;
            (self.next_start, self.next_stop) = (now + START, now + START);
        }
    }

    fn watch_line(&mut self, now: Instant) {
        for until in self.bumpers.iter_mut().chain([&mut self.button]) {
            if *until <= now {
                *until = Instant::ZERO;
            }
        }
        let bumper = (1..).zip(&self.bumpers).find(|(_, until)| **until > now).map(|(number, _)| number);
        let button = (self.button > now).then_some(BUTTON);
        let puller = bumper.or(button).or(self.others);
        let (engaged, source) = (puller.is_some(), puller.unwrap_or(self.source));
        if (engaged, source) != (self.engaged, self.source) {
            (self.engaged, self.source) = (engaged, source);
            self.deadlines.set(Timer::Tell, now);
        }
    }

    fn count_down(&mut self, now: Instant) {
        let Some(due) = self.deadlines.get(Timer::Cut) else { return };
        if due <= now {
            self.keep_supply();
            self.target = 0;
        } else if self.deadlines.tick(Timer::Announce, now, ANNOUNCE) {
            let seconds = due.since(now).as_nanos().div_ceil(1_000_000_000).min(255) as u8;
            self.says.push_back(Unasked::PowerOffRequested { seconds });
        }
    }

    /// Next unsolicited message.
    pub fn poll_unasked(&mut self) -> Option<Unasked> {
        self.says.pop_front()
    }

    /// Instant of the next [`Psc1::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        let pressed = |until: &Instant| *until != Instant::ZERO;
        let released = self.bumpers.into_iter().chain([self.button]).filter(pressed).min();
        let stops = (self.on & !self.target != 0).then_some(self.next_stop);
        let starts = (stops.is_none() && self.target & !self.on != 0).then_some(self.next_start);
        earliest([self.deadlines.next(), released, stops, starts]).unwrap_or(Instant::NEVER)
    }
}

/// Distance of each bumper switch, 1 to 8, to the nearest object, m: four across the front from left to right, four
/// across the rear from right to left.
fn bumper_gaps(scene: &Scene) -> [f64; 8] {
    const DEPTH: f64 = 0.02;
    let body = scene.body();
    let p = body.parameters();
    if let Some(shape) = &p.shape {
        return std::array::from_fn(|place| {
            bumper(shape, place).map_or(f64::INFINITY, |bumper| scene.clearance_of_shape(body.pose(), &bumper))
        });
    }
    let (front, quarter) = (p.wheelbase + p.overhang_front, p.width / 4.0);
    std::array::from_fn(|place| {
        let across = (1.5 - (place % 4) as f64) * quarter;
        let (y, rear, front) = if place < 4 {
            (across, front - DEPTH, front)
        } else {
            (-across, -p.overhang_rear, DEPTH - p.overhang_rear)
        };
        scene.clearance_of(body.pose() * Pose::new(0.0, y, 0.0), rear, front, quarter / 2.0)
    })
}

/// The part of a shape, 2 cm deep, behind a bumper switch: a quarter of its width, of its front or rear.
fn bumper(shape: &Shape, place: usize) -> Option<Shape> {
    const DEPTH: f64 = 0.02;
    const POINTS: usize = 4;
    let (left, right) = (shape.reach(Point { x: 0.0, y: 1.0 }), -shape.reach(Point { x: 0.0, y: -1.0 }));
    let quarter = (left - right) / 4.0;
    let sign = if place < 4 { 1.0 } else { -1.0 };
    let beside = if place < 4 { place } else { 7 - place };
    let edge = |y: f64| {
        let across = |(a, b): (Point, Point)| {
            let within = y >= a.y.min(b.y) && y <= a.y.max(b.y);
            let part = if a.y == b.y { 0.0 } else { (y - a.y) / (b.y - a.y) };
            let x = if a.y == b.y { (sign * a.x).max(sign * b.x) } else { sign * (a.x + part * (b.x - a.x)) };
            within.then_some(x)
        };
        shape.edges().filter_map(across).fold(f64::NEG_INFINITY, f64::max)
    };
    let ends: Vec<(f64, f64)> = (0..=POINTS)
        .map(|n| left - quarter * (beside as f64 + n as f64 / POINTS as f64))
        .map(|y| (edge(y.clamp(right, left)), y.clamp(right, left)))
        .filter(|(x, _)| x.is_finite())
        .collect();
    let corners = ends.iter().flat_map(|&(x, y)| [x, x - DEPTH].map(|x| Point { x: sign * x, y }));
    Shape::hull(&corners.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::{Column, World};
    use rs485::boards::psc1::{build_set, parse_currents};

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn scene(world: World) -> Scene {
        Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1)
    }

    #[test]
    fn bumpers_of_a_polygon_are_along_its_front_and_its_rear() {
        let corners = [(0.4, 0.0), (0.2, 0.25), (-0.2, 0.25), (-0.4, 0.0), (-0.2, -0.25), (0.2, -0.25)];
        let shape = Shape::hull(&corners.map(|(x, y)| Point { x, y })).unwrap();
        let bumpers: Vec<Shape> = (0..8).map(|place| bumper(&shape, place).expect("a bumper")).collect();
        for (place, expected) in
            [(0, (0.2, 0.25)), (1, (0.4, 0.0)), (3, (0.2, -0.25)), (4, (-0.2, -0.25)), (7, (-0.2, 0.25))]
        {
            let (x, y) = expected;
            assert!(bumpers[place].distance(Point { x, y }) < 1e-9, "{place}: {:?}", bumpers[place]);
        }
        // Of each point of the front one of the four is at most a little away.
        for n in 0..100 {
            let y = f64::from(n) * 0.005 - 0.25;
            let front = Point { x: 0.4 - 0.8 * y.abs(), y };
            let near = bumpers[..4].iter().map(|bumper| bumper.distance(front)).fold(f64::INFINITY, f64::min);
            assert!(near < 1e-9 && bumpers[4..].iter().all(|bumper| bumper.distance(front) > 0.1), "{front:?} {near}");
        }
    }

    fn board() -> Psc1 {
        Psc1::new(BatteryConfig::default(), Instant::ZERO)
    }

    fn ask(board: &mut Psc1, now: Instant, code: u8, data: &[u8]) -> Vec<u8> {
        let asked = Asked { instruction: code, data: data.iter().copied().collect(), answered: true };
        let (status, data) = board.answer(now, &asked, &scene(World::default()));
        assert_eq!(status, Status::Ok);
        data.to_vec()
    }

    type Log<T> = Vec<(u64, T)>;

    /// Serves the board from one moment to another; what it said, and each change of its channels, with the time in ms.
    fn run(board: &mut Psc1, from: Instant, until: Instant) -> (Log<Unasked>, Log<u8>) {
        let scene = scene(World::default());
        let (mut said, mut masks) = (Vec::new(), Vec::new());
        while board.poll_timeout() <= until {
            let now = board.poll_timeout().max(from);
            let ms = now.as_nanos() / 1_000_000;
            let before = board.on;
            board.handle_timeout(now, &scene);
            assert!(board.poll_timeout() > now, "due again at {now:?}");
            said.extend(std::iter::from_fn(|| board.poll_unasked()).map(|what| (ms, what)));
            masks.extend((board.on != before).then_some((ms, board.on)));
        }
        (said, masks)
    }

    fn pause(engaged: bool, source: u8) -> Unasked {
        Unasked::PauseChanged { engaged, source }
    }

    #[test]
    fn the_line_is_told_every_500_ms_and_at_each_change() {
        let mut board = board();
        assert_eq!(run(&mut board, at(0), at(700)).0, [(0, pause(false, 0)), (500, pause(false, 0))]);
        board.press(3, at(1150));
        board.handle_timeout(at(710), &scene(World::default()));
        assert_eq!(board.poll_unasked(), Some(pause(true, 3)));
        assert_eq!(run(&mut board, at(710), at(1800)).0, [(1150, pause(false, 3)), (1650, pause(false, 3))]);
    }

    #[test]
    fn whoever_pulls_is_named_and_others_go_on_when_one_lets_go() {
        let mut board = board();
        run(&mut board, at(0), at(100));
        board.pull(Some(0x11));
        board.push_button(at(300));
        let next = board.poll_timeout().min(at(110));
        board.handle_timeout(next, &scene(World::default()));
        assert_eq!(board.poll_unasked(), Some(pause(true, 0x20)));
        assert_eq!(run(&mut board, at(110), at(400)).0, [(300, pause(true, 0x11))]);
        board.pull(None);
        board.handle_timeout(at(450), &scene(World::default()));
        assert!(!board.is_engaged());
    }

    #[test]
    fn channels_stop_a_second_apart_from_masters_to_slaves_and_start_half_a_second_apart_the_other_way() {
        let mut board = board();
        assert_eq!(ask(&mut board, at(0), 0x02, &build_set(0b0110_1000, 0)), [0b1001_0111], "monitor stays");
        assert_eq!(ask(&mut board, at(0), 0x01, &[]), [0xFF]);
        let (_, masks) = run(&mut board, at(0), at(5000));
        assert_eq!(masks, [(0, 0b1101_1111), (1000, 0b1101_0111), (2000, 0b1001_0111)], "audio, motors, sensors");
        ask(&mut board, at(5000), 0x02, &build_set(0xFF, 0xFF));
        let (_, masks) = run(&mut board, at(5000), at(9000));
        assert_eq!(masks, [(5000, 0b1101_0111), (5500, 0b1101_1111), (6000, 0xFF)], "sensors, motors, audio");
    }

    #[test]
    fn switching_the_host_off_announces_the_end_of_supply_and_then_cuts_all() {
        let mut board = board();
        run(&mut board, at(0), at(100));
        assert_eq!(ask(&mut board, at(100), 0x02, &build_set(0xFF, 0)), [1], "the host has its time");
        let (said, masks) = run(&mut board, at(100), at(45_000));
        let seconds: Vec<u8> = said
            .iter()
            .filter_map(
                |(_, what)| if let Unasked::PowerOffRequested { seconds } = what { Some(*seconds) } else { None },
            )
            .collect();
        assert!(seconds.iter().copied().eq((1..=30).rev()), "{seconds:?}");
        let expected = [0, 1, 2, 3, 4, 5, 6].map(|n| 100 + 1000 * n);
        assert!(masks[..7].iter().map(|(ms, _)| *ms).eq(expected), "the others one by one: {masks:?}");
        assert_eq!(masks.last(), Some(&(30_100, 0)), "the host at last");
        board.supply();
        assert_eq!(run(&mut board, at(45_000), at(60_000)).1.last().map(|(_, mask)| *mask), Some(0xFF));
    }

    #[test]
    fn a_cold_board_starts_its_channels_from_slaves_to_masters_the_host_at_last() {
        let mut board = board();
        board.start_cold(at(0));
        assert_eq!(ask(&mut board, at(0), 0x01, &[]), [0]);
        let (said, masks) = run(&mut board, at(0), at(6000));
        let channels = [6, 3, 7, 5, 4, 2, 1, 0];
        let mut on = 0;
        let expected = (1..).map(|n| 500 * n).zip(channels.map(|channel: u8| {
            on |= 1 << channel;
            on
        }));
        assert_eq!(masks, expected.collect::<Vec<_>>());
        assert!(said.iter().all(|(_, what)| *what == pause(false, 0)), "{said:?}");
    }

    #[test]
    fn a_tripped_channel_stays_off_until_it_is_switched_on_and_the_host_does_not_trip() {
        let mut board = board();
        assert!(board.trip(5) && !board.trip(0) && !board.trip(8));
        assert!(run(&mut board, at(0), at(5000)).1.is_empty());
        assert_eq!(ask(&mut board, at(5000), 0x01, &[]), [0b1101_1111]);
        ask(&mut board, at(5000), 0x02, &build_set(0x20, 0x20));
        assert_eq!(run(&mut board, at(5000), at(9000)).1, [(5000, 0xFF)]);
    }

    #[test]
    fn an_overloaded_channel_draws_more_while_it_is_on() {
        let mut board = board();
        board.overload(5, at(1000));
        let drawn = |board: &mut Psc1, ms| parse_currents(&ask(board, at(ms), 0x03, &[])).unwrap().milliamps[5];
        assert!(drawn(&mut board, 500) > 11_000);
        assert!(drawn(&mut board, 1500) < 1000);
        board.overload(5, at(9000));
        board.trip(5);
        assert!(drawn(&mut board, 2000) < 100);
    }

    #[test]
    fn an_empty_battery_ends_the_supply() {
        let mut board = board();
        board.set_battery(19.5, Instant::NEVER);
        let (said, masks) = run(&mut board, at(0), at(60_000));
        let first = said.iter().find(|(_, what)| matches!(what, Unasked::PowerOffRequested { .. }));
        assert!(matches!(first, Some((ms, _)) if (1500..=2000).contains(ms)), "{first:?}");
        assert_eq!(masks.last().map(|(_, mask)| *mask), Some(0));
    }

    #[test]
    fn currents_are_those_of_the_channels_that_are_on() {
        let mut board = board();
        let currents = parse_currents(&ask(&mut board, at(0), 0x03, &[])).unwrap();
        let volts = f64::from(currents.battery_mv) / 1000.0;
        let watts = currents.milliamps.map(|ma| f64::from(ma) / 1000.0 * volts);
        assert!((watts.iter().sum::<f64>() - 150.0).abs() < 5.0, "{watts:?} W");
        assert!((watts[4] - 45.0).abs() < 2.0, "the monitor: {watts:?}");
        board.on = !0x10;
        let currents = parse_currents(&ask(&mut board, at(10), 0x03, &[])).unwrap();
        assert!(currents.milliamps[4] < 100, "{currents:?}");
    }

    #[test]
    fn who_runs_into_something_presses_the_bumpers_that_are_nearest() {
        let mut world = World::default();
        // The front is at 0.75; the switches' middles at 0.225, 0.075, -0.075, -0.225.
        world.columns.push(Column { centre: Point { x: 0.95, y: 0.2 }, radius: 0.199 });
        let gaps = bumper_gaps(&scene(world));
        assert!(gaps[0] < 0.002 && gaps[1] > 0.006 && gaps[7] > 0.5, "{gaps:?}");
        let mut world = World::default();
        world.columns.push(Column { centre: Point { x: -0.35, y: -0.2 }, radius: 0.199 });
        let gaps = bumper_gaps(&scene(world.clone()));
        assert!(gaps[4] < 0.002 && gaps[5] > 0.006 && gaps[0] > 0.5, "{gaps:?}");
        let mut board = board();
        board.bump(at(10), &scene(world));
        board.handle_timeout(at(10), &scene(World::default()));
        assert_eq!((board.is_engaged(), board.source), (true, 5));
        run(&mut board, at(10), at(520));
        assert!(!board.is_engaged(), "its foam has pushed the robot off");
    }
}
