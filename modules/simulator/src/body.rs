//! The robot's body: mass, motor force, losses, steering, wheels with encoders, and what it bumps into. Its driven axle
//! and its steered wheels are Advee's, or each of its wheels has a motor and none is steered.
//!
//! Steps of [`STEP`], in each of which acceleration is constant: straight runs and ramps are exact, and so is the arc
//! of the step's mean speed. The current loop and the speed loop of the drive are faster than a step (time constants
//! 0.7 ms and 4 ms, docs/facts/robot.md 2.4): within its force the motor has the demanded speed at the step's end.

mod wheels;

use crate::people::Hull;
use crate::random::Random;
use crate::world::World;
use base::Duration;
use kinematics::{Chassis, Shape, Twist, WHEELS_MAX, integrate};
use navitools::{Ackermann, Motion, Pose};
use settings::robot::{Geometry, Traction};
use wheels::Wheels;

/// The step of the integration.
pub const STEP: Duration = Duration::from_millis(5);
const DT: f64 = 0.005;
const GRAVITY: f64 = 9.81;
/// A contact lasts until the body is this far away, m.
const RELEASE: f64 = 0.01;

/// Parameters of the body; the defaults are those of docs/facts/robot.md 1.2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Between the axles, m.
    pub wheelbase: f64,
    /// Between the front hubs, m.
    pub track: f64,
    /// Behind the rear axle, m.
    pub overhang_rear: f64,
    /// Ahead of the front axle, m.
    pub overhang_front: f64,
    /// m.
    pub width: f64,
    /// Outline in the robot's frame within the rectangle by these measures; `None`: that rectangle. The body's inertia
    /// is always the rectangle's.
    pub shape: Option<Shape>,
    /// kg.
    pub mass: f64,
    /// Radius of all wheels, m.
    pub wheel_radius: f64,
    /// Greatest force of the motor at the wheel, N; of all motors together.
    pub force_max: f64,
    /// Greatest speed that gear and supply allow, m/s.
    pub speed_max: f64,
    /// Rolling resistance by weight.
    pub rolling: f64,
    /// Drag of motor and gear at the wheel, N; of all together.
    pub drag: f64,
    /// Deceleration by a brake that acts while the motors have no feed, m/s²; 0: there is none.
    pub brake: f64,
    /// The steering's mechanical stop on either side, rad; beyond the switch.
    pub steering_stop: f64,
    /// Homing switch of the steering.
    pub steering_switch: Switch,
    /// Greatest rate, rad/s.
    pub steering_rate: f64,
    /// Time constant of the position loop, s.
    pub steering_lag: f64,
    /// Play between drive and wheels, rad.
    pub steering_play: f64,
    /// Counts of an encoder per wheel turn.
    pub encoder_counts: f64,
    /// What the motor of a base that steers drives.
    pub traction: Traction,
    /// Deviations from these, also from run to run.
    pub errors: Errors,
}

/// The steering shall turn so far beyond its greatest angle and its switch before it is at its stop, degrees.
const STOP_BEYOND: f64 = 1.5;

/// Homing switch of a steering, closed from its edge to the stop on its side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// Its edge, rad.
    pub angle: f64,
    /// True if it is closed to the left of its edge, at greater angles.
    pub left: bool,
}

/// Deviations of a robot from its drawing: bounds of those constant for a run, standard deviations of those that
/// change.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// An encoder counts up to this part more or less than the truth, each by itself: the front wheels', or those of
    /// all wheels' motors.
    pub encoder_scale: f64,
    /// The track is up to this part wider or narrower.
    pub track: f64,
    /// Common scale noise of both front wheels, m per √m.
    pub along: f64,
    /// Differential scale noise, as a rotation of the robot, rad per √m.
    pub turn: f64,
    /// Slip of the driven wheels where force is the robot's weight; front wheels are not driven, and roll.
    pub slip: f64,
}

