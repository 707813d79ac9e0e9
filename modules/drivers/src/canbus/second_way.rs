//! Reaction to the speed monitor: first the quick stop, then, where the robot does not brake, the second way to stop.
//!
//! The second way cuts the motors' feed through the power controller, an output of another node, or a GPIO line: none
//! depends on the drive. It is never used while the drive brakes as commanded, and only a person switches the feed on
//! again.

use super::config::{SecondWay, Stop, UnbrakedStop};
use super::feed_output::{FeedOutput, News};
use super::net::NodeAt;
use super::objection::Objection;
use super::propulsion::Propulsion;
use super::speed_monitor::{Alarm, MARGIN_MPS, Order, SpeedMonitor};
use super::{Canbus, STANDSTILL_MPS, Timer};
use base::{Duration, Fault, Instant, Level, Severity};
use canopen::axis::NotFollowing;
use canopen::master::{LostReason, Ticket};
use messages::{Hold, lowlevel};
use module::{Actions, Input, PortId};
use rs485::boards::psc1;

/// Power channel that feeds the motors.
const MOTORS: &str = "motors";
/// Period of the order to cut the feed, until the power controller reports that it is cut.
const CUT_PERIOD: Duration = Duration::from_millis(500);
/// A drive that turned when it was reset must be read again within this time.
const UNWATCHED_MAX: Duration = Duration::from_millis(450);

/// Difference by which one of several wheels may be slower than its set-point, m/s; from which set-point on, m/s, it
/// must not stand; and for how long: the robot turns meanwhile.
const LAG_MPS: f64 = MARGIN_MPS;
const TURNS_MPS: f64 = 0.05;
const LAG_MAX: Duration = Duration::from_millis(200);
/// Set-point from which on one of several wheels must not turn the other way, m/s, and the part of it at which it does.
/// Others may hold a wheel whose encoder counts backwards at its speed: then nothing but the sign is wrong.
const TURNS_BACK_MPS: f64 = STANDSTILL_MPS;
const TURNS_BACK_PART: f64 = 0.5;
/// For how long the only wheel of a robot without odometry may stand although it is to turn, beyond twice its ramp to a
/// speed that is no standstill: the robot is blocked, or the encoder is dead. Then the loop of the drive accelerates
/// the wheel without end.
const STANDS_MAX: Duration = Duration::from_millis(300);

/// What cuts the motors' feed.
#[derive(Debug)]
enum Way {
    /// The power controller; whether it reported the channel of the motors as off, be it switched off by this process,
    /// an earlier one, or somebody else.
    Power {
        off: bool,
    },
    /// An output of a node, or a GPIO line.
    Output(FeedOutput),
    None,
}

/// Watch of one wheel.
#[derive(Debug)]
pub(super) struct WheelWatch {
    monitor: SpeedMonitor,
    /// The wheel may have turned when its drive was reset, and its speed has not been read since: until then it must
    /// be. Set until the drive is booted, at standstill, or without power.
    pub(super) unwatched: Option<Instant>,
    /// Since when the wheel has been slower than commanded, or turned the other way; of the only wheel, stood.
    lags: Option<Instant>,
    /// For how long the only wheel may stand.
    stands_max: Duration,
}

impl WheelWatch {
    /// Acceleration of a command, deceleration of a command and of a quick stop as configured, m/s². `has_ramp`: it is
    /// commanded its final speed, and its drive accelerates so.
    pub(super) fn new(acceleration: f64, deceleration: f64, quick_stop: f64, has_ramp: bool) -> Self {
        let monitor = SpeedMonitor::new(deceleration, quick_stop, has_ramp.then_some(acceleration));
        let ramp = 2.0 * STANDSTILL_MPS / acceleration.max(f64::MIN_POSITIVE);
        let stands_max = STANDS_MAX + Duration::from_secs_f64(ramp.min(60.0));
        Self { monitor, unwatched: None, lags: None, stands_max }
    }
}

impl WheelWatch {
    /// True once the only wheel, which is to turn at `target`, has been measured at standstill for too long. One
    /// that turns the other way stops first; the speed monitor judges it.
    fn stands(&mut self, now: Instant, target: Option<f64>, measured: f64) -> bool {
        if !target.is_some_and(|target| is_standing(target, measured)) {
            self.lags = None;
            return false;
        }
        now.since(*self.lags.get_or_insert(now)) >= self.stands_max
    }

