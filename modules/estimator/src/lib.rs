//! Where the robot is: an EKF over odometry and beacon bearings.
#![forbid(unsafe_code)]
