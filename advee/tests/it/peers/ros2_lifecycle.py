"""Unmodified ROS 2 as the lifecycle manager of the robot's node: `ros2_lifecycle.py DOMAIN`.

What the robot's node answers in each state is compared with what a lifecycle node of rclpy answers there. Prints a line
of JSON. Everything waits for what it needs; the test bounds the time.
"""

import json
import os
import sys
import time

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

import rclpy
from geometry_msgs.msg import Twist
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode

NODES = ["/courier", "/reference"]
QUESTIONS = {
    "get_state": GetState,
    "get_available_states": GetAvailableStates,
    "get_available_transitions": GetAvailableTransitions,
    "get_transition_graph": GetAvailableTransitions,
}
# One that is impossible in each state, and one that is possible.
STEPS = [
    ("unconfigured", Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CONFIGURE),
    ("inactive", Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE),
    ("active", Transition.TRANSITION_CLEANUP, Transition.TRANSITION_DEACTIVATE),
    ("inactive again", Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP),
    ("unconfigured again", Transition.TRANSITION_ACTIVE_SHUTDOWN, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN),
    ("finalized", Transition.TRANSITION_CONFIGURE, None),
]


def plain(message):
    """A message as lists and numbers; lists of states and transitions are sorted."""
    if isinstance(message, (list, tuple)):
        return sorted((plain(item) for item in message), key=json.dumps)
    if not hasattr(message, "get_fields_and_field_types"):
        return message
    names = [name for name in message.get_fields_and_field_types() if name != "timestamp"]
    return {name: plain(getattr(message, name)) for name in names}


class Manager:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("manager")
        self.reference = LifecycleNode("reference")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.executor.add_node(self.reference)
        self.speed = None
        self.clients = {}
        self.events = {name: [] for name in NODES}
        self.cmd = self.node.create_publisher(Twist, "/cmd_vel", 1)
        self.node.create_subscription(Odometry, "/odom", self.on_odom, 10)
        for name, events in self.events.items():
            topic = f"{name}/transition_event"
            self.node.create_subscription(TransitionEvent, topic, lambda event, to=events: to.append(plain(event)), 10)

    def on_odom(self, odom):
        self.speed = abs(odom.twist.twist.linear.x)

    def until(self, condition, each=lambda: None):
        while not condition():
            each()
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, kind, name, request):
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, name)
        self.until(self.clients[name].service_is_ready)
        future = self.clients[name].call_async(request)
        self.until(future.done)
        return future.result()

    def ask(self, name):
        answers = {what: self.call(kind, f"{name}/{what}", kind.Request()) for what, kind in QUESTIONS.items()}
        return {what: plain(answer) for what, answer in answers.items()}

    def change(self, name, transition):
        request = ChangeState.Request()
        request.transition.id = transition
        return self.call(ChangeState, f"{name}/change_state", request).success

    def command(self, speed):
        twist = Twist()
        twist.linear.x = speed
        self.cmd.publish(twist)

    def fastest(self, seconds):
        """Greatest speed while motion is commanded."""
        fastest, end = 0.0, time.monotonic() + seconds
        while time.monotonic() < end:
            self.command(0.3)
            self.executor.spin_once(timeout_sec=0.05)
            fastest = max(fastest, self.speed)
        return fastest


manager = Manager()
manager.until(lambda: manager.speed is not None and manager.cmd.get_subscription_count() > 0)
result = {"states": [], "differences": [], "impossible": [], "possible": []}
result["before"] = manager.fastest(1.0)
for state, impossible, possible in STEPS:
    ours, reference = (manager.ask(name) for name in NODES)
    result["states"].append(ours["get_state"]["current_state"]["label"])
    result["differences"] += [[state, what, ours[what], reference[what]] for what in ours if ours[what] != reference[what]]
    result["impossible"].append([manager.change(name, impossible) for name in NODES])
    if possible is None:
        break
    if state == "active":
        manager.until(lambda: manager.speed > 0.1, lambda: manager.command(0.3))
        manager.fastest(1.0)
    result["possible"].append([manager.change(name, possible) for name in NODES])
    if state == "active":
        manager.until(lambda: manager.speed < 0.01, lambda: manager.command(0.3))
        result["after"] = manager.fastest(0.5)
manager.until(lambda: all(len(events) >= 10 for events in manager.events.values()))
# rcl leaves the transition itself empty.
ours, reference = ([[one["start_state"], one["goal_state"]] for one in events] for events in manager.events.values())
result["events"] = [] if ours == reference else [ours, reference]
print(json.dumps(result), flush=True)
manager.reference.destroy_node()
manager.node.destroy_node()
rclpy.shutdown()
