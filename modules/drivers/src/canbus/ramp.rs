//! Set-points of a drive that has no ramp of its own in its mode, cyclic synchronous velocity or position: each differs
//! from the one before by no more than the robot's limits permit in a period.

use base::{Duration, Instant, Ticker};

/// Period of the set-points on a bus without SYNC.
pub(super) const PERIOD: Duration = Duration::from_millis(20);

/// When the next set-point is due.
#[derive(Clone, Copy, Debug)]
enum Due {
    /// After each SYNC: the next one finds exactly one new set-point. The time of the SYNC that was seen to be next.
    Sync(Option<Instant>),
    /// At a period. Set while the drive is enabled.
    Period(Option<Ticker>),
}

/// The ramp of one wheel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramp {
    period: Duration,
    due: Due,
    /// m/s².
    acceleration: f64,
    /// m/s².
    deceleration: f64,
    /// Last set-point, m/s.
    present: f64,
}

impl Ramp {
    /// At standstill. `sync`: period of SYNC, if the bus has one.
    pub(super) fn new(sync: Option<Duration>, acceleration: f64, deceleration: f64) -> Self {
        let due = if sync.is_some() { Due::Sync(None) } else { Due::Period(None) };
        Self { period: sync.unwrap_or(PERIOD), due, acceleration, deceleration, present: 0.0 }
    }

    /// The drive is not enabled: its motion will begin at this speed, m/s.
    pub(super) fn begin(&mut self, speed: f64) {
        self.present = speed;
        match &mut self.due {
            Due::Sync(seen) => *seen = None,
            Due::Period(ticker) => *ticker = None,
        }
    }

    /// The drive is enabled: takes a step to `target`, m/s, if one is due. `sync`: when the next SYNC is sent. True if
    /// a set-point is to be sent, a new one or not.
    pub(super) fn advance(&mut self, now: Instant, target: f64, sync: Option<Instant>) -> bool {
        let due = match &mut self.due {
            Due::Sync(seen) => std::mem::replace(seen, sync) != sync,
            Due::Period(ticker) => ticker.get_or_insert(Ticker::new(now, self.period)).due(now),
        };
        if due {
            self.present = self.step(target);
        }
        due
    }

    /// One period nearer to the target: a motion the other way round passes through standstill.
    fn step(&self, target: f64) -> f64 {
        let (present, dt) = (self.present, self.period.as_secs_f64());
        let turns = present * target < 0.0;
        let aim = if turns { 0.0 } else { target };
        let rate = if aim.abs() > present.abs() { self.acceleration } else { self.deceleration };
        let way = (aim - present).clamp(-rate * dt, rate * dt);
        // The target itself, without what an addition rounds.
        if way == aim - present { aim } else { present + way }
    }

    /// The set-point in force, m/s.
    pub(super) fn setpoint(&self) -> f64 {
        self.present
    }

    /// When the next step is due, where that is no SYNC.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        match &self.due {
            Due::Sync(_) => None,
            Due::Period(ticker) => ticker.as_ref().map(Ticker::next),
        }
    }
}

/// The way of a steering whose drive has no profile of its own (cyclic synchronous and interpolated position), in its
/// counts: a set-point for each SYNC.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glide {
    period: Duration,
    /// Counts/s.
    speed: f64,
    /// Counts/s², of the way's begin and its end.
    acceleration: f64,
    /// The time of the SYNC that was seen to be next.
    seen: Option<Instant>,
    target: Option<f64>,
    /// Last set-point.
    present: f64,
    /// Counts/s.
    velocity: f64,
}

impl Glide {
    /// Of a drive that stands. `period`: of SYNC.
    pub(super) fn new(period: Duration, speed: f64, acceleration: f64) -> Self {
        Self { period, speed, acceleration, seen: None, target: None, present: 0.0, velocity: 0.0 }
    }

    /// The drive does not follow set-points: the way will begin here, without a target.
    pub(super) fn begin(&mut self, position: i32) {
        (self.seen, self.target, self.present, self.velocity) = (None, None, position.into(), 0.0);
    }

    /// A new target, which is kept.
    pub(super) fn set(&mut self, target: i32) {
        self.target = Some(target.into());
    }

    /// The drive is enabled: takes a step if a SYNC was sent. `sync`: when the next one is. True if a set-point is to
    /// be sent, a new one or not.
    pub(super) fn advance(&mut self, sync: Option<Instant>) -> bool {
        let due = std::mem::replace(&mut self.seen, sync) != sync;
        if due {
            self.step();
        }
        due
    }

