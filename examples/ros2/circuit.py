"""A rectangle to the left of where a robot stands, and how to drive along it: what both examples here share."""

import math

SPEED, TURN = 0.4, 1.0  # m/s, rad/s; a command beyond the robot's limits stops it
PERIOD = 0.05  # s: a command lives 0.25 s, so it is repeated
PATIENCE = 5.0  # s for which the robot may stand although it is commanded
SCAN_MAX = 0.5  # s: what an older scan saw may be elsewhere
# It stands while something is that near to its middle; towards that it is slower by so much, m/s per m.
HALF_WIDTH, STAND, SLOW = 0.4, 0.75, 0.8


def ahead(ranges, angle_min, angle_increment, range_min):
    """Way to the nearest point of a scan within the width of the robot, m; the scanner looks forward."""
    nearest = math.inf
    for number, distance in enumerate(ranges):
        if not range_min <= distance < math.inf:  # nothing in range is inf, and not known is nan
            continue
        angle = angle_min + number * angle_increment
        if abs(distance * math.sin(angle)) < HALF_WIDTH and math.cos(angle) > 0:
            nearest = min(nearest, distance * math.cos(angle))
    return nearest


def heading(orientation):
    """Heading of a quaternion about the vertical, rad."""
    return 2 * math.atan2(orientation.z, orientation.w)


class Circuit:
    """Corners that are left, and what has been driven; `say` gets the lines for people."""

    def __init__(self, length, width, pose, say):
        x, y, theta = pose
        sin, cos = math.sin(theta), math.cos(theta)
        corners = [(length, 0), (length, width), (0, width), (0, 0)]
        self.corners = [(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in corners]
        self.start = self.last = (x, y)
        self.way, self.waits, self.stood = 0.0, False, 0.0
        self.say = say
        say(f"around {length} m by {width} m, from {x:.2f}, {y:.2f}")

    def step(self, pose, free):
        """Speed and rotation at a pose in the frame of the odometry, with so much way ahead (None: not known), each
        `PERIOD`. Ends the program when it is around, or when the robot does not move."""
        place, theta = pose[:2], pose[2]
        moved = math.dist(self.last, place)
        self.last = place
        self.way += moved
        if math.dist(place, self.corners[0]) < (0.1 if len(self.corners) == 1 else 0.25):
            self.corners.pop(0)
            if not self.corners:
                self.say(f"around: {self.way:.1f} m, ends {math.dist(self.start, place):.2f} m from its start")
                raise SystemExit(0)
            self.say(f"corner at {place[0]:.2f}, {place[1]:.2f}")
        distance = math.dist(place, self.corners[0])
        bearing = math.atan2(self.corners[0][1] - place[1], self.corners[0][0] - place[0])
        error = math.remainder(bearing - theta, math.tau)
        speed = min(SPEED, SLOW * distance + 0.05) * max(0.0, math.cos(error)) ** 2
        speed = 0.0 if self.waits_for(free) else min(speed, SLOW * (free - STAND) + 0.1)
        self.stood = self.stood + PERIOD if moved < 0.0005 and speed > 0.05 else 0.0
        if self.stood > PATIENCE:
            self.say("the robot does not obey: it gives up")
            raise SystemExit(1)
        return speed, max(-TURN, min(TURN, 2 * error))

    def waits_for(self, free):
        """True while the way is not free."""
        if self.waits != (free is None or free < STAND + (0.2 if self.waits else 0.0)):
            self.waits = not self.waits
            why = "no scan comes" if free is None else f"something is {free:.2f} m ahead"
            self.say(f"{why}: it waits" if self.waits else "the way is free again")
        return self.waits
