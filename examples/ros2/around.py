#!/usr/bin/env python3
"""Drives around a rectangle, as a node of ROS 2 (rclpy): `around.py [LENGTH_M WIDTH_M]`.

    target/release/advee up --sim --goal none --config conf/courier --set ros2.enabled=true --set ros2.commands=true
    python3 examples/ros2/around.py

Requires ROS 2, or `pip install ros-rclpy ros-rmw-fastrtps-cpp ros-geometry-msgs ros-nav-msgs ros-sensor-msgs`. It
steers by /odom, slows down before what /scan sees ahead and stands until that is gone, and ends with zero. Of the
courier's start in the hall, 5 m by 4 m are around a column.
"""
import sys

import rclpy
from circuit import PERIOD, SCAN_MAX, Circuit, ahead, heading
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import LaserScan


class Around(Node):
    def __init__(self, length, width):
        super().__init__("around")
        self.size = (length, width)
        self.circuit = None
        self.pose = None
        self.free = self.scanned = None
        self.publisher = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(Odometry, "odom", self.on_odom, 10)
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)
        self.create_timer(PERIOD, self.on_timer)

    def on_odom(self, odom):
        at = odom.pose.pose
        self.pose = (at.position.x, at.position.y, heading(at.orientation))

    def on_scan(self, scan):
        self.free = ahead(scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min)
        self.scanned = self.get_clock().now()

    def on_timer(self):
        if self.pose is None or self.free is None or self.publisher.get_subscription_count() == 0:
            return self.get_logger().info("waits for the robot", once=True)
        if self.circuit is None:
            self.circuit = Circuit(*self.size, self.pose, self.get_logger().info)
        is_new = self.get_clock().now() - self.scanned < Duration(seconds=SCAN_MAX)
        self.command(*self.circuit.step(self.pose, self.free if is_new else None))

    def command(self, speed, rotation):
        twist = Twist()
        twist.linear.x, twist.angular.z = speed, rotation
        self.publisher.publish(twist)


def main():
    length, width = map(float, sys.argv[1:]) if len(sys.argv) == 3 else (5.0, 4.0)
    # The last zero is sent after Ctrl-C too.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Around(length, width)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.command(0.0, 0.0)
        node.publisher.wait_for_all_acked(Duration(seconds=1))
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
