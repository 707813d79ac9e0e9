//! BR-SD1: eight sonars fired in three slots of 70 ms, two floor rangers, and a hand on the PAUSE line.

use crate::scene::Scene;
use crate::sonar::Echo;
use base::{Duration, Instant};
use navitools::{Point, Pose};
use rs485::boards::sd1::{
    self, Both, CLEAR_PAUSE_SRC, GET_BOTH_DATA, GET_IR_DATA, GET_PAUSE_SRC, GET_SRF_DATA, IRS, Irs, NO_ECHO,
    OUT_OF_RANGE, PauseSource, SLOT, SRFS, Srfs, build_srfs,
};
use rs485::slave::Asked;
use rs485::{Data, frame::Status};

/// Slots of a sweep; channel `c` is fired in slot `c % 3`, so neighbours never are at once.
const SLOTS: u64 = sd1::SLOTS as u64;
/// The floor rangers' cycle is 16.5 ms; sampled on the body's grid.
pub const RANGER_PERIOD: Duration = Duration::from_millis(20);
/// Greatest distance at which a sonar without an echo receives another's pulse, m.
const FAR: f64 = 6.0;
/// Two beams have nothing in common whose axes are farther apart, rad.
const APART: f64 = 1.75;
/// Beyond these the floor is not where it should be, m.
const FLOOR: (f64, f64) = (0.080, 0.200);

/// Sensors of a board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sd1Config {
    /// Sonars by channel, at most 8: where on the robot, and where they look.
    pub srfs: Vec<Pose>,
    /// Floor rangers by channel, left first, at most 2: which point of the floor they look at, in the robot's frame.
    pub irs: Vec<Point>,
}

/// Ends of the faults injected into its sonars.
#[derive(Clone, Debug, Default)]
struct Ears {
    blind: Instant,
    stuck: (Instant, Srfs),
    /// Probability of crosstalk, and its end.
    crosstalk: (Instant, f64),
}

/// What a sonar received in a slot, by the number of the slot. A board is asked more often than a sonar fires.
#[derive(Clone, Copy, Debug, Default)]
struct Received {
    /// Its own echo.
    echo: Option<(u64, Option<Echo>)>,
    /// Distance of the first sound, m.
    first: Option<(u64, Option<f64>)>,
}

/// The board.
#[derive(Debug)]
pub struct Sd1 {
    config: Sd1Config,
    address: u8,
    /// Time when its first slot begins: boards are not synchronised.
    start: Instant,
    outside: [u8; IRS],
    pause: PauseSource,
    ears: Ears,
    received: [Received; SRFS],
}

impl Sd1 {
    /// A board that is switched on at `start`.
    #[must_use]
    pub fn new(address: u8, config: Sd1Config, start: Instant) -> Self {
        let start = start + Duration::from_millis(u64::from(address % 7) * 10);
        let (pause, ears) = (PauseSource::None, Ears::default());
        Self { config, address, start, outside: [0; IRS], pause, ears, received: Default::default() }
    }

    /// Resets at `now`.
    pub fn reset(&mut self, now: Instant) {
        let ears = std::mem::take(&mut self.ears);
        *self = Self { ears, ..Self::new(self.address, std::mem::take(&mut self.config), now) };
    }

    /// Blinds the sonars until an instant.
    pub fn blind(&mut self, until: Instant) {
        self.ears.blind = until;
    }

    /// Freezes the sonars' readings until an instant.
    pub fn stick(&mut self, now: Instant, until: Instant, scene: &Scene) {
        self.ears.stuck = (until, self.srfs(now, scene));
    }

    /// Gives each sonar a probability of crosstalk until an instant: readings too near.
    pub fn mix(&mut self, until: Instant, probability: f64) {
        self.ears.crosstalk = (until, probability);
    }

    /// Sonars are well.
    pub fn heal(&mut self) {
        self.ears = Ears::default();
    }

    /// Address on the bus.
    #[must_use]
    pub fn address(&self) -> u8 {
        self.address
    }

    /// Reason for which it pulls the PAUSE line.
    #[must_use]
    pub fn pause(&self) -> PauseSource {
        self.pause
    }

