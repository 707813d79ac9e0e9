#!/usr/bin/env python3
"""A small planner in place of the built-in one: of some arcs ahead the one that leads nearest to the
goal and past what was sensed (the dynamic window approach, without the window: the robot limits its acceleration).

    planner.py [--speed M/S] [--curvature 1/M] [--middle M] [--radius M]

A module in Python, docs/other-planners.md: the entry `planner` of modules.toml with `command` and `args`. It has no map
and no memory beyond seconds, so it does not find out of a dead end; it backs out of a narrow place. What the robot must
not do it cannot do: guard, arbitration and time to live bind it like any planner.
"""
import math
import os
import random
import sys
import time

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "modules", "python"))
import advee  # noqa: E402
from lowlevel import (cmd_velocity_t, data_guard_t, data_hold_t, data_ranges_t, data_scan_t, hold_t,  # noqa: E402
                      reading_t)
from middlelevel import cmd_goal_t, data_estimate_t, data_goal_t, data_obstacles_t  # noqa: E402

PRIORITY = 0                            # of planners; higher ones are people's
PERIOD, REPORTS = 0.05, 0.2             # s: commands live 0.25 s; state of the goal
ESTIMATE_AGE, MEMORY = 0.2, 4.0         # s: of the pose to drive by; of what was sensed
CELL, SENSED, ECHOES = 0.2, 2.0, 2      # m, m: side of a cell; what is farther is not kept; echoes of an obstacle
AHEAD, STEP, ARCS = 1.6, 0.2, 6         # m, m: length of an arc, of a step on it; number of arcs to each side
REACHED = 0.3                           # m: least tolerance, as the accuracy of the estimate
STUCK, BACK = 1.5, 3.0                  # s: without way ahead before it backs out, and for how long
NO_GOAL, BAD_ESTIMATE = 601, 504        # docs/holds.md


