//! Wheels of a base that does not steer, each with a motor of its own.
//!
//! The base is a rigid body on wheels that do not leave the floor: a motor moves all of it, and a wheel whose motor
//! does not hold it is dragged along. Within a step the forces of all motors and losses act at once: each is what
//! brings its wheel to the demanded speed, within the motor's force, found by sequential impulses (Catto, *Iterative
//! Dynamics with Temporal Coherence*, 2005).
//!
//! Of a base with more wheels than motions the demands may contradict each other, by the resolution of a velocity
//! object alone. A wheel that transmits a force rolls more than the floor passes under it, in proportion to both
//! ([`Errors::slip`](super::Errors)): by that the contradiction becomes a force that the motors have against each
//! other, and without slip it is all that they can. The force that moves the base is not changed by it.

use super::{DT, Demand, GRAVITY, Parameters};
use crate::random::Random;
use kinematics::{Chassis, PerWheel, Twist};

/// Rounds of impulses, and the correction of all wheels below which they end early, m/s.
const ROUNDS: usize = 40;
const SETTLED: f64 = 1e-13;
/// Speed of a wheel below which it stands if no motor turns it, m/s.
const STANDS: f64 = 1e-9;

/// State.
#[derive(Clone, Debug)]
pub(super) struct Wheels {
    motions: PerWheel<Twist>,
    wheels: PerWheel<Wheel>,
    /// Inverse of the mass in the independent motions, kg or kg m².
    inverse_mass: [f64; 3],
    /// Of each independent motion.
    amounts: [f64; 3],
    /// For each wheel: what of the forces of all of them it has against the others. Empty if they cannot have any.
    against_others: PerWheel<PerWheel<f64>>,
}

/// A wheel and its motor.
#[derive(Clone, Copy, Debug)]
struct Wheel {
    /// Speed of the tread per amount of each motion.
    row: [f64; 3],
    /// How much more than the truth it counts.
    scale: f64,
    /// Force of the motor in the last step, N.
    force: f64,
    /// Way by its own encoder, m.
    way: f64,
}

impl Wheel {
    fn speed(&self, amounts: &[f64; 3]) -> f64 {
        self.row.iter().zip(amounts).map(|(part, amount)| part * amount).sum()
    }
}

/// What moves a wheel in a step: the speed that its motor demands, or 0, and the forces that there are for it, N.
#[derive(Clone, Copy)]
struct Effort {
    speed: f64,
    least: f64,
    greatest: f64,
    /// Losses, against the motion; not the motor's.
    against: f64,
}

impl Wheels {
    /// Those of a standing base. Its independent motions must not share inertia: its middle is on the axle.
    pub fn new(chassis: &Chassis, parameters: &Parameters, mut scale: impl FnMut() -> f64) -> Self {
        let motions: PerWheel<Twist> = chassis.motions().iter().copied().collect();
        let states: PerWheel<_> = motions.iter().map(|motion| chassis.wheel_states(*motion, &[])).collect();
        let row = |wheel: usize| core::array::from_fn(|n| states.get(n).map_or(0.0, |states| states[wheel].speed_mps));
        let wheel = |number| Wheel { row: row(number), scale: scale(), force: 0.0, way: 0.0 };
        let wheels = (0..chassis.wheels().len()).map(wheel).collect();
        let (length, width) =
            (parameters.wheelbase + parameters.overhang_front + parameters.overhang_rear, parameters.width);
        let inertia = parameters.mass * (length * length + width * width) / 12.0;
        let mass = |motion: &Twist| {
            parameters.mass * (motion.vx * motion.vx + motion.vy * motion.vy) + inertia * motion.omega * motion.omega
        };
        let inverse_mass = core::array::from_fn(|n| motions.get(n).map_or(0.0, |motion| 1.0 / mass(motion)));
        let one = |wheel: usize| -> PerWheel<f64> {
            (0..chassis.wheels().len()).map(|other| if other == wheel { 1.0 } else { 0.0 }).collect()
        };
        // The projection is symmetric.
        let against_others = (0..chassis.wheels().len()).map_while(|wheel| chassis.strain(&one(wheel))).collect();
        Self { motions, wheels, inverse_mass, amounts: [0.0; 3], against_others }
    }

    /// Velocity of the base.
    pub fn twist(&self) -> Twist {
        self.combined(&self.amounts)
    }

