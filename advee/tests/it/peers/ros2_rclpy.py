"""Unmodified ROS 2 beside the robot: `look DOMAIN` reads topics and tries to drive; `drive DOMAIN` drives; `own DOMAIN`
reads topics in the robot's own types.

Prints a line of JSON. Everything waits for what it needs; the test bounds the time.
"""

import json
import math
import os
import sys
import time

os.environ["ROS_DOMAIN_ID"] = sys.argv[2]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD = 0.05


class Peer:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("peer")
        self.got = {}
        self.twist = self.node.create_publisher(Twist, "/cmd_vel", 1)
        # A participant has one type for a topic: the other type is another one's.
        self.other = rclpy.Context()
        rclpy.init(context=self.other)
        self.second = rclpy.create_node("second", context=self.other)
        self.stamped = self.second.create_publisher(TwistStamped, "/cmd_vel", 1)
        self.listen("odom", Odometry, 10)

    def listen(self, name, kind, qos):
        self.node.create_subscription(kind, "/" + name, lambda message: self.got.__setitem__(name, message), qos)

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=left)

    def until(self, condition, each=lambda: None):
        while not condition():
            each()
            self.spin(PERIOD)

    @property
    def x(self):
        return self.got["odom"].pose.pose.position.x

    @property
    def speed(self):
        return self.got["odom"].twist.twist.linear.x

    def stands(self):
        return abs(self.speed) < 0.01

    def command(self, speed):
        twist = Twist()
        twist.linear.x = speed
        self.twist.publish(twist)

    def command_stamped(self, speed):
        stamped = TwistStamped()
        stamped.header.stamp = self.node.get_clock().now().to_msg()
        stamped.twist.linear.x = speed
        self.stamped.publish(stamped)


def look(peer):
    topics = {
        "amcl_pose": (PoseWithCovarianceStamped, LATCHED),
        "clock": (Clock, qos_profile_sensor_data),
        "diagnostics": (DiagnosticArray, 10),
        "map": (OccupancyGrid, LATCHED),
        "scan": (LaserScan, qos_profile_sensor_data),
    }
    for name, (kind, qos) in topics.items():
        peer.listen(name, kind, qos)
    peer.until(lambda: all(name in peer.got for name in [*topics, "odom"]))
    from_x = peer.x
    for _ in range(40):
        peer.command(0.3)
        peer.spin(PERIOD)
    odom, scan, grid = (peer.got[name] for name in ["odom", "scan", "map"])
    measured = [distance for distance in scan.ranges if math.isfinite(distance)]
    return {
        "frames": [odom.header.frame_id, odom.child_frame_id, scan.header.frame_id, grid.header.frame_id],
        "age": time.time() - odom.header.stamp.sec - odom.header.stamp.nanosec / 1e9,
        "beams": len(scan.ranges),
        "measured": len(measured),
        "nearest": min(measured),
        "grid": [grid.info.width, grid.info.height, len(grid.data), sorted(set(grid.data))],
        "diagnostics": [status.name for status in peer.got["diagnostics"].status],
        "nodes": sorted(peer.node.get_node_names()),
        "listeners": peer.twist.get_subscription_count() + peer.stamped.get_subscription_count(),
        "moved": abs(peer.x - from_x),
    }


def drive(peer):
    peer.until(lambda: peer.twist.get_subscription_count() > 0 and peer.stamped.get_subscription_count() > 0)
    peer.until(lambda: "odom" in peer.got)
    result = {}
    from_x = peer.x
    peer.until(lambda: peer.x - from_x > 0.3, lambda: peer.command(0.3))
    result["speed"] = peer.speed
    # Silence.
    begin = time.monotonic()
    peer.until(peer.stands)
    result["stood_after"] = time.monotonic() - begin
    # Motion without a zero before it.
    fastest = 0.0
    for _ in range(20):
        peer.command(0.3)
        peer.spin(PERIOD)
        fastest = max(fastest, abs(peer.speed))
    result["without_zero"] = fastest
    # A zero, then motion, with the other type.
    for _ in range(6):
        peer.command_stamped(0.0)
        peer.spin(PERIOD)
    from_x = peer.x
    peer.until(lambda: peer.x - from_x > 0.2, lambda: peer.command_stamped(0.3))
    # Not a number.
    begin = time.monotonic()
    peer.until(peer.stands, lambda: peer.command_stamped(math.nan))
    result["stood_after_nan"] = time.monotonic() - begin
    return result


def own(peer):
    from advee_msgs.msg import DataFaults, DataGoal, DataGuard, DataHold, DataProcesses, DataState

    kinds = {
        "faults": DataFaults,
        "goal": DataGoal,
        "guard": DataGuard,
        "holds": DataHold,
        "processes": DataProcesses,
        "state": DataState,
    }
    states = {}
    for name, kind in kinds.items():
        peer.listen("advee/" + name, kind, 10)
    peer.node.create_subscription(
        DataState, "/advee/state", lambda message: states.__setitem__(message.module, message.state), 10
    )
    peer.until(lambda: all("advee/" + name in peer.got for name in kinds) and "planner" in states)
    got = {name: peer.got["advee/" + name] for name in kinds}
    processes = got["processes"]
    return {
        "ages": [time.time() - message.timestamp / 1e6 for message in got.values()],
        "modules": sorted(process.module for process in processes.processes),
        "count": processes.count,
        "planner_runs": states["planner"] == DataState.RUN,
        "holds": [[hold.code, hold.latched] for hold in got["holds"].holds],
        "goal": got["goal"].status == DataGoal.IDLE,
        "forward": got["guard"].forward,
        "faults": got["faults"].count == len(got["faults"].faults),
    }


peer = Peer()
print(json.dumps({"look": look, "drive": drive, "own": own}[sys.argv[1]](peer)), flush=True)
peer.node.destroy_node()
peer.second.destroy_node()
rclpy.shutdown(context=peer.other)
rclpy.shutdown()