    /// True once a wheel that is told to turn at `target` has been measured to be slower for too long.
    fn is_behind(&mut self, now: Instant, target: Option<f64>, measured: f64) -> bool {
        let lags = target.is_some_and(|target| {
            let along = measured * target.signum();
            let stands = target.abs() >= TURNS_MPS && along < STANDSTILL_MPS;
            let turns_back = target.abs() >= TURNS_BACK_MPS && along <= -TURNS_BACK_PART * target.abs();
            target.abs() - along > LAG_MPS || stands || turns_back
        });
        if !lags {
            self.lags = None;
            return false;
        }
        now.since(*self.lags.get_or_insert(now)) >= LAG_MAX
    }
}

/// True if a wheel stands that is to turn at `target`.
fn is_standing(target: f64, measured: f64) -> bool {
    target.abs() >= TURNS_MPS && measured.abs() < STANDSTILL_MPS
}

/// What cuts the motors' feed, and what the monitors have found.
#[derive(Debug)]
pub(super) struct StopWatch {
    way: Way,
    /// Number of the CAN bus of the node whose output it is.
    bus: usize,
    /// Latched: [`Hold::SpeedExceeded`], [`Hold::FeedCut`] or [`Hold::WheelStood`].
    latched: Option<Hold>,
}

impl StopWatch {
    /// `has_power`: there is a power controller; `line`: port of the GPIO line, if there is one.
    /// `bus`: number of the CAN bus of the output of a node.
    pub(super) fn new(stop: &Stop, has_power: bool, line: PortId, bus: usize) -> Self {
        let way = match (stop.second_way, stop.output) {
            (SecondWay::Power, _) if has_power => Way::Power { off: false },
            (SecondWay::Canopen, Some(output)) => Way::Output(FeedOutput::node(output)),
            (SecondWay::Gpio, _) if stop.feed_line().is_some() => Way::Output(FeedOutput::line(line)),
            _ => Way::None,
        };
        Self { way, bus, latched: None }
    }

    /// Objection to any motion.
    pub(super) fn objection(&self) -> Option<Objection> {
        let of_way = || match &self.way {
            Way::Power { off } => off.then_some(Hold::FeedOff),
            Way::Output(output) => output.objection(),
            Way::None => None,
        };
        self.latched.filter(|hold| *hold != Hold::WheelStood).or_else(of_way).map(Objection::Speed)
    }

    /// True while the motors' feed is cut, or is to be: by this way, or as the power controller reports.
    pub(super) fn cuts_feed(&self) -> bool {
        let is_off = match &self.way {
            Way::Power { off } => *off,
            Way::Output(output) => output.is_off(),
            Way::None => false,
        };
        is_off || self.latched == Some(Hold::FeedCut)
    }

    /// The objection that remains of a wheel that stood, when its drive has none any more.
    pub(super) fn stood(&self) -> Option<Objection> {
        self.latched.filter(|hold| *hold == Hold::WheelStood).map(Objection::Speed)
    }

    fn output(&self) -> Option<&FeedOutput> {
        if let Way::Output(output) = &self.way { Some(output) } else { None }
    }

    fn output_mut(&mut self) -> Option<&mut FeedOutput> {
        if let Way::Output(output) = &mut self.way { Some(output) } else { None }
    }

    /// Node of the output that feeds the motors.
    pub(super) fn node(&self) -> Option<NodeAt> {
        Some(NodeAt { bus: self.bus, id: self.output()?.node_id()? })
    }

    /// A transfer has ended, with its data unless it failed; false if it is not one of these.
    pub(super) fn on_sdo(&mut self, now: Instant, ticket: Ticket, result: Option<&[u8]>) -> bool {
        self.output_mut().is_some_and(|output| output.on_sdo(now, ticket, result))
    }

    /// An input of a port; false if it is not the port of the GPIO line.
    pub(super) fn on_port(&mut self, now: Instant, port: PortId, input: &Input<'_>) -> bool {
        self.output_mut().is_some_and(|output| output.on_port(now, port, input))
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.output()?.poll_timeout()
    }
}

impl Canbus {
    /// Reports at the start what stops the robot if a drive does not.
    pub(super) fn start_second_way(&mut self, now: Instant, out: &mut Actions) {
        match &mut self.stop_watch.way {
            Way::Power { .. } => {}
            Way::Output(output) => output.start(now),
            Way::None => {
                out.note("THERE IS NO SECOND WAY TO STOP: if the drive does not brake, nothing cuts the motors' feed");
            }
        }
    }