    /// The greatest speed from which it comes to a stand at the target, within the acceleration.
    fn step(&mut self) {
        let (dt, Some(target)) = (self.period.as_secs_f64(), self.target) else { return };
        let (way, gain) = (target - self.present, self.acceleration * dt);
        if way.abs() <= gain * dt && self.velocity.abs() <= gain {
            (self.present, self.velocity) = (target, 0.0);
            return;
        }
        let most = libm::sqrt(gain * gain + 2.0 * self.acceleration * way.abs()) - gain;
        let wanted = most.min(self.speed).copysign(way);
        self.velocity += (wanted - self.velocity).clamp(-gain, gain);
        self.present += self.velocity * dt;
    }

    /// The set-point in force, counts.
    pub(super) fn setpoint(&self) -> i32 {
        self.present.round() as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn each_set_point_is_within_the_limits_of_the_one_before() {
        let mut ramp = Ramp::new(None, 0.5, 0.8);
        let mut now = Instant::ZERO;
        let mut run = |ramp: &mut Ramp, target, periods| {
            let mut all = vec![ramp.setpoint()];
            for _ in 0..periods {
                assert!(ramp.advance(now, target, None));
                assert!(!ramp.advance(now + MS, target, None), "not before the next is due");
                assert_eq!(ramp.poll_timeout(), Some(now + PERIOD));
                now += PERIOD;
                all.push(ramp.setpoint());
            }
            all
        };
        let steps = |all: &[f64]| all.windows(2).map(|two| two[1] - two[0]).collect::<Vec<_>>();
        let up = run(&mut ramp, 0.4, 45);
        assert!(steps(&up).iter().all(|step| (0.0..=0.01 + 1e-9).contains(step)), "{up:?}");
        assert_eq!((up[20] * 1000.0).round(), 200.0, "0.5 m/s² for 0.4 s");
        assert_eq!(up[45], 0.4);
        // The other way round: it brakes, stands, and accelerates.
        let turn = run(&mut ramp, -0.2, 60);
        assert!(turn.contains(&0.0) && turn[60] == -0.2, "{turn:?}");
        for two in turn.windows(2) {
            let bound = if two[0] > 0.0 { 0.016 } else { 0.01 };
            assert!((two[1] - two[0]).abs() <= bound + 1e-9, "{two:?}");
        }
        // After a pause a step is one step.
        now += PERIOD * 50;
        assert!(ramp.advance(now, 0.0, None));
        assert!((ramp.setpoint() + 0.184).abs() < 1e-9, "{}", ramp.setpoint());
    }

    #[test]
    fn with_sync_there_is_one_set_point_for_each() {
        let mut ramp = Ramp::new(Some(MS * 10), 0.5, 0.8);
        ramp.begin(0.3);
        let next = |n: u32| Some(Instant::ZERO + MS * 10 * n);
        assert!(ramp.advance(Instant::ZERO, 0.4, next(1)) && !ramp.advance(Instant::ZERO + MS, 0.4, next(1)));
        assert_eq!((ramp.setpoint(), ramp.poll_timeout()), (0.305, None));
        // A SYNC that was missed is not made up for.
        assert!(ramp.advance(Instant::ZERO + MS * 35, 0.4, next(4)));
        assert!((ramp.setpoint() - 0.31).abs() < 1e-12);
        ramp.begin(0.0);
        assert_eq!(ramp.setpoint(), 0.0);
    }

    #[test]
    fn a_position_is_reached_within_speed_and_acceleration_from_any_motion() {
        let mut glide = Glide::new(MS * 10, 1000.0, 10_000.0);
        glide.begin(500);
        let mut sync = Instant::ZERO;
        let mut all = vec![500.0];
        let mut to = |glide: &mut Glide, target, steps| {
            glide.set(target);
            for _ in 0..steps {
                sync += MS * 10;
                assert!(glide.advance(Some(sync)) && !glide.advance(Some(sync)));
                all.push(glide.present);
            }
            glide.setpoint()
        };
        assert_eq!(to(&mut glide, 1500, 130), 1500);
        // Turned round on the way, and stopped short.
        let _ = to(&mut glide, 0, 40);
        assert_eq!(to(&mut glide, 1400, 130), 1400);
        assert_eq!(to(&mut glide, 1403, 10), 1403);
        let speeds: Vec<f64> = all.windows(2).map(|two| (two[1] - two[0]) * 100.0).collect();
        assert!(speeds.iter().all(|speed| speed.abs() <= 1000.0 + 1e-6), "{speeds:?}");
        assert!(speeds.windows(2).all(|two| (two[1] - two[0]).abs() <= 200.0 + 1e-6), "{speeds:?}");
        assert!(all.iter().all(|position| (0.0..=1500.0).contains(position)), "{all:?}");
        // Without a target it stays.
        glide.begin(-7);
        sync += MS * 10;
        assert!(glide.advance(Some(sync)));
        assert_eq!(glide.setpoint(), -7);
    }
}
