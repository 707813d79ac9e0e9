"""What every module of the robot does, for modules in Python on the official LCM (docs/writing-a-module.md).

    class Watch(advee.Module):
        def __init__(self, args):
            super().__init__(args)
            self.subscribe("LL_DATA_POWER", data_power_t, self.on_power)

        def on_power(self, power):
            self.working()

    if __name__ == "__main__":
        advee.run(Watch, advee.arguments("watch").parse_args())

One loop serves the bus, timers and the module's own descriptors, and beats; all handlers are called from it and must come
back soon: one that takes 200 ms is a hang. Around them the loop announces the state each second and on change, obeys state
commands by the table, reports a fault once and its end once and lists the active ones, ends at TERMINATE, at SIGTERM, and when the watchdog that
started it is gone for good. What the official lcm-gen makes of messages/*.lcm is looked for in PYTHONPATH and in the folder
`types` beside this file. Needs Python 3.9 and the package lcm; advee.hpp is the same in C++.
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
from common import cmd_state_t, data_faults_t, data_state_t, error_t, fault_t  # noqa: E402

ANNOUNCE = 1.0              # s between two announcements
BEAT = 0.05                 # s between two beats
LOOK = 0.5                  # s between two looks for the watchdog
ORPHANED = 6                # looks without its CM_DATA_PROCESSES: it is gone, and none came in its place
FAULTS_MAX = 256            # active faults in a list; further ones are not reported
TEXT_MAX = 512              # bytes of a subject or a message in a list
BURST = 64                  # messages taken in one turn of the loop, so that a flood delays nothing else for long

# Exit codes: a class plus a number 0 to 16.
RESOURCE, DEVICE, OTHER = 0x10, 0x20, 0x40
# Fault numbers that all modules share (docs/faults.md). A module's own begin at 0x8001.
COMMAND_FORBIDDEN, MESSAGE_MALFORMED, UNHANDLED = 0x0001, 0x0002, 0x8000


class State(enum.IntEnum):
    """The states of a module, by their values on the wire."""
    UNKNOWN, INIT, STOP, RUN, ERROR, TERMINATE, PAUSE = range(7)


class Kind(enum.IntEnum):
    """What a fault is about."""
    UNKNOWN, TIMEOUT, RESOURCE, DEVICE = range(4)


class Severity(enum.IntEnum):
    """How grave: news, not as it should be, work that is not being done."""
    NOTICE, WARNING, ERROR = range(3)


# Which commands are obeyed in which state: any, or only those of a person. TERMINATE is obeyed in all of them.
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
    """Now, in µs since 1970, for messages: no step of the clock turns it back."""
    return (_EPOCH_NS + time.monotonic_ns()) // 1000


def _clipped(text):
    """The beginning of a text, where it is too long for a list."""
    return text.encode()[:TEXT_MAX].decode(errors="ignore").replace("\0", " ")


class _Arguments(argparse.ArgumentParser):
    def error(self, message):
        """A command line that cannot be is a resource that is not there; argparse's own 2 is no class of ours."""
        self.exit(RESOURCE, f"{self.prog}: {message}\n")


def arguments(name, description=None):
    """The command line of a module: an argparse.ArgumentParser with what all have. The watchdog gives the same by the
    environment variables ADVEE_MODULE, ADVEE_STATE and LCM_DEFAULT_URL; an argument goes before."""
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
    """Makes the module of this class and runs it to its end; ends the process with its exit code."""
    try:
        code = module(args).run()
    except Exception:  # of its constructor: it has not spoken yet
        traceback.print_exc()
        code = OTHER
    sys.exit(code)


