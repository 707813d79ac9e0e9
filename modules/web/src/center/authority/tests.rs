//! Outputs of the authority for given inputs: scripted, and for random pages on random networks.

use super::*;

fn at(ms: u64) -> Instant {
    Instant::from_millis(5_000_000 + ms)
}

const LIMITS: Limits = Limits { speed: 0.5, steering: 0.4, sideways: 0.0, rotation: 0.0 };

/// An authority with clients; number `n` is named by its letter, and its clock starts there.
struct Bench {
    authority: Authority,
    seq: u64,
}

impl Bench {
    fn new(clients: usize) -> Self {
        Self::with(LIMITS, clients)
    }

    fn with(limits: Limits, clients: usize) -> Self {
        let mut authority = Authority::new(limits);
        for name in ["a", "b", "c"].into_iter().take(clients) {
            authority.join(name.into(), Role::Operator, name.into());
        }
        let mut bench = Self { authority, seq: 0 };
        bench.said();
        bench
    }

    /// Its outputs, one word each.
    fn said(&mut self) -> Vec<String> {
        let mut said = Vec::new();
        while let Some(say) = self.authority.poll() {
            said.push(match say {
                Output::Motion { source, motion: Motion::Curve { speed, .. }, .. } => format!("{source} {speed}"),
                Output::Motion { source, motion: Motion::Velocity { vx, vy, omega }, .. } => {
                    format!("{source} {vx} {vy} {omega}")
                }
                Output::Creep { source, held } => format!("{source} creep {held}"),
                Output::Zero { source } => format!("{source} 0"),
                Output::Pause { source } => format!("{source} pause"),
                Output::Run { source } => format!("{source} run"),
                Output::Planner { source } => format!("{source} planner"),
                Output::Authority { to, why } => format!("{to}: {why}"),
                Output::Ended { to, hold, why } => format!("{to}: hold {hold}: {why}"),
            });
        }
        said
    }

    /// Created at `t`, received at `ms`.
    fn drive(&mut self, ms: u64, client: ClientId, hold: u64, t: u64, speed: f64) -> Vec<String> {
        self.seq += 1;
        let drive =
            Drive { hold, seq: self.seq, t: t as f64, motion: Motion::Curve { speed, steering: 0.1 }, creep: false };
        self.authority.drive(at(ms), client, drive);
        self.said()
    }

    /// Client 1 at once, a velocity.
    fn velocity(&mut self, ms: u64, hold: u64, vx: f64, vy: f64, omega: f64) -> Vec<String> {
        self.seq += 1;
        let motion = Motion::Velocity { vx, vy, omega };
        self.authority.drive(at(ms), 1, Drive { hold, seq: self.seq, t: ms as f64, motion, creep: false });
        self.said()
    }

    /// Client 1 at once, with the second input held.
    fn creep(&mut self, ms: u64, hold: u64) -> Vec<String> {
        self.seq += 1;
        let drive = Drive {
            hold,
            seq: self.seq,
            t: ms as f64,
            motion: Motion::Curve { speed: 0.2, steering: 0.1 },
            creep: true,
        };
        self.authority.drive(at(ms), 1, drive);
        self.said()
    }

    fn wait(&mut self, until: u64) -> Vec<(u64, String)> {
        let mut said = Vec::new();
        while let Some(due) = self.authority.poll_timeout().filter(|due| *due <= at(until)) {
            self.authority.handle_timeout(due);
            let ms = due.since(at(0)).as_millis() as u64;
            said.extend(self.said().into_iter().map(|word| (ms, word)));
        }
        said
    }

    fn take(&mut self, ms: u64, client: ClientId, from: Option<ClientId>) -> Result<Vec<String>, String> {
        self.authority.take(at(ms), client, from)?;
        Ok(self.said())
    }
}

fn timed(words: &[(u64, &str)]) -> Vec<(u64, String)> {
    words.iter().map(|(ms, word)| (*ms, (*word).into())).collect()
}