    /// The drive of a wheel is lost. One that misses the master's heartbeat brakes on its own, and one that does not
    /// answer was commanded to stop before it is reset. In all other cases it is reset while it may turn, and monitors
    /// no heartbeat until it is booted.
    pub(super) fn watch_reset(&mut self, now: Instant, node: NodeAt, reason: LostReason) {
        if matches!(reason, LostReason::BootUp | LostReason::State(_) | LostReason::DuplicateId)
            && let Some(wheel) = self.wheels.of_mut(node)
        {
            await_speed(now, wheel);
        }
    }

    /// Judges the measured speed of each wheel against its present order; to be called after each decision.
    pub(super) fn watch_speed(&mut self, now: Instant, out: &mut Actions) {
        for number in 0..self.wheels.count() {
            self.watch_wheel(now, number, out);
        }
    }

    fn watch_wheel(&mut self, now: Instant, number: usize, out: &mut Actions) {
        // The controller's line cuts the feed by itself.
        let cuts_feed = self.around.pause.cuts_feed();
        // What moves too fast, or does not stop: with one drive the robot itself.
        let alone = self.wheels.count() == 1;
        // Nothing but the encoder of the drive measures whether the robot moves.
        let witnessless = alone && !self.config.odometry;
        let Some(wheel) = self.wheels.get_mut(number) else { return };
        let order = if cuts_feed { Order::None } else { wheel.order() };
        let changing = match order {
            Order::None => false,
            Order::Drive(speed) => {
                let lags = wheel.watch.lags.is_some() || witnessless && is_standing(speed, wheel.speed());
                lags || (wheel.speed() - speed).abs() > MARGIN_MPS
            }
            Order::Stop => !wheel.is_slower(now, STANDSTILL_MPS),
        };
        wheel.set_changing(now, changing);
        wheel.watch.monitor.command(now, order);
        let measured = wheel.take_measured();
        let target = if let Order::Drive(speed) = order { Some(speed) } else { None };
        wheel.compare(now, target, measured, out);
        let is_late = measured.is_some_and(|speed| match alone {
            false => wheel.watch.is_behind(now, target, speed),
            true => witnessless && wheel.watch.stands(now, target, speed),
        });
        if let Some(speed) = measured.filter(|_| is_late) {
            wheel.stop_for(now, NotFollowing { target: target.unwrap_or(0.0), measured: speed }, out);
            if alone && self.stop_watch.latched.is_none() {
                // The next command would accelerate it as unseen.
                self.stop_watch.latched = Some(Hold::WheelStood);
            }
        }
        if wheel.is_up() || order == Order::None {
            wheel.watch.unwatched = None;
        }
        let unheard = wheel.watch.unwatched.take_if(|until| *until <= now).is_some();
        if wheel.watch.unwatched.is_some() && measured.is_some() {
            await_speed(now, wheel);
        }
        let alarm = measured.and_then(|speed| wheel.watch.monitor.measure(now, speed));
        let name = wheel.axis.name();
        if unheard {
            self.on_not_stopping(now, &format!("reset while it turned, the {name} is not heard"), out);
        }
        let what = if alone { "the robot drives".into() } else { format!("the {name} wheel turns") };
        match alarm {
            None => {}
            Some(Alarm::Exceeded { measured, allowed })
                if matches!(self.stop_watch.latched, None | Some(Hold::WheelStood)) =>
            {
                let why = format!("{what} at {measured:.2} m/s, at most {allowed:.2} is commanded: quick stop");
                out.raise(Severity::Error, Fault::SpeedExceeded, "", why);
                self.stop_watch.latched = Some(Hold::SpeedExceeded);
            }
            Some(Alarm::Exceeded { .. }) => {}
            Some(Alarm::NotStopping { measured, allowed }) => {
                let what = format!("told to stop, {what} at {measured:.2} m/s and not below {allowed:.2}");
                self.on_not_stopping(now, &what, out);
            }
            Some(Alarm::Accelerates { measured, lowest }) => {
                let what = format!("told to stop, {what} at {measured:.2} m/s after {lowest:.2}");
                self.on_accelerating(now, number, &what, out);
            }
        }
    }

