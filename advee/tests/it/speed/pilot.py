"""A program in step with a robot in virtual time: `pilot.py LCM_URL`. At each SIM_DATA_CLOCK it works for 20 ms, sends
a motion command, and answers. After 100 ticks in step it prints their number, and how many it missed in between, as
JSON, and goes on."""
import json
import sys
import time

import lcm
from lowlevel import cmd_motion_t
from simulation import cmd_clock_t, data_clock_t, data_run_t

TICK_US = 50_000
COUNT = 100
# Answers until those ticks are done that waited for it when it joined, in its queue and in that of the socket.
JOINING = 20
bus = lcm.LCM(sys.argv[1])
newest = 0
joined = False


def on_clock(_channel, data):
    global newest
    newest = max(newest, data_clock_t.decode(data).timestamp)


def on_run(_channel, data):
    global joined
    joined = "pilot" in data_run_t.decode(data).in_step


def answer(now):
    message = cmd_clock_t()
    message.timestamp, message.tick, message.source = now, now, "pilot"
    bus.publish("SIM_CMD_CLOCK", message.encode())


def drive(now):
    command = cmd_motion_t()
    command.timestamp, command.speed, command.priority, command.source = now, 0.3, 1, "pilot"
    bus.publish("LL_CMD_MOTION", command.encode())


bus.subscribe("SIM_DATA_CLOCK", on_clock)
bus.subscribe("SIM_DATA_RUN", on_run)
last = answers = ticks = missed = 0
while True:
    bus.handle()
    # Ticks from before it joined wait, too: the newest counts.
    while bus.handle_timeout(0) > 0:
        pass
    if newest > last:
        time.sleep(0.02)
        # Motion commands of a program that has not answered yet are refused.
        if last > 0:
            drive(newest)
        answers += joined
        if answers > JOINING:
            ticks += 1
            missed += (newest - last) // TICK_US - 1
        last = newest
        if ticks == COUNT:
            print(json.dumps({"ticks": ticks, "missed": missed}), flush=True)
    # A tick that comes again was lost, or its answer.
    answer(last)
