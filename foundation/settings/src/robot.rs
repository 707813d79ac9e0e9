//! Sections that several modules share: measures and limits of the robot, beacons of where it drives.
//!
//! The robot's frame: origin on the floor under the middle of the axle that does not steer, the rear one unless
//! `[base]` gives another, x forward, y to the left, angles counter-clockwise.

use crate::footprint::{Footprint, Outline};
use crate::{Rule, Table, settings};
use base::Duration;
use kinematics::{Chassis, Point, Shape};
use std::ops::RangeInclusive;

/// Length and width of a rectangle, m, and its part behind the origin.
const SIDE: RangeInclusive<f64> = 0.1..=10.0;
const OVERHANG: RangeInclusive<f64> = 0.0..=5.0;

settings! {
    /// `[geometry]`: measures of the robot. Its outline is a rectangle, by `length_m`, `width_m` and
    /// `rear_overhang_m`, or a convex polygon, `footprint_m`.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Geometry {
        /// Rear axle to front axle; of a base that steers: fixed to steered axle, whichever is in front.
        wheelbase_m: f64 = required, 0.05..=5.0;
        /// Distance of the front wheels.
        track_m: f64 = required, 0.05..=5.0;
        /// Radius of all wheels.
        wheel_radius_m: f64 = required, 0.01..=1.0;
        /// Bumper to bumper; required without `footprint_m`.
        length_m: Option<f64> = optional, SIDE;
        /// Width; required without `footprint_m`.
        width_m: Option<f64> = optional, SIDE;
        /// Rear axle to rear bumper, at most `length_m`; required without `footprint_m`.
        rear_overhang_m: Option<f64> = optional, OVERHANG;
        /// The outline as a polygon in the robot's frame, in place of the three measures above, with the reference
        /// point and the contact points of the wheels in it. Of a concave one the convex hull is used.
        footprint_m: Option<Footprint> = optional, Outline;
        /// Counts of a front wheel's encoder per turn.
        ticks_per_turn: u32 = required, 1..=1_000_000;
        /// What the propulsion of a robot without `[base]` drives.
        driven: DrivenAxle = DrivenAxle::Fixed;
        /// Wheels of a base that steers, by `[base]`.
        steered: Steered = unset Steered::FRONT;
    }
    check Geometry::check;
}

settings! {
    /// Driven wheels of a base that steers.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum DrivenAxle {
        /// The axle that does not steer.
        #[default]
        Fixed = "rear",
        /// The single steered wheel: a tricycle. Its drive measures the speed of its tread, which `limits.speed_mps`
        /// bounds as well.
        Steered = "front",
    }
}

/// Wheels of a base that steers, beside their distances in [`Geometry`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steered {
    /// A single steered wheel, not two.
    pub one_steered: bool,
    /// A single wheel on the fixed axle, not two.
    pub one_fixed: bool,
    /// Where the steered wheels are, seen from the fixed axle.
    pub end: End,
    /// Place of the driven wheel of the fixed axle to the left of its middle, m; 0: the axle is driven as a whole.
    pub driven_left_m: f64,
}

impl Steered {
    /// Two fixed wheels behind two steered ones.
    pub const FRONT: Self = Self { one_steered: false, one_fixed: false, end: End::Front, driven_left_m: 0.0 };
}

/// What the propulsion of a base that steers turns: gives the speed of its tread by that of the fixed axle's middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Traction {
    /// The fixed axle, or one of its wheels.
    Fixed {
        /// Place of the wheel to the left of the axle's middle, divided by the wheelbase; 0: the axle as a whole.
        left: f64,
    },
    /// The single steered wheel.
    Steered,
}

/// Least ratio of [`Traction::tread_ratio`]: a wheel nearer to the centre of the turn hardly measures the speed.
const TREAD_RATIO_MIN: f64 = 0.2;