#[test]
fn a_velocity_is_forwarded_to_a_base_that_does_not_steer_within_its_limits() {
    let omni = Limits { sideways: 0.5, rotation: 1.2, ..LIMITS };
    let mut bench = Bench::with(omni, 1);
    bench.take(0, 1, None).unwrap();
    assert_eq!(bench.velocity(100, 1, 0.3, -0.5, 1.2), ["a 0.3 -0.5 1.2"]);
    let refused = "1: hold 1: 0 m/s, 0.6 m/s to the left, 0 rad/s are refused: at most 0.5 m/s, 0.5 m/s and 1.2 rad/s";
    assert_eq!(bench.velocity(150, 1, 0.0, 0.6, 0.0), ["a 0", refused], "the hold ends");
    // A differential base does not go sideways; one that steers obeys no velocity but straight ahead.
    let mut bench = Bench::with(Limits { sideways: 0.0, ..omni }, 1);
    bench.take(0, 1, None).unwrap();
    assert_eq!(bench.velocity(100, 1, 0.0, 0.0, -1.0), ["a 0 0 -1"]);
    assert_eq!(bench.velocity(150, 1, 0.0, 0.01, 0.0)[0], "a 0");
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    assert_eq!(bench.velocity(100, 1, 0.2, 0.0, 0.0), ["a 0.2 0 0"]);
    assert_eq!(bench.velocity(150, 1, 0.2, 0.0, f64::NAN)[0], "a 0");
}

#[test]
fn one_client_holds_the_authority_and_others_are_informed() {
    let mut bench = Bench::new(2);
    assert_eq!(bench.take(0, 1, None).unwrap(), ["1: the robot is yours", "2: a holds the robot"]);
    assert!(bench.take(1, 1, None).unwrap().is_empty(), "it has it already");
    assert_eq!(bench.authority.holder(at(2000)).unwrap().since, 2.0);
    assert!(bench.take(2, 2, None).unwrap_err().starts_with("a holds the robot now"));
    assert!(bench.take(2, 2, Some(7)).is_err(), "not the one that it was shown");
    assert_eq!(bench.take(3, 2, Some(1)).unwrap(), ["1: b has taken over from you", "2: you have taken over"]);
    assert!(bench.authority.release(at(4), 1).is_err());
    bench.authority.release(at(5), 2).unwrap();
    assert_eq!(bench.said(), ["1: b has released the robot", "2: you have released the robot"]);
    assert!(bench.take(6, 1, Some(2)).is_ok(), "no holder to take over from");
    bench.authority.leave(at(7), 1);
    assert_eq!(bench.authority.holder(at(7)), None);
}

#[test]
fn a_hold_ends_with_three_zeros_and_is_not_resumed() {
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    assert_eq!(bench.drive(100, 1, 1, 100, 0.3), ["a 0.3"]);
    assert_eq!(bench.drive(150, 1, 1, 150, 0.2), ["a 0.2"]);
    bench.authority.zero(at(170), 1, 1, 3);
    assert_eq!(bench.said(), ["a 0"]);
    assert_eq!(bench.wait(2000), timed(&[(220, "a 0"), (270, "a 0")]));
    assert_eq!(bench.drive(2000, 1, 1, 2000, 0.3), Vec::<String>::new(), "its seq was used by the zero");
    assert_eq!(bench.drive(2001, 1, 1, 2001, 0.3), ["1: hold 1: this hold is over: press anew"]);
    assert!(bench.drive(2002, 1, 1, 2002, 0.3).is_empty(), "reported once");
    assert_eq!(bench.drive(2003, 1, 2, 2003, 0.3), ["a 0.3"]);
}

#[test]
fn silence_ends_a_hold_and_a_new_press_stops_the_zeros() {
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    bench.drive(100, 1, 1, 100, 0.3);
    assert_eq!(bench.wait(299), []);
    let ended = timed(&[(300, "a 0"), (300, "1: hold 1: nothing was heard for 0.2 s")]);
    assert_eq!(bench.wait(300), ended);
    assert_eq!(bench.drive(310, 1, 1, 310, 0.3), Vec::<String>::new(), "ended, and already reported");
    assert_eq!(bench.drive(320, 1, 2, 320, 0.3), ["a 0.3"]);
    assert_eq!(bench.wait(519), []);
}

