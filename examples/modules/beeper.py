#!/usr/bin/env python3
"""A module in Python on the official LCM: beeps the faster the nearer the nearest thing is, as a car does that parks.

    pip install lcm
    lcm-gen -p --ppath build messages/*/*.lcm
    PYTHONPATH=build python3 examples/modules/beeper.py [NAME]

It does what every module does: announces its state on CM_DATA_STATE each second and on change, obeys CM_CMD_STATE by the
table of states, reports on CM_EVENT_ERROR what is wrong and that it is well again, and ends at TERMINATE or SIGTERM with
status 0. Its device are the sonars, LL_DATA_SRFS; while the PAUSE line, LL_EVENT_STOP, holds the robot it is silent.
beeper.cpp is the same in C++.
"""
import math
import select
import signal
import sys
import time

import lcm
from common import cmd_state_t, data_state_t, error_t
from lowlevel import data_srfs_t, event_stop_t

NEAR = 1.0                          # m: things further away are not worth a beep
FASTEST = 0.1                       # s between two beeps; otherwise a second a metre
SILENT = 1.0                        # s without LL_DATA_SRFS: the sonars are lost
ANNOUNCE = 1.0                      # s between two announcements
FORBIDDEN, SONARS_SILENT = 0x0001, 0x8001  # docs/faults.md; from 0x8000 on each module's own

State = data_state_t
NAMES = {getattr(State, name): name for name in ("INIT", "STOP", "RUN", "ERROR", "TERMINATE", "PAUSE")}
# Which commands are obeyed in which state: to any command, or only to a manual one.
ANY, MANUAL = {False, True}, {True}
COMMANDS = {
    State.INIT: {State.STOP: MANUAL},
    State.RUN: {State.PAUSE: ANY, State.STOP: MANUAL},
    State.PAUSE: {State.RUN: ANY, State.STOP: MANUAL},
    State.STOP: {State.RUN: MANUAL, State.PAUSE: MANUAL},
    State.ERROR: {State.STOP: MANUAL},
}
# Timestamps are wall-clock time that no clock step turns back.
EPOCH_NS = time.time_ns() - time.monotonic_ns()


def timestamp():
    return (EPOCH_NS + time.monotonic_ns()) // 1000


class Beeper:
    def __init__(self, name):
        self.name, self.state = name, State.INIT
        self.before_error = State.RUN               # where recovery leads
        self.lost = False                           # the sonars, as reported
        self.nearest, self.held = math.inf, False
        now = time.monotonic()
        self.heard, self.announce_at, self.beep_at = now, now, now
        self.bus = lcm.LCM()                        # LCM_DEFAULT_URL, or LCM's default
        self.bus.subscribe("CM_CMD_STATE", self.on_command)
        self.bus.subscribe("LL_DATA_SRFS", self.on_sonars)
        self.bus.subscribe("LL_EVENT_STOP", self.on_pause_line)

    def run(self):
        while self.state != State.TERMINATE:
            self.on_time(time.monotonic())
            due = [self.announce_at, self.beep_at if self.wants_to_beep() else math.inf]
            due.append(math.inf if self.lost else self.heard + SILENT)
            readable, _, _ = select.select([self.bus], [], [], max(0, min(due) - time.monotonic()))
            if readable:
                self.bus.handle()

    def on_time(self, now):
        if now >= self.announce_at:
            self.announce()
        if not self.lost and now >= self.heard + SILENT:
            self.lost, self.nearest = True, math.inf
            self.report(SONARS_SILENT, error_t.TIMEOUT, error_t.ERROR, "no LL_DATA_SRFS: the sonars are silent")
            self.fail()
        if self.wants_to_beep() and now >= self.beep_at:
            print(f"\abeep {self.nearest:.2f} m", flush=True)
            self.beep_at = now + max(FASTEST, self.nearest)

    def wants_to_beep(self):
        return self.state == State.RUN and not self.held and self.nearest < NEAR

    def on_sonars(self, _channel, data):
        ranges = data_srfs_t.decode(data).srfs
        self.nearest = min((found.distance for found in ranges if found.valid), default=math.inf)
        self.heard = time.monotonic()
        if self.lost:
            self.lost = False
            self.report(SONARS_SILENT, error_t.TIMEOUT, error_t.NOTICE, "the sonars are heard again")
        if self.state == State.INIT:
            self.enter(State.RUN)
        elif self.state == State.ERROR:
            self.enter(self.before_error)

    def on_pause_line(self, _channel, data):
        self.held = event_stop_t.decode(data).engaged

    def on_command(self, _channel, data):
        command = cmd_state_t.decode(data)
        if command.module not in (self.name, "*") or command.state == self.state:
            return
        if command.state == State.TERMINATE or command.manual in COMMANDS[self.state].get(command.state, ()):
            self.enter(command.state)
            if self.lost:
                self.fail()
        else:
            to = NAMES.get(command.state, command.state)
            self.report(FORBIDDEN, error_t.UNKNOWN, error_t.WARNING,
                        f"command {to} from {command.source} refused in {NAMES[self.state]}")

    def fail(self):
        if self.state in (State.INIT, State.RUN, State.PAUSE):
            self.before_error = State.RUN if self.state == State.INIT else self.state
            self.enter(State.ERROR)

    def enter(self, state):
        self.state = state
        self.announce()

    def announce(self):
        self.announce_at = time.monotonic() + ANNOUNCE
        message = data_state_t()
        message.timestamp, message.module, message.state = timestamp(), self.name, self.state
        self.bus.publish("CM_DATA_STATE", message.encode())

    def report(self, number, kind, severity, text):
        caller = sys._getframe(1)
        message = error_t()
        message.timestamp, message.module, message.number, message.message = timestamp(), self.name, number, text
        message.type, message.severity = kind, severity
        message.file, message.line = "beeper.py", caller.f_lineno
        self.bus.publish("CM_EVENT_ERROR", message.encode())


beeper = Beeper(sys.argv[1] if len(sys.argv) > 1 else "beeper")
signal.signal(signal.SIGTERM, lambda *_: sys.exit())
try:
    beeper.run()
except (SystemExit, KeyboardInterrupt):
    beeper.enter(State.TERMINATE)