    fn combined(&self, amounts: &[f64; 3]) -> Twist {
        self.motions.iter().zip(amounts).fold(Twist::ZERO, |sum, (motion, amount)| sum + *motion * *amount)
    }

    /// Speed of a wheel's tread, m/s; 0 of one that there is not, here and below.
    pub fn speed(&self, wheel: usize) -> f64 {
        self.wheels.get(wheel).map_or(0.0, |wheel| wheel.speed(&self.amounts))
    }

    /// Way of a wheel by its own encoder, m.
    pub fn way(&self, wheel: usize) -> f64 {
        self.wheels.get(wheel).map_or(0.0, |wheel| wheel.way)
    }

    /// Force of a wheel's motor in the last step, N.
    pub fn force(&self, wheel: usize) -> f64 {
        self.wheels.get(wheel).map_or(0.0, |wheel| wheel.force)
    }

    /// Power of all motors, W.
    pub fn power(&self) -> f64 {
        self.wheels.iter().map(|wheel| wheel.force * wheel.speed(&self.amounts)).sum()
    }

    pub fn stop(&mut self) {
        self.amounts = [0.0; 3];
        self.wheels.iter_mut().for_each(|wheel| wheel.force = 0.0);
    }

    pub fn rests(&self, demand: &Demand) -> bool {
        self.amounts == [0.0; 3]
            && demand.wheels.iter().take(self.wheels.len()).all(|speed| speed.is_none_or(|speed| speed == 0.0))
    }

    /// The velocities after a step; answers the displacement in it.
    pub fn accelerate(&mut self, parameters: &Parameters, demand: &Demand) -> Twist {
        let old = self.amounts;
        let efforts: PerWheel<Effort> =
            (0..self.wheels.len()).map(|number| self.effort(number, parameters, demand)).collect();
        let mut impulses: PerWheel<f64> = efforts.iter().map(|_| 0.0).collect();
        let creep = self.creep(parameters);
        for _ in 0..ROUNDS {
            let mut correction = 0.0f64;
            for (number, (wheel, effort)) in self.wheels.iter().zip(&efforts).enumerate() {
                let gain: f64 = wheel.row.iter().zip(&self.inverse_mass).map(|(part, mass)| part * part * mass).sum();
                let (mut missing, mut yielding) = (effort.speed - wheel.speed(&self.amounts), gain);
                if let Some(shares) = self.against_others.get(number) {
                    missing -=
                        creep * shares.iter().zip(&impulses).map(|(share, impulse)| share * impulse).sum::<f64>();
                    yielding += creep * shares[number];
                }
                let impulse = &mut impulses[number];
                let wanted = *impulse + missing / yielding;
                let allowed = wanted.clamp(effort.least * DT, effort.greatest * DT);
                let change = allowed - core::mem::replace(impulse, allowed);
                for ((amount, part), mass) in self.amounts.iter_mut().zip(&wheel.row).zip(&self.inverse_mass) {
                    *amount += part * mass * change;
                }
                correction = correction.max(libm::fabs(change * gain));
            }
            if correction < SETTLED {
                break;
            }
        }
        let is_still =
            |(wheel, effort): (&Wheel, &Effort)| effort.speed == 0.0 && libm::fabs(wheel.speed(&self.amounts)) < STANDS;
        if self.wheels.iter().zip(&efforts).all(is_still) {
            self.amounts = [0.0; 3];
        }
        for (number, (wheel, impulse)) in self.wheels.iter_mut().zip(impulses).enumerate() {
            wheel.force = demand.wheels[number].map_or(0.0, |_| impulse / DT + efforts[number].against);
        }
        let mean = core::array::from_fn(|n| (old[n] + self.amounts[n]) / 2.0 * DT);
        self.combined(&mean)
    }

    /// How much faster than the floor a wheel rolls per impulse of a step against the others, (m/s)/(N s): the slip of
    /// a wheel whose force is the weight on it, at the mean speed of the wheels.
    fn creep(&self, parameters: &Parameters) -> f64 {
        let count = self.wheels.len() as f64;
        let mean = self.wheels.iter().map(|wheel| libm::fabs(wheel.speed(&self.amounts))).sum::<f64>() / count;
        let weight = parameters.mass * GRAVITY / count;
        parameters.errors.slip * mean / weight / DT
    }