#[test]
fn commands_delayed_by_the_network_are_late() {
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    bench.authority.ping(at(90), 1, 80.0);
    assert_eq!(bench.drive(100, 1, 1, 90, 0.3), ["a 0.3"]);
    // Created at 140, which is 150 on the robot's clock: valid until 390 plus a little for drift, although silence
    // would end later.
    assert_eq!(bench.drive(280, 1, 1, 140, 0.3), ["a 0.3"]);
    assert_eq!(bench.drive(385, 1, 1, 134, 0.3), Vec::<String>::new(), "241 ms old");
    assert_eq!(bench.wait(389), []);
    let ended = timed(&[(390, "a 0"), (390, "1: hold 1: what was heard came too late")]);
    assert_eq!(bench.wait(391), ended);
    bench.wait(900);
    // A press that begins late is not accepted.
    assert_eq!(bench.drive(1000, 1, 2, 700, 0.3), ["1: hold 2: what was heard came too late: press anew"]);
    assert!(bench.drive(1001, 1, 2, 991, 0.3).is_empty());
    assert_eq!(bench.authority.counts().late, 2);
}

#[test]
fn input_after_the_end_but_before_the_timer_is_ignored() {
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    bench.drive(100, 1, 1, 100, 0.3);
    let said = bench.drive(300, 1, 1, 300, 0.3);
    assert_eq!(said, ["a 0", "1: hold 1: nothing was heard for 0.2 s"]);
}

#[test]
fn repeated_late_foreign_and_invalid_commands_move_nothing() {
    let mut bench = Bench::new(2);
    bench.take(0, 1, None).unwrap();
    bench.drive(100, 1, 1, 100, 0.3);
    let replayed =
        Drive { hold: 1, seq: 1, t: 100.0, motion: Motion::Curve { speed: 0.3, steering: 0.1 }, creep: true };
    bench.authority.drive(at(110), 1, replayed);
    assert!(bench.said().is_empty());
    assert_eq!(bench.drive(120, 2, 1, 120, 0.3), ["2: hold 1: the robot is not yours: take it first"]);
    assert!(bench.drive(121, 2, 1, 121, 0.3).is_empty());
    for (number, bad) in [f64::NAN, f64::INFINITY, 0.51, -0.51].into_iter().enumerate() {
        let hold = number as u64 + 2;
        assert_eq!(bench.drive(130, 1, hold, 130, 0.3), ["a 0.3"]);
        let said = bench.drive(131, 1, hold, 131, bad);
        assert!(said[0] == "a 0" && said[1].starts_with(&format!("1: hold {hold}: {bad} m/s, ")), "{said:?}");
        assert!(bench.drive(132, 1, hold, 132, 0.3).is_empty(), "over");
    }
    bench.drive(140, 1, 9, 140, 0.3);
    let timeless =
        Drive { hold: 9, seq: 999, t: f64::NAN, motion: Motion::Curve { speed: 0.1, steering: 0.0 }, creep: false };
    bench.authority.drive(at(141), 1, timeless);
    assert_eq!(bench.said()[0], "a 0", "an invalid time");
    let counts = bench.authority.counts();
    assert_eq!((counts.repeated, counts.not_holder, counts.refused, counts.over), (1, 2, 5, 4));
}

#[test]
fn lost_authority_disconnection_and_invalid_input_end_the_hold() {
    let mut bench = Bench::new(2);
    bench.take(0, 1, None).unwrap();
    bench.drive(100, 1, 1, 100, 0.3);
    let said = bench.take(110, 2, Some(1)).unwrap();
    assert_eq!(said[..2], ["a 0", "1: hold 1: b has taken over"]);
    assert!(bench.drive(120, 1, 1, 120, 0.3).is_empty(), "it knows");
    assert_eq!(bench.drive(130, 2, 1, 130, 0.2), ["b 0.2"]);
    bench.authority.nonsense(at(140), 2);
    assert_eq!(bench.said()[0], "b 0");
    bench.drive(150, 2, 2, 150, 0.2);
    bench.authority.leave(at(155), 2);
    assert_eq!(bench.said(), ["b 0", "1: b has gone: nobody holds the robot", "2: b has gone: nobody holds the robot"]);
    assert_eq!(bench.wait(1000).iter().filter(|(_, word)| word == "b 0").count(), 2, "its zeros are sent nevertheless");
}

