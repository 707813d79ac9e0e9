//! The live host, the topology of the robot, and the tools of the command line.
