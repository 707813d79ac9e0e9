//! Virtual time, the robot's body, the world, and every board at bus level.