#[test]
fn every_client_may_stop_and_the_planner_resumes_with_the_drives() {
    let mut bench = Bench::new(2);
    bench.take(0, 1, None).unwrap();
    bench.drive(100, 1, 1, 100, 0.3);
    bench.authority.stop(at(120), 2);
    assert_eq!(bench.said(), ["b pause", "a 0", "1: hold 1: b has stopped the robot", "b 0"]);
    let rest = timed(&[(170, "a 0"), (170, "b 0"), (170, "b pause"), (220, "a 0"), (220, "b 0"), (220, "b pause")]);
    assert_eq!(bench.wait(5000), rest);
    bench.authority.resume(at(6000), 1);
    assert_eq!(bench.said(), ["a run"]);
    let said = bench.wait(6400);
    assert_eq!(said, timed(&[(6100, "a planner"), (6300, "a planner")]));
    bench.authority.stop(at(6410), 1);
    assert_eq!(bench.said(), ["a pause", "a 0"]);
    assert!(bench.wait(9000).iter().all(|(_, word)| word != "a planner"), "a stop takes it back");
}

#[test]
fn a_stop_is_repeated_though_its_client_has_gone() {
    let mut bench = Bench::new(2);
    bench.authority.stop(at(120), 2);
    bench.authority.leave(at(120), 2);
    assert_eq!(bench.said(), ["b pause", "b 0"]);
    let rest = timed(&[(170, "b 0"), (170, "b pause"), (220, "b 0"), (220, "b pause")]);
    assert_eq!(bench.wait(5000), rest);
}

#[test]
fn the_second_input_is_forwarded_while_it_is_held_and_ends_with_its_release_or_the_hold() {
    let mut bench = Bench::new(2);
    bench.take(0, 1, None).unwrap();
    assert_eq!(bench.drive(100, 1, 1, 100, 0.2), ["a 0.2"]);
    assert_eq!(bench.creep(150, 1), ["a creep true", "a 0.2"]);
    assert_eq!(bench.creep(200, 1), ["a creep true", "a 0.2"]);
    assert_eq!(bench.drive(210, 1, 1, 210, 0.2), ["a creep false", "a 0.2"], "the release is sent at once");
    assert_eq!(bench.drive(260, 1, 1, 260, 0.2), ["a 0.2"], "once");
    // Whatever ends the hold ends the creep: the pad, silence, somebody else, a Stop.
    bench.creep(300, 1);
    bench.authority.zero(at(310), 1, 1, 99);
    assert_eq!(bench.said(), ["a 0", "a creep false"]);
    bench.seq = 99;
    bench.creep(400, 2);
    let ended = [(600, "a 0"), (600, "a creep false"), (600, "1: hold 2: nothing was heard for 0.2 s")];
    assert_eq!(bench.wait(600), timed(&ended));
    bench.creep(700, 3);
    bench.authority.stop(at(710), 2);
    let said = ["b pause", "a 0", "a creep false", "1: hold 3: b has stopped the robot", "b 0"];
    assert_eq!(bench.said(), said);
    bench.wait(900);
    bench.creep(900, 4);
    assert_eq!(bench.take(910, 2, Some(1)).unwrap()[..2], ["a 0", "a creep false"]);
    bench.wait(1900);
    assert!(!bench.creep(2000, 5).contains(&"a creep true".into()), "another one holds the robot");
}

