"""The contract of a module, for modules in Python on the official LCM (docs/writing-a-module.md).

    class Watch(advee.Module):
        def __init__(self, args):
            super().__init__(args)
            self.subscribe("LL_DATA_POWER", data_power_t, self.on_power)

        def on_power(self, power):
            self.working()

    if __name__ == "__main__":
        advee.run(Watch, advee.arguments("watch").parse_args())

One loop serves the bus, timers and the module's own descriptors, and sends heartbeats; all handlers are called from it
and must return quickly: one that takes 200 ms is a hang. Around them the loop announces the state each second and on
change, obeys state commands by the table, reports each fault when it is raised and when it is cleared, lists the active
ones, and ends at TERMINATE, at SIGTERM, and when the watchdog that started it is gone without a successor. The output
of the official lcm-gen for messages/*.lcm is searched in PYTHONPATH and in the folder `types` beside this file. Needs
Python 3.9 and the package lcm; advee.hpp is the same in C++.
"""
import argparse
import enum
import os
import select
import signal
import socket
import struct
import sys
import threading
import time
import traceback

import lcm

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), "types"))
from common import cmd_level_t, cmd_state_t, data_faults_t, data_state_t, error_t, fault_t  # noqa: E402

ANNOUNCE = 1.0              # s between two announcements
BEAT = 0.05                 # s between two beats
LOOK = 0.5                  # s between two looks for the watchdog
ORPHANED = 6                # looks without its CM_DATA_PROCESSES: it is gone, and none came in its place
FAULTS_MAX = 256            # active faults in a list; further ones are not reported
TEXT_MAX = 512              # bytes of a subject or a message in a list
LEVELS = range(4)           # debug, info, warning, error; a severity is of the level above its value
REFUSALS = 1.0              # s at least between two reports of refused commands for the levels
BURST = 64                  # messages taken in one turn of the loop, so that a flood delays nothing else for long

# Exit codes: a class plus a number 0 to 16.
RESOURCE, DEVICE, OTHER = 0x10, 0x20, 0x40
# Fault numbers shared by all modules (docs/faults.md). A module's own numbers begin at 0x8001.
COMMAND_FORBIDDEN, MESSAGE_MALFORMED, UNHANDLED = 0x0001, 0x0002, 0x8000


class State(enum.IntEnum):
    """The states of a module, by their values on the wire."""
    UNKNOWN, INIT, STOP, RUN, ERROR, TERMINATE, PAUSE = range(7)


class Kind(enum.IntEnum):
    """Type of a fault."""
    UNKNOWN, TIMEOUT, RESOURCE, DEVICE = range(4)


class Severity(enum.IntEnum):
    """Severity: information, irregularity, work that is not being done."""
    NOTICE, WARNING, ERROR = range(3)


# Commands that are obeyed in each state: any, or only manual ones. TERMINATE is obeyed in all states.
ANY, MANUAL = (False, True), (True,)
COMMANDS = {
    State.INIT: {State.STOP: MANUAL},
    State.RUN: {State.PAUSE: ANY, State.STOP: MANUAL},
    State.PAUSE: {State.RUN: ANY, State.STOP: MANUAL},
    State.STOP: {State.RUN: MANUAL, State.PAUSE: MANUAL},
    State.ERROR: {State.STOP: MANUAL},
}

_EPOCH_NS = time.time_ns() - time.monotonic_ns()


def timestamp():
    """Current time for messages, µs since 1970; a step of the wall clock never turns it back."""
    return (_EPOCH_NS + time.monotonic_ns()) // 1000


def _clipped(text):
    """The text, truncated to the maximum length in a list."""
    return text.encode()[:TEXT_MAX].decode(errors="ignore").replace("\0", " ")


class _Arguments(argparse.ArgumentParser):
    def error(self, message):
        """Exits with RESOURCE for an invalid command line, because argparse's own code 2 is not in a class of ours."""
        self.exit(RESOURCE, f"{self.prog}: {message}\n")