    /// Samples the floor rangers, every [`RANGER_PERIOD`] while the robot moves.
    pub fn sample(&mut self, now: Instant, scene: &Scene) {
        for (channel, source) in [PauseSource::IrLeft, PauseSource::IrRight].into_iter().enumerate() {
            let Some(mount) = self.config.irs.get(channel) else {
                continue;
            };
            let floor = scene.ranger(*mount, self.stream(16 + channel as u64, ranger_cycle(now)));
            let good = floor.is_some_and(|distance| (FLOOR.0..=FLOOR.1).contains(&distance));
            self.outside[channel] = if good { 0 } else { self.outside[channel].saturating_add(1) };
            if self.outside[channel] >= 2 && self.pause == PauseSource::None {
                self.pause = source;
            }
        }
    }

    /// Answers a request.
    pub fn answer(&mut self, now: Instant, asked: &Asked, scene: &Scene) -> (Status, Data) {
        let data = |bytes: &[u8]| (Status::Ok, bytes.iter().copied().collect());
        match asked.instruction {
            code if code == GET_SRF_DATA.code => data(&build_srfs(&self.srfs(now, scene))),
            code if code == GET_IR_DATA.code => data(&self.irs(now, scene)),
            code if code == GET_BOTH_DATA.code => {
                data(&Both { srfs: self.srfs(now, scene), irs: self.irs(now, scene) }.build())
            }
            code if code == GET_PAUSE_SRC.code => data(&self.pause.build()),
            code if code == CLEAR_PAUSE_SRC.code => {
                (self.pause, self.outside) = (PauseSource::None, [0; IRS]);
                data(&[])
            }
            _ => (Status::UnknownInstruction, Data::new()),
        }
    }

    fn stream(&self, channel: u64, cycle: u64) -> u64 {
        u64::from(self.address) << 56 | channel << 48 | cycle
    }

    /// Readings of each channel's last finished slot.
    fn srfs(&mut self, now: Instant, scene: &Scene) -> Srfs {
        if now < self.ears.stuck.0 {
            return self.ears.stuck.1.clone();
        }
        let count = self.config.srfs.len().min(SRFS);
        (0..count).map(|channel| self.srf(now, channel, scene)).collect()
    }

    /// Reading of a channel's last finished slot.
    fn srf(&mut self, now: Instant, channel: usize, scene: &Scene) -> u16 {
        let slots = now.since(self.start).as_nanos() as u64 / SLOT.as_nanos() as u64;
        // The latest slot before the running one that is this channel's.
        let turn = channel as u64 % SLOTS;
        let Some(slot) = (0..slots).rev().take(SLOTS as usize).find(|slot| slot % SLOTS == turn) else {
            return NO_ECHO;
        };
        if now < self.ears.blind {
            return NO_ECHO;
        }
        let heard = self.first(channel, slot, scene);
        let metres = scene.reading(heard, self.stream(channel as u64, slot));
        let (mixed, probability) = self.ears.crosstalk;
        let mut random = scene.random(self.stream(32 + channel as u64, slot));
        let metres = match now < mixed && random.chance(probability) {
            true => Some(metres.unwrap_or(FAR) * random.uniform()),
            false => metres,
        };
        metres.map_or(NO_ECHO, |metres| libm::round(metres * 1000.0) as u16)
    }

    /// Distance of the first sound that a channel received in a slot, m.
    fn first(&mut self, channel: usize, slot: u64, scene: &Scene) -> Option<f64> {
        match self.received[channel].first {
            Some((known, first)) if known == slot => first,
            _ => {
                let first = self.heard(channel, slot, scene);
                self.received[channel].first = Some((slot, first));
                first
            }
        }
    }

    /// Distance of the first sound received in a slot, m: its own echo, or another's fired with it.
    fn heard(&mut self, channel: usize, slot: u64, scene: &Scene) -> Option<f64> {
        let mount = self.config.srfs[channel];
        let mut first = self.echo(channel, slot, scene).map(|echo| echo.distance);
        for other in 0..self.config.srfs.len().min(SRFS) {
            let together = other != channel && other % SLOTS as usize == channel % SLOTS as usize;
            // Sensors that look away from each other have nothing in common.
            if !together || libm::fabs((self.config.srfs[other].theta - mount.theta).radians()) > APART {
                continue;
            }
            let stream = self.stream(64 + 8 * channel as u64 + other as u64, slot);
            let echo = self.echo(other, slot, scene);
            let overheard = echo.and_then(|echo| scene.overheard(mount, self.fired(slot), &echo, stream));
            first = overheard.into_iter().chain(first).reduce(f64::min);
        }
        first
    }