impl Traction {
    /// Speed of the driven tread per speed of the fixed axle's middle, at this angle of the equivalent single steered
    /// wheel, rad, positive to the left; at least 0.2 for a wheel of the fixed axle. NaN for NaN, except of an axle
    /// that is driven as a whole, whose ratio is 1.
    #[must_use]
    pub fn tread_ratio(self, steering_rad: f64) -> f64 {
        match self {
            Self::Fixed { left: 0.0 } => 1.0,
            Self::Fixed { left } => {
                let ratio = 1.0 - libm::tan(steering_rad) * left;
                // Not `max`, which would make a number of NaN.
                if ratio < TREAD_RATIO_MIN { TREAD_RATIO_MIN } else { ratio }
            }
            Self::Steered => 1.0 / libm::cos(steering_rad),
        }
    }

    /// The greatest ratio at angles up to this one either way, rad.
    #[must_use]
    pub fn greatest_ratio(self, steering_rad: f64) -> f64 {
        self.tread_ratio(steering_rad).max(self.tread_ratio(-steering_rad))
    }

    /// True if the speed of the fixed axle's middle is known without the steering's angle.
    #[must_use]
    pub fn is_the_axle(self) -> bool {
        self == Self::Fixed { left: 0.0 }
    }
}

settings! {
    /// `[limits]`: bounds of motion. A command beyond `speed_mps` or `steering_rad` is refused and stops the robot; the
    /// others only slow it down.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Limits {
        /// Speed, either way.
        speed_mps: f64 = required, 0.01..=10.0;
        /// Highest speed under a manual source.
        speed_manual_mps: f64 = required, 0.01..=10.0;
        /// Highest speed under the planner.
        speed_autonomous_mps: f64 = required, 0.01..=10.0;
        /// Angle of the equivalent single front wheel, either way.
        steering_rad: f64 = required, 0.01..=1.5;
        /// Acceleration.
        acceleration_mps2: f64 = required, 0.01..=20.0;
        /// Deceleration of a stop that is commanded.
        deceleration_mps2: f64 = required, 0.01..=20.0;
        /// Deceleration of a stop after a fault.
        quick_stop_mps2: f64 = required, 0.01..=20.0;
        /// Lateral acceleration at the rear axle; caps the speed in curves.
        lateral_acceleration_mps2: f64 = required, 0.01..=20.0;
        /// Rate of the steering angle.
        steering_rate_radps: f64 = required, 0.01..=20.0;
        /// Rotation of a base without steering, either way; a command beyond it is refused and stops the robot. That of
        /// a steered base follows from speed and steering angle.
        rotation_radps: f64 = 1.0, 0.01..=20.0;
        /// Validity of a motion command.
        command_ttl_s as command_ttl: Duration = 0.25, 0.05..=1.0;
    }
}

settings! {
    /// `[base]`: kind of the base, and the places of its wheels. The robot's frame has its origin in the middle of the
    /// wheels; of a base that steers in the middle of its fixed axle. Absent: a driven rear axle and steered front
    /// wheels, by `[geometry]`.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct BaseKeys {
        kind: BaseKind = flat;
        /// Part of the rated torque of its motor by which a wheel may work against the others, of a base with more
        /// wheels than motions (mecanum, skid-steer, four or more omni wheels) whose drives report their torque (0x6077
        /// in a TPDO); more than that for 0.15 s stops the robot.
        strain: f64 = 0.3, 0.05..=10.0;
    }
}

settings! {
    /// Wheels of a base.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum BaseKind by kind {
        /// Two wheels on one axle, or two rows of wheels or tracks with one drive each. Axes `left`, `right`.
        Differential(Differential) = "differential",
        /// Two axles of two wheels that are dragged sideways in turns. Axes `front_left`, `front_right`, `rear_left`,
        /// `rear_right`.
        SkidSteer(Rectangle) = "skid-steer",
        /// The same as `"skid-steer"`.
        Skid(Rectangle) = "skid",
        /// Four mecanum wheels, whose rollers seen from above form an X. Axes as of `"skid-steer"`.
        Mecanum(Rectangle) = "mecanum",
        /// Omni wheels evenly on a circle, each rolling along it counter-clockwise. Axes `wheel_1` and so on.
        Omni(Circle) = "omni",
        /// A single steered wheel and a fixed axle, `geometry.wheelbase_m` apart. Axes `propulsion`, `steering`.
        Tricycle(Tricycle) = "tricycle",
        /// Two steered wheels with one linkage and a driven fixed axle. Axes as of `"tricycle"`.
        Ackermann(Ackermann) = "ackermann",
        /// A single wheel on the fixed axle and a single steered one. Axes as of `"tricycle"`.
        Bicycle(Bicycle) = "bicycle",
    }
}