    /// A wheel gains speed against its brake. Without a second way its drive is switched off: it is what accelerates
    /// it.
    fn on_accelerating(&mut self, now: Instant, number: usize, what: &str, out: &mut Actions) {
        let has_way = !matches!(self.stop_watch.way, Way::None);
        if has_way || self.config.stop.unbraked == UnbrakedStop::Brake {
            self.on_not_stopping(now, what, out);
            return;
        }
        let Some(wheel) = self.wheels.get_mut(number).filter(|wheel| !wheel.is_cut()) else { return };
        wheel.cut();
        let what = format!("{what}: the {} drive is switched off, and the wheel rolls", wheel.axis.name());
        // The fault may have been reported already, as a wheel that does not stop.
        out.say(Level::Warning, &what);
        out.raise(Severity::Error, Fault::StopFailed, "", what);
        self.stop_watch.latched = Some(Hold::SpeedExceeded);
    }

    fn on_not_stopping(&mut self, now: Instant, what: &str, out: &mut Actions) {
        if self.stop_watch.latched == Some(Hold::FeedCut) {
            return;
        }
        match &mut self.stop_watch.way {
            Way::None => {
                out.raise(Severity::Error, Fault::StopFailed, "", format!("{what}; there is no second way to stop it"));
                self.stop_watch.latched = Some(Hold::SpeedExceeded);
                return;
            }
            Way::Power { .. } => self.deadlines.set(Timer::Cut, now),
            Way::Output(output) => {
                output.order(now, false);
            }
        }
        out.raise(Severity::Error, Fault::StopFailed, "", format!("{what}: the motors' feed is cut"));
        self.stop_watch.latched = Some(Hold::FeedCut);
    }

    /// Orders the feed to be cut, or to be switched on as a person commanded, if that is due.
    pub(super) fn advance_second_way(&mut self, now: Instant, out: &mut Actions) {
        let cut = self.stop_watch.latched == Some(Hold::FeedCut);
        let bus = self.stop_watch.bus;
        if let (Way::Output(output), Some(net)) = (&mut self.stop_watch.way, self.nets.get_mut(bus)) {
            let news = output.advance(now, net.is_up(), cut, &mut net.master, out);
            let words = news.map(|news| output.words(news)).unwrap_or_default();
            match news {
                Some(News::Lost) => out.raise(Severity::Error, Fault::SecondWayLost, "", words),
                Some(News::Back) => out.clear(Fault::SecondWayLost, "", words),
                None => {}
            }
        }
        if self.deadlines.is_due(Timer::Cut, now) {
            self.deadlines.set(Timer::Cut, now + CUT_PERIOD);
            let device = motors();
            out.publish(lowlevel::CmdPower { timestamp: out.timestamp(now), device, action: lowlevel::CmdPower::OFF });
        }
    }

    /// The power controller's report, received at `now`: the order to cut is repeated while the motors are fed. While
    /// they are not fed the robot is held, whoever switched them off: a drive without a feed is only known to be in
    /// fault.
    pub(super) fn on_power(&mut self, now: Instant, power: &lowlevel::DataPower) {
        let Some(motors) = power.channels.iter().find(|channel| channel.name == MOTORS) else { return };
        let Way::Power { off } = &mut self.stop_watch.way else { return };
        *off = !motors.on;
        if !motors.on {
            self.deadlines.clear(Timer::Cut);
        } else if self.stop_watch.latched == Some(Hold::FeedCut) && !self.deadlines.is_set(Timer::Cut) {
            self.deadlines.set(Timer::Cut, now);
        }
    }

    /// A person switches the motors on: the only way out of a cut. The output feeds them only at standstill.
    pub(super) fn on_power_command(&mut self, now: Instant, command: &lowlevel::CmdPower, out: &mut Actions) {
        let on = [lowlevel::CmdPower::ON, lowlevel::CmdPower::REBOOT].contains(&command.action);
        if command.device != motors() || !on {
            return;
        }
        // A drive whose supply was cut cannot be asked.
        let stands = self.wheels.are_slower_or_absent(now, STANDSTILL_MPS);
        let cut = self.stop_watch.latched == Some(Hold::FeedCut);
        if let Way::Output(output) = &mut self.stop_watch.way {
            if !stands || !(cut || output.is_off()) {
                return;
            }
            if !output.order(now, true) {
                out.say(Level::Warning, "the motors' feed is not switched on: what cuts it does not answer");
                return;
            }
        }
        if cut {
            self.deadlines.clear(Timer::Cut);
            self.end_alarm(out);
        }
    }

