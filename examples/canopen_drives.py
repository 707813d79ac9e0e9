#!/usr/bin/env python3
"""CiA 402 drives on a CAN bus, each made of an EDS or DCF: to try a data sheet without its drive.

    pip install canopen python-can msgpack
    python3 examples/canopen_drives.py udp:239.74.163.2:43113 1=wheel.eds 2=wheel.eds

The bus is `udp:GROUP:PORT`, or a network interface for SocketCAN: `vcan0`. The objects, their access, types and limits
are those of the sheet; SDO, NMT, heartbeat and PDOs are of CANopen for Python. Behind them are the power state machine
of CiA 402, profile velocity with the ramps of 0x6083 to 0x6085, and the loss of the master by 0x1016 and 0x6007.
Velocity and ramps are in the drive's own units, the ramps per second; the position (0x6064) does not move.

Prints a line for each event: monotonic time in s, node, event. The line `fault NODE` on standard input makes it fail.
"""
import signal
import sys
import threading
import time

try:
    import canopen
    from canopen.profiles.p402 import State402
    from canopen.sdo import SdoAbortedError
except ModuleNotFoundError as error:
    sys.exit(f"{error}: pip install canopen python-can msgpack; or .venv/bin/python, which make test fills")

CYCLE = 0.005
PRINTS = threading.Lock()
PROFILE_VELOCITY = 3
ABORT_HIGH, ABORT_LOW, ABORT_STATE, ABORT_VALUE = (
    0x06090031, 0x06090032, 0x08000022, 0x06090030)
# CiA 402-2, table of the controlword: mask, value. Bit 7 is separate: its rising edge resets a fault.
COMMANDS = (
    ("shutdown", 0x87, 0x06), ("switch on", 0x8F, 0x07), ("enable operation", 0x8F, 0x0F),
    ("disable voltage", 0x82, 0x00), ("quick stop", 0x86, 0x02),
)
DISABLED, READY, ON, ENABLED, STOPPING, REACTING, FAULT = (
    "SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "QUICK STOP ACTIVE",
    "FAULT REACTION ACTIVE", "FAULT")
TRANSITIONS = {
    DISABLED: {"shutdown": READY},
    READY: {"switch on": ON, "disable voltage": DISABLED, "quick stop": DISABLED},
    ON: {"enable operation": ENABLED, "shutdown": READY, "disable voltage": DISABLED, "quick stop": DISABLED},
    ENABLED: {"switch on": ON, "shutdown": READY, "disable voltage": DISABLED, "quick stop": STOPPING},
    STOPPING: {"disable voltage": DISABLED},
    REACTING: {},
    FAULT: {},
}
# Commands without effect in a state: those that ask for no more than what is.
IDLE = {
    DISABLED: ("disable voltage", "quick stop"), READY: ("shutdown",), ON: ("switch on",),
    ENABLED: ("enable operation",), STOPPING: ("quick stop",), REACTING: ("disable voltage", "quick stop"),
    FAULT: ("disable voltage", "quick stop"),
}


def sheet(file, node):
    """The objects of a data sheet. A DCF describes one node: for another one the values of its device do not hold."""
    try:
        od = canopen.import_od(file, node)
    except Exception as error:  # Of several kinds, by what it stumbles over.
        sys.exit(f"{file}: CANopen for Python cannot load it: {error!r}")
    if od.node_id not in (None, node):
        # Without its own node id the values of $NODEID are those of this node.
        for group in od.values():
            for variable in [group] if isinstance(group, canopen.objectdictionary.ODVariable) else group.values():
                variable.value = None if variable.default is not None else variable.value
    return od