class Beats:
    """This process's page of beats (docs/beats.md). Without a page, when started by hand, all of it does nothing."""

    def __init__(self, path=os.environ.get("ADVEE_BEATS")):
        self._page, self._threads, self._lock = None, 0, threading.Lock()
        if path:
            try:
                self._page = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
            except OSError as error:
                print(f"no page of beats: {error}", file=sys.stderr)

    def thread(self, name):
        """A function for the thread of that name to call in its loop at least each 50 ms; it comes back at once. From
        this call on silence is a hang, so begin when the loop does. A page has room for 63 threads."""
        if self._page is None:
            return lambda: None
        with self._lock:
            place = 64 + 64 * self._threads
            os.pwrite(self._page, struct.pack("<48sI12x", name.encode()[:48], 1), place)
            self._threads += 1
            # The number of threads last: an entry counts when it is whole.
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
    """A module: derive from it, subscribe in the constructor, say working() when the device is there."""

    def __init__(self, args):
        """`args` are what arguments() has parsed."""
        self.name, self.state, self.beats = args.name, State.INIT, Beats()
        self._wanted, self._before_error, self._failed = args.state, State.INIT, False
        self._faults, self._timers, self._handlers, self._code = {}, [], {}, None
        self._poll = select.poll()
        try:
            self._lcm = lcm.LCM(args.lcm_url)
        except RuntimeError as error:
            print(f"{self.name}: LCM at {args.lcm_url}: {error}", file=sys.stderr)
            sys.exit(RESOURCE)
        self.subscribe("CM_CMD_STATE", cmd_state_t, self._on_command)
        self.watch(self._lcm.fileno(), self._on_bus)
        if "ADVEE_GUARDED" in os.environ:  # a watchdog has started us
            self._unheard = 0
            self._lcm.subscribe("CM_DATA_PROCESSES", self._on_watchdog)
            self.every(LOOK, self._look_for_watchdog)

    # --- for the module ---

    def on_state(self, state):
        """To be overridden: the state has changed, and that has been announced. In TERMINATE it is the last call."""

    @property
    def acts(self):
        """Whether it may act on the world: in RUN alone."""
        return self.state == State.RUN

    def subscribe(self, channel, message_type, handler):
        """Calls handler(message) for each message. One that is none of that type is dropped and reported once."""
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
        """Sends a message of a type that lcm-gen made."""
        self._lcm.publish(channel, message.encode())

    def every(self, seconds, handler):
        """Calls handler() each so many seconds; what was missed is dropped."""
        self._timers.append([time.monotonic() + seconds, seconds, handler])

    def watch(self, fileno, handler):
        """Calls handler() when this descriptor can be read."""
        self._handlers[fileno] = handler
        self._poll.register(fileno, select.POLLIN)

    def working(self):
        """The device is there: leads out of INIT, and out of ERROR to where that came from. May be said again."""
        self._failed = False
        if self.state == State.ERROR and self._before_error != State.INIT:
            self._enter(self._before_error)
        elif self.state in (State.INIT, State.ERROR):
            self._enter(self._wanted)

    def failed(self):
        """The device is lost: ERROR, until working(). Go on trying. May be said again."""
        self._failed = True
        if self.state in (State.INIT, State.RUN, State.PAUSE, State.STOP):
            self._before_error = self.state
            self._enter(State.ERROR)

    def fault(self, number, kind, severity, text, subject=""):
        """Reports a fault, once until clear(). Its number, 0x8001 or above, means one thing for good; `subject` tells
        faults of one number apart, where several things can have it. Raised again it is listed with the new severity and
        text."""
        active = self._faults.get((number, subject))
        if active is not None:
            news, active["severity"], active["message"] = active["severity"] != severity, severity, text
            if news:
                self._list(timestamp())
        elif len(self._faults) < FAULTS_MAX:
            since = timestamp()
            self._faults[number, subject] = {"kind": kind, "severity": severity, "since": since, "message": text}
            self._list(since)
            self._report(number, kind, severity, text, since)

    def clear(self, number, text, subject=""):
        """The fault stands no more: says so, if it was reported."""
        if (number, subject) in self._faults:
            now, kind = timestamp(), self._faults.pop((number, subject))["kind"]
            self._list(now)
            self._report(number, kind, Severity.NOTICE, text, now)

    def fatal(self, number, kind, text, code=None):
        """Reports why it cannot go on, and ends with this exit code, or that of the kind. The watchdog starts it again."""
        self._report(number, kind, Severity.ERROR, text, timestamp(), fatal=True)
        self._code = code or {Kind.RESOURCE: RESOURCE, Kind.DEVICE: DEVICE}.get(kind, OTHER)

    def end(self):
        """Ends in good order, as a TERMINATE command does."""
        if self.state != State.TERMINATE:
            self._enter(State.TERMINATE)
            if self._code is None:
                self._code = 0

    # --- the loop ---

    def run(self):
        """Runs until it ends, and returns the exit code."""
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
        """Hands on one message, if there is one. LCM gives up when a signal comes just then: so once more."""
        try:
            return self._lcm.handle_timeout(0)
        except OSError:
            return self._lcm.handle_timeout(0)

    def _on_watchdog(self, _channel, _data):
        self._unheard = 0

    def _look_for_watchdog(self):
        # Looks are counted, not seconds: one who was held up himself looks once, and then hears what has come.
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
            # It was led through STOP out of ERROR; its device is lost as before.
            if self._failed and self.state in (State.RUN, State.PAUSE):
                self.failed()
        elif command.state in list(State):
            manner = "manual " if command.manual else ""
            self._report(COMMAND_FORBIDDEN, Kind.UNKNOWN, Severity.WARNING, f"{manner}command "
                         f"{State(command.state).name} from {command.source} refused in {self.state.name}", timestamp())
        else:
            self._report(COMMAND_FORBIDDEN, Kind.UNKNOWN, Severity.WARNING,
                         f"command from {command.source} refused: {command.state} is no state", timestamp())

    def _enter(self, state):
        self.state = state
        self._announce()
        self.on_state(state)

    def _announce_all(self):
        self._announce()
        self._list(timestamp())

    def _list(self, now):
        """Says which faults are active; before the report of the same moment, which so is known by its subject."""
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