settings! {
    /// Where the steered wheels are.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum End {
        /// In front of the fixed axle.
        #[default]
        Front = "front",
        /// Behind it, as of a fork-lift truck.
        Rear = "rear",
    }
}

settings! {
    /// What the propulsion drives.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Driven {
        /// The axle that does not steer, or one wheel of it.
        #[default]
        Fixed = "fixed",
        /// The steered wheel.
        Steered = "steered",
    }
}

settings! {
    /// Wheels of a tricycle.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Tricycle {
        /// End of the base at which the steered wheel is.
        steered: End = End::Front;
        /// What the propulsion drives. Of the steered wheel the drive measures the speed of its tread, which
        /// `limits.speed_mps` bounds as well.
        driven: Driven = Driven::Fixed;
        /// Place of the driven wheel to the left of the middle of the fixed axle; 0: both wheels are driven through a
        /// differential gear.
        driven_left_m: f64 = 0.0, -5.0..=5.0;
    }
}

settings! {
    /// Wheels of a base with two steered ones.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Ackermann {
        /// End of the base at which the steered wheels are.
        steered: End = End::Front;
        /// Place of the driven wheel to the left of the middle of the fixed axle; 0: both wheels are driven through a
        /// differential gear.
        driven_left_m: f64 = 0.0, -5.0..=5.0;
    }
}

settings! {
    /// Wheels of a bicycle.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Bicycle {
        /// End of the base at which the steered wheel is.
        steered: End = End::Front;
        /// What the propulsion drives. Of the steered wheel the drive measures the speed of its tread, which
        /// `limits.speed_mps` bounds as well.
        driven: Driven = Driven::Fixed;
    }
}

/// A base that does not steer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// Its wheels, each with a drive of its own.
    pub layout: Layout,
    /// Part of a motor's rated torque by which a wheel may work against the others.
    pub strain: f64,
}

/// Wheels of a base that does not steer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layout {
    /// Two wheels or rows of wheels.
    Differential(Differential),
    /// Two axles of two wheels that are dragged sideways in turns.
    SkidSteer(Rectangle),
    /// Four mecanum wheels.
    Mecanum(Rectangle),
    /// Omni wheels on a circle.
    Omni(Circle),
}

impl BaseKeys {
    /// The base; absent if it steers.
    #[must_use]
    pub fn base(&self) -> Option<Base> {
        let layout = match self.kind {
            BaseKind::Differential(places) => Layout::Differential(places),
            BaseKind::SkidSteer(places) | BaseKind::Skid(places) => Layout::SkidSteer(places),
            BaseKind::Mecanum(places) => Layout::Mecanum(places),
            BaseKind::Omni(places) => Layout::Omni(places),
            BaseKind::Tricycle(_) | BaseKind::Ackermann(_) | BaseKind::Bicycle(_) => return None,
        };
        Some(Base { layout, strain: self.strain })
    }

    /// The measures of the robot with the wheels of a base that steers; those of any other base are unchanged.
    #[must_use]
    pub fn measures(&self, geometry: Geometry) -> Geometry {
        let (one_steered, one_fixed, end, driven, driven_left_m) = match self.kind {
            BaseKind::Tricycle(Tricycle { steered, driven, driven_left_m }) => {
                (true, false, steered, driven, driven_left_m)
            }
            BaseKind::Ackermann(Ackermann { steered, driven_left_m }) => {
                (false, false, steered, Driven::Fixed, driven_left_m)
            }
            BaseKind::Bicycle(Bicycle { steered, driven }) => (true, true, steered, driven, 0.0),
            _ => return geometry,
        };
        let driven = match driven {
            Driven::Fixed => DrivenAxle::Fixed,
            Driven::Steered => DrivenAxle::Steered,
        };
        Geometry { driven, steered: Steered { one_steered, one_fixed, end, driven_left_m }, ..geometry }
    }
}

