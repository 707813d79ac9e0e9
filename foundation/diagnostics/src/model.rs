//! Model: the latest value of everything.

use crate::pace::{Pace, is_slow};
use crate::{Errors, ModuleRow, Modules, Scans, Slot, Texts, Traffic, guard};
use base::{Duration, Instant};
use messages::{Message, StopReports, common, lowlevel, middlelevel, simulation};
use std::collections::BTreeMap;

/// Maximum number of buses.
const BUSES_MAX: usize = 32;
/// Maximum number of inertial measurement units.
const IMUS_MAX: usize = 8;
/// Maximum number of beacons whose use is kept: those that the map lists first.
const BEACONS_MAX: usize = 256;
/// Maximum number of modules whose lists of causes are kept.
const HOLDERS_MAX: usize = 16;
/// Maximum number of tracked people.
const PERSONS_MAX: usize = 64;
/// Maximum number of parameters of the planner.
const PARAMETERS_MAX: usize = 32;
/// Maximum number of programs in step with a simulation, and of those that are not.
const PROGRAMS_MAX: usize = 16;
/// Maximum number of command sources.
const SOURCES_MAX: usize = 16;

const fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// Configuration that is not on the bus.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// Name of the robot.
    pub robot: String,
    /// Modules without which the robot does not move.
    pub critical: Vec<String>,
    /// True if the robot may be a simulation on the bus whose time passes slowly or stands still: values age by its
    /// time then ([`Model::at`]). False for a real robot and for a recorded run.
    pub simulated: bool,
}

/// Latest value of everything on the bus. Periods are those of `docs/design.md` 5.
#[derive(Clone, Debug)]
pub struct Model {
    config: Config,
    pace: Pace,
    /// Traffic by channel.
    pub traffic: Traffic,
    /// Faults and reports.
    pub errors: Errors,
    /// Texts of modules.
    pub texts: Texts,
    modules: Modules,
    /// Processes, as reported by the watchdog.
    pub processes: Slot<common::DataProcesses>,
    /// Logger.
    pub log: Slot<common::DataLog>,
    /// Motion, and the reason for a standstill.
    pub motion: Slot<lowlevel::DataMotion>,
    /// Velocity of the body.
    pub velocity: Slot<lowlevel::DataVelocity>,
    /// Greatest speeds that can still be stopped, with the fields: at most 10, of at most 64 corners each.
    pub guard: Slot<lowlevel::DataGuard>,
    /// PAUSE line, of all its sources.
    pub stop: Slot<lowlevel::EventStop>,
    stops: StopReports,
    /// Odometry.
    pub odometry: Slot<lowlevel::DataOdo>,
    /// Sonars.
    pub sonars: Slot<lowlevel::DataSrfs>,
    /// Infrared sensors.
    pub infrareds: Slot<lowlevel::DataIrs>,
    /// Sonars and infrared sensors, each at its own instant.
    pub ranges: Slot<lowlevel::DataRanges>,
    /// Lidars.
    pub scans: Scans,
    /// Sighted beacons.
    pub beacons: Slot<lowlevel::DataBeacons>,
    /// State of the beacon scanner.
    pub scanner: Slot<lowlevel::DataScanner>,
    /// Drives.
    pub axes: Slot<lowlevel::DataAxes>,
    /// What the drives do and bear.
    pub wheels: Slot<lowlevel::DataWheels>,
    /// Battery and channels.
    pub power: Slot<lowlevel::DataPower>,
    /// Temperatures and fans.
    pub temperatures: Slot<lowlevel::DataTemperature>,
    /// Gamepad.
    pub gamepad: Slot<lowlevel::DataJoydev>,
    /// Last answer about an object of a drive.
    pub sdo: Slot<lowlevel::DataSdo>,
    /// Estimated pose.
    pub estimate: Slot<middlelevel::DataEstimate>,
    /// What the estimator makes of each beacon: at most 256.
    pub beacon_use: Slot<middlelevel::DataBeaconUse>,
    /// State of the goal.
    pub goal: Slot<middlelevel::DataGoal>,
    /// Operation mode of the planner.
    pub mode: Slot<middlelevel::DataMode>,
    /// Parameters of the planner that can be changed while it runs: at most 32.
    pub parameters: Slot<middlelevel::DataParameters>,
    /// Planned path.
    pub plan: Slot<middlelevel::DataPlan>,
    /// People that the planner tracks: at most 64.
    pub persons: Slot<middlelevel::DataPersons>,
    /// Sensed obstacles.
    pub obstacles: Slot<middlelevel::DataObstacles>,
    /// True pose, in a simulation.
    pub truth: Slot<simulation::DataTruth>,
    /// True places of people, in a simulation.
    pub people: Slot<simulation::DataPeople>,
    /// Rate of simulated time.
    pub clock: Slot<simulation::DataClock>,
    /// Time and world of a simulation with `--speed`.
    pub run: Slot<simulation::DataRun>,
    holds: BTreeMap<String, Slot<lowlevel::DataHold>>,
    buses: BTreeMap<String, Slot<lowlevel::DataBus>>,
    imus: BTreeMap<String, Slot<lowlevel::DataImu>>,
    commands: BTreeMap<String, Slot<Commanded>>,
}

