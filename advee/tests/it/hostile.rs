//! Campaign of bad input: every datagram, file, frame and request that has ever done harm, and mutations of them, sent
//! to a robot that drives or stands. Whatever arrives, the robot goes on as commanded or stops; no process dies, memory
//! stays bounded, and an operator can drive on afterwards. Judged by the simulated body, the kernel's list of
//! processes, and the bus.
//!
//! `cargo test` runs one round of each kind, with a fixed seed; `make bad-input MINUTES=60 SEED=7` goes on for that
//! time. The choices of a round depend on seed and number alone: `ROUND=123` repeats that round.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod attack;
mod recipes;

use crate::support::{self, Robot, workspace};
use attack::{Attack, Yard};
use messages::{Hold, common, lowlevel};
use module::State;
use simulator::Random;
use std::collections::{BTreeMap, BTreeSet};
use std::net::TcpListener;
use std::time::{Duration, Instant};

/// Speed that the operator commands, m/s, on a circle.
const SPEED: f64 = 0.3;
const STEERING: f64 = 0.4;
/// Speed beyond the commanded one that a judge calls too fast, m/s: the drive's ripple, and one unit of its resolution.
const MARGIN: f64 = 0.05;
/// Time for which an earlier, greater command excuses a speed: ramp, time to live, and one sample.
const BRAKING: Duration = Duration::from_millis(1200);
/// Maximum distance by which frames of another CANopen master, which drives obey, move a robot before it stands, m.
const FOREIGN_WAY: f64 = 0.3;
/// Growth from which a process counts as unbounded, bytes: a log's buffer is smaller, the buffer of an announced
/// message was larger.
const GROWTH_MAX: u64 = 96 << 20;
/// Speed below which it stands, m/s: an attack may take a second, in which the last speed that was seen counts.
const STOOD: f64 = 0.001;
/// Time within which a robot that is commanded to stand does so, and is seen to.
const STOPPED: Duration = Duration::from_secs(5);
/// Time within which an operator drives again.
const RECOVERY: Duration = Duration::from_secs(40);

/// The robot, its operator, and what they have been through.
struct Campaign {
    robot: Robot,
    yard: Yard,
    /// Commands so far: time and speed.
    commanded: Vec<(Instant, f64)>,
    next: Instant,
    wanted: f64,
    /// Speed of the body at the last look, and the way since the round began.
    last: Instant,
    way: f64,
    excess: f64,
    memory: BTreeMap<u32, u64>,
}

/// Outcomes of the rounds of one kind of attack.
#[derive(Default)]
struct Tally {
    rounds: u32,
    stopped: u32,
    shots: u64,
    slowest_recovery: f64,
}

impl Campaign {
    fn new() -> Self {
        let http = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let world = workspace().join("conf/worlds/empty.toml").display().to_string();
        let at = http.to_string();
        // Datagrams command nothing, so that none of them is a command; by default any program of the computer may.
        let robot = Robot::ready(&["--http", &at, "--world", &world, "--set", "bus.commands=memory"]);
        let yard = Yard::new(&robot, http);
        let now = Instant::now();
        let mut campaign = Self {
            robot,
            yard,
            commanded: Vec::new(),
            next: now,
            wanted: 0.0,
            last: now,
            way: 0.0,
            excess: 0.0,
            memory: BTreeMap::new(),
        };
        campaign.robot.believe_own();
        campaign.recover("at the start");
        campaign.memory = campaign.sizes();
        campaign
    }

    /// Passes some milliseconds: the operator commands, the body is looked at.
    fn turn(&mut self) {
        let now = Instant::now();
        if self.next <= now {
            self.next = now + Duration::from_millis(50);
            self.robot.command(self.wanted, STEERING);
            self.commanded.push((now, self.wanted));
            self.commanded.retain(|(at, _)| at.elapsed() < BRAKING);
        }
        self.robot.pass(0.01);
        let speed = self.robot.view.speed().abs();
        let allowed = self.commanded.iter().map(|(_, speed)| speed.abs()).fold(0.0, f64::max);
        let now = Instant::now();
        self.way += speed * (now - self.last).as_secs_f64();
        self.last = now;
        self.excess = self.excess.max(speed - allowed);
    }