#[test]
fn clock_drift_is_tracked() {
    let mut bench = Bench::new(1);
    bench.take(0, 1, None).unwrap();
    // An hour at 20 Hz; the page's clock is 100 ppm slow.
    for number in 0..72_000_u64 {
        let ms = number * 50;
        let t = ms as f64 * (1.0 - 1e-4);
        let drive =
            Drive { hold: 1, seq: number, t, motion: Motion::Curve { speed: 0.1, steering: 0.0 }, creep: false };
        bench.authority.drive(at(ms), 1, drive);
        assert_eq!(bench.said(), ["a 0.1"], "{ms}");
    }
}

/// xorshift64*
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) % limit
    }
}

/// Message on its way to the server.
#[derive(Clone, Debug)]
enum Way {
    Ping { t: f64 },
    Drive { drive: Drive, said: u64 },
    Zero { hold: u64, seq: u64 },
    Take { from: Option<ClientId> },
    Release,
    Stop,
    Resume,
    Nonsense,
    Leave,
}

/// Two operators with their own clocks press, release, creep, take over and stop; the network delays, repeats and
/// reorders. The rules hold in every case.
#[test]
fn no_network_moves_the_robot_against_the_rules() {
    let (mut moved, mut crept) = (0, 0);
    for seed in 1..=400_u64 {
        let judge = run(seed);
        (moved, crept) = (moved + judge.moved, crept + judge.crept);
    }
    assert!(moved > 10_000 && crept > 2_000, "{moved}, {crept}: the rules are held against something");
}

