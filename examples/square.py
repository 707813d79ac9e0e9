#!/usr/bin/env python3
"""Drives a square with rounded corners, with the official LCM and only the message definitions of this project.

    pip install lcm
    lcm-gen -p --ppath build messages/*/*.lcm
    PYTHONPATH=build python3 examples/square.py [SIDE_M]

Commands the robot on LL_CMD_MOTION as a remote operator, steers by its odometry (LL_DATA_ODO), and prints the true
path from the simulator (SIM_DATA_TRUTH) as one line of JSON. Exit status 1 if the robot does not move or does not
return to its start.
"""
import json
import math
import os
import sys
import time

try:
    import lcm
except ModuleNotFoundError as error:
    sys.exit(f"{error}: pip install lcm; or .venv/bin/python, which make test fills")
from lowlevel import cmd_motion_t, data_motion_t, data_odo_t
from simulation import data_truth_t

SPEED, STEERING = 0.4, 0.5          # m/s, rad
PERIOD = 0.05                       # s: a command lives 0.25 s, so it is repeated
side = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0

bus = lcm.LCM(os.environ.get("LCM_DEFAULT_URL", ""))
odo, motion, truth = [], [], []


def keep(where, message_type):
    def handler(_channel, data):
        where[:] = [message_type.decode(data)]
    return handler


for channel, where, message_type in (("LL_DATA_ODO", odo, data_odo_t), ("LL_DATA_MOTION", motion, data_motion_t),
                                     ("SIM_DATA_TRUTH", truth, data_truth_t)):
    bus.subscribe(channel, keep(where, message_type))


def command(speed, steering):
    """Sends one command, then receives messages until the next one is due."""
    message = cmd_motion_t()
    message.timestamp = int(time.time() * 1e6)
    message.speed, message.steering = speed, steering
    message.priority, message.source = 1, "square.py"
    bus.publish("LL_CMD_MOTION", message.encode())
    until = time.monotonic() + PERIOD
    while (left := until - time.monotonic()) > 0:
        bus.handle_timeout(max(1, int(left * 1000)))


def drive(speed, steering, until, limit):
    """Commands until `until()` or for `limit` seconds; returns false on timeout."""
    end = time.monotonic() + limit
    while not until():
        if time.monotonic() > end:
            return False
        command(speed, steering)
    return True


ready = drive(0, 0, lambda: odo and truth and motion and motion[0].homed and not motion[0].reason, 20)
if not ready:
    print("the robot is not ready:", motion[0].reason if motion else "nothing heard of it", file=sys.stderr)
    sys.exit(1)

start, corners = truth[0], []
ahead = odo[0].heading
for corner in range(1, 5):
    path = odo[0].path
    arrived = drive(SPEED, 0, lambda: odo[0].path >= path + side, 10 + 5 * side)
    # Relative to the start, so that errors of the corners do not accumulate.
    turned = drive(SPEED, STEERING, lambda: odo[0].heading >= ahead + corner * math.pi / 2, 20)
    if not (arrived and turned):
        command(0, 0)
        print("the robot does not get on:", motion[0].reason, file=sys.stderr)
        sys.exit(1)
    corners.append([round(truth[0].x, 2), round(truth[0].y, 2)])
drive(0, 0, lambda: abs(truth[0].speed) < 0.01, 5)

end = truth[0]
off = math.hypot(end.x - start.x, end.y - start.y)
print(json.dumps({"corners": corners, "off_m": round(off, 2), "collisions": end.collisions}))
sys.exit(0 if off < 1.5 and end.collisions == 0 else 1)