    fn effort(&self, number: usize, parameters: &Parameters, demand: &Demand) -> Effort {
        let share = 1.0 / self.wheels.len() as f64;
        let losses = share * parameters.mass * parameters.coasting();
        let Some(wanted) = demand.wheels[number] else {
            let losses = losses + if demand.unfed { share * parameters.mass * parameters.brake } else { 0.0 };
            return Effort { speed: 0.0, least: -losses, greatest: losses, against: 0.0 };
        };
        let speed = wanted.clamp(-parameters.speed_max, parameters.speed_max);
        // Losses help to brake and hinder to gain speed, whichever way it rolls.
        let old = self.speed(number);
        let towards = if old == 0.0 { speed } else { old };
        let against = if towards == 0.0 { 0.0 } else { libm::copysign(losses, towards) };
        let force = share * parameters.force_max;
        Effort { speed, least: -force - against, greatest: force - against, against }
    }

    /// The encoders count a displacement of the base.
    pub fn roll(&mut self, parameters: &Parameters, displacement: Twist, random: &mut Random) {
        let super::Errors { along, turn, slip, .. } = parameters.errors;
        let rolled = |amounts: &[f64; 3]| self.wheels.iter().map(|wheel| libm::fabs(wheel.speed(amounts))).sum::<f64>();
        let way = rolled(&self.amounts_of(displacement)) / self.wheels.len() as f64;
        let mut counted = displacement;
        if way > 0.0 && (along > 0.0 || turn > 0.0) {
            let root = libm::sqrt(way);
            counted = counted * (1.0 + along * root * random.normal() / way);
            counted.omega += turn * root * random.normal();
        }
        let weight = parameters.mass * GRAVITY / self.wheels.len() as f64;
        let amounts = self.amounts_of(counted);
        for wheel in &mut self.wheels {
            let way = wheel.speed(&amounts);
            wheel.way += way * wheel.scale + libm::fabs(way) * slip * wheel.force / weight;
        }
    }

    /// Amounts of the motions that make up a displacement which the base can do.
    fn amounts_of(&self, displacement: Twist) -> [f64; 3] {
        // Motions are orthogonal: along the axle's normal and about it, or the axes of the frame.
        let dot = |a: Twist, b: Twist| a.vx * b.vx + a.vy * b.vy + a.omega * b.omega;
        let part = |motion: &Twist| dot(*motion, displacement) / dot(*motion, *motion);
        core::array::from_fn(|n| self.motions.get(n).map_or(0.0, part))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Body, Errors};
    use super::*;
    use crate::world::World;
    use core::f64::consts::FRAC_PI_2;
    use kinematics::{Limits, WHEELS_MAX, WheelState, integrate};
    use navitools::Pose;

    const LIMITS: Limits = Limits { speed_mps: 2.0, acceleration_mps2: 1.0, deceleration_mps2: 1.0 };
    const HALF_TRACK: f64 = 0.21;

    fn differential() -> Chassis {
        Chassis::differential(2.0 * HALF_TRACK, LIMITS).unwrap()
    }

    fn all() -> [Chassis; 4] {
        [
            differential(),
            Chassis::skid_steer(0.5, &[0.2, -0.2], LIMITS).unwrap(),
            Chassis::mecanum(0.4, 0.5, LIMITS).unwrap(),
            Chassis::omni(0.25, 3, 0.5, LIMITS).unwrap(),
        ]
    }

    fn parameters() -> Parameters {
        Parameters { wheelbase: 0.4, overhang_front: 0.05, overhang_rear: 0.45, ..Parameters::default() }
    }

    fn body(chassis: &Chassis) -> Body {
        Body::new(parameters(), Pose::default()).on_wheels(chassis)
    }

    fn run(body: &mut Body, seconds: f64, demand: Demand) {
        for _ in 0..libm::round(seconds / DT) as u32 {
            body.step(&World::default(), &demand);
        }
    }

    /// What the motors demand for a velocity.
    fn demand(chassis: &Chassis, twist: Twist) -> Demand {
        let mut demand = Demand::default();
        let states = chassis.wheel_states(twist, &[]);
        demand.wheels.iter_mut().zip(states).for_each(|(wheel, state)| *wheel = Some(state.speed_mps));
        demand
    }

    fn assert_near(found: Twist, expected: Twist, tolerance: f64) {
        let gap = found - expected;
        assert!([gap.vx, gap.vy, gap.omega].iter().all(|gap| gap.abs() < tolerance), "{found:?}, not {expected:?}");
    }