    fn pass(&mut self, seconds: f64) {
        let end = Instant::now() + Duration::from_secs_f64(seconds);
        while Instant::now() < end {
            self.turn();
        }
    }

    fn drives(&self) -> bool {
        self.robot.view.speed() > SPEED / 2.0
    }

    /// An operator drives again: releases the controls, does what the cause asks for, presses again. Returns the time
    /// that it took, s.
    fn recover(&mut self, after: &str) -> f64 {
        let begin = Instant::now();
        while !self.drives() {
            assert!(
                begin.elapsed() < RECOVERY,
                "{after}: the robot does not drive again: {} {:?}",
                self.robot.view.reason(),
                self.robot.view.causes()
            );
            self.wanted = 0.0;
            self.pass(0.3);
            if self.robot.view.is_free() {
                self.wanted = SPEED;
                self.pass(0.8);
            } else {
                self.act();
            }
        }
        begin.elapsed().as_secs_f64()
    }

    /// Waits until the robot stands as commanded: on a busy machine what is seen of it is late.
    fn stop(&mut self, name: &str) {
        let begin = Instant::now();
        self.pass(0.5);
        while self.robot.view.speed().abs() > STOOD {
            assert!(begin.elapsed() < STOPPED, "{name}: commanded to stand, it drives on");
            self.turn();
        }
        self.pass(0.3);
    }

    /// Deliberate act of an operator that the causes ask for.
    fn act(&mut self) {
        let timestamp = 0;
        for cause in self.robot.view.causes() {
            match cause {
                Hold::FeedCut | Hold::FeedOff => {
                    self.robot.publish(lowlevel::CmdPower { timestamp, device: 3, action: lowlevel::CmdPower::ON });
                }
                Hold::ToBeHomed | Hold::HomingFailed => {
                    self.robot.publish(lowlevel::CmdHoming { timestamp, axis: "steering".into() });
                }
                _ => {
                    let (module, state, source) = ("*".into(), State::Run as i8, "test".into());
                    self.robot.publish(common::CmdState { timestamp, module, state, manual: true, source });
                }
            }
        }
    }

    /// One attack. Returns whether the robot stopped, the number of shots, and the time until it drove again, s.
    fn round(&mut self, attack: Attack, random: &mut Random, name: &str) -> (bool, u64, f64) {
        // In every fourth attack the robot is commanded to stand still, by a source that holds it.
        let stands = random.chance(0.25);
        if stands {
            self.wanted = 0.0;
            self.stop(name);
        }
        let before: BTreeSet<u32> = self.robot.processes().into_iter().collect();
        (self.way, self.excess) = (0.0, 0.0);
        let end = Instant::now() + Duration::from_millis(600);
        let mut shots = 0;
        while Instant::now() < end {
            shots += self.yard.shoot(&self.robot, attack, random);
            self.turn();
        }
        // Longer than any effect of an attack.
        self.pass(1.0);
        let speed = self.robot.view.speed().abs();
        let goes_on = speed > SPEED / 2.0;
        let foreign = attack == Attack::Frames;
        if stands {
            let most = if foreign { FOREIGN_WAY } else { 0.01 };
            assert!(self.way <= most, "{name}: commanded to stand, it went {:.3} m", self.way);
            assert!(speed < 0.01, "{name}: commanded to stand, it drives at {speed:.3} m/s");
        } else if !foreign {
            assert!(self.excess <= MARGIN, "{name}: {:.3} m/s beyond what is commanded", self.excess);
        } else {
            assert!(speed <= SPEED + MARGIN, "{name}: it drives at {speed:.3} m/s");
        }
        self.yard.clean();
        let recovery = self.recover(name);
        self.same_processes(&before, attack, name);
        self.bounded(name);
        (!stands && !goes_on, shots, recovery)
    }