settings! {
    /// Place of the wheels of a differential base.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Differential {
        /// Distance of the left and the right wheels. Of rows of wheels: the effective one, by which the difference of
        /// both sides' ways has to be divided to get the angle that the robot has turned by.
        track_m: f64 = required, 0.05..=5.0;
    }
}

settings! {
    /// Places of four wheels.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Rectangle {
        /// Rear wheels to front wheels.
        wheelbase_m: f64 = required, 0.05..=5.0;
        /// Distance of the left and the right wheels; of a skid-steer base the effective one.
        track_m: f64 = required, 0.05..=5.0;
    }
}

settings! {
    /// Places of wheels on a circle.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Circle {
        /// Radius of the circle.
        radius_m: f64 = required, 0.05..=5.0;
        /// Number of wheels.
        wheels: u8 = 3, 3..=6;
        /// Direction from the origin to the first wheel.
        first_rad: f64 = 0.0, -6.3..=6.3;
    }
}

settings! {
    /// An item of `beacons`: an infrared beacon in the frame of the map.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Beacon {
        /// Transmitted number.
        id: u8 = required, 0..=255;
        /// Position.
        x: f64 = required, -1e4..=1e4;
        /// Position.
        y: f64 = required, -1e4..=1e4;
    }
}

/// Distance by which a wheel's contact point may be outside of the outline, m: rounding.
const ROUNDING_M: f64 = 1e-6;

impl Geometry {
    fn check(&self, table: &Table<'_>) {
        let sides = [("length_m", self.length_m, SIDE), ("width_m", self.width_m, SIDE)];
        let all = sides.into_iter().chain([("rear_overhang_m", self.rear_overhang_m, OVERHANG)]);
        for (key, value, range) in all {
            match (&self.footprint_m, value) {
                (Some(_), Some(_)) => table.refuse(key, "nothing beside footprint_m, from which it follows"),
                (None, None) => table.refuse_missing(key, Rule::<f64>::expected(&range)),
                _ => {}
            }
        }
        if let Some(footprint) = &self.footprint_m
            && table.is_good("footprint_m")
            && footprint.shape.outside(Point::default()) > 0.0
        {
            table.refuse("footprint_m", "an outline with the reference point [0, 0] in it");
        }
        if let (Some(length), Some(rear)) = (self.length_m, self.rear_overhang_m)
            && table.is_good("length_m")
            && table.is_good("rear_overhang_m")
            && rear > length
        {
            let expected = format_args!("at most length_m, {length}, so that the reference point is in the outline");
            table.refuse("rear_overhang_m", expected);
        }
    }

    /// Refuses an outline without the wheels' contact points in it, and a track wider than the robot. `base`: the base
    /// of a robot that does not steer; `table`: this table once more.
    pub fn check_wheels(&self, base: Option<(&Base, &Limits)>, table: &Table<'_>) {
        let outline = ["footprint_m", "length_m", "width_m", "rear_overhang_m"];
        let is_good = |key: &&str| !table.has(key) || table.is_good(key);
        let (whole, complete) = (outline.iter().all(is_good), self.shape().is_some());
        if !whole || !complete || !table.is_good("track_m") || !table.is_good("wheelbase_m") {
            return;
        }
        let width = 2.0 * self.half_width_m();
        if self.track_m > width + ROUNDING_M {
            table.refuse("track_m", format_args!("at most the width of the outline, {width}"));
            return;
        }
        let contacts = match base {
            Some((base, limits)) => base.contacts(limits, width),
            None => self.contacts(),
        };
        let Some(outside) = contacts.into_iter().find(|contact| self.outside(*contact) > ROUNDING_M) else { return };
        let at = format!("[{:.3}, {:.3}]", outside.x, outside.y);
        if self.footprint_m.is_some() {
            table.refuse("footprint_m", format_args!("an outline with the wheel at {at} in it"));
            return;
        }
        let ahead = outside.x > 0.0 && outside.x > self.front_m();
        let behind = outside.x < 0.0 && outside.x < -self.rear_m();
        match (ahead, behind) {
            (false, false) => {
                table.refuse("width_m", format_args!("at least {:.3}: a wheel is at {at}", 2.0 * outside.y.abs()));
            }
            (true, _) => {
                let least = outside.x + self.rear_m();
                table.refuse("length_m", format_args!("at least {least:.3} by rear_overhang_m: a wheel is at {at}"));
            }
            (_, true) => {
                table.refuse("rear_overhang_m", format_args!("at least {:.3}: a wheel is at {at}", -outside.x));
            }
        }
    }