    #[test]
    fn each_base_gets_the_velocity_that_its_motors_demand_and_goes_there() {
        for chassis in all() {
            let sideways = if chassis.motions().len() == 3 { 0.3 } else { 0.0 };
            for twist in [Twist::new(0.4, 0.0, 0.5), Twist::new(0.0, 0.0, -0.8), Twist::new(-0.2, sideways, 0.3)] {
                let mut body = body(&chassis);
                let demand = demand(&chassis, twist);
                run(&mut body, 2.0, demand);
                assert_near(body.twist(), twist, 1e-9);
                let from = body.pose();
                run(&mut body, 3.0, demand);
                let expected = integrate(from, twist, 3.0);
                let gap = libm::hypot(body.pose().x - expected.x, body.pose().y - expected.y);
                assert!(gap < 1e-9 && (body.pose().theta - expected.theta).radians().abs() < 1e-9, "{gap}");
                run(&mut body, 2.0, self::demand(&chassis, Twist::ZERO));
                assert!(body.twist() == Twist::ZERO && body.rests(&Demand::default()));
            }
        }
    }

    #[test]
    fn the_motors_together_have_the_force_of_the_drawing() {
        for chassis in all().into_iter().take(3) {
            let mut body = body(&chassis);
            run(&mut body, 0.5, demand(&chassis, Twist::new(2.0, 0.0, 0.0)));
            // (208 N - 14 N - 2.4 N) / 95 kg for half a second.
            let expected = (208.0 / 95.0 - 0.015 * 9.81 - 2.4 / 95.0) * 0.5;
            assert_near(body.twist(), Twist::new(expected, 0.0, 0.0), 1e-9);
            let force: f64 = (0..chassis.wheels().len()).map(|wheel| body.force(wheel)).sum();
            assert!((force - 208.0).abs() < 1e-6 && (body.power() - force * expected).abs() < 1e-6, "{force}");
        }
    }

    #[test]
    fn without_power_it_rolls_out_and_with_a_brake_it_does_not_roll_far() {
        for (unfed, brake) in [(false, 0.0), (true, 1.5)] {
            let chassis = differential();
            let mut body = Body::new(Parameters { brake, ..parameters() }, Pose::default()).on_wheels(&chassis);
            run(&mut body, 2.0, demand(&chassis, Twist::new(0.8, 0.0, 0.0)));
            let start = body.pose().x;
            run(&mut body, 10.0, Demand { unfed, ..Demand::default() });
            let expected = 0.8 * 0.8 / (2.0 * (brake + body.parameters().coasting()));
            assert!((body.pose().x - start - expected).abs() < 1e-3, "{} {expected}", body.pose().x - start);
            assert!(body.rests(&Demand::default()));
        }
    }

    #[test]
    fn a_wheel_that_stands_is_what_a_differential_base_turns_about() {
        let mut body = body(&differential());
        let mut wheels = [None; WHEELS_MAX];
        wheels[..2].copy_from_slice(&[Some(0.0), Some(0.42)]);
        run(&mut body, 2.0, Demand { wheels, ..Demand::default() });
        assert_near(body.twist(), Twist::new(0.21, 0.0, 1.0), 1e-9);
    }

    #[test]
    fn a_wheel_without_power_is_dragged_along_and_hinders() {
        let chassis = Chassis::mecanum(0.4, 0.5, LIMITS).unwrap();
        let mut body = body(&chassis);
        let mut demand = demand(&chassis, Twist::new(0.5, 0.0, 0.0));
        demand.wheels[2] = None;
        run(&mut body, 2.0, demand);
        // Three wheels determine the velocity.
        assert_near(body.twist(), Twist::new(0.5, 0.0, 0.0), 1e-9);
        assert!((body.wheel_speed(2) - 0.5).abs() < 1e-9 && body.force(2) == 0.0 && body.force(0) > 1.0);
    }

    #[test]
    fn motors_that_fight_move_the_base_as_the_stronger_side_wants() {
        let chassis = Chassis::mecanum(0.4, 0.5, LIMITS).unwrap();
        let mut body = body(&chassis);
        let mut demand = demand(&chassis, Twist::new(0.5, 0.0, 0.0));
        demand.wheels[0] = Some(0.0);
        run(&mut body, 3.0, demand);
        let forces: Vec<f64> = (0..4).map(|wheel| body.force(wheel)).collect();
        assert!(forces.iter().all(|force| force.abs() <= 52.0 + 1e-9) && forces[0] < -40.0, "{forces:?}");
        assert!(body.speed() > 0.0 && body.speed() < 0.5, "{:?}", body.twist());
    }

