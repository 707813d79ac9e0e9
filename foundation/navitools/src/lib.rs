//! Angles, poses, Ackermann kinematics, odometry: pure maths.
