"""High-level module on a second host, with only the official LCM and the message definitions.

    second_host.py SPEED SECONDS

Commands the robot at 20 Hz: zero until its odometry is received and it may be driven, then SPEED, to the end. After a
silence it commands SPEED on, and each 8 s zero for 0.3 s, as one lets go and presses again.
Prints events, each once as a line of JSON: `ready`; `moving`, by the odometry; `silent`, after a second without
odometry.
"""
import json
import os
import sys
import time

import lcm
from lowlevel import cmd_motion_t, data_motion_t, data_odo_t

PERIOD = 0.05
speed, seconds = float(sys.argv[1]), float(sys.argv[2])
bus = lcm.LCM(os.environ["LCM_DEFAULT_URL"])
state = {"odo": None, "heard": 0.0, "ready": False, "told": set(), "silent": None}


def tell(what, **more):
    if what not in state["told"]:
        state["told"].add(what)
        print(json.dumps({"what": what, **more}), flush=True)


def on_odo(_channel, data):
    state["odo"], state["heard"] = data_odo_t.decode(data), time.monotonic()


def on_motion(_channel, data):
    motion = data_motion_t.decode(data)
    state["ready"] = state["ready"] or (motion.homed and not motion.reason)


def lets_go(now):
    return state["silent"] is not None and now - state["silent"] > 8.0 and (now - state["silent"]) % 8.0 < 0.3


bus.subscribe("LL_DATA_ODO", on_odo)
bus.subscribe("LL_DATA_MOTION", on_motion)
end = time.monotonic() + seconds
while (now := time.monotonic()) < end:
    message = cmd_motion_t()
    message.timestamp = int(time.time() * 1e6)
    message.speed, message.steering = (speed if state["ready"] and not lets_go(now) else 0.0), 0.0
    message.priority, message.source = 1, "second_host.py"
    try:
        bus.publish("LL_CMD_MOTION", message.encode())
    except OSError:
        pass                                                   # the link is down
    if state["ready"] and state["odo"]:
        tell("ready")
        if state["odo"].translation > 0.8 * speed:
            tell("moving", translation=state["odo"].translation)
        if now - state["heard"] > 1.0:
            state["silent"] = state["silent"] or now
            tell("silent")
    while (left := now + PERIOD - time.monotonic()) > 0:
        bus.handle_timeout(max(1, int(left * 1000)))