impl Errors {
    /// Errors of docs/facts/robot.md 1.2. The slip is that of a hard tyre on a smooth floor: 1.5 % in a quick stop.
    #[must_use]
    pub fn usual() -> Self {
        Self { encoder_scale: 0.01, track: 0.01, along: 0.01, turn: 0.5f64.to_radians(), slip: 0.1 }
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            wheelbase: 0.60,
            track: 0.50,
            overhang_rear: 0.15,
            overhang_front: 0.15,
            width: 0.60,
            shape: None,
            mass: 95.0,
            wheel_radius: 0.100,
            force_max: 208.0,
            speed_max: 2.42,
            rolling: 0.015,
            drag: 2.4,
            brake: 0.0,
            steering_stop: 37.5f64.to_radians(),
            steering_switch: Switch { angle: -36f64.to_radians(), left: false },
            steering_rate: 40f64.to_radians(),
            steering_lag: 0.10,
            steering_play: 0.5f64.to_radians(),
            encoder_counts: 4096.0,
            traction: Traction::Fixed { left: 0.0 },
            errors: Errors::default(),
        }
    }
}

impl Parameters {
    /// Those of the usual robot with these measures.
    #[must_use]
    pub fn of(geometry: &Geometry) -> Self {
        Self {
            wheelbase: geometry.wheelbase_m,
            track: geometry.track_m,
            overhang_rear: geometry.rear_m(),
            overhang_front: geometry.front_m() - geometry.wheelbase_m,
            width: geometry.width_m(),
            shape: geometry.footprint().copied(),
            wheel_radius: geometry.wheel_radius_m,
            encoder_counts: f64::from(geometry.ticks_per_turn),
            traction: geometry.traction(),
            ..Self::default()
        }
    }

    /// The same with a steering that turns up to `most`, rad, and has its homing switch at `switch`, to the hundredth
    /// of a degree nearest to it; its stops are beyond both.
    #[must_use]
    pub fn steered(self, most: f64, switch: Switch) -> Self {
        let degrees = libm::round(switch.angle.to_degrees() * 100.0) / 100.0;
        let stop = libm::fabs(degrees).max(most.to_degrees()) + STOP_BEYOND;
        let steering_switch = Switch { angle: degrees.to_radians(), ..switch };
        Self { steering_switch, steering_stop: stop.to_radians(), ..self }
    }

    /// Motor turns per metre driven, by motor turns per turn of the wheel.
    #[must_use]
    pub fn motor_turns_per_metre(&self, gear: f64) -> f64 {
        gear / (2.0 * core::f64::consts::PI * self.wheel_radius)
    }

    /// Way of a wheel per encoder count, m.
    #[must_use]
    pub fn metres_per_tick(&self) -> f64 {
        2.0 * core::f64::consts::PI * self.wheel_radius / self.encoder_counts
    }

    /// Deceleration with the power stage off, m/s².
    #[must_use]
    pub fn coasting(&self) -> f64 {
        self.rolling * GRAVITY + self.drag / self.mass
    }
}

/// Demand of the drives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demand {
    /// Speed of the tread of each driven wheel, m/s; of a base that steers the first: that of its driven axle or
    /// wheel over ground. `None` with the power stage off: it coasts.
    pub wheels: [Option<f64>; WHEELS_MAX],
    /// Angle of the steering drive's output, rad; none with the power stage off: the gear holds it.
    pub steering: Option<f64>,
    /// The motors have no feed: the brake acts, if there is one.
    pub unfed: bool,
}

impl Demand {
    /// All wheels at this speed, m/s.
    #[must_use]
    pub fn speed(speed: f64) -> Self {
        Self { wheels: [Some(speed); WHEELS_MAX], ..Self::default() }
    }
}

/// The body in the world.
#[derive(Clone, Debug)]
pub struct Body {
    parameters: Parameters,
    geometry: Ackermann,
    pose: Pose,
    speed: f64,
    /// Force of the motor at the wheel, N.
    force: f64,
    /// In place of driven axle and steering.
    wheels: Option<Wheels>,
    /// Signed way of the rear axle's middle since the start.
    travelled: f64,
    /// Output of the steering drive, and the wheels behind the play.
    steering: (f64, f64),
    /// Curvature by the wheels' angle, and path of the front hubs per path.
    curvature: f64,
    hub_ratios: (f64, f64),
    /// Path of the driven tread per path, and its way since the start.
    tread_ratio: f64,
    tread: f64,
    /// Ways of the front wheels by their encoders, and how much these count more than the truth.
    hubs: (f64, f64),
    scales: (f64, f64),
    /// Slip: excess path of the driven wheels.
    slipped: f64,
    random: Random,
    /// Path within which no part of the body can reach a wall, m.
    free_way: f64,
    touching: bool,
    /// Something was in the way of the last step.
    blocked: bool,
    collisions: u32,
}

