//! Modules that drive the robot's busses.