    /// Contact points of the wheels of a base that steers, m. Of one without `[base]` the steered wheels may be as far
    /// behind the axle as `wheelbase_m` is ahead of it.
    fn contacts(&self) -> Vec<Point> {
        let Steered { one_steered, one_fixed, end, driven_left_m } = self.steered;
        let half = self.track_m / 2.0;
        let axle = |one: bool, x: f64| {
            let places: &[f64] = if one { &[0.0] } else { &[half, -half] };
            places.iter().map(|&y| Point { x, y }).collect::<Vec<_>>()
        };
        let one = one_steered || self.driven == DrivenAxle::Steered;
        let (ahead, behind) = (axle(one, self.wheelbase_m), axle(one, -self.wheelbase_m));
        let within = |contact: &Point| self.outside(*contact) <= ROUNDING_M;
        let steered = if end == End::Rear || behind.iter().all(within) { behind } else { ahead };
        let driven = Point { x: 0.0, y: driven_left_m };
        axle(one_fixed, 0.0).into_iter().chain([driven]).chain(steered).collect()
    }

    /// Distance of a point from the outline's edges, m: at most its distance; negative within.
    fn outside(&self, point: Point) -> f64 {
        self.shape().map_or(f64::NEG_INFINITY, |shape| shape.outside(point))
    }

    /// Its outline if that is a polygon; `None`: it is a rectangle.
    #[must_use]
    pub fn footprint(&self) -> Option<&Shape> {
        self.footprint_m.as_ref().map(|footprint| &footprint.shape)
    }

    /// Corners of the outline, m, counter-clockwise; of a rectangle from the one at the rear right on.
    #[must_use]
    pub fn corners(&self) -> Vec<Point> {
        let (front, rear, half) = (self.front_m(), -self.rear_m(), self.half_width_m());
        let rectangle = || [(rear, -half), (front, -half), (front, half), (rear, half)].map(|(x, y)| Point { x, y });
        self.footprint().map_or_else(|| rectangle().into(), |shape| shape.corners().into())
    }

    /// The outline; `None` without an area.
    #[must_use]
    pub fn shape(&self) -> Option<Shape> {
        self.footprint().copied().or_else(|| Shape::hull(&self.corners()))
    }

    /// Bumper to bumper, m: from the rearmost to the foremost point of the outline.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        let of = |shape: &Shape| shape.front() - shape.rear();
        self.footprint().map_or(self.length_m.unwrap_or_default(), of)
    }

    /// Width, m: twice the distance of the farthest corner of the outline from the x axis.
    #[must_use]
    pub fn width_m(&self) -> f64 {
        self.footprint().map_or(self.width_m.unwrap_or_default(), |shape| 2.0 * shape.half_width())
    }

    /// Half of the width, m.
    #[must_use]
    pub fn half_width_m(&self) -> f64 {
        self.width_m() / 2.0
    }

    /// Origin to the rearmost point of the outline, m.
    #[must_use]
    pub fn rear_m(&self) -> f64 {
        self.footprint().map_or(self.rear_overhang_m.unwrap_or_default(), |shape| -shape.rear())
    }

    /// Origin to the foremost point of the outline, m.
    #[must_use]
    pub fn front_m(&self) -> f64 {
        self.footprint().map_or_else(|| self.length_m() - self.rear_m(), Shape::front)
    }

    /// Distance of the farthest corner of the outline from the origin, m.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        let rectangle = || self.front_m().max(self.rear_m()).hypot(self.width_m() / 2.0);
        self.footprint().map_or_else(rectangle, Shape::radius)
    }

    /// What the propulsion of a base that steers turns.
    #[must_use]
    pub fn traction(&self) -> Traction {
        match self.driven {
            DrivenAxle::Fixed => Traction::Fixed { left: self.steered.driven_left_m / self.wheelbase_m },
            DrivenAxle::Steered => Traction::Steered,
        }
    }

    /// Greatest distance of a driven wheel from the middle of the fixed axle, m, at which it turns in the narrowest
    /// curve at a fifth of the robot's speed or more.
    #[must_use]
    pub fn driven_left_max_m(&self, limits: &Limits) -> f64 {
        (1.0 - TREAD_RATIO_MIN) * self.wheelbase_m / libm::tan(limits.steering_rad)
    }

    /// Distance driven in one turn of a wheel, m.
    #[must_use]
    pub fn wheel_circumference_m(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.wheel_radius_m
    }
}