    /// So no measured speed shows it.
    #[test]
    fn three_mecanum_wheels_hold_a_fourth_that_is_to_turn_faster_by_their_force() {
        let (chassis, twist) = (Chassis::mecanum(0.45, 0.42, LIMITS).unwrap(), Twist::new(0.25, 0.0, 0.3));
        for wheel in 0..4 {
            let mut body = body(&chassis);
            let mut demand = demand(&chassis, twist);
            run(&mut body, 2.0, demand);
            assert!((0..4).all(|wheel| body.force(wheel).abs() < 5.0), "{:?}", body.force(0));
            demand.wheels[wheel] = demand.wheels[wheel].map(|speed| speed + 0.5);
            run(&mut body, 3.0, demand);
            assert_near(body.twist(), twist, 1e-6);
            assert!((0..4).all(|wheel| body.force(wheel).abs() > 40.0), "{:?}", body.force(0));
        }
    }

    #[test]
    fn demands_that_contradict_each_other_a_little_are_a_force_by_their_creep_and_move_nothing() {
        let (chassis, twist) = (Chassis::mecanum(0.45, 0.42, LIMITS).unwrap(), Twist::new(0.3, 0.0, 0.0));
        for (slip, off, expected) in [(0.1, 1e-3, 1e-3 / 4.0 * 233.0 / (0.1 * 0.3)), (0.1, 0.5, 30.0), (0.0, 1e-3, 3.0)]
        {
            let errors = Errors { slip, ..Errors::default() };
            let mut body = Body::new(Parameters { errors, ..parameters() }, Pose::default()).on_wheels(&chassis);
            let mut demand = demand(&chassis, twist);
            run(&mut body, 2.0, demand);
            let before: Vec<f64> = (0..4).map(|wheel| body.force(wheel)).collect();
            demand.wheels[1] = demand.wheels[1].map(|speed| speed + off);
            run(&mut body, 1.0, demand);
            assert_near(body.twist(), twist, off.min(0.02));
            // Both front wheels against both rear ones.
            for (wheel, sign) in [1.0, 1.0, -1.0, -1.0].into_iter().enumerate() {
                let force = sign * (body.force(wheel) - before[wheel]);
                let exact = slip > 0.0 && off < 0.1;
                assert!(
                    if exact { (force - expected).abs() < 0.05 } else { force > expected },
                    "{slip} {off}: {force}"
                );
            }
        }
    }

    #[test]
    fn its_encoders_count_what_it_went_and_as_wrongly_as_the_table_says() {
        for (errors, exact) in [(Errors::default(), true), (Errors::usual(), false)] {
            let chassis = differential();
            let random = Random::stream(9, 1);
            let mut body =
                Body::drawn(Parameters { errors, ..parameters() }, Pose::default(), random).on_wheels(&chassis);
            run(&mut body, 4.0, demand(&chassis, Twist::new(0.4, 0.0, 0.3)));
            let ways = [0, 1].map(|wheel| WheelState { speed_mps: body.motor_way(wheel), steering_rad: 0.0 });
            let counted = chassis.estimate(&ways).unwrap().twist;
            let (way, turn) = (body.travelled(), body.pose().theta.radians());
            let (off, skew) = ((counted.vx - way).abs() / way, (counted.omega - turn).abs());
            if exact {
                assert!(off < 1e-9 && skew < 1e-9, "{off} {skew}");
            } else {
                assert!(off > 1e-5 && off < 0.06 && skew > 1e-5 && skew < 0.2, "{off} {skew}");
            }
            let (left, right) = body.ticks();
            assert!(right > left && left > 0);
        }
    }

    #[test]
    fn a_corner_meets_the_wall_when_it_turns_on_the_spot() {
        let world = World::hall(20.0, 12.0);
        let chassis = differential();
        let mut body = Body::new(parameters(), Pose::new(10.0, 0.35, 0.0)).on_wheels(&chassis);
        let turn = demand(&chassis, Twist::new(0.0, 0.0, 0.5));
        for _ in 0..(4.0 / DT) as u32 {
            body.step(&world, &turn);
        }
        assert!(body.collisions() == 1 && body.is_blocked() && body.pose().theta.radians() < FRAC_PI_2);
        assert!(body.clearance(&world) > 0.0 && body.clearance(&world) < 0.006, "{}", body.clearance(&world));
        assert!(body.twist() == Twist::ZERO && body.fastest() == 0.0);
    }
}