class Drive:
    def __init__(self, network, number, file):
        self.network, self.number, self.lock = network, number, threading.RLock()
        self.node = canopen.LocalNode(number, sheet(file, number))
        #: Any other device has its objects, and moves nothing.
        self.is_drive = all(index in self.node.object_dictionary for index in (0x6040, 0x6041, 0x60FF, 0x606C))
        self.begin()
        self.node.add_write_callback(self.on_write)
        # A master may be waiting: from here on its frames arrive.
        with self.lock:
            network.add_node(self.node)
            # After the node's own handler, which changes the state.
            network.subscribe(0, self.on_nmt)
            network.subscribe(0x80, self.on_sync)
            self.boot()

    def begin(self):
        """State after power-on, or a reset of the application."""
        self.node.data_store.clear()
        self.state, self.word, self.words, self.velocity = DISABLED, 0, [], 0.0
        self.target, self.reached = None, 0
        self.masters, self.received, self.sent, self.syncs = {}, {}, {}, 0
        for index in (0x603F, 0x6040, 0x6061, 0x6064, 0x606C, 0x60FF):
            self.put(index, 0)

    def begin_communication(self):
        """State after a reset of the communication: the motor keeps its own."""
        for index in [index for index in self.node.data_store if 0x1000 <= index < 0x2000]:
            del self.node.data_store[index]
        self.masters, self.received, self.sent, self.syncs = {}, {}, {}, 0
        self.abort()

    def boot(self):
        self.node.nmt.state = "INITIALISING"
        try:
            self.node.nmt.state = "PRE-OPERATIONAL"
        except KeyError:
            # The state is that: what is missing is 0x1017.
            pass

    def say(self, *words):
        """Prints a line in one piece: several threads do."""
        with PRINTS:
            sys.stdout.write(" ".join(map(str, (f"{time.monotonic():.4f}", self.number, *words))) + "\n")
            sys.stdout.flush()

    # Objects.

    def get(self, index, sub=0, absent=None):
        """Value of an object; `absent` where the sheet has no such object, or no value of it."""
        try:
            return self.node.object_dictionary.get_variable(index, sub).decode_raw(self.node.get_data(index, sub))
        except (SdoAbortedError, AttributeError):
            return absent

    def put(self, index, value):
        """Writes an object as the device itself does, whatever its access; one that it has."""
        variable = self.node.object_dictionary.get_variable(index, 0)
        if variable is not None:
            self.node.data_store.setdefault(index, {})[0] = variable.encode_raw(value)

    def on_write(self, index, subindex, od, data):
        """Refuses what a device of this sheet would refuse."""
        value = od.decode_raw(data) if od.data_type in canopen.objectdictionary.INTEGER_TYPES else None
        if value is not None and od.max is not None and value > od.max:
            raise SdoAbortedError(ABORT_HIGH)
        if value is not None and od.min is not None and value < od.min:
            raise SdoAbortedError(ABORT_LOW)
        match index:
            case 0x6060 if value not in (0, PROFILE_VELOCITY):
                raise SdoAbortedError(ABORT_VALUE)
            case 0x1016 if subindex:
                self.watch(value)
            case 0x6040:
                # A command is taken when it arrives: one that is in effect does not undo a stop of the drive itself.
                self.words.append(value)
            case _ if 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00:
                # CiA 301, 7.5.2.36: a mapping is changed while its PDO is invalid, its entries while there are none.
                valid = not self.get(index & ~0x200, 1, 0) & 1 << 31
                if valid or subindex and self.get(index, 0, 0):
                    raise SdoAbortedError(ABORT_STATE)

    # The master.

    def watch(self, entry):
        master, limit = entry >> 16 & 0x7F, (entry & 0xFFFF) / 1000
        if not master or not limit:
            self.masters.clear()
            return
        self.masters[master] = limit
        self.received.pop(master, None)
        self.network.subscribe(0x700 + master, self.on_heartbeat)

    def on_heartbeat(self, can_id, _, __):
        with self.lock:
            self.received[can_id - 0x700] = time.monotonic()

    def check_master(self):
        for master, limit in self.masters.items():
            at = self.received.get(master)
            if at is not None and time.monotonic() - at > limit:
                del self.received[master]
                self.say("master lost")
                self.node.emcy.send(0x8130, self.get(0x1001, 0, 0))
                self.abort()
                if self.get(0x1029, 1, 0) == 0 and self.node.nmt.state == "OPERATIONAL":
                    self.node.nmt.state = "PRE-OPERATIONAL"

    def abort(self):
        """The connection is aborted: 0x6007, a fault where there is none."""
        powered = self.state in (ON, ENABLED)
        match self.get(0x6007, 0, 1):
            case 1 if powered:
                self.fault(0x8130)
            case 2 if powered:
                self.go(DISABLED)
            case 3 if powered:
                self.go(STOPPING if self.state == ENABLED else DISABLED)

    def on_nmt(self, _, data, __):
        command, node = data[0], data[1]
        if node not in (0, self.number):
            return
        with self.lock:
            if command in (0x81, 0x82):
                self.node.nmt.stop_heartbeat()
                self.begin() if command == 0x81 else self.begin_communication()
                self.boot()
            elif command == 1:
                self.map_pdos()
            elif command in (2, 0x80):
                self.abort()
            self.say("nmt", self.node.nmt.state.lower())

    # PDOs.

    def map_pdos(self):
        for pdo in self.node.rpdo.values():
            if pdo.callbacks and pdo.enabled:
                self.network.unsubscribe(pdo.cob_id, pdo.on_message)
            pdo.read()
            pdo.callbacks[:] = [self.on_pdo]
        for pdo in self.node.tpdo.values():
            pdo.read()
        self.sent, self.syncs = {}, 0

    def on_pdo(self, pdo):
        """Takes the set-points first: the controlword acts on them."""
        with self.lock:
            if self.node.nmt.state != "OPERATIONAL":
                return
            for variable in sorted(pdo.map, key=lambda variable: variable.index == 0x6040):
                try:
                    self.node.set_data(variable.index, variable.subindex, bytes(variable.get_data()))
                except SdoAbortedError as error:
                    self.say("refused", f"0x{variable.index:04X}", error)

    def on_sync(self, _, __, ___):
        with self.lock:
            self.syncs += 1
            self.send(lambda pdo: 1 <= pdo.trans_type <= 240 and self.syncs % pdo.trans_type == 0)

    def send(self, due):
        """Sends the TPDOs that are due."""
        if self.node.nmt.state != "OPERATIONAL":
            return
        for number, pdo in self.node.tpdo.items():
            if pdo.enabled and pdo.map and due(pdo):
                for variable in pdo.map:
                    variable.raw = self.get(variable.index, variable.subindex, 0)
                now, (at, data) = time.monotonic(), self.sent.get(number, (0.0, None))
                event = pdo.trans_type >= 254
                if not event or data != pdo.data and now - at >= (pdo.inhibit_time or 0) / 10_000:
                    self.sent[number] = now, bytes(pdo.data)
                    pdo.transmit()

    # The power state machine.

    def go(self, state):
        self.state = state
        self.say("state", state.lower())

    def command(self, word):
        before, self.word = self.word, word
        if self.word & ~before & 0x80 and self.state == FAULT:
            self.go(DISABLED)
        if self.word & 0x80:
            return
        name = next((name for name, mask, value in COMMANDS if self.word & mask == value), None)
        follows = dict(TRANSITIONS[self.state])
        if self.state == STOPPING and self.stays():
            follows["enable operation"] = ENABLED
        if name in follows:
            self.go(follows[name])
        elif self.word != before and name not in IDLE[self.state]:
            self.say("refused", f"{name} ({self.word:04X})", "in", self.state.lower())

    def fault(self, code):
        if self.state in (REACTING, FAULT):
            return
        self.put(0x603F, code)
        self.go(REACTING)
        self.node.emcy.send(code, 1)

    def stays(self):
        """True if the quick stop option keeps the drive in Quick Stop Active."""
        return self.get(0x605A, 0, 2) >= 5

    # Motor without mass, ramps only.

    def ramp(self, target, rate):
        step = (rate or 1e9) * CYCLE
        self.velocity += max(-step, min(step, target - self.velocity))

    def move(self):
        quick = 0x6084 if self.get(0x605A, 0, 2) in (1, 5) else 0x6085
        target = self.get(0x60FF) if self.state == ENABLED and not self.word & 0x100 else 0
        target = target if self.get(0x6061) == PROFILE_VELOCITY else 0
        slower = abs(target) < abs(self.velocity) or target * self.velocity < 0
        index = quick if self.state in (STOPPING, REACTING) else 0x6084 if slower else 0x6083
        self.ramp(target, self.get(index))
        reached = target if self.velocity == target else None
        if self.state == ENABLED and target != self.target:
            self.say("target", target)
        if self.velocity == 0 and self.state == STOPPING and not self.stays():
            self.go(DISABLED)
        elif self.velocity == 0 and self.state == REACTING:
            self.go(FAULT)
        self.target = target if self.state == ENABLED else None
        if reached is not None and self.reached != reached:
            self.say("velocity", reached)
        self.reached = reached

    def statusword(self):
        powered = self.state in (ON, ENABLED, STOPPING, REACTING)
        operational = self.node.nmt.state == "OPERATIONAL"
        in_mode = self.state == ENABLED
        return (State402.SW_MASK[self.state][1] | powered << 4 | operational << 9
                | (in_mode and self.reached is not None) << 10 | (in_mode and self.velocity == 0) << 12)

    def cycle(self):
        with self.lock:
            self.check_master()
            if not self.is_drive:
                return
            while self.words:
                self.command(self.words.pop(0))
            self.put(0x6061, self.get(0x6060, 0, 0))
            self.move()
            self.put(0x6041, self.statusword())
            self.put(0x606C, round(self.velocity))
            self.send(lambda pdo: pdo.trans_type >= 254)