def arguments(name, description=None):
    """The command line of a module: an argparse.ArgumentParser with the common arguments. The watchdog passes the same
    by the environment variables ADVEE_MODULE, ADVEE_STATE and LCM_DEFAULT_URL; arguments have priority."""
    def first_state(text):
        if text not in ("RUN", "PAUSE", "STOP"):
            raise argparse.ArgumentTypeError(f"{text}: expected RUN, PAUSE or STOP")
        return State[text]

    parser = _Arguments(description=description)
    parser.add_argument("--name", default=os.environ.get("ADVEE_MODULE") or name, help="its name on the bus")
    parser.add_argument("--state", type=first_state, default=os.environ.get("ADVEE_STATE") or "RUN",
                        help="its state after INIT: RUN, PAUSE or STOP")
    parser.add_argument("--lcm-url", default=os.environ.get("LCM_DEFAULT_URL") or "udpm://239.255.76.67:7667?ttl=0",
                        help="the LCM bus")
    return parser


def run(module, args):
    """Creates the module of this class, runs it, and ends the process with its exit code."""
    try:
        code = module(args).run()
    except Exception:  # of its constructor: it has not spoken yet
        traceback.print_exc()
        code = OTHER
    sys.exit(code)


class Beats:
    """The heartbeat page of this process (docs/beats.md). Without a page, when started by hand, it has no effect."""

    def __init__(self, path=os.environ.get("ADVEE_BEATS")):
        self._page, self._threads, self._lock = None, 0, threading.Lock()
        if path:
            try:
                self._page = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
            except OSError as error:
                print(f"no page of beats: {error}", file=sys.stderr)

    def thread(self, name):
        """Returns a function for the thread of that name to call in its loop at least each 50 ms; it does not block.
        From this call on silence is a hang, so make it when the loop begins. Maximum number of threads: 63."""
        if self._page is None:
            return lambda: None
        with self._lock:
            place = 64 + 64 * self._threads
            os.pwrite(self._page, struct.pack("<48sI12x", name.encode()[:48], 1), place)
            self._threads += 1
            # The number of threads last: an entry counts when it is complete.
            os.pwrite(self._page, struct.pack("<4sIII", b"BEAT", 1, os.getpid(), self._threads), 0)
        count, due = 1, time.monotonic() + BEAT

        def beat():
            nonlocal count, due
            now = time.monotonic()
            if now >= due:
                count, due = (count + 1) & 0xFFFFFFFF, now + BEAT
                os.pwrite(self._page, struct.pack("<I", count), place + 48)
        return beat

    def __bool__(self):
        return self._page is not None