/// Axes of four wheels.
const FOUR: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];
/// Axes of wheels on a circle.
const CIRCLE: [&str; 6] = ["wheel_1", "wheel_2", "wheel_3", "wheel_4", "wheel_5", "wheel_6"];

impl Base {
    /// Names of the axes, one for each wheel, in the order of the wheels of [`Base::chassis`].
    #[must_use]
    pub fn axes(&self) -> &'static [&'static str] {
        match &self.layout {
            Layout::Differential(_) => &["left", "right"],
            Layout::SkidSteer(_) | Layout::Mecanum(_) => &FOUR,
            Layout::Omni(circle) => CIRCLE.get(..usize::from(circle.wheels)).unwrap_or(&CIRCLE),
        }
    }

    /// True for a base that goes sideways.
    #[must_use]
    pub fn goes_sideways(&self) -> bool {
        matches!(self.layout, Layout::Mecanum(_) | Layout::Omni(_))
    }

    /// Distance of its wheels' treads from the middle, m: what they roll for each rad of a turn on the spot.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        match self.layout {
            Layout::Differential(Differential { track_m }) | Layout::SkidSteer(Rectangle { track_m, .. }) => {
                track_m / 2.0
            }
            Layout::Mecanum(Rectangle { wheelbase_m, track_m }) => (wheelbase_m + track_m) / 2.0,
            Layout::Omni(Circle { radius_m, .. }) => radius_m,
        }
    }

    /// Contact points of the wheels of a robot of this width, m. The track of two rows of wheels or tracks is the
    /// effective one, which is up to twice the real one: beyond the width, half of it counts.
    fn contacts(&self, limits: &Limits, width: f64) -> Vec<Point> {
        // What is no base is refused by its driver.
        let Ok(chassis) = self.chassis(limits) else { return Vec::new() };
        let effective = matches!(self.layout, Layout::Differential(_) | Layout::SkidSteer(_));
        let wheels = chassis.wheels().iter();
        wheels
            .map(|wheel| {
                let part = if effective && 2.0 * wheel.y_m.abs() > width { 0.5 } else { 1.0 };
                Point { x: wheel.x_m, y: part * wheel.y_m }
            })
            .collect()
    }

    /// Kinematics of the base.
    ///
    /// # Errors
    /// The first quantity that no base has.
    pub fn chassis(&self, limits: &Limits) -> Result<Chassis, kinematics::Error> {
        let wheel = kinematics::Limits {
            speed_mps: limits.speed_mps,
            acceleration_mps2: limits.acceleration_mps2,
            deceleration_mps2: limits.deceleration_mps2,
        };
        match self.layout {
            Layout::Differential(Differential { track_m }) => Chassis::differential(track_m, wheel),
            Layout::SkidSteer(Rectangle { wheelbase_m, track_m }) => {
                Chassis::skid_steer(track_m, &[wheelbase_m / 2.0, -wheelbase_m / 2.0], wheel)
            }
            Layout::Mecanum(Rectangle { wheelbase_m, track_m }) => Chassis::mecanum(wheelbase_m, track_m, wheel),
            Layout::Omni(Circle { radius_m, wheels, first_rad }) => {
                Chassis::omni(radius_m, usize::from(wheels), first_rad, wheel)
            }
        }
    }
}

impl Limits {
    /// Highest speed that a manual source can demand, m/s.
    #[must_use]
    pub fn manual_mps(&self) -> f64 {
        self.speed_manual_mps.min(self.speed_mps)
    }
}