fn run(seed: u64) -> Judge {
    let mut chance = Chance(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let mut authority = Authority::new(LIMITS);
    let clocks = [chance.below(1_000_000) as f64, chance.below(1_000_000) as f64];
    for name in ["a", "b"] {
        authority.join(name.into(), Role::Operator, name.into());
    }
    // Arrival time, order among equal times, sender, message.
    let mut ways: Vec<(u64, u64, ClientId, Way)> = Vec::new();
    let (mut seqs, mut holds, mut pressed, mut creeps) = ([0_u64; 2], [0_u64; 2], [false; 2], [false; 2]);
    let worst = [1, 40, 200, 800][chance.below(4) as usize];
    for (client, t) in (1..).zip(clocks) {
        ways.push((0, 0, client, Way::Ping { t }));
    }
    for said in (10..6000_u64).step_by(10) {
        for index in 0..2 {
            let (client, t) = (index as ClientId + 1, clocks[index] + said as f64);
            let event = chance.below(400);
            let mut sent = Vec::new();
            match event {
                0..=5 => (pressed[index], holds[index]) = (true, holds[index] + 1),
                6..=8 if pressed[index] => {
                    pressed[index] = false;
                    seqs[index] += 1;
                    sent.push(Way::Zero { hold: holds[index], seq: seqs[index] });
                }
                9..=12 => sent.push(Way::Take { from: [None, Some(1), Some(2)][chance.below(3) as usize] }),
                13 => sent.push(Way::Release),
                14 => sent.push(Way::Stop),
                15 => sent.push(Way::Resume),
                16 => sent.push(Way::Nonsense),
                17 if chance.below(10) == 0 => sent.push(Way::Leave),
                18..=25 => creeps[index] = !creeps[index],
                _ => {}
            }
            if pressed[index] && said % 50 == 0 {
                seqs[index] += 1;
                let speed =
                    [0.3, -0.2, f64::NAN, 9.0][usize::from(chance.below(60) == 0) * 2 + chance.below(2) as usize];
                let creep = creeps[index];
                let drive = Drive {
                    hold: holds[index],
                    seq: seqs[index],
                    t,
                    motion: Motion::Curve { speed, steering: 0.1 },
                    creep,
                };
                sent.push(Way::Drive { drive, said });
            }
            for way in sent {
                let copies = 1 + usize::from(chance.below(20) == 0);
                for _ in 0..copies {
                    ways.push((said + chance.below(worst), chance.below(1000), client, way.clone()));
                }
            }
        }
    }
    ways.sort_by_key(|(when, order, ..)| (*when, *order));
    let mut judge = Judge::default();
    for (when, _, client, way) in ways {
        while let Some(due) = authority.poll_timeout().filter(|due| *due <= at(when)) {
            // The timer is late at times.
            let late = (due + Duration::from_millis(chance.below(3))).min(at(when)).max(due);
            authority.handle_timeout(late);
            judge.hear(late, &mut authority, None);
        }
        let now = at(when);
        let mut said = None;
        match way {
            Way::Ping { t } => authority.ping(now, client, t),
            Way::Drive { drive, said: at } => {
                authority.drive(now, client, drive);
                said = Some((client, drive, at));
            }
            Way::Zero { hold, seq } => authority.zero(now, client, hold, seq),
            Way::Take { from } => drop(authority.take(now, client, from)),
            Way::Release => drop(authority.release(now, client)),
            Way::Stop => authority.stop(now, client),
            Way::Resume if authority.holds(client) => authority.resume(now, client),
            Way::Resume => {}
            Way::Nonsense => authority.nonsense(now, client),
            Way::Leave => authority.leave(now, client),
        }
        judge.hear(now, &mut authority, said);
    }
    while let Some(due) = authority.poll_timeout() {
        authority.handle_timeout(due);
        judge.hear(due, &mut authority, None);
    }
    assert!(judge.moving.is_none(), "seed {seed}: it is still moved at the end");
    assert!(judge.creeping.is_none(), "seed {seed}: it still creeps at the end");
    judge
}

#[derive(Default)]
struct Judge {
    /// Client that moves the robot, its hold, and the deadline for a zero.
    moving: Option<(ClientId, u64, Instant)>,
    /// Newest ended hold of each client.
    over: [u64; 3],
    moved: usize,
    /// User whose second input counts on the bus.
    creeping: Option<Arc<str>>,
    crept: usize,
}

impl Judge {
    fn hear(&mut self, now: Instant, authority: &mut Authority, said: Option<(ClientId, Drive, u64)>) {
        let holder = authority.holder(now).map(|holder| holder.id);
        if let Some((_, _, until)) = self.moving {
            assert!(now <= until, "no zero within 250 ms after the last good command");
        }
        while let Some(say) = authority.poll() {
            match say {
                Output::Creep { source, held: true } => {
                    let (client, drive, _) = said.as_ref().expect("only a command creeps");
                    assert!(drive.creep && Some(*client) == holder, "the second input of the holder is held");
                    self.creeping = Some(source);
                    self.crept += 1;
                }
                Output::Creep { source, held: false } => {
                    assert_eq!(self.creeping.take(), Some(source), "one end for each creep");
                }
                Output::Motion { source, motion, .. } => {
                    let (client, drive, at_ms) = said.expect("only a command moves the robot");
                    assert_eq!((motion, Some(client)), (drive.motion, holder), "from the holder, unchanged");
                    assert_eq!(&*source, ["", "a", "b"][client as usize]);
                    assert!(matches!(motion, Motion::Curve { speed, .. } if speed.abs() <= LIMITS.speed));
                    assert_eq!(self.creeping.is_some(), drive.creep, "it ends with its release");
                    assert!(now.since(at(at_ms)) < Duration::from_millis(250), "late");
                    assert!(drive.hold > self.over[client as usize], "hold {} was over", drive.hold);
                    if let Some((before, hold, _)) = self.moving.filter(|(_, hold, _)| *hold != drive.hold) {
                        self.over[before as usize] = hold;
                    }
                    self.moving = Some((client, drive.hold, at(at_ms) + Duration::from_millis(250)));
                    self.moved += 1;
                }
                Output::Zero { source } => {
                    if let Some((client, hold, _)) =
                        self.moving.filter(|(client, ..)| ["", "a", "b"][*client as usize] == &*source)
                        && !authority.holder(now).is_some_and(|holder| holder.driving && holder.id == client)
                    {
                        self.over[client as usize] = hold;
                        self.moving = None;
                    }
                }
                _ => {}
            }
        }
        if let Some(creeping) = &self.creeping {
            // `moving` has a deadline: the creep ends with it.
            let mover = self.moving.map(|(client, ..)| ["", "a", "b"][client as usize]);
            assert_eq!(mover, Some(&**creeping), "who creeps moves the robot");
        }
    }
}