impl Body {
    /// Standing at `pose`, wheels straight.
    #[must_use]
    pub fn new(parameters: Parameters, pose: Pose) -> Self {
        Self::drawn(parameters, pose, Random::new(0))
    }

    /// A body whose errors have a random stream of their own.
    #[must_use]
    pub fn drawn(parameters: Parameters, pose: Pose, mut random: Random) -> Self {
        let mut about_one = |part: f64| 1.0 + part * (2.0 * random.uniform() - 1.0);
        let Errors { encoder_scale, track, .. } = parameters.errors;
        let scales = (about_one(encoder_scale), about_one(encoder_scale));
        let track = parameters.track * about_one(track);
        let geometry = Ackermann { wheelbase_m: parameters.wheelbase, track_m: track };
        Self {
            parameters,
            geometry,
            pose,
            speed: 0.0,
            force: 0.0,
            wheels: None,
            travelled: 0.0,
            steering: (0.0, 0.0),
            curvature: 0.0,
            hub_ratios: (1.0, 1.0),
            tread_ratio: 1.0,
            tread: 0.0,
            hubs: (0.0, 0.0),
            scales,
            slipped: 0.0,
            random,
            free_way: 0.0,
            touching: false,
            blocked: false,
            collisions: 0,
        }
    }

    /// The same on these wheels, each with a motor; of steered wheels it has none.
    #[must_use]
    pub fn on_wheels(mut self, chassis: &Chassis) -> Self {
        let (part, random) = (self.parameters.errors.encoder_scale, &mut self.random);
        let scale = || 1.0 + part * (2.0 * random.uniform() - 1.0);
        self.wheels = Some(Wheels::new(chassis, &self.parameters, scale));
        self
    }

