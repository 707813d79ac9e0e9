//! `LL_CMD_VELOCITY` on the whole robot: it drives the commanded circle, `LL_DATA_VELOCITY` is what the body does, and
//! the guard stops it before a wall.

use super::guard::{Guarded, guarded};
use super::*;
use messages::simulation::DataTruth;
use std::f64::consts::TAU;

fn velocity(vx: f64, omega: f64) -> lowlevel::CmdVelocity {
    let priority = lowlevel::CmdMotion::REMOTE;
    lowlevel::CmdVelocity { timestamp: 0, vx, vy: 0.0, omega, priority, source: "test".into(), session: 1 }
}

/// Commands at 20 Hz from now on, for a while; queued in the machine.
fn drive(robot: &mut Robot, vx: f64, omega: f64, seconds: f64) {
    let begin = robot.machine.now();
    for n in 0..(seconds * 20.0) as u32 {
        robot.machine.inject(begin + n * Duration::from_millis(50), velocity(vx, omega));
    }
}

/// What the body did, and what was measured of it.
#[derive(Default)]
struct Way {
    truths: Vec<DataTruth>,
    measured: Vec<lowlevel::DataVelocity>,
}

impl Way {
    fn of(robot: &mut Robot) -> Rc<RefCell<Self>> {
        let way = Rc::new(RefCell::new(Self::default()));
        let keep = way.clone();
        robot.machine.observe(move |_, news| match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => keep.borrow_mut().truths.push(truth.clone()),
            News::Message { message: Message::LlDataVelocity(velocity), .. } => {
                keep.borrow_mut().measured.push(velocity.clone());
            }
            _ => {}
        });
        way
    }

    /// Angle that the body has turned by, rad.
    fn turned(&self) -> f64 {
        let steps = self.truths.windows(2).map(|pair| pair[1].theta - pair[0].theta);
        steps.map(|step| step - TAU * (step / TAU).round()).sum()
    }

    /// Extent along an axis, m.
    fn extent(&self, along: impl Fn(&DataTruth) -> f64) -> f64 {
        let all = || self.truths.iter().map(&along);
        all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
    }
}

#[test]
fn it_drives_the_commanded_circle_and_measures_what_the_body_does() {
    let world = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml");
    let place = RobotLocation { world: Some(world), ..place() };
    let mut robot = Robot::at(&place, Config { seed: 1, ..Config::default() });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    let (speed, radius) = (0.4, 1.5);
    let turn = TAU * radius / speed;
    drive(&mut robot, speed, speed / radius, turn + 4.0);
    // The steering and the speed reach their set-points.
    robot.pass(3.0);
    let way = Way::of(&mut robot);
    robot.pass(turn);
    {
        let way = way.borrow();
        for extent in [way.extent(|truth| truth.x), way.extent(|truth| truth.y)] {
            assert!((extent - 2.0 * radius).abs() < 0.1, "{extent} m");
        }
        let turned = way.turned();
        assert!((turned - TAU).abs() < 0.2, "{turned} rad");
        let mean = |component: fn(&lowlevel::DataVelocity) -> f64| {
            way.measured.iter().map(component).sum::<f64>() / way.measured.len() as f64
        };
        assert!(way.measured.len() as f64 > 19.0 * turn, "20 Hz");
        let (vx, omega) = (mean(|measured| measured.vx), mean(|measured| measured.omega));
        let true_speed = way.truths.iter().map(|truth| truth.speed).sum::<f64>() / way.truths.len() as f64;
        assert!((vx - true_speed).abs() < 0.01, "{vx} m/s, truly {true_speed}");
        assert!((omega - turned / turn).abs() < 0.01, "{omega} rad/s, truly {}", turned / turn);
        for measured in &way.measured {
            assert!(measured.vy.abs() < 1e-9 && measured.residual < 1e-9 && measured.ready, "{measured:?}");
            assert!((measured.vx_target - speed).abs() < 1e-3 && (measured.omega_target - speed / radius).abs() < 1e-3);
        }
    }
    // It cannot turn on the spot: it brakes, stands, and says why.
    drive(&mut robot, 0.0, 0.5, 3.0);
    robot.pass(2.5);
    assert!(robot.speed().abs() < 0.001 && !robot.motion().quick_stop, "{}", robot.speed());
    assert!(robot.seen.borrow().holds.has(Hold::NoTurnOnSpot), "{:?}", robot.seen.borrow().holds);
}

#[test]
fn commanded_by_velocity_towards_a_wall_it_comes_to_stand_before_it() {
    let Guarded { mut robot, truth } = guarded(1);
    let start = truth.borrow().x;
    // A steering angle of -0.02 rad at the wheelbase of 0.6 m.
    drive(&mut robot, 0.6, -0.02, 60.0);
    robot.pass(59.0);
    let truth = truth.borrow().clone();
    assert!(truth.collisions == 0 && truth.x > start + 3.0, "{truth:?}");
    assert!(truth.speed.abs() < 0.05 && truth.clearance > 0.0, "{truth:?}");
    assert!(robot.seen.borrow().holds.is_free(), "a bound is no refusal: {:?}", robot.seen.borrow().holds);
}

#[test]
fn silence_begins_a_quick_stop_and_no_motion_resumes_by_the_other_message() {
    let mut robot = Robot::ready(1);
    let begin = robot.machine.now();
    drive(&mut robot, 0.4, 0.1, 2.0);
    robot.pass(4.0);
    let last = begin + Duration::from_millis(1950);
    let took = robot.quick_stop_after(begin + Duration::from_millis(500)).since(last);
    assert!((250_000..251_000).contains(&took.as_micros()), "{took:?}");
    robot.drive(0.4, 0.0, 2.0);
    robot.pass(1.5);
    assert!(robot.speed().abs() < 0.001 && robot.hold() == Some(Hold::NotReleased), "{:?}", robot.hold());
    robot.pass(1.0);
    robot.machine.inject(robot.machine.now(), velocity(0.0, 0.0));
    robot.drive(0.4, 0.0, 2.0);
    robot.pass(1.5);
    assert!(robot.speed() > 0.3, "{} m/s, {:?}", robot.speed(), robot.hold());
}
