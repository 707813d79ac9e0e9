"""CiA 402 drive on `canopen` (PyPI): `drive402.py PORT`. Its state machine is typed from the tables of CiA 402-2 and
refuses and counts every command that is invalid in its state. The controlword is evaluated in a cycle of 5 ms.

The line `fault` injects a fault; `report` prints the refused commands and the transitions since the last report."""
import json
import sys
import threading
import time

import canopen
from canopen.objectdictionary import ODRecord, ODVariable
from canopen.objectdictionary import INTEGER8, INTEGER16, INTEGER32, UNSIGNED8, UNSIGNED16, UNSIGNED32

NODE = 9
CYCLE = 0.005

# CiA 402-2, table of the controlword: mask, value. Bit 7 is separate: its rising edge resets a fault.
COMMANDS = (
    ("shutdown", 0x87, 0x06), ("switch on", 0x8F, 0x07), ("enable", 0x8F, 0x0F),
    ("disable voltage", 0x82, 0x00), ("quick stop", 0x86, 0x02),
)
# State: value of the statusword's bits 0 to 3, 5 and 6; commands: number of the transition and its target.
STATES = {
    "switch on disabled": (0x40, {"shutdown": (2, "ready")}),
    "ready": (0x21, {"switch on": (3, "switched on"), "disable voltage": (7, "switch on disabled"),
                     "quick stop": (7, "switch on disabled")}),
    "switched on": (0x23, {"enable": (4, "enabled"), "shutdown": (6, "ready"),
                           "disable voltage": (10, "switch on disabled"), "quick stop": (10, "switch on disabled")}),
    "enabled": (0x27, {"switch on": (5, "switched on"), "shutdown": (8, "ready"),
                       "disable voltage": (9, "switch on disabled"), "quick stop": (11, "quick stop active")}),
    "quick stop active": (0x07, {"disable voltage": (12, "switch on disabled")}),
    "fault reaction active": (0x0F, {}),
    "fault": (0x08, {}),
}
# Commands without effect in a state: those for the current state or a lower one.
IDLE = {
    "switch on disabled": {"disable voltage", "quick stop"},
    "ready": {"shutdown"},
    "switched on": {"switch on"},
    "enabled": {"enable"},
    "quick stop active": {"quick stop"},
    "fault reaction active": {"disable voltage", "quick stop"},
    "fault": {"disable voltage", "quick stop"},
}
PP, PV, HM = 1, 3, 6
# The home switch is active from here on; homing method 24 of the table: search upwards, its left edge.
HOME_SWITCH = 700


def dictionary():
    od = canopen.ObjectDictionary()

    def variable(index, sub, name, data_type, default, access="rw"):
        new = ODVariable(name, index, sub)
        new.data_type, new.access_type, new.default, new.pdo_mappable = data_type, access, default, index >= 0x6000
        return new

    def record(index, name, *members):
        new = ODRecord(name, index)
        new.add_member(variable(index, 0, "Highest sub-index", UNSIGNED8, max(m[0] for m in members), "rw"))
        for sub, data_type, default in members:
            new.add_member(variable(index, sub, f"{name} {sub}", data_type, default))
        od.add_object(new)

    for index, data_type, default, access in (
        (0x1000, UNSIGNED32, 0x00020192, "ro"), (0x1001, UNSIGNED8, 0, "ro"), (0x1017, UNSIGNED16, 0, "rw"),
        (0x603F, UNSIGNED16, 0, "ro"), (0x6040, UNSIGNED16, 0, "rw"), (0x6041, UNSIGNED16, 0, "ro"),
        (0x605A, INTEGER16, 2, "ro"), (0x6060, INTEGER8, 0, "rw"), (0x6061, INTEGER8, 0, "ro"),
        (0x6064, INTEGER32, 0, "ro"), (0x606C, INTEGER32, 0, "ro"), (0x607A, INTEGER32, 0, "rw"),
        (0x607C, INTEGER32, 0, "rw"), (0x6081, UNSIGNED32, 20000, "rw"), (0x6083, UNSIGNED32, 50000, "rw"),
        (0x6084, UNSIGNED32, 50000, "rw"), (0x6085, UNSIGNED32, 50000, "rw"), (0x6098, INTEGER8, 0, "rw"),
        (0x609A, UNSIGNED32, 50000, "rw"), (0x60FF, INTEGER32, 0, "rw"), (0x6502, UNSIGNED32, 0x25, "ro"),
    ):
        od.add_object(variable(index, 0, f"Object {index:04X}", data_type, default, access))
    record(0x1018, "Identity", *((sub, UNSIGNED32, value) for sub, value in enumerate((0xFEED, 402, 1, 1), 1)))
    record(0x6099, "Homing speeds", (1, UNSIGNED32, 2000), (2, UNSIGNED32, 500))
    for n, base in enumerate((0x200, 0x300)):
        record(0x1400 + n, f"RPDO {n}", (1, UNSIGNED32, base + NODE), (2, UNSIGNED8, 255))
        record(0x1600 + n, f"RPDO {n} mapping", *((sub, UNSIGNED32, 0) for sub in range(1, 9)))
        record(0x1800 + n, f"TPDO {n}", (1, UNSIGNED32, 0x40000000 | base - 0x80 + NODE), (2, UNSIGNED8, 255))
        record(0x1A00 + n, f"TPDO {n} mapping", *((sub, UNSIGNED32, 0) for sub in range(1, 9)))
        for index in (0x1600 + n, 0x1A00 + n):
            od[index][0].default = 0
    return od


