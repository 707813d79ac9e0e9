//! The 9-bit EIA-485 master, its frames, and drivers of the robot's boards.