    /// Echo of a channel's own sound in a slot.
    fn echo(&mut self, channel: usize, slot: u64, scene: &Scene) -> Option<Echo> {
        match self.received[channel].echo {
            Some((known, echo)) if known == slot => echo,
            _ => {
                let stream = self.stream(48 + channel as u64, slot);
                let echo = scene.echo(self.config.srfs[channel], self.fired(slot), stream);
                self.received[channel].echo = Some((slot, echo));
                echo
            }
        }
    }

    /// Instant at which a slot begins.
    fn fired(&self, slot: u64) -> Instant {
        Instant::from_nanos(self.start.as_nanos() + slot * SLOT.as_nanos() as u64)
    }

    fn irs(&self, now: Instant, scene: &Scene) -> Irs {
        let measure = |(channel, mount): (usize, &Point)| {
            let metres = scene.ranger(*mount, self.stream(16 + channel as u64, ranger_cycle(now)));
            metres.map_or(OUT_OF_RANGE, |metres| libm::round(metres * 1000.0) as u8)
        };
        self.config.irs.iter().take(IRS).enumerate().map(measure).collect()
    }
}

fn ranger_cycle(now: Instant) -> u64 {
    now.as_nanos() / RANGER_PERIOD.as_nanos() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::World;

    fn scene(world: World) -> Scene {
        Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::exact(), 1)
    }

    fn board(irs: Vec<Point>) -> Sd1 {
        let ahead = vec![Pose::new(0.75, 0.0, 0.0); 3];
        // Address 0x15 begins at once: 0x15 % 7 == 0.
        Sd1::new(0x15, Sd1Config { srfs: ahead, irs }, Instant::ZERO)
    }

    fn ask(board: &mut Sd1, at_ms: u64, code: u8, scene: &Scene) -> Vec<u8> {
        let asked = Asked { instruction: code, data: Data::new(), answered: true };
        let (status, data) = board.answer(Instant::from_millis(at_ms), &asked, scene);
        assert_eq!(status, Status::Ok);
        data.to_vec()
    }

    #[test]
    fn a_channel_says_what_its_last_finished_slot_measured() {
        let mut scene = scene(World::hall(20.0, 12.0));
        let mut board = board(Vec::new());
        // The wall ahead is 9.25 m from the sensors; drive until it is in range.
        scene.demand.wheels[0] = Some(1.0);
        let (mut poses, mut at) = (vec![scene.body().pose().x; 1], 0);
        while scene.body().pose().x < 16.0 {
            scene.step();
            poses.push(scene.body().pose().x);
            at += 5;
        }
        let answer = ask(&mut board, at, 0x01, &scene);
        let slots = at / 70;
        for channel in 0..3 {
            let slot = (0..slots).rev().find(|slot| slot % 3 == channel).unwrap();
            let x = poses[(slot * 70 / 5) as usize];
            let mm = u16::from_le_bytes([answer[2 * channel as usize], answer[2 * channel as usize + 1]]);
            let expected = libm::round((20.0 - 0.75 - x) * 100.0) as u16 * 10;
            assert_eq!(mm, expected, "channel {channel}, fired at {} ms of {at}", slot * 70);
        }
    }

    #[test]
    fn a_board_that_is_asked_often_answers_as_one_that_is_asked_for_the_first_time() {
        let mut world = World::hall(20.0, 12.0);
        (world.people.count, world.places) = (20, vec![Point { x: 12.0, y: 6.0 }, Point { x: 14.0, y: 6.5 }]);
        let mut scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 3);
        let srfs: Vec<Pose> = (0..8).map(|channel| Pose::new(0.7, 0.0, 0.3 * f64::from(channel) - 1.0)).collect();
        let new = || Sd1::new(0x15, Sd1Config { srfs: srfs.clone(), irs: Vec::new() }, Instant::ZERO);
        let (mut often, mut answers) = (new(), Vec::new());
        scene.demand.wheels[0] = Some(0.4);
        for at in (0..20_000).step_by(35) {
            while scene.next_step() <= Instant::from_millis(at) {
                scene.step();
            }
            if at == 10_000 {
                assert!(scene.kidnap(1));
            }
            let answer = ask(&mut often, at, 0x01, &scene);
            assert_eq!(answer, ask(&mut new(), at, 0x01, &scene), "at {at} ms");
            answers.push(answer);
        }
        answers.dedup();
        assert!(answers.len() > 250, "{} different ones", answers.len());
    }

    #[test]
    fn ears_that_are_blind_stuck_or_mixed_say_so_until_they_are_well() {
        let mut world = World::hall(20.0, 12.0);
        world.start = Pose::new(16.0, 6.0, 0.0);
        let mut scene = scene(world);
        let mut board = board(Vec::new());
        let well = ask(&mut board, 500, 0x01, &scene);
        board.blind(Instant::from_millis(900));
        assert_eq!(ask(&mut board, 800, 0x01, &scene), [NO_ECHO.to_le_bytes(); 3].concat());
        board.reset(Instant::from_millis(800));
        assert_eq!(ask(&mut board, 899, 0x01, &scene), [NO_ECHO.to_le_bytes(); 3].concat(), "a reset does not help");
        board.reset(Instant::ZERO);
        assert_eq!(ask(&mut board, 1000, 0x01, &scene), well);
        board.stick(Instant::from_millis(1000), Instant::from_millis(3000), &scene);
        scene.demand.wheels[0] = Some(0.5);
        for _ in 0..400 {
            scene.step();
        }
        assert_eq!(ask(&mut board, 2900, 0x01, &scene), well);
        let nearer = ask(&mut board, 3000, 0x01, &scene);
        assert_ne!(nearer, well);
        board.mix(Instant::from_millis(4000), 1.0);
        let mixed = ask(&mut board, 3000, 0x01, &scene);
        let metres =
            |bytes: &[u8]| bytes.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect::<Vec<_>>();
        assert!(metres(&mixed).iter().zip(metres(&nearer)).all(|(mixed, well)| *mixed < well), "{mixed:?}");
        board.heal();
        assert_eq!(ask(&mut board, 3000, 0x01, &scene), nearer);
    }

    #[test]
    fn before_the_first_slot_is_over_there_is_no_echo() {
        let mut world = World::hall(20.0, 12.0);
        world.start = Pose::new(16.0, 6.0, 0.0);
        let scene = scene(world);
        let mut board = board(vec![Point { x: 0.8, y: 0.2 }]);
        assert_eq!(ask(&mut board, 69, 0x01, &scene), [0; 6]);
        // 20 - 16 - 0.75 = 3.25 m; one slot is over, then all three.
        assert_eq!(ask(&mut board, 70, 0x01, &scene), [0xB2, 0x0C, 0, 0, 0, 0]);
        let both = ask(&mut board, 210, 0x10, &scene);
        assert_eq!(both[..8], [3, 0xB2, 0x0C, 0xB2, 0x0C, 0xB2, 0x0C, 1]);
        assert!((112..=128).contains(&both[8]), "{}", both[8]);
    }

    #[test]
    fn two_samples_without_floor_pull_the_pause_line_until_it_is_let_go() {
        let mut world = World::hall(20.0, 12.0);
        let p = |x, y| Point { x, y };
        world.drops.push(vec![p(10.5, 5.0), p(12.0, 5.0), p(12.0, 7.0), p(10.5, 7.0)]);
        let scene = scene(world);
        let mut board = board(vec![p(0.0, 0.2), p(0.8, -0.2)]);
        board.sample(Instant::from_millis(20), &scene);
        assert_eq!(ask(&mut board, 20, 0x20, &scene), [0]);
        board.sample(Instant::from_millis(40), &scene);
        assert_eq!(ask(&mut board, 40, 0x20, &scene), [2]);
        assert_eq!(ask(&mut board, 40, 0x02, &scene)[1], 255);
        assert_eq!(ask(&mut board, 40, 0x21, &scene), []);
        assert_eq!(board.pause(), PauseSource::None);
    }
}
