"""Actions that a module in Python offers: HL_CMD_ACTION and HL_DATA_ACTION (docs/highlevel.md).

    class Greeter(actions.Performer):
        def __init__(self, args):
            super().__init__(args)
            self.offer("greet", self.on_greet)
            self.every(0.1, self.working)   # it needs no device

        def on_greet(self, action):
            name = action.text("name")
            action.succeed(f"greeted {name}")

The helper answers each command, rejects those beyond the limits and those that come while the module is not in RUN,
repeats the status each second, knows repeated commands by their id, and fails what is under way when the module leaves
RUN. All calls come from the module's loop, and all methods are called from it. actions.hpp is the same in C++.
"""
import math
import re
import time

import advee
from advee import Kind, Severity, State
from highlevel import cmd_action_t, data_action_t

ID, NAME = re.compile(r"[!-~]{1,128}"), re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,63}")
PARAMETERS_MAX, VALUE_MAX = 32, 4096    # parameters of a command; bytes of a value
PERIOD = 1.0                            # s between two statuses of an action that lasts
AGAIN = 0.1                             # s at least between two statuses that differ in the progress alone
ENDS = 3                                # times that an end is published
UNDER_WAY_MAX = 16                      # actions at a time; further ones are rejected
ENDED_MAX = 64                          # actions that have ended and are known by their id

ACCEPTED, RUNNING, SUCCEEDED, FAILED, CANCELLED, REJECTED = (getattr(data_action_t, status) for status in (
    "ACCEPTED", "RUNNING", "SUCCEEDED", "FAILED", "CANCELLED", "REJECTED"))


class Rejected(Exception):
    """To be raised when an action is about to begin: it is rejected, with this reason."""


class Action:
    """An action that was commanded: its id, its name, and its parameters, a dictionary of texts."""

    def __init__(self, performer, command):
        self.id, self.name = command.id, command.name
        self.parameters = {parameter.name: parameter.value for parameter in command.parameters}
        self.status, self.progress, self.message, self.cancelling = ACCEPTED, math.nan, "", False
        self._performer, self._published, self._ends, self._lost = performer, -math.inf, 0, None

    @property
    def over(self):
        """True once it has ended."""
        return self.status >= SUCCEEDED

    def text(self, name, default=None):
        """Returns a parameter; without it and without a default the action is rejected."""
        value = self.parameters.get(name, default)
        if value is None:
            raise Rejected(f"parameter {name} is missing")
        return value

    def number(self, name, low, high, default=None):
        """Returns a parameter as a number from low to high, else the action is rejected; a default needs no limits."""
        if name not in self.parameters and default is not None:
            return default
        try:
            value = float(self.text(name))
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise Rejected(f"parameter {name} is no number from {low:g} to {high:g}")
        return value

    def run(self, progress=math.nan, message=""):
        """Reports that it is under way: progress 0 to 1, or NaN if that is not known; what is done now."""
        self._change(RUNNING, progress, message)

    def succeed(self, message=""):
        """Ends it: it has reached its aim."""
        self._change(SUCCEEDED, 1.0, message)

    def fail(self, message):
        """Ends it: it has not reached its aim, for this reason."""
        self._change(FAILED, self.progress, message)

    def cancelled(self, message=""):
        """Ends it because it was cancelled; as FAILED where that was because the module left RUN."""
        if self._lost:
            self.fail(self._lost)
        else:
            self._change(CANCELLED, self.progress, message)

    def _reject(self, message):
        """Rejects it; after its start it has failed."""
        self._change(REJECTED if self.status == ACCEPTED else FAILED, self.progress, message)

    def _change(self, status, progress, message):
        """Changes the status. After the end nothing changes; a new progress alone is not published too often."""
        if self.over:
            return
        news = (self.status, self.message) != (status, message)
        self.status, self.message = status, message
        self.progress = progress if 0.0 <= progress <= 1.0 else math.nan
        if news or time.monotonic() - self._published >= AGAIN:
            self._publish()
        if self.over:
            self._ends = ENDS - 1
            self._performer._ended(self)

    def _publish(self):
        self._published = time.monotonic()
        message = data_action_t()
        message.timestamp, message.id, message.status = advee.timestamp(), self.id, self.status
        message.progress, message.message = self.progress, advee._clipped(self.message)
        self._performer.publish("HL_DATA_ACTION", message)

    def _answer(self):
        """Publishes the status for a repeated command."""
        if time.monotonic() - self._published >= AGAIN:
            self._publish()

    def _repeat(self):
        """Called each period."""
        if not self.over or self._ends > 0:
            self._ends -= 1 if self.over else 0
            self._publish()