def connect(bus):
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.1
    kind, _, rest = bus.partition(":")
    if kind == "udp":
        group, _, port = rest.partition(":")
        network.connect(
            interface="udp_multicast", channel=group, port=int(port or 43113), hop_limit=0, fd=False)
    else:
        network.connect(interface="socketcan", channel=bus)
    return network


def run(drives, over):
    due = time.monotonic()
    while not over.is_set():
        for drive in drives:
            drive.cycle()
        due = max(due + CYCLE, time.monotonic() - CYCLE)
        time.sleep(max(0, due - time.monotonic()))


def main(bus, *nodes):
    network, over = connect(bus), threading.Event()
    nodes = [node.partition("=") for node in nodes]
    drives = {int(number): Drive(network, int(number), file) for number, _, file in nodes}
    motors = threading.Thread(target=run, args=(drives.values(), over), daemon=True)
    motors.start()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    for number, drive in drives.items():
        drive.say("ready", drive.node.object_dictionary.device_information.product_name or "")
    try:
        for line in sys.stdin:
            match line.split():
                case ["fault", number] if number.isdecimal() and int(number) in drives:
                    drive = drives[int(number)]
                    with drive.lock:
                        drive.fault(0x2310)
        signal.pause()
    except KeyboardInterrupt:
        pass
    finally:
        over.set()
        motors.join()
        network.disconnect()


if __name__ == "__main__":
    if len(sys.argv) < 3 or not all(node.partition("=")[0].isdecimal() and "=" in node for node in sys.argv[2:]):
        sys.exit(__doc__)
    main(*sys.argv[1:])