class Module:
    """A module: derive from it, subscribe in the constructor, call working() when the device is there."""

    def __init__(self, args):
        """`args` are the arguments parsed by arguments()."""
        self.name, self.state, self.beats = args.name, State.INIT, Beats()
        self._wanted, self._before_error, self._failed = args.state, State.INIT, False
        self._send_from, self._refused, self._refusal = LEVELS[0], 0, -REFUSALS
        self._faults, self._timers, self._handlers, self._code = {}, [], {}, None
        self._poll = select.poll()
        try:
            self._lcm = lcm.LCM(args.lcm_url)
        except RuntimeError as error:
            print(f"{self.name}: LCM at {args.lcm_url}: {error}", file=sys.stderr)
            sys.exit(RESOURCE)
        self.subscribe("CM_CMD_STATE", cmd_state_t, self._on_command)
        self.subscribe("CM_CMD_LEVEL", cmd_level_t, self._on_level)
        self.watch(self._lcm.fileno(), self._on_bus)
        if "ADVEE_GUARDED" in os.environ:  # a watchdog has started us
            self._unheard = 0
            self._lcm.subscribe("CM_DATA_PROCESSES", self._on_watchdog)
            self.every(LOOK, self._look_for_watchdog)

    # --- for the module ---

    def on_state(self, state):
        """To be overridden: called after a change of state has been announced. In TERMINATE it is the last call."""

    @property
    def acts(self):
        """True if the module may act: only in RUN."""
        return self.state == State.RUN

    def subscribe(self, channel, message_type, handler):
        """Calls handler(message) for each message. A message of another type is dropped and reported once."""
        def decoded(_channel, data):
            try:
                message = message_type.decode(data)
            except (ValueError, struct.error, UnicodeDecodeError, IndexError, MemoryError) as error:
                text = f"{channel}: a message of {len(data)} bytes is dropped: {error}"
                self.fault(MESSAGE_MALFORMED, Kind.UNKNOWN, Severity.WARNING, text, channel)
            else:
                handler(message)
        self._lcm.subscribe(channel, decoded).set_queue_capacity(BURST)

    def publish(self, channel, message):
        """Publishes a message of a type generated by lcm-gen."""
        self._lcm.publish(channel, message.encode())

    def every(self, seconds, handler):
        """Calls handler() with this period; missed calls are dropped."""
        self._timers.append([time.monotonic() + seconds, seconds, handler])

    def in_step(self, handler):
        """Takes part in virtual time (advee up --sim --speed N): calls handler(timestamp) with the robot's time, µs,
        each 50 ms of it, and answers when the handler has returned; time does not pass on before. The `source` of its
        motion commands is to be the module's name. In real time the handler is called each second by a simulated
        robot, and never by a real one: use every() there."""
        from simulation import cmd_clock_t, data_clock_t
        done = None

        def on_clock(clock):
            nonlocal done
            if clock.timestamp != done:
                handler(clock.timestamp)
                done = clock.timestamp
            # A tick that comes again was not answered, as far as the robot knows.
            answer = cmd_clock_t()
            answer.timestamp = answer.tick = clock.timestamp
            answer.source = self.name
            self.publish("SIM_CMD_CLOCK", answer)
        self.subscribe("SIM_DATA_CLOCK", data_clock_t, on_clock)

    def watch(self, fileno, handler):
        """Calls handler() when this descriptor is readable."""
        self._handlers[fileno] = handler
        self._poll.register(fileno, select.POLLIN)

    def working(self):
        """Reports the device as present: leads out of INIT, and out of ERROR to the previous state. May be repeated."""
        self._failed = False
        if self.state == State.ERROR and self._before_error != State.INIT:
            self._enter(self._before_error)
        elif self.state in (State.INIT, State.ERROR):
            self._enter(self._wanted)

    def failed(self):
        """Reports the device as lost: ERROR, until working(). Keep trying. May be repeated."""
        self._failed = True
        if self.state in (State.INIT, State.RUN, State.PAUSE, State.STOP):
            self._before_error = self.state
            self._enter(State.ERROR)

    def fault(self, number, kind, severity, text, subject=""):
        """Raises a fault; reported once until clear(). The meaning of its number, 0x8001 or above, never changes;
        `subject` distinguishes faults of one number. Raised again, it is listed with the new severity and text."""
        active = self._faults.get((number, subject))
        if active is not None:
            news, active["severity"], active["message"] = active["severity"] != severity, severity, text
            if news:
                self._list(timestamp())
        elif len(self._faults) < FAULTS_MAX:
            since, sent = timestamp(), self._sends(severity)
            self._faults[number, subject] = {
                "kind": kind, "severity": severity, "since": since, "message": text, "sent": sent}
            self._list(since)
            if sent:
                self._report(number, kind, severity, text, since)

    def clear(self, number, text, subject=""):
        """Clears a fault; reported if it was active."""
        if (number, subject) in self._faults:
            now, active = timestamp(), self._faults.pop((number, subject))
            self._list(now)
            if active["sent"]:
                self._report(number, active["kind"], Severity.NOTICE, text, now)

    def fatal(self, number, kind, text, code=None):
        """Reports a fatal error, and ends with this exit code, or the kind's one. The watchdog restarts the module."""
        self._report(number, kind, Severity.ERROR, text, timestamp(), fatal=True)
        self._code = code or {Kind.RESOURCE: RESOURCE, Kind.DEVICE: DEVICE}.get(kind, OTHER)

    def end(self):
        """Ends the module in good order, as a TERMINATE command does."""
        if self.state != State.TERMINATE:
            self._enter(State.TERMINATE)
            if self._code is None:
                self._code = 0

    # --- the loop ---

    def run(self):
        """Runs until the module ends, and returns the exit code."""
        asked = (signal.SIGTERM, signal.SIGINT)
        wake, woken = socket.socketpair()  # a signal writes its number to the one, so that poll returns for the other
        for side in wake, woken:
            side.setblocking(False)
        signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
        for number in asked:
            signal.signal(number, lambda *_: None)
        self.watch(woken.fileno(), lambda: self.end() if set(asked) & set(woken.recv(64)) else None)
        try:
            self._announce_all()
            self.every(ANNOUNCE, self._announce_all)
            beat = self.beats.thread("main")
            while self._code is None:
                beat()
                self._serve_timers()
                if self._code is None:
                    for fileno, _ in self._poll.poll(self._wait_ms()):
                        self._handlers[fileno]()
        except Exception as error:
            traceback.print_exc()
            self.fatal(UNHANDLED, Kind.UNKNOWN, f"{type(error).__name__}: {error}", OTHER)
        return self._code

    def _wait_ms(self):
        due = min(timer[0] for timer in self._timers) - time.monotonic()
        return 1000 * max(0.0, min(due, BEAT) if self.beats else due)

    def _serve_timers(self):
        for timer in self._timers:
            late = time.monotonic() - timer[0]
            if late >= 0:
                timer[0] += timer[1] * (1 + late // timer[1])
                timer[2]()

    def _on_bus(self):
        for _ in range(BURST):
            if self._code is not None or not self._hear():
                return

    def _hear(self):
        """Dispatches one message, if there is one. LCM fails if a signal interrupts it: then it is tried again."""
        try:
            return self._lcm.handle_timeout(0)
        except OSError:
            return self._lcm.handle_timeout(0)

    def _on_watchdog(self, _channel, _data):
        self._unheard = 0

    def _look_for_watchdog(self):
        # Checks are counted, not seconds: a delayed process checks once, and then receives the queued messages.
        self._unheard += 1
        if self._unheard > ORPHANED:
            print(f"{self.name}: the watchdog is gone: it ends", file=sys.stderr)
            self.end()

    def _on_command(self, command):
        if command.module not in (self.name, "*") or command.state == self.state:
            return
        if command.state == State.TERMINATE:
            self.end()
        elif command.manual in COMMANDS.get(self.state, {}).get(command.state, ()):
            if self.state == State.INIT:
                self._wanted = State(command.state)
            self._enter(State(command.state))
            # A command led it through STOP out of ERROR; its device is still lost.
            if self._failed and self.state in (State.RUN, State.PAUSE):
                self.failed()
        elif command.state in list(State):
            manner = "manual " if command.manual else ""
            self._forbidden(f"{manner}command {State(command.state).name} from {command.source} refused in "
                            f"{self.state.name}")
        else:
            self._forbidden(f"command from {command.source} refused: {command.state} is no state")

    def _on_level(self, command):
        """Obeys a command for the level from which reports are sent. Its watchdog prints and sends its lines, and
        answers."""
        if command.module not in (self.name, "*"):
            return
        known = (cmd_level_t.UNCHANGED, cmd_level_t.CONFIGURED, *LEVELS)
        for value in (command.print_from, command.send_from):
            if value not in known:
                return self._refuse_level(value, command.source)
        if command.send_from == cmd_level_t.CONFIGURED:
            self._send_from = LEVELS[0]
        elif command.send_from != cmd_level_t.UNCHANGED:
            self._send_from = command.send_from

    def _refuse_level(self, value, source):
        """Counts a refused command for the levels, and reports at most one each second."""
        self._refused += 1
        if time.monotonic() - self._refusal < REFUSALS:
            return
        more = f"; {self._refused} refused since the last report" if self._refused > 1 else ""
        self._refused, self._refusal = 0, time.monotonic()
        self._forbidden(f"command from {source} refused: {value} is no level{more}")

    def _forbidden(self, text):
        if self._sends(Severity.WARNING):
            self._report(COMMAND_FORBIDDEN, Kind.UNKNOWN, Severity.WARNING, text, timestamp())

    def _sends(self, severity):
        return severity + 1 >= self._send_from

    def _enter(self, state):
        self.state = state
        self._announce()
        self.on_state(state)

    def _announce_all(self):
        self._announce()
        self._list(timestamp())

    def _list(self, now):
        """Publishes the active faults, before the report of the same moment, so that its subject is known."""
        message = data_faults_t()
        message.timestamp, message.module = now, self.name
        for (number, subject), active in sorted(self._faults.items()):
            fault = fault_t()
            fault.number, fault.subject, fault.severity = number, _clipped(subject), active["severity"]
            fault.since, fault.message = active["since"], _clipped(active["message"])
            message.faults.append(fault)
        message.count = len(message.faults)
        self.publish("CM_DATA_FAULTS", message)

    def _announce(self):
        message = data_state_t()
        message.timestamp, message.module, message.state = timestamp(), self.name, self.state
        self.publish("CM_DATA_STATE", message)

    def _report(self, number, kind, severity, text, now, fatal=False):
        caller = sys._getframe(2)
        message = error_t()
        message.timestamp, message.module, message.number, message.message = now, self.name, number, text
        message.fatal, message.type, message.severity = fatal, kind, severity
        message.file, message.line = os.path.basename(caller.f_code.co_filename), caller.f_lineno
        self.publish("CM_EVENT_ERROR", message)