class Planner(advee.Module):
    def __init__(self, args):
        super().__init__(args)
        self.limits = args
        self.session = random.getrandbits(62)
        self.pose, self.pose_at, self.forward = None, -math.inf, 0.0
        self.goal, self.waypoint, self.status, self.text = cmd_goal_t(), 0, data_goal_t.IDLE, "there is no goal"
        self.cells, self.fired = {}, {}  # (x, y) in cells: until when, number of echoes; sonar: its last firing
        self.free_at, self.back_until, self.turn = time.monotonic(), -math.inf, 0.0
        self.rest_until = -math.inf     # commands zero until then
        self.subscribe("ML_DATA_ESTIMATE", data_estimate_t, self.on_estimate)
        self.subscribe("LL_DATA_RANGES", data_ranges_t, self.on_ranges)
        self.subscribe("LL_DATA_SCAN", data_scan_t, self.on_scan)
        self.subscribe("LL_DATA_GUARD", data_guard_t, self.on_guard)
        self.subscribe("ML_CMD_GOAL", cmd_goal_t, self.on_goal)
        self.every(PERIOD, self.on_time)
        self.every(REPORTS, self.report)
        self.working()

    # --- input ---

    def on_estimate(self, estimate):
        pose = estimate.x, estimate.y, estimate.theta
        if estimate.quality >= estimate.COARSE and all(map(math.isfinite, pose)):
            self.pose, self.pose_at = pose, time.monotonic()

    def on_guard(self, guard):
        self.forward = guard.forward

    def on_ranges(self, ranges):
        for one in ranges.readings:
            # The list repeats what was measured before.
            new = one.status == reading_t.MEASURED and self.fired.get(one.id) != one.timestamp
            if one.kind == reading_t.SONAR and new:
                self.fired[one.id] = one.timestamp
                self.sense(one.x, one.y, one.theta, one.distance)

    def on_scan(self, scan):
        if scan.status != scan.OK:
            return
        for number in range(0, scan.count, 3):
            self.sense(scan.x, scan.y, scan.theta + scan.angle_min + number * scan.angle_step, scan.ranges[number])

    def sense(self, x, y, angle, distance):
        """Keeps the point of the robot's frame that was sensed from x, y."""
        if not math.isfinite(angle) or not math.isfinite(distance):
            return
        x, y = x + distance * math.cos(angle), y + distance * math.sin(angle)
        if self.pose and math.hypot(x, y) < SENSED:
            px, py, theta = self.pose
            wx, wy = px + x * math.cos(theta) - y * math.sin(theta), py + x * math.sin(theta) + y * math.cos(theta)
            cell = round(wx / CELL), round(wy / CELL)
            self.cells[cell] = time.monotonic() + MEMORY, self.cells.get(cell, (0, 0))[1] + 1

    def on_goal(self, goal):
        numbers = [number for point in goal.waypoints for number in (point.x, point.y, point.tolerance)]
        self.goal, self.waypoint, self.free_at = goal, 0, time.monotonic()
        if not goal.waypoints:
            self.over(data_goal_t.CANCELLED, "cancelled")
        elif not all(map(math.isfinite, numbers)):
            self.over(data_goal_t.FAILED, "refused: a waypoint is not a place")
        else:
            self.status, self.text = data_goal_t.DRIVING, f"drives to waypoint 1 of {goal.count}"
        self.report()

    # --- what it does ---

    @property
    def located(self):
        return time.monotonic() - self.pose_at < ESTIMATE_AGE

    def on_state(self, _state):
        self.rest_until = -math.inf

    def on_time(self):
        now = time.monotonic()
        self.cells = {cell: seen for cell, seen in self.cells.items() if seen[0] > now}
        if not self.acts:
            return
        if self.status == data_goal_t.DRIVING and self.located:
            self.drive(now)
        elif now < self.rest_until:
            self.command(0.0, 0.0)

    def drive(self, now):
        self.rest_until = now + 1.0
        point = self.goal.waypoints[self.waypoint]
        if math.hypot(point.x - self.pose[0], point.y - self.pose[1]) <= max(point.tolerance, REACHED):
            self.waypoint += 1
            if self.waypoint == self.goal.count and not self.goal.loop:
                self.waypoint -= 1
                return self.over(data_goal_t.REACHED, "the goal is reached")
            self.waypoint %= self.goal.count
            point = self.goal.waypoints[self.waypoint]
            self.text = f"drives to waypoint {self.waypoint + 1} of {self.goal.count}"
        if now < self.back_until:
            return self.command(-0.2, -0.2 * -self.turn)
        arcs = (n * self.limits.curvature / ARCS for n in range(-ARCS, ARCS + 1))
        near = self.obstacles
        cost, curvature = min((self.cost(point, arc, near), arc) for arc in arcs)
        self.turn = curvature
        if math.isfinite(cost) and self.forward > 0.03:
            self.free_at = now
        elif now - self.free_at > STUCK:
            self.back_until, self.free_at = now + BACK, now + BACK
        speed = self.limits.speed / (1.0 + abs(curvature)) if math.isfinite(cost) else 0.0
        return self.command(speed, speed * curvature)

    @property
    def obstacles(self):
        """Places of which a second echo has come: a single one may be false."""
        return [(x * CELL, y * CELL) for (x, y), (_, echoes) in self.cells.items() if echoes >= ECHOES]

    def cost(self, goal, curvature, near):
        """Of the arc of this curvature; infinite if it touches something."""
        x, y, theta = self.pose
        way, room, nearest = 0.0, SENSED, math.hypot(goal.x - x, goal.y - y)
        length = min(AHEAD, nearest)
        while way < length:
            theta += curvature * STEP
            x, y, way = x + STEP * math.cos(theta), y + STEP * math.sin(theta), way + STEP
            # The body is a disc around its middle, ahead of the rear axle.
            mx, my = x + self.limits.middle * math.cos(theta), y + self.limits.middle * math.sin(theta)
            room = min([room] + [math.hypot(px - mx, py - my) - self.limits.radius for px, py in near])
            nearest = min(nearest, math.hypot(goal.x - x, goal.y - y))
            if room <= 0.0:
                return math.inf
        ahead = math.atan2(goal.y - y, goal.x - x) - theta
        turned = abs(math.remainder(ahead, math.tau)) if nearest > 0.5 else 0.0
        return nearest + 0.4 * turned + 0.1 / (room + 0.1)

    def command(self, speed, rotation):
        message = cmd_velocity_t()
        message.timestamp, message.vx, message.omega = advee.timestamp(), speed, rotation
        message.priority, message.source, message.session = PRIORITY, self.name, self.session
        self.publish("LL_CMD_VELOCITY", message)

    def over(self, status, text):
        self.status, self.text, self.rest_until = status, text, time.monotonic() + 1.0
        self.report()

    # --- output ---

    def report(self):
        """State of the goal, what holds it, and what was sensed, for displays and for `advee goal --wait`."""
        goal, hold, obstacles = data_goal_t(), data_hold_t(), data_obstacles_t()
        goal.timestamp = hold.timestamp = obstacles.timestamp = advee.timestamp()
        goal.id, goal.waypoint, goal.status, goal.message = self.goal.id, self.waypoint, self.status, self.text
        goal.remaining = math.nan
        if self.pose and self.status == goal.DRIVING:
            points = self.goal.waypoints[self.waypoint:]
            places = [self.pose[:2]] + [(point.x, point.y) for point in points]
            goal.remaining = sum(math.dist(*pair) for pair in zip(places, places[1:]))
        hold.module = self.name
        causes = [] if self.status == goal.DRIVING else [NO_GOAL]
        if not self.located:
            causes = [BAD_ESTIMATE]
        for code in causes:
            row = hold_t()
            row.code, row.since = code, goal.timestamp
            hold.holds.append(row)
        hold.count = len(hold.holds)
        obstacles.size = CELL
        places = self.obstacles
        obstacles.x, obstacles.y, obstacles.count = [x for x, _ in places], [y for _, y in places], len(places)
        for channel, message in ("ML_DATA_GOAL", goal), ("LL_DATA_HOLD", hold), ("ML_DATA_OBSTACLES", obstacles):
            self.publish(channel, message)


if __name__ == "__main__":
    parser = advee.arguments("planner", "Drives to goals along arcs.")
    parser.add_argument("--speed", type=float, default=0.4, metavar="M/S", help="greatest speed (0.4)")
    parser.add_argument("--curvature", type=float, default=1.0, metavar="1/M", help="of the tightest arc (1.0)")
    parser.add_argument("--middle", type=float, default=0.3, metavar="M", help="of the body, before its origin (0.3)")
    parser.add_argument("--radius", type=float, default=0.5, metavar="M", help="of the disc that it takes (0.5)")
    advee.run(Planner, parser.parse_args())