class Drive:
    def __init__(self, port):
        self.lock = threading.RLock()
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.1
        self.network.connect(
            interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False
        )
        self.node = self.network.create_node(NODE, dictionary())
        self.network.subscribe(0, self.on_nmt)
        self.state, self.word, self.before = "switch on disabled", 0, 0
        self.position = self.velocity = 0.0
        self.goal, self.acknowledged, self.homing, self.reached = None, False, None, False
        self.refused, self.taken, self.status = [], [], None
        self.sent = 0.0

    def get(self, index, sub=0):
        variable = self.node.object_dictionary.get_variable(index, sub)
        return variable.decode_raw(self.node.get_data(index, sub))

    def set(self, index, value):
        variable = self.node.object_dictionary.get_variable(index, 0)
        self.node.data_store.setdefault(index, {})[0] = variable.encode_raw(value)

    def on_nmt(self, _, data, __):
        command, node = data[0], data[1]
        if node not in (0, NODE):
            return
        with self.lock:
            if command in (0x81, 0x82):
                self.node.data_store.clear()
                self.node.nmt.stop_heartbeat()
                self.node.nmt.state = "INITIALISING"
                self.node.nmt.state = "PRE-OPERATIONAL"
            elif command == 1:
                for pdo in (*self.node.rpdo.values(), *self.node.tpdo.values()):
                    pdo.read()
                for pdo in self.node.rpdo.values():
                    pdo.callbacks[:] = [self.on_pdo]
                self.status = None

    def on_pdo(self, pdo):
        """Set-points first: the controlword of a PDO acts on them."""
        with self.lock:
            for variable in sorted(pdo.map, key=lambda variable: variable.index == 0x6040):
                self.node.set_data(variable.index, variable.subindex, bytes(variable.get_data()))

    # The power state machine.

    def go(self, transition, state):
        self.taken.append(transition)
        self.state = state

    def command(self):
        self.before, self.word = self.word, self.get(0x6040)
        if self.word & ~self.before & 0x80:
            if self.state == "fault":
                self.set(0x603F, 0)
                self.go(15, "switch on disabled")
            else:
                self.refused.append([self.state, f"fault reset {self.word:04X}"])
            return
        if self.word & 0x80:
            return
        name = next((name for name, mask, value in COMMANDS if self.word & mask == value), None)
        transitions = STATES[self.state][1]
        if name in transitions:
            self.go(*transitions[name])
        elif name not in IDLE[self.state] and self.word != self.before:
            self.refused.append([self.state, f"{name} {self.word:04X}"])

    def fault(self):
        self.set(0x603F, 0x2310)
        self.go(13, "fault reaction active")
        self.node.emcy.send(0x2310, 0x03)

    # Motor without mass, ramps only.

    def ramp(self, target, rate):
        step = rate * CYCLE
        self.velocity += max(-step, min(step, target - self.velocity))

    def approach(self, target, speed):
        """Moves towards a position; returns True when it is reached."""
        left = target - self.position
        step = max(-speed * CYCLE, min(speed * CYCLE, left))
        self.position += step
        self.velocity = step / CYCLE
        return left == step

    def edge(self, bit):
        return self.word & ~self.before & 1 << bit

    def move(self):
        mode = self.get(0x6061)
        bits = 0
        if mode == PV:
            target = 0 if self.word & 0x100 else self.get(0x60FF)
            self.ramp(target, self.get(0x6083))
            self.position += self.velocity * CYCLE
            bits = (self.velocity == target) << 10 | (self.velocity == 0) << 12
        elif mode == PP:
            if self.edge(4) and not self.acknowledged:
                self.goal, self.acknowledged, self.reached = self.get(0x607A), True, False
                if self.word & 0x40:
                    self.goal += round(self.position)
            if not self.word & 0x10:
                self.acknowledged = False
            if self.goal is not None and not self.word & 0x100:
                self.reached = self.approach(self.goal, self.get(0x6081))
            bits = self.reached << 10 | self.acknowledged << 12
        elif mode == HM:
            if self.edge(4):
                self.homing = "search" if self.get(0x6098) == 24 else "error"
            elif not self.word & 0x10 and self.homing == "search":
                self.homing = "interrupted"
            if self.homing == "search":
                self.position += self.get(0x6099, 1) * CYCLE
                if self.position >= HOME_SWITCH:
                    self.position, self.homing = float(self.get(0x607C)), "done"
            bits = {None: 1 << 10, "interrupted": 1 << 10, "search": 0, "done": 1 << 12 | 1 << 10,
                    "error": 1 << 13 | 1 << 10}[self.homing]
        return bits

    def cycle(self):
        self.command()
        if self.get(0x6060) != self.get(0x6061):
            self.set(0x6061, self.get(0x6060))
            self.homing = self.goal = None
            self.reached = False
        bits = 0
        if self.state == "enabled":
            bits = self.move()
        else:
            self.goal, self.acknowledged, self.homing = None, False, None
            self.ramp(0, self.get(0x6085))
            self.position += self.velocity * CYCLE
        if self.velocity == 0 and self.state == "quick stop active":
            self.go(12, "switch on disabled")
        elif self.velocity == 0 and self.state == "fault reaction active":
            self.go(14, "fault")
        operational = self.node.nmt.state == "OPERATIONAL"
        power = self.state in ("switched on", "enabled", "quick stop active", "fault reaction active")
        status = STATES[self.state][0] | power << 4 | operational << 9 | bits
        self.set(0x6041, status)
        self.set(0x6064, round(self.position))
        self.set(0x606C, round(self.velocity))
        if operational:
            self.send(status)

    def send(self, status):
        now = time.monotonic()
        changed = (status, self.get(0x6061)) != self.status
        if changed or now > self.sent + 0.02:
            self.status, self.sent = (status, self.get(0x6061)), now
            for pdo in self.node.tpdo.values():
                for variable in pdo.map:
                    variable.raw = self.get(variable.index)
                if pdo.map:
                    pdo.transmit()

    def run(self, over):
        due = time.monotonic()
        while not over.is_set():
            with self.lock:
                self.cycle()
            due = max(due + CYCLE, time.monotonic() - CYCLE)
            time.sleep(max(0, due - time.monotonic()))


def main(port):
    drive, over = Drive(port), threading.Event()
    motor = threading.Thread(target=drive.run, args=(over,))
    motor.start()
    print("ready", flush=True)
    for line in sys.stdin:
        match line.strip():
            case "fault":
                with drive.lock:
                    drive.fault()
            case "report":
                with drive.lock:
                    print("report", json.dumps([drive.refused, drive.taken]), flush=True)
                    drive.refused.clear()
                    drive.taken.clear()
            case "quit":
                break
    over.set()
    motor.join()
    drive.network.disconnect()


main(int(sys.argv[1]))
