"""Unmodified ROS 2 as a client of the robot's actions, services and parameters.

`ros2_actions.py PART DOMAIN X Y YAW AHEAD_X AHEAD_Y [COUNT]` with the parts `refused`, `navigate`, `many`, `operate`.
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
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

NAMES = {value: name[7:] for name, value in vars(GoalStatus).items() if name.startswith("STATUS_")}


class Peer:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("peer")
        self.odom = None
        self.node.create_subscription(Odometry, "/odom", self.on_odom, 10)
        self.to_pose = ActionClient(self.node, NavigateToPose, "navigate_to_pose")
        self.through = ActionClient(self.node, NavigateThroughPoses, "navigate_through_poses")
        self.feedbacks = []

    def on_odom(self, odom):
        self.odom = odom

    def until(self, condition):
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def wait(self, future):
        self.until(future.done)
        return future.result()

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = self.wait(client.call_async(request))
        self.node.destroy_client(client)
        return answer

    @property
    def speed(self):
        return abs(self.odom.twist.twist.linear.x) + abs(self.odom.twist.twist.angular.z)

    def pose(self, x, y, frame="map"):
        pose = PoseStamped()
        pose.header.frame_id = frame
        pose.pose.position.x, pose.pose.position.y = x, y
        pose.pose.orientation.z, pose.pose.orientation.w = math.sin(YAW / 2), math.cos(YAW / 2)
        return pose

    def send(self, pose, tree=""):
        """The handle of a goal."""
        self.until(self.to_pose.server_is_ready)
        goal = NavigateToPose.Goal(pose=pose, behavior_tree=tree)
        self.feedbacks.clear()
        return self.wait(self.to_pose.send_goal_async(goal, feedback_callback=self.on_feedback))

    def on_feedback(self, feedback):
        self.feedbacks.append(feedback.feedback)


def outcome(answer):
    return [NAMES[answer.status], answer.result.error_code, answer.result.error_msg]


X, Y, YAW, AHEAD_X, AHEAD_Y = (float(text) for text in sys.argv[3:8])
# Beyond: some seconds of driving.
FAR = (2 * AHEAD_X - X, 2 * AHEAD_Y - Y)


def refused(peer):
    """Goals of a robot that ROS may not command."""
    peer.until(lambda: peer.odom is not None)
    handle = peer.send(peer.pose(AHEAD_X, AHEAD_Y))
    peer.until(peer.through.server_is_ready)
    goal = NavigateThroughPoses.Goal()
    goal.poses.goals = [peer.pose(AHEAD_X, AHEAD_Y)]
    other = peer.wait(peer.through.send_goal_async(goal))
    services = [name for name, _ in peer.node.get_service_names_and_types()]
    return {
        "accepted": [handle.accepted, other.accepted],
        "speed": peer.speed,
        "operator": [name for name in services if name.endswith(("/pause", "/home", "/release_planner"))],
    }


def navigate(peer):
    result = {}
    # In another frame, and with a behavior tree.
    result["frame"] = peer.send(peer.pose(AHEAD_X, AHEAD_Y, "odom")).accepted
    result["tree"] = peer.send(peer.pose(AHEAD_X, AHEAD_Y), "tree.xml").accepted
    # A goal, replaced while it is driven to, by one that is cancelled while it is driven to.
    first = peer.send(peer.pose(AHEAD_X, AHEAD_Y))
    first_result = first.get_result_async()
    peer.until(lambda: peer.odom is not None and peer.speed > 0.05 and len(peer.feedbacks) > 3)
    at = peer.feedbacks[-1]
    result["feedback"] = [
        at.current_pose.header.frame_id,
        at.current_pose.pose.position.x,
        at.current_pose.pose.position.y,
        at.navigation_time.sec + at.navigation_time.nanosec / 1e9,
        at.distance_remaining,
        at.number_of_recoveries,
    ]
    second = peer.send(peer.pose(*FAR))
    result["replaced"] = outcome(peer.wait(first_result))
    peer.until(lambda: len(peer.feedbacks) > 1)
    second_result = second.get_result_async()
    cancel = peer.wait(second.cancel_goal_async())
    result["cancel"] = [cancel.return_code, len(cancel.goals_canceling)]
    result["cancelled"] = outcome(peer.wait(second_result))
    peer.until(lambda: peer.speed < 0.01)
    # Once more: it has ended.
    again = peer.wait(second.cancel_goal_async())
    result["again"] = again.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
    # A goal that is reached; its result is asked for at once, and once more afterwards.
    third = peer.send(peer.pose(AHEAD_X, AHEAD_Y))
    result["reached"] = outcome(peer.wait(third.get_result_async()))
    result["later"] = outcome(peer.wait(third.get_result_async()))
    # Through two poses.
    goal = NavigateThroughPoses.Goal()
    goal.poses.goals = [peer.pose((X + AHEAD_X) / 2, (Y + AHEAD_Y) / 2), peer.pose(X, Y)]
    left = []
    sent = peer.through.send_goal_async(
        goal, feedback_callback=lambda feedback: left.append(feedback.feedback.number_of_poses_remaining)
    )
    answer = peer.wait(peer.wait(sent).get_result_async())
    result["through"] = outcome(answer)
    result["waypoints"] = [waypoint.waypoint_status for waypoint in answer.result.waypoint_statuses]
    result["left"] = sorted(set(left))
    return result


def many(peer):
    """Goals one after the other, each while the last one is pursued; every third is cancelled."""
    count = int(sys.argv[8])
    results, accepted, with_feedback, cancels = [], 0, 0, 0
    # Ahead and behind: the robot comes to neither before it is sent to the other one.
    places = [FAR, (2 * X - FAR[0], 2 * Y - FAR[1])]
    for n in range(count):
        handle = peer.send(peer.pose(*places[n % 2]))
        accepted += handle.accepted
        results.append(handle.get_result_async())
        if n % 10 == 0:
            peer.until(lambda: peer.feedbacks or results[-1].done())
            with_feedback += bool(peer.feedbacks)
        if n % 3 == 2 or n + 1 == count:
            cancels += len(peer.wait(handle.cancel_goal_async()).goals_canceling)
            peer.wait(results[-1])
    outcomes = [NAMES[peer.wait(future).status] for future in results]
    return {
        "accepted": accepted,
        "cancels": cancels,
        "feedback": with_feedback,
        "outcomes": {name: outcomes.count(name) for name in sorted(set(outcomes))},
    }


def operate(peer):
    result = {}
    peer.until(lambda: peer.odom is not None)
    names = peer.call(ListParameters, "/courier/list_parameters", ListParameters.Request()).result
    result["parameters"] = names.names
    asked = ["robot", "limits.speed_mps", "use_sim_time", "none"]
    values = peer.call(GetParameters, "/courier/get_parameters", GetParameters.Request(names=asked)).values
    result["values"] = [values[0].string_value, values[1].double_value, values[2].bool_value, values[3].type]
    types = peer.call(GetParameterTypes, "/courier/get_parameter_types", GetParameterTypes.Request(names=asked))
    result["types"] = list(types.types)
    described = peer.call(DescribeParameters, "/courier/describe_parameters", DescribeParameters.Request(names=asked))
    result["read_only"] = [one.read_only for one in described.descriptors]
    change = [Parameter("limits.speed_mps", value=9.0).to_parameter_msg()]
    answer = peer.call(SetParameters, "/courier/set_parameters", SetParameters.Request(parameters=change))
    result["set"] = [[one.successful, one.reason] for one in answer.results]
    request = SetParametersAtomically.Request(parameters=change)
    answer = peer.call(SetParametersAtomically, "/courier/set_parameters_atomically", request)
    result["set_atomically"] = answer.result.successful
    # PAUSE while it drives, and on again: the goal has to be sent once more, or the planner be released.
    handle = peer.send(peer.pose(AHEAD_X, AHEAD_Y))
    peer.until(lambda: peer.speed > 0.05)
    answer = peer.call(SetBool, "/courier/pause", SetBool.Request(data=True))
    result["pause"] = [answer.success, answer.message]
    peer.until(lambda: peer.speed < 0.01)
    peer.feedbacks.clear()
    peer.until(lambda: len(peer.feedbacks) > 10)
    result["moved_in_pause"] = peer.speed
    result["resume"] = peer.call(SetBool, "/courier/pause", SetBool.Request(data=False)).success
    answer = peer.call(Trigger, "/courier/release_planner", Trigger.Request())
    result["release"] = [answer.success, answer.message]
    result["reached"] = outcome(peer.wait(handle.get_result_async()))
    return result


peer = Peer()
part = {"refused": refused, "navigate": navigate, "many": many, "operate": operate}[sys.argv[1]]
begin = time.monotonic()
result = part(peer)
print(json.dumps({**result, "seconds": time.monotonic() - begin}), flush=True)
peer.to_pose.destroy()
peer.through.destroy()
peer.node.destroy_node()
rclpy.shutdown()