    /// A person commands this module to RUN: ends an alarm that did not cut the feed, once the robot stands, as far
    /// as it is measured.
    pub(super) fn acknowledge_speed(&mut self, out: &mut Actions) {
        let ends = matches!(self.stop_watch.latched, Some(Hold::SpeedExceeded | Hold::WheelStood));
        if ends && self.wheels.stand_or_are_cut(self.now) {
            self.end_alarm(out);
        }
    }

    fn end_alarm(&mut self, out: &mut Actions) {
        self.stop_watch.latched = None;
        self.wheels.iter_mut().for_each(Propulsion::end_cut);
        for fault in [Fault::SpeedExceeded, Fault::StopFailed] {
            out.clear(fault, "", "an operator has let the robot go");
        }
    }
}

/// The wheel may turn although it is not watched: its speed is awaited.
fn await_speed(now: Instant, wheel: &mut Propulsion) {
    wheel.watch.unwatched = wheel.may_turn().then_some(now + UNWATCHED_MAX);
}

/// Number of the channel that feeds the motors.
fn motors() -> i8 {
    psc1::CHANNELS.iter().position(|name| *name == MOTORS).and_then(|place| i8::try_from(place).ok()).unwrap_or(-1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(millis)
    }

    /// 0.3 s, and 80 ms for its ramp.
    fn watch() -> WheelWatch {
        WheelWatch::new(0.5, 0.8, 1.5, true)
    }

    /// When the only wheel is found standing, ms; `speeds` gives target and measured speed after each 10 ms.
    fn found(speeds: impl Fn(f64) -> (Option<f64>, f64)) -> Option<u64> {
        let mut watch = watch();
        (0..500).map(|step| 10 * step).find(|ms| {
            let (target, measured) = speeds(*ms as f64 / 1000.0);
            watch.stands(at(*ms), target, measured)
        })
    }

    #[test]
    fn an_only_wheel_that_stands_although_it_is_to_turn_is_found_in_its_time() {
        assert_eq!(found(|_| (Some(0.3), 0.0)), Some(380));
        assert_eq!(found(|_| (Some(-0.05), 0.019)), Some(380));
        assert_eq!(found(|s| (Some(0.3), if s < 1.0 { 0.3 } else { 0.0 })), Some(1380));
        // Its targets change, and so does their sign.
        assert_eq!(found(|s| (Some(0.3 * libm::cos(20.0 * s).signum()), 0.0)), Some(380));
    }

    /// The same of one of several wheels.
    fn found_behind(speeds: impl Fn(f64) -> (f64, f64)) -> Option<u64> {
        let mut watch = watch();
        (0..200).map(|step| 10 * step).find(|ms| {
            let (target, measured) = speeds(*ms as f64 / 1000.0);
            watch.is_behind(at(*ms), Some(target), measured)
        })
    }

    #[test]
    fn one_of_several_wheels_that_turns_the_other_way_is_found_at_low_speed() {
        for target in [0.02, -0.03, 0.049] {
            // Others hold it at its speed, and its encoder counts backwards.
            assert_eq!(found_behind(|_| (target, -target)), Some(200), "{target}");
            // It stands, or creeps back.
            assert_eq!(found_behind(|_| (target, 0.0)), None, "{target}");
            assert_eq!(found_behind(|_| (target, -0.4 * target)), None, "{target}");
        }
        // Below what counts as standstill the sign of a measured speed is noise.
        assert_eq!(found_behind(|_| (0.019, -0.019)), None);
        // It turns round on its ramp, 100 ms late.
        let ramp = |s: f64| (0.5 * s - 0.3).min(0.04);
        assert_eq!(found_behind(|s| (ramp(s), ramp(s - 0.1))), None);
    }

    #[test]
    fn an_only_wheel_on_its_ramp_or_with_less_to_do_is_not() {
        assert_eq!(found(|s| (Some(0.3), (0.1 * (s - 0.15)).clamp(0.0, 0.3))), None, "late, and a fifth of its ramp");
        assert_eq!(found(|s| (Some(-0.3), (0.8 - 0.5 * s).max(-0.3))), None, "it turns round");
        assert_eq!(found(|_| (Some(0.049), 0.0)), None, "too slow to be judged");
        assert_eq!(found(|_| (None, 0.0)), None, "not enabled, or commanded to stop");
        assert_eq!(found(|_| (Some(0.3), f64::NAN)), None, "unknown, which others judge");
        assert_eq!(
            found(|s| (Some(0.3).filter(|_| (100.0 * s).round() % 37.0 != 0.0), 0.0)),
            None,
            "commanded to stop in between"
        );
    }
}