    /// Only a truncated station ends a process: that of its owner.
    fn same_processes(&mut self, before: &BTreeSet<u32>, attack: Attack, name: &str) {
        let now: BTreeSet<u32> = self.robot.processes().into_iter().collect();
        let gone: Vec<u32> = before.difference(&now).copied().collect();
        let most = usize::from(attack == Attack::Stations && std::mem::take(&mut self.yard.cut));
        assert!(gone.len() <= most, "{name}: processes {gone:?} died");
        assert!(now.len() >= before.len(), "{name}: {} processes of {}", now.len(), before.len());
    }

    /// Private memory of each process, bytes.
    fn sizes(&self) -> BTreeMap<u32, u64> {
        let data = |pid: &u32| {
            let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
            let line = status.lines().find_map(|line| line.strip_prefix("VmData:"))?;
            Some((*pid, line.trim().trim_end_matches(" kB").parse::<u64>().ok()? << 10))
        };
        self.robot.processes().iter().filter_map(data).collect()
    }

    fn bounded(&mut self, name: &str) {
        for (pid, size) in self.sizes() {
            let first = *self.memory.entry(pid).or_insert(size);
            let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            let grown = size.saturating_sub(first);
            assert!(grown <= GROWTH_MAX, "{name}: {} grew by {} MiB", command.replace('\0', " "), grown >> 20);
        }
    }
}

/// Value of an environment variable.
fn given<T: std::str::FromStr>(name: &str) -> Option<T> {
    std::env::var(name).ok().filter(|text| !text.is_empty()).and_then(|text| text.parse().ok())
}

#[test]
fn bad_input_leaves_the_robot_driving_as_commanded_or_standing() {
    let (minutes, seed) = (given::<f64>("BAD_INPUT_MINUTES"), given("SEED").unwrap_or(1));
    let rounds = match (given::<u64>("ROUND"), minutes) {
        (Some(round), _) => round..round + 1,
        (None, Some(_)) => 0..u64::MAX,
        (None, None) => 0..Attack::ALL.len() as u64,
    };
    let _turn = if minutes.is_some() { support::alone() } else { support::turn() };
    let end = minutes.map(|minutes| Instant::now() + Duration::from_secs_f64(60.0 * minutes));
    let mut campaign = Campaign::new();
    let mut tallies: BTreeMap<Attack, Tally> = BTreeMap::new();
    for round in rounds {
        if end.is_some_and(|end| Instant::now() >= end) {
            break;
        }
        let attack = Attack::ALL[(round % Attack::ALL.len() as u64) as usize];
        let name = format!("SEED={seed} ROUND={round} ({attack:?})");
        let (stopped, shots, recovery) = campaign.round(attack, &mut Random::stream(seed, round), &name);
        let tally = tallies.entry(attack).or_default();
        tally.rounds += 1;
        tally.stopped += u32::from(stopped);
        tally.shots += shots;
        tally.slowest_recovery = tally.slowest_recovery.max(recovery);
    }
    println!("{:10} {:>7} {:>9} {:>8} {:>22}", "seed", "rounds", "shots", "stopped", "driven again after, s");
    for (attack, Tally { rounds, stopped, shots, slowest_recovery }) in tallies {
        println!("{:10} {rounds:7} {shots:9} {stopped:8} {slowest_recovery:22.1}", format!("{attack:?}"));
    }
}

#[test]
fn a_process_whose_station_is_truncated_is_started_again_and_the_robot_drives_on() {
    let _turn = support::turn();
    let mut campaign = Campaign::new();
    for (number, process) in campaign.robot.processes().into_iter().enumerate() {
        let size = [0, 4096, 8192][number % 3];
        if campaign.yard.truncate(process, size) {
            let command = std::fs::read_to_string(format!("/proc/{process}/cmdline")).unwrap_or_default();
            while campaign.robot.processes().contains(&process) {
                campaign.turn();
            }
            campaign.recover(&format!("{size} bytes left of the station of {}", command.replace('\0', " ")));
        }
    }
}
