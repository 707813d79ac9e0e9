//! The simulated robot: its body, the world around it, and every board at bus level.
//!
//! [`Simulator`] is a module like any other: it sits on the same buses as the drivers and answers them as the boards
//! would. It runs in the live host, in real time, and in the virtual one (`sim`), which shares its source of chance
//! ([`Random`]), its names of faults ([`faults`]) and what they do to a bus ([`disturbance`]). Knows no other module,
//! no file, no socket, no clock.
//!
//! The body by itself, without its boards:
//!
//! ```
//! use base::Instant;
//! use simulator::body::{Demand, Parameters};
//! use simulator::scene::Scene;
//! use simulator::sonar::Sonar;
//! use simulator::world::World;
//!
//! // In the middle of a hall of 20 m by 12 m, looking along x.
//! let mut scene = Scene::new(Instant::ZERO, World::hall(20.0, 12.0), Parameters::default(), Sonar::exact(), 1);
//! let start = scene.body().pose();
//!
//! // Straight ahead at 1 m/s: the wall is 10 m ahead of the rear axle, 9.25 m ahead of the bumper.
//! scene.demand = Demand { steering: Some(0.0), ..Demand::speed(1.0) };
//! while scene.next_step() <= Instant::from_millis(5000) {
//!     scene.step();
//! }
//! let driven = scene.body().pose().x - start.x;
//! assert!(driven > 4.0 && driven < 5.0, "it needs time to accelerate: {driven} m");
//! assert!((scene.body().speed() - 1.0).abs() < 0.01);
//! while scene.next_step() <= Instant::from_millis(15_000) {
//!     scene.step();
//! }
//! assert_eq!((scene.body().speed(), scene.body().collisions()), (0.0, 1));
//! assert!((scene.body().pose().x - start.x - 9.25).abs() < 0.02);
//! ```
#![forbid(unsafe_code)]

mod auxiliary;
pub mod boards;
pub mod body;
pub mod disturbance;
pub mod faults;
mod gamepad;
pub mod imu;
mod io;
pub mod lidar;
pub mod people;
mod random;
pub mod scene;
mod simulator;
pub mod sonar;
pub mod world;

pub use auxiliary::{HostConfig, I2cConfig, W1Config};
pub use boards::drive::{DriveConfig, DriveKind};
pub use boards::drive_line::{DriveLineConfig, MotorConfig};
pub use boards::encoder::Axis;
pub use io::{ComputerConfig, DeviceConfig, ExchangeConfig, LineConfig, ModbusConfig};
pub use random::Random;
pub use simulator::{BoardConfig, BoardKind, CanConfig, Config, SerialConfig, Simulator};