/// Last motion command of a source, of either message: a source that sends both is one.
#[derive(Clone, Debug)]
enum Commanded {
    Motion(lowlevel::CmdMotion),
    Velocity(lowlevel::CmdVelocity),
}

impl Model {
    /// Creates an empty model.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            modules: Modules::new(config.critical.clone()),
            config,
            pace: Pace::default(),
            traffic: Traffic::default(),
            errors: Errors::default(),
            texts: Texts::default(),
            processes: Slot::every(ms(100)),
            log: Slot::every(ms(1000)),
            motion: Slot::every(ms(50)),
            velocity: Slot::every(ms(50)),
            // Sent each 50 ms, good for 150 ms.
            guard: Slot::every(ms(75)),
            stop: Slot::every(ms(500)),
            stops: StopReports::default(),
            odometry: Slot::every(ms(250)),
            sonars: Slot::every(ms(250)),
            infrareds: Slot::every(ms(250)),
            ranges: Slot::every(ms(250)),
            scans: Scans::default(),
            beacons: Slot::every(ms(1000)),
            scanner: Slot::every(ms(10_000)),
            axes: Slot::every(ms(200)),
            wheels: Slot::every(ms(200)),
            power: Slot::every(ms(1000)),
            temperatures: Slot::every(ms(1000)),
            gamepad: Slot::every(ms(200)),
            sdo: Slot::every(Duration::MAX),
            estimate: Slot::every(ms(50)),
            beacon_use: Slot::every(ms(1000)),
            goal: Slot::every(ms(200)),
            mode: Slot::every(ms(1000)),
            parameters: Slot::every(ms(1000)),
            plan: Slot::every(ms(1000)),
            persons: Slot::every(ms(200)),
            obstacles: Slot::every(ms(1000)),
            truth: Slot::every(ms(100)),
            people: Slot::every(ms(200)),
            clock: Slot::every(ms(1000)),
            run: Slot::every(ms(1000)),
            holds: BTreeMap::new(),
            buses: BTreeMap::new(),
            imus: BTreeMap::new(),
            commands: BTreeMap::new(),
        }
    }

    /// Name of the robot.
    #[must_use]
    pub fn robot(&self) -> &str {
        &self.config.robot
    }

    /// Instant of the robot's time at the instant `real` of the viewers' clock, for all functions that take a `now`.
    /// The same instant, unless the robot is a simulation whose time passes slowly.
    #[must_use]
    pub fn at(&self, real: Instant) -> Instant {
        self.pace.at(real)
    }

    /// Simulated seconds per real second, where values age by them: 0 while time stands still.
    pub(crate) fn slow_rate(&self, now: Instant) -> Option<f64> {
        self.clock.fresh(now).map(|clock| clock.rate).filter(|rate| self.config.simulated && is_slow(*rate))
    }

    /// Processes a message of `bytes` bytes received at the instant `at` of the viewers' clock; `message` is its
    /// content if the channel is one of the robot's.
    pub fn receive(&mut self, at: Instant, channel: &str, bytes: usize, message: Option<Message>) {
        if let Some(Message::SimDataClock(clock)) = &message
            && self.config.simulated
        {
            self.pace.on_rate(at, clock.rate);
        }
        let at = self.at(at);
        self.traffic.count(at, channel, bytes);
        match message {
            Some(Message::CmDataState(state)) => self.modules.on_state(at, &state),
            Some(Message::CmDataLevel(level)) => self.modules.on_level(&level),
            Some(Message::CmDataProcesses(processes)) => self.processes.put(at, processes),
            Some(Message::CmEventError(error)) => self.errors.on_report(at, &error),
            Some(Message::CmDataFaults(list)) => self.errors.on_list(at, &list),
            Some(Message::CmEventText(text)) => self.texts.take(&text),
            Some(Message::CmDataLog(log)) => self.log.put(at, log),
            Some(Message::LlDataMotion(motion)) => self.motion.put(at, motion),
            Some(Message::LlCmdMotion(command)) => {
                let source = command.source.clone();
                put(&mut self.commands, SOURCES_MAX, source, ms(50), at, Commanded::Motion(command));
            }
            Some(Message::LlCmdVelocity(command)) => {
                let source = command.source.clone();
                put(&mut self.commands, SOURCES_MAX, source, ms(50), at, Commanded::Velocity(command));
            }
            Some(Message::LlDataVelocity(velocity)) => self.velocity.put(at, velocity),
            Some(Message::LlDataGuard(guard)) => self.guard.put(at, guard::limited(guard)),
            Some(Message::LlEventStop(stop)) => {
                self.stops.on_report(&stop).into_iter().for_each(|stop| self.stop.put(at, stop));
            }
            Some(Message::LlDataOdo(odometry)) => self.odometry.put(at, odometry),
            Some(Message::LlDataSrfs(sonars)) => self.sonars.put(at, sonars),
            Some(Message::LlDataIrs(infrareds)) => self.infrareds.put(at, infrareds),
            Some(Message::LlDataRanges(ranges)) => self.ranges.put(at, ranges),
            Some(Message::LlDataScan(scan)) => self.scans.on_scan(at, &scan),
            Some(Message::LlDataBeacons(beacons)) => self.beacons.put(at, beacons),
            Some(Message::LlDataScanner(scanner)) => self.scanner.put(at, scanner),
            Some(Message::LlDataImu(imu)) => {
                let name = imu.name.clone();
                put(&mut self.imus, IMUS_MAX, name, ms(20), at, imu);
            }
            Some(Message::LlDataAxes(axes)) => self.axes.put(at, axes),
            Some(Message::LlDataWheels(wheels)) => self.wheels.put(at, wheels),
            Some(Message::LlDataPower(power)) => self.power.put(at, power),
            Some(Message::LlDataTemperature(temperatures)) => self.temperatures.put(at, temperatures),
            Some(Message::LlDataBus(bus)) => {
                let name = bus.bus.clone();
                put(&mut self.buses, BUSES_MAX, name, ms(1000), at, bus);
            }
            Some(Message::LlDataHold(list)) => {
                let module = list.module.clone();
                put(&mut self.holds, HOLDERS_MAX, module, ms(200), at, list);
            }
            Some(Message::LlDataJoydev(gamepad)) => self.gamepad.put(at, gamepad),
            Some(Message::LlDataSdo(sdo)) => self.sdo.put(at, sdo),
            Some(Message::MlDataEstimate(estimate)) => self.estimate.put(at, estimate),
            Some(Message::MlDataBeaconUse(mut uses)) => {
                uses.beacons.truncate(BEACONS_MAX);
                self.beacon_use.put(at, uses);
            }
            Some(Message::MlDataGoal(goal)) => self.goal.put(at, goal),
            Some(Message::MlDataMode(mode)) => self.mode.put(at, mode),
            Some(Message::MlDataParameters(mut parameters)) => {
                parameters.parameters.truncate(PARAMETERS_MAX);
                self.parameters.put(at, parameters);
            }
            Some(Message::MlDataPlan(plan)) => self.plan.put(at, plan),
            Some(Message::MlDataPersons(mut persons)) => {
                persons.persons.truncate(PERSONS_MAX);
                self.persons.put(at, persons);
            }
            Some(Message::MlDataObstacles(obstacles)) => self.obstacles.put(at, obstacles),
            Some(Message::SimDataTruth(truth)) => self.truth.put(at, truth),
            Some(Message::SimDataPeople(people)) => self.people.put(at, people),
            Some(Message::SimDataClock(clock)) => self.clock.put(at, clock),
            Some(Message::SimDataRun(mut run)) => {
                run.in_step.truncate(PROGRAMS_MAX);
                run.not_in_step.truncate(PROGRAMS_MAX);
                self.run.put(at, run);
            }
            _ => {}
        }
    }

    /// Modules.
    #[must_use]
    pub fn modules(&self, now: Instant) -> Vec<ModuleRow> {
        // An old list of processes is not used.
        let processes = self.processes.fresh(now).map_or(&[][..], |heard| &heard.processes);
        let mut rows = self.modules.rows(now, processes);
        for row in &mut rows {
            row.faults = self.errors.active(&row.module, now);
        }
        rows
    }

    /// Causes that hold the motion; `None` if their list is not current.
    #[must_use]
    pub fn motion_holds(&self, now: Instant) -> Option<&lowlevel::DataHold> {
        self.holds.get(messages::MOTION_MODULE)?.fresh(now)
    }

    /// Current lists of causes: of the motion first, then in order of the modules' names.
    pub(crate) fn holds(&self, now: Instant) -> impl Iterator<Item = &lowlevel::DataHold> {
        let others = self.holds.values().filter_map(move |slot| slot.fresh(now)).filter(|list| !list.is_of_motion());
        self.motion_holds(now).into_iter().chain(others)
    }

    /// True if causes of the motion were ever listed: a log from before `LL_DATA_HOLD` only has its text.
    pub(crate) fn knows_holds(&self) -> bool {
        self.holds.contains_key(messages::MOTION_MODULE)
    }

    /// Buses in order of their names.
    pub fn buses(&self) -> impl Iterator<Item = &Slot<lowlevel::DataBus>> {
        self.buses.values()
    }

    /// Inertial measurement units in order of their names.
    pub fn imus(&self) -> impl Iterator<Item = &Slot<lowlevel::DataImu>> {
        self.imus.values()
    }

    /// Recent `LL_CMD_MOTION` of the sources whose last command is one, in order of their names.
    pub fn commands(&self, now: Instant) -> impl Iterator<Item = &lowlevel::CmdMotion> {
        self.commanded(now).filter_map(|command| match command {
            Commanded::Motion(command) => Some(command),
            Commanded::Velocity(_) => None,
        })
    }

    /// Recent `LL_CMD_VELOCITY` of the sources whose last command is one, in order of their names.
    pub fn velocity_commands(&self, now: Instant) -> impl Iterator<Item = &lowlevel::CmdVelocity> {
        self.commanded(now).filter_map(|command| match command {
            Commanded::Motion(_) => None,
            Commanded::Velocity(command) => Some(command),
        })
    }

    fn commanded(&self, now: Instant) -> impl Iterator<Item = &Commanded> {
        self.commands.values().filter_map(move |slot| slot.get().filter(|_| slot.age(now) < Some(ms(1000))))
    }
}

fn put<T>(slots: &mut BTreeMap<String, Slot<T>>, most: usize, key: String, every: Duration, at: Instant, value: T) {
    if slots.contains_key(&key) || slots.len() < most {
        slots.entry(key).or_insert_with(|| Slot::every(every)).put(at, value);
    }
}