    /// Parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Pose of the rear axle's centre.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Forward, m/s.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.twist().vx
    }

    /// Velocity.
    #[must_use]
    pub fn twist(&self) -> Twist {
        let steered = || Twist::new(self.speed, 0.0, self.speed * self.curvature);
        self.wheels.as_ref().map_or_else(steered, Wheels::twist)
    }

    /// Speed of the tread of a driven wheel, m/s.
    #[must_use]
    pub fn wheel_speed(&self, wheel: usize) -> f64 {
        self.wheels.as_ref().map_or(self.speed * self.tread_ratio, |wheels| wheels.speed(wheel))
    }

    /// Force of a driven wheel's motor at the wheel in the last step, N, forward positive.
    #[must_use]
    pub fn force(&self, wheel: usize) -> f64 {
        self.wheels.as_ref().map_or(self.force, |wheels| wheels.force(wheel))
    }

    /// Power that the motors of all driven wheels give, W; negative: they brake.
    #[must_use]
    pub fn power(&self) -> f64 {
        self.wheels.as_ref().map_or(self.force * self.speed, Wheels::power)
    }

    /// Signed way forward since the start, m.
    #[must_use]
    pub fn travelled(&self) -> f64 {
        self.travelled
    }

    /// Way of a driven wheel by its motor's own encoder, m.
    #[must_use]
    pub fn motor_way(&self, wheel: usize) -> f64 {
        self.wheels.as_ref().map_or(self.tread + self.slipped, |wheels| wheels.way(wheel))
    }

    /// Angle of the equivalent single front wheel, rad.
    #[must_use]
    pub fn steering(&self) -> f64 {
        let Some(wheels) = &self.wheels else { return self.steering.1 };
        let Twist { vx, omega, .. } = wheels.twist();
        if vx == 0.0 { 0.0 } else { libm::atan(omega * self.parameters.wheelbase / vx) }
    }

    /// Angle of the steering drive's output, rad: what its encoder sees; the wheels lag by the play.
    #[must_use]
    pub fn steering_output(&self) -> f64 {
        self.steering.0
    }

    /// True if the homing switch is closed.
    #[must_use]
    pub fn switch_closed(&self) -> bool {
        let Switch { angle, left } = self.parameters.steering_switch;
        if left { self.steering.0 >= angle } else { self.steering.0 <= angle }
    }

    /// Whether the limit switch at the drive's negative end, and the one at its positive end, is closed: the homing
    /// switch serves as one of them, by the sign of the drive's counts per radian.
    #[must_use]
    pub fn limits_closed(&self, counts_per_radian: f64) -> (bool, bool) {
        let positive = self.parameters.steering_switch.left == (counts_per_radian > 0.0);
        (self.switch_closed() && !positive, self.switch_closed() && positive)
    }

    /// The encoder counts of the left and the right front wheel since the start.
    #[must_use]
    pub fn ticks(&self) -> (i64, i64) {
        let count = |way: f64| libm::floor(way / self.parameters.metres_per_tick()) as i64;
        let (left, right) = self.wheels.as_ref().map_or(self.hubs, |wheels| (wheels.way(0), wheels.way(1)));
        (count(left), count(right))
    }

    /// Number of collisions.
    #[must_use]
    pub fn collisions(&self) -> u32 {
        self.collisions
    }

    /// True if something was in the way of the last step: a bumper is pressed.
    #[must_use]
    pub fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// Outline and how it moves, as people meet it.
    #[must_use]
    pub fn hull(&self) -> Hull {
        let p = &self.parameters;
        let outline = (-p.overhang_rear, p.wheelbase + p.overhang_front, p.width / 2.0);
        Hull::new(self.pose, outline, self.twist()).shaped(p.shape)
    }

    /// Speed of its fastest part, m/s.
    #[must_use]
    pub fn fastest(&self) -> f64 {
        if self.wheels.is_some() { self.sweep(self.twist()) } else { libm::fabs(self.speed) }
    }

    /// The farthest that a part of it has moved in the step that led here from `before`, m.
    #[must_use]
    pub fn moved_since(&self, before: &Self) -> f64 {
        match &self.wheels {
            Some(wheels) => {
                let (old, new) = (before.twist(), wheels.twist());
                self.sweep(old).max(self.sweep(new)) * DT
            }
            None => self.sweep_along(self.travelled - before.travelled),
        }
    }

    /// The farthest that a part of it moves by a displacement, m.
    fn sweep(&self, displacement: Twist) -> f64 {
        libm::hypot(displacement.vx, displacement.vy) + libm::fabs(displacement.omega) * self.corner()
    }

    /// The same along the arc of its steering.
    fn sweep_along(&self, way: f64) -> f64 {
        libm::fabs(way) * (1.0 + libm::fabs(self.curvature) * self.corner())
    }

    /// No part is farther from the origin, m.
    fn corner(&self) -> f64 {
        let p = &self.parameters;
        p.overhang_rear.max(p.wheelbase + p.overhang_front) + p.width / 2.0
    }

    /// Undoes the last step, which led here from `before`, because a person was in the way. `anew`: not in the step
    /// before.
    pub fn stop_at(&mut self, before: &Self, anew: bool) {
        self.clone_from(before);
        self.stop();
        self.blocked = true;
        self.collisions += u32::from(anew);
    }

    /// Lifted and put elsewhere: its wheels have not turned.
    pub fn put(&mut self, pose: Pose) {
        self.stop();
        (self.pose, self.force, self.free_way) = (pose, 0.0, 0.0);
        (self.touching, self.blocked) = (false, false);
    }

    fn stop(&mut self) {
        self.speed = 0.0;
        self.wheels.iter_mut().for_each(Wheels::stop);
    }

    /// Distance of the body's outline to the nearest wall or column, m; infinite without one.
    #[must_use]
    pub fn clearance(&self, world: &World) -> f64 {
        self.clearance_at(world, self.pose)
    }

    /// The same if the body were at this pose.
    pub(crate) fn clearance_at(&self, world: &World, pose: Pose) -> f64 {
        let p = &self.parameters;
        if let Some(shape) = &p.shape {
            return world.clearance_of_shape(pose, shape);
        }
        world.clearance(pose, -p.overhang_rear, p.wheelbase + p.overhang_front, p.width / 2.0)
    }

    /// True if a step with this demand changes nothing.
    #[must_use]
    pub fn rests(&self, demand: &Demand) -> bool {
        if let Some(wheels) = &self.wheels {
            return wheels.rests(demand);
        }
        self.speed == 0.0
            && demand.wheels[0].is_none_or(|speed| speed == 0.0)
            && demand.steering.is_none_or(|angle| self.reachable(angle) == self.steering.0)
    }

    fn reachable(&self, angle: f64) -> f64 {
        angle.clamp(-self.parameters.steering_stop, self.parameters.steering_stop)
    }

    /// Goes on by [`STEP`].
    pub fn step(&mut self, world: &World, demand: &Demand) {
        self.blocked = if let Some(wheels) = &mut self.wheels {
            let displacement = wheels.accelerate(&self.parameters, demand);
            displacement != Twist::ZERO && !self.displace(world, displacement)
        } else {
            self.steer(demand.steering);
            let demanded = demand.wheels[0].map(|tread| tread / self.tread_ratio);
            let way = self.accelerate(demanded, demand.unfed);
            way != 0.0 && !self.advance(world, way)
        };
        if self.blocked {
            self.stop();
            self.collisions += u32::from(!self.touching);
            self.touching = true;
        }
    }

    fn steer(&mut self, demand: Option<f64>) {
        let p = &self.parameters;
        if let Some(angle) = demand {
            let target = self.reachable(angle);
            let gap = target - self.steering.0;
            let rate = (gap / p.steering_lag.max(DT)).clamp(-p.steering_rate, p.steering_rate);
            // The last thousandth of a degree is friction's.
            self.steering.0 = if libm::fabs(gap) < 2e-5 { target } else { self.steering.0 + rate * DT };
        }
        let half = p.steering_play / 2.0;
        let wheels = self.steering.1.clamp(self.steering.0 - half, self.steering.0 + half);
        if wheels != self.steering.1 {
            self.steering.1 = wheels;
            self.curvature = self.geometry.curvature(wheels);
            self.hub_ratios = self.geometry.hub_ratios(self.curvature);
            self.tread_ratio = p.traction.tread_ratio(wheels);
        }
    }

    /// The new speed; answers the way of the step.
    fn accelerate(&mut self, demand: Option<f64>, unfed: bool) -> f64 {
        let p = &self.parameters;
        let losses = p.coasting();
        let old = self.speed;
        let Some(demand) = demand else {
            self.force = 0.0;
            let losses = losses + if unfed { p.brake } else { 0.0 };
            let slower = losses * DT;
            if libm::fabs(old) <= slower {
                self.speed = 0.0;
                return libm::copysign(old * old / (2.0 * losses), old);
            }
            self.speed = old - libm::copysign(slower, old);
            return (old + self.speed) / 2.0 * DT;
        };
        let demand = demand.clamp(-p.speed_max, p.speed_max);
        let force = p.force_max / p.mass;
        // Losses help to brake and hinder to gain speed, whichever way it rolls.
        let towards = if old == 0.0 { demand } else { old };
        let against = if towards == 0.0 { 0.0 } else { libm::copysign(losses, towards) };
        let change = (demand - old).clamp((-force - against) * DT, (force - against) * DT);
        self.speed = old + change;
        self.force = (change / DT + against) * p.mass;
        (old + self.speed) / 2.0 * DT
    }

    /// Moves along the arc; false, and nothing moved, when something is in the way.
    fn advance(&mut self, world: &World, way: f64) -> bool {
        let pose = self.pose.along(Motion { translation: way, rotation: way * self.curvature });
        if !self.go(world, pose, self.sweep_along(way)) {
            return false;
        }
        let p = &self.parameters;
        self.travelled += way;
        self.tread += way * self.tread_ratio;
        // Forward force makes them roll more than the way going forward, and less going back.
        self.slipped += libm::fabs(way) * p.errors.slip * self.force / (p.mass * GRAVITY);
        let (mut left, mut right) = (way * self.hub_ratios.0 * self.scales.0, way * self.hub_ratios.1 * self.scales.1);
        let Errors { along, turn, .. } = p.errors;
        if along > 0.0 || turn > 0.0 {
            let root = libm::sqrt(libm::fabs(way));
            let (both, apart) = (along * root * self.random.normal(), turn * root * self.random.normal());
            left += both - apart * p.track / 2.0;
            right += both + apart * p.track / 2.0;
        }
        (self.hubs.0, self.hubs.1) = (self.hubs.0 + left, self.hubs.1 + right);
        true
    }

    /// The same on wheels.
    fn displace(&mut self, world: &World, displacement: Twist) -> bool {
        let pose = integrate(self.pose, displacement, 1.0);
        if !self.go(world, pose, self.sweep(displacement)) {
            return false;
        }
        self.travelled += displacement.vx;
        if let Some(wheels) = &mut self.wheels {
            wheels.roll(&self.parameters, displacement, &mut self.random);
        }
        true
    }

    /// Goes to a pose, by which no part of it moves farther than `sweep`, m; false if something is in the way.
    fn go(&mut self, world: &World, pose: Pose, sweep: f64) -> bool {
        self.free_way -= sweep;
        if self.free_way <= 0.0 {
            self.free_way = self.clearance_at(world, pose);
            if self.free_way == 0.0 {
                return false;
            }
            self.touching &= self.free_way < RELEASE;
        }
        self.pose = pose;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use navitools::odometry::SteeredWheels;

    fn body() -> (Body, World) {
        (Body::new(Parameters::default(), Pose::default()), World::default())
    }

    fn run(body: &mut Body, world: &World, seconds: f64, demand: Demand) {
        for _ in 0..libm::round(seconds / DT) as u32 {
            body.step(world, &demand);
        }
    }

    fn speed(speed: f64) -> Demand {
        Demand::speed(speed)
    }

    #[test]
    fn a_straight_run_is_speed_times_time() {
        let (mut body, world) = body();
        run(&mut body, &world, 2.0, speed(0.8));
        let start = body.pose().x;
        run(&mut body, &world, 10.0, speed(0.8));
        assert!((body.pose().x - start - 8.0).abs() < 1e-9 && body.pose().y == 0.0);
        let ticks = 8.0 / body.parameters().metres_per_tick();
        let (left, right) = body.ticks();
        assert_eq!(left, right);
        assert!((left as f64 - ticks - start / body.parameters().metres_per_tick()).abs() < 2.0);
    }

    #[test]
    fn the_motor_s_force_limits_the_acceleration() {
        let (mut body, world) = body();
        run(&mut body, &world, 0.5, speed(2.4));
        // (208 N - 14 N - 2.4 N) / 95 kg for half a second.
        let expected = (208.0 / 95.0 - 0.015 * 9.81 - 2.4 / 95.0) * 0.5;
        assert!((body.speed() - expected).abs() < 1e-9, "{} {expected}", body.speed());
        run(&mut body, &world, 5.0, speed(9.0));
        assert_eq!(body.speed(), 2.42);
    }

    #[test]
    fn without_power_it_coasts_as_far_as_its_losses_let_it() {
        let (mut body, world) = body();
        run(&mut body, &world, 2.0, speed(0.8));
        let start = body.pose().x;
        run(&mut body, &world, 10.0, Demand::default());
        let expected = 0.8 * 0.8 / (2.0 * body.parameters().coasting());
        assert!((body.pose().x - start - expected).abs() < 1e-9, "{} {expected}", body.pose().x - start);
        assert!(body.rests(&Demand::default()));
    }

    #[test]
    fn a_brake_acts_while_the_motors_have_no_feed() {
        let world = World::default();
        let mut body = Body::new(Parameters { brake: 1.5, ..Parameters::default() }, Pose::default());
        run(&mut body, &world, 2.0, speed(0.8));
        let start = body.pose().x;
        run(&mut body, &world, 2.0, Demand { unfed: true, ..Demand::default() });
        let expected = 0.8 * 0.8 / (2.0 * (1.5 + body.parameters().coasting()));
        assert!((body.pose().x - start - expected).abs() < 1e-9, "{} {expected}", body.pose().x - start);
    }

    #[test]
    fn full_lock_drives_a_circle_of_the_table_s_radius_and_the_odometry_agrees() {
        let (mut body, world) = body();
        let lock = 35f64.to_radians();
        let steer = Demand { steering: Some(lock + 0.25f64.to_radians()), ..speed(0.0) };
        run(&mut body, &world, 3.0, steer);
        assert!((body.steering() - lock).abs() < 1e-6, "{}", body.steering().to_degrees());
        run(&mut body, &world, 1.0, Demand { wheels: speed(0.5).wheels, ..steer });
        let (from, path, ticks) = (body.pose(), body.travelled(), body.ticks());
        run(&mut body, &world, 4.0, Demand { wheels: speed(0.5).wheels, ..steer });
        let radius = 0.60 / libm::tan(lock);
        let turned = (body.pose().theta - from.theta).radians();
        let expected = navitools::wrap((body.travelled() - path) / radius);
        assert!((turned - expected).abs() < 1e-6, "{turned} {expected}");
        assert!((radius - 0.857).abs() < 0.0005);
        let per_tick = body.parameters().metres_per_tick();
        let way = |new: i64, old: i64| (new - old) as f64 * per_tick;
        let seen = SteeredWheels::new(0.60, 0.50).motion(way(body.ticks().0, ticks.0), way(body.ticks().1, ticks.1));
        assert!((seen.translation - 2.0).abs() < 1e-3 && (seen.rotation - 2.0 / radius).abs() < 3e-3, "{seen:?}");
    }

    #[test]
    fn steering_is_limited_in_rate_then_lags_and_has_play() {
        let (mut body, world) = body();
        let demand = Demand { steering: Some(30f64.to_radians()), ..Demand::default() };
        run(&mut body, &world, 0.5, demand);
        assert!((body.steering_output().to_degrees() - 20.0).abs() < 1e-9, "40 deg/s for 0.5 s");
        // The rate limit lasts until the gap is 4 deg (0.65 s); from there it closes with 0.1 s.
        run(&mut body, &world, 0.15, demand);
        assert!((body.steering_output().to_degrees() - 26.0).abs() < 1e-6);
        run(&mut body, &world, 0.1, demand);
        let gap = 30.0 - body.steering_output().to_degrees();
        assert!((gap - 4.0 * libm::exp(-1.0)).abs() < 0.05, "{gap}");
        run(&mut body, &world, 2.0, demand);
        assert!(body.rests(&demand));
        assert!((body.steering().to_degrees() - 29.75).abs() < 1e-9, "{}", body.steering().to_degrees());
    }

    /// What odometry measures over 4 m straight ahead: way and turn.
    fn measured(errors: Errors, seed: u64) -> (f64, f64) {
        let parameters = Parameters { errors, ..Parameters::default() };
        let mut body = Body::drawn(parameters, Pose::default(), Random::stream(9, seed));
        while body.travelled() < 4.0 {
            body.step(&World::default(), &speed(0.8));
        }
        let ways = body.ticks();
        let way = |ticks: i64| ticks as f64 * body.parameters().metres_per_tick() / body.travelled() * 4.0;
        (((way(ways.0) + way(ways.1)) / 2.0 - 4.0), (way(ways.1) - way(ways.0)) / 0.5)
    }

    fn deviation(values: &[f64]) -> f64 {
        libm::sqrt(values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64)
    }

    #[test]
    fn odometry_is_as_wrong_as_the_table_says() {
        let Errors { along, turn, encoder_scale, track, .. } = Errors::usual();
        let random = Errors { along, turn, ..Errors::default() };
        let (ways, turns): (Vec<f64>, Vec<f64>) = (0..300).map(|seed| measured(random, seed)).unzip();
        // Over 4 m twice the deviation over 1 m.
        assert!((deviation(&ways) - 0.02).abs() < 0.003, "{}", deviation(&ways));
        assert!((deviation(&turns).to_degrees() - 1.0).abs() < 0.15, "{}", deviation(&turns).to_degrees());
        let constant = Errors { encoder_scale, track, ..Errors::default() };
        let (ways, turns): (Vec<f64>, Vec<f64>) = (0..300).map(|seed| measured(constant, seed)).unzip();
        let most = |values: &[f64]| values.iter().fold(0.0f64, |most, value| most.max(value.abs()));
        assert!(most(&ways) < 0.0405 && most(&ways) > 0.03, "{}", most(&ways));
        assert!(most(&turns) < 0.165 && most(&turns) > 0.1, "{}", most(&turns));
        assert_eq!(measured(Errors::usual(), 1), measured(Errors::usual(), 1));
        assert_eq!(measured(constant, 1), measured(constant, 1));
    }

    #[test]
    fn the_driven_wheels_slip_when_it_starts_and_stops_and_the_front_ones_roll() {
        let errors = Errors { slip: 0.1, ..Errors::default() };
        let mut body = Body::new(Parameters { errors, ..Parameters::default() }, Pose::default());
        run(&mut body, &World::default(), 1.0, speed(0.8));
        let started = body.motor_way(0) - body.travelled();
        // A tenth of 208 N on 932 N of weight while it gains speed, over 0.158 m, then of the 16.4 N of its losses.
        let expected = 0.1 / 932.0 * (208.0 * 0.158 + 16.4 * (body.travelled() - 0.158));
        assert!((started - expected).abs() < 1e-4, "{started} {expected}");
        run(&mut body, &World::default(), 2.0, speed(0.0));
        assert!(body.motor_way(0) - body.travelled() < started - 2e-3);
        let (left, _) = body.ticks();
        assert!((left as f64 * body.parameters().metres_per_tick() - body.travelled()).abs() < 1e-3);
    }

    #[test]
    fn the_switch_closes_before_the_stop() {
        let (mut body, world) = body();
        let demand = Demand { steering: Some(-1.0), ..Demand::default() };
        run(&mut body, &world, 0.8, demand);
        assert!(!body.switch_closed());
        run(&mut body, &world, 2.0, demand);
        assert!(body.switch_closed());
        assert!((body.steering_output().to_degrees() + 37.5).abs() < 1e-9);
    }

    #[test]
    fn switch_and_stops_of_the_steering_are_those_of_the_robot() {
        let steered = |most, angle, left| Parameters::default().steered(most, Switch { angle, left });
        // -36 degrees to four digits: the usual robot.
        assert_eq!(steered(0.6109, -0.6283, false), Parameters::default());
        for (most, angle, left, stop) in [
            (0.6, 0.45, true, 0.6 + 1.5f64.to_radians()),
            (0.9, -0.45, false, 0.9 + 1.5f64.to_radians()),
            (0.6, 0.8, true, 0.8 + 1.5f64.to_radians()),
            (0.6, 0.0, false, 0.6 + 1.5f64.to_radians()),
        ] {
            let mut body = Body::new(steered(most, angle, left), Pose::default());
            let side = if left { 1.0 } else { -1.0 };
            assert!((body.parameters().steering_stop - stop).abs() < 1e-4);
            for (off, closed) in [(-0.01, false), (0.01, true), (2.0, true)] {
                let demand = Demand { steering: Some(angle + side * off), ..Demand::default() };
                run(&mut body, &World::default(), 6.0, demand);
                assert_eq!(body.switch_closed(), closed, "{most} {angle} {off}");
                assert_eq!(body.limits_closed(1.0), (closed && !left, closed && left));
                assert_eq!(body.limits_closed(-1.0), (closed && left, closed && !left));
            }
            assert!((body.steering_output() - side * stop).abs() < 1e-4, "{}", body.steering_output());
        }
    }

    #[test]
    fn a_polygon_touches_with_its_own_edges() {
        let corners = [(-0.15, -0.3), (0.75, 0.0), (-0.15, 0.3)].map(|(x, y)| navitools::Point { x, y });
        let parameters = Parameters { shape: Shape::hull(&corners), ..Parameters::default() };
        // At a wall its tip.
        let mut pointed = Body::new(parameters, Pose::new(18.0, 6.0, 0.0));
        run(&mut pointed, &World::hall(20.0, 12.0), 5.0, speed(1.0));
        assert_eq!((pointed.speed(), pointed.collisions()), (0.0, 1));
        assert!((pointed.pose().x - 19.25).abs() < 0.006, "{}", pointed.pose().x);
        // At a column beside the tip its side, 0.5 m farther back.
        let centre = navitools::Point { x: 3.0, y: 0.2 };
        let world = World { columns: vec![crate::world::Column { centre, radius: 0.05 }], ..World::default() };
        let mut ways = [Parameters::default(), parameters].map(|parameters| {
            let mut body = Body::new(parameters, Pose::default());
            run(&mut body, &world, 5.0, speed(1.0));
            assert_eq!(body.collisions(), 1);
            let clearance = body.clearance(&world);
            assert!(clearance > 0.0 && clearance < 0.006, "{clearance}");
            body.pose().x
        });
        ways[0] -= 3.0 - 0.05 - 0.75;
        // The edge's line is y = (0.75 - x) / 3; the column is at 5 cm from it.
        ways[1] -= 3.0 - (0.75 - 3.0 * 0.2) - 0.05 * libm::sqrt(10.0);
        assert!(ways.iter().all(|off| off.abs() < 0.02), "{ways:?}");
    }

    #[test]
    fn it_stops_at_a_wall_and_the_collision_counts_once() {
        let world = World::hall(20.0, 12.0);
        let mut body = Body::new(Parameters::default(), Pose::new(18.0, 6.0, 0.0));
        run(&mut body, &world, 5.0, speed(1.0));
        assert_eq!((body.speed(), body.collisions()), (0.0, 1));
        let gap = body.clearance(&world);
        assert!(gap > 0.0 && gap < 0.006, "within a step of the wall: {gap}");
        run(&mut body, &world, 2.0, speed(-0.5));
        assert!(body.clearance(&world) > 0.5);
        run(&mut body, &world, 5.0, speed(0.5));
        assert_eq!(body.collisions(), 2);
    }
}