class Performer(advee.Module):
    """A module that offers actions: call offer() in the constructor."""

    def __init__(self, args):
        super().__init__(args)
        self._offers, self._under_way, self._over = {}, {}, {}
        self.subscribe("HL_CMD_ACTION", cmd_action_t, self._on_action)
        self.every(PERIOD, self._repeat)

    # --- for the module ---

    def offer(self, name, begin, cancel=None):
        """Offers the action of this name. begin(action) is called for each one, in RUN: it starts the work, or raises
        Rejected, and returns quickly; action.run() reports progress, succeed(), fail() or cancelled() its end, then or
        later. cancel(action) is called once when it is cancelled, and when the module leaves RUN: what is under way is
        stopped, and action.cancelled() called as soon as it is; without cancel that is at once."""
        if not NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no name of an action")
        self._offers[name] = begin, cancel

    @property
    def actions(self):
        """The actions under way, in the order of their commands."""
        return list(self._under_way.values())

    # --- the contract ---

    def _on_action(self, command):
        if not ID.fullmatch(command.id):
            self.fault(advee.MESSAGE_MALFORMED, Kind.UNKNOWN, Severity.WARNING,
                       "HL_CMD_ACTION: a command without a valid id is dropped", "HL_CMD_ACTION")
            return
        action = self._under_way.get(command.id) or self._over.get(command.id)
        if action is not None:
            if command.cancel and not action.over:
                self._cancel(action)
            action._answer()
        elif command.name in self._offers:
            self._begin(Action(self, command), command)

    def _begin(self, action, command):
        self._under_way[action.id] = action
        if command.cancel:
            action.cancelled("it was not under way")
            return
        reason = self._objection(command)
        if reason:
            action._reject(reason)
            return
        try:
            self._offers[action.name][0](action)
        except Rejected as rejected:
            action._reject(str(rejected))
        if action._published == -math.inf:  # its work has begun without a report
            action._publish()

    def _objection(self, command):
        """The reason for which a command is rejected, if there is one."""
        names = [parameter.name for parameter in command.parameters]
        if not self.acts:
            return f"{self.name} is in {self.state.name}"
        if len(self._under_way) > UNDER_WAY_MAX:
            return f"{self.name} has {UNDER_WAY_MAX} actions under way"
        if len(names) > PARAMETERS_MAX:
            return f"{len(names)} parameters are more than {PARAMETERS_MAX}"
        if len(set(names)) < len(names) or not all(map(NAME.fullmatch, names)):
            return "a parameter has no valid name, or that of another one"
        if any(len(parameter.value.encode()) > VALUE_MAX for parameter in command.parameters):
            return f"the value of a parameter has more than {VALUE_MAX} bytes"
        return None

    def _cancel(self, action):
        if action.cancelling:
            return
        action.cancelling = True
        cancel = self._offers[action.name][1]
        if cancel is None:
            action.cancelled()
        else:
            cancel(action)

    def _ended(self, action):
        """Keeps an action that has ended, instead of the oldest one."""
        self._under_way.pop(action.id, None)
        self._over[action.id], action.parameters = action, {}
        if len(self._over) > ENDED_MAX:
            del self._over[next(iter(self._over))]

    def _repeat(self):
        for action in [*self._under_way.values(), *self._over.values()]:
            action._repeat()

    def _enter(self, state):
        if state != State.RUN:
            for action in self.actions:
                action._lost = f"{self.name} is in {state.name}"
                self._cancel(action)
                action.cancelled()
        super()._enter(state)
