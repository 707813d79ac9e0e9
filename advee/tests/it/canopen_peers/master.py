"""Master on `canopen` (PyPI): `master.py PORT EXCHANGE`, for a node with the objects of node.eds. Exit code 0 if the
node behaves as required. Prints `on` when the node may be powered on."""
import pathlib
import struct
import sys
import time

import canopen
from canopen.lss import LssError
from canopen.sdo import SdoAbortedError, SdoCommunicationError

HERE = pathlib.Path(__file__).parent
NODE = 5
PRE_OPERATIONAL, OPERATIONAL, STOPPED, BOOT_UP = 127, 5, 4, 0


def until(condition, what, seconds=5.0):
    """Waits for a condition that another thread makes true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.002)


class States(list):
    """States in the node's heartbeats since the last check."""

    def await_(self, state, what):
        until(lambda: state in self, f"{what}: {list(self)}")
        self.clear()


def abort_code(act):
    try:
        act()
    except SdoAbortedError as abort:
        return abort.code
    return None


def pattern(length):
    """Bytes without a short period, so that a lost or duplicate segment is detected."""
    return bytes((n * n // 7 + 31 * n) & 0xFF for n in range(length))


def nmt(network, node, states):
    node.sdo[0x1017].raw = 10
    for state, code in (("OPERATIONAL", OPERATIONAL), ("PRE-OPERATIONAL", PRE_OPERATIONAL), ("STOPPED", STOPPED)):
        states.clear()
        node.nmt.state = state
        states.await_(code, state)
    # Stopped: NMT and error control only.
    node.sdo.RESPONSE_TIMEOUT = 0.1
    try:
        node.sdo.upload(0x1000, 0)
        raise AssertionError("an SDO was answered in Stopped")
    except SdoCommunicationError:
        pass
    node.sdo.RESPONSE_TIMEOUT = 2.0
    for state in ("RESET COMMUNICATION", "RESET"):
        node.nmt.state = state
        states.await_(BOOT_UP, state)
        # The power-on values are back: no heartbeat.
        assert node.sdo[0x1017].raw == 0
        node.sdo[0x1017].raw = 10
        states.await_(PRE_OPERATIONAL, state)
    node.sdo[0x2004].raw = 1
    node.nmt.state = "RESET COMMUNICATION"
    states.await_(BOOT_UP, "reset communication")
    assert node.sdo[0x2004].raw == 1, "an application object was reset"
    node.nmt.state = "RESET"
    states.await_(BOOT_UP, "reset node")
    assert node.sdo[0x2004].raw == 0x12345678
    # To all, and to another one.
    node.sdo[0x1017].raw = 10
    network.nmt.state = "OPERATIONAL"
    states.await_(OPERATIONAL, "start of all")
    network.send_message(0, [2, NODE + 1])
    time.sleep(0.05)
    assert STOPPED not in states
    # Commands that no master sends have no effect.
    for data in (b"", b"\x01", b"\x03\x05", b"\x02\x05\x00", b"\x02\xff"):
        network.send_message(0, data)
    time.sleep(0.05)
    assert set(states) == {OPERATIONAL}, states


def heartbeat(network, node, states):
    for period in (20, 50):
        node.sdo[0x1017].raw = period
        states.clear()
        time.sleep(1.0)
        count = len(states)
        assert 1000 / period * 0.8 <= count <= 1000 / period + 2, f"{count} heartbeats in 1 s at {period} ms"
    node.sdo[0x1017].raw = 0
    time.sleep(0.1)
    states.clear()
    time.sleep(0.2)
    assert not states
    # The node monitors our heartbeat, from the first one on.
    node.sdo[0x1016][1].raw = 100 << 16 | 150
    assert abort_code(lambda: node.sdo[0x1016][2].__setattr__("raw", 100 << 16 | 99)) == 0x06040043
    time.sleep(0.3)
    assert not node.emcy.log, "it missed what it had never heard"
    ours = network.send_periodic(0x700 + 100, [OPERATIONAL], 0.03)
    time.sleep(0.5)
    assert not node.emcy.log
    ours.stop()
    until(lambda: node.emcy.log, "a lost heartbeat")
    assert node.emcy.log[0].code == 0x8130 and node.emcy.log[0].data[0] == 100


def guarding(network, node, states):
    toggles = []
    network.subscribe(0x700 + NODE, lambda _, data, __: toggles.append(data[0]))
    node.sdo[0x100C].raw = 60
    node.sdo[0x100D].raw = 3
    node.nmt.start_node_guarding(0.05)
    until(lambda: len(toggles) >= 10, "answers to guarding")
    assert toggles[:10] == [PRE_OPERATIONAL | (n & 1) << 7 for n in range(10)], toggles
    node.nmt.state = "OPERATIONAL"
    states.await_(OPERATIONAL, "start, seen by guarding")
    assert not node.emcy.log
    node.nmt.stop_node_guarding()
    until(lambda: node.emcy.log, "the end of the life time")
    assert node.emcy.log[0].code == 0x8130
    # 1000 days and 12 345.678 s after 1984-01-01; the node consumes TIME once configured to.
    moment = 441763200 + 1000 * 86400 + 12345.678
    network.time.transmit(moment)
    time.sleep(0.05)
    assert node.sdo[0x2004].raw == 0x12345678
    node.sdo[0x1012].raw = 0x80000100
    network.time.transmit(moment)
    until(lambda: node.sdo[0x2004].raw in (12345677, 12345678), "the time of day")
    assert node.sdo[0x2006].raw == 1000


def lss(network, node, states):
    master = network.lss
    master.RESPONSE_TIMEOUT = 0.08
    identity = [0xFEED, 0x80000001, 0x20003, 0xC0FFEE01]
    print("on")
    time.sleep(0.3)
    assert not states, "a node without id boots"
    found, address = master.fast_scan()
    assert found and address == identity, f"{found} {address}"
    # It is in the configuration state now.
    assert [master.inquire_lss_address(part) for part in (0x5A, 0x5B, 0x5C, 0x5D)] == identity
    assert master.inquire_node_id() == 0xFF
    for refused in (lambda: master.configure_node_id(128), lambda: master.configure_bit_timing(4)):
        try:
            refused()
            raise AssertionError("it took what it cannot be")
        except LssError:
            pass
    master.configure_node_id(NODE)
    master.configure_bit_timing(2)
    master.store_configuration()
    master.send_switch_state_global(master.WAITING_STATE)
    states.await_(BOOT_UP, "the boot-up message of the node with its new id")
    assert node.sdo[0x1018][4].raw == identity[3]
    # No node is left in the configuration state, and the node is found by its address.
    assert master.fast_scan() == (False, None)
    assert master.send_switch_state_selective(*identity)
    assert master.inquire_node_id() == NODE
    master.send_switch_state_global(master.WAITING_STATE)
    node.nmt.state = "RESET"
    states.await_(BOOT_UP, "the boot-up message with the stored id")


def emergency(network, node, states):
    for code, register, description in (
        (0x2310, 0x03, "Current"), (0x4210, 0x09, "Temperature"), (0x8250, 0x11, "Monitoring"),
        (0xFF01, 0x81, "Device Specific"), (0x5041, 0x01, "Device Hardware"),
    ):
        node.sdo[0x2001].raw = code | register << 16 | 0x77 << 24
        until(lambda: node.emcy.log and node.emcy.log[-1].code == code, f"emergency {code:04X}")
        last = node.emcy.log[-1]
        assert (last.register, bytes(last.data), last.get_desc()) == (register, b"\x77\2\3\4\5", description)
        assert node.sdo[0x1001].raw == register
    assert len(node.emcy.active) == 5
    # The newest first, four kept.
    history = [node.sdo.upload(0x1003, sub) for sub in range(5)]
    assert history[0] == b"\4" and [h[0] | h[1] << 8 for h in history[1:]] == [0x5041, 0xFF01, 0x8250, 0x4210]
    node.sdo[0x2001].raw = 0
    until(lambda: not node.emcy.active, "error reset")
    node.sdo.download(0x1003, 0, b"\0")
    assert node.sdo.upload(0x1003, 0) == b"\0"


def sdo(network, node, states):
    assert node.sdo[0x1000].raw == 0x191
    assert [node.sdo[0x1018][sub].raw for sub in (1, 2, 3, 4)] == [0xFEED, 0x80000001, 0x20003, 0xC0FFEE01]
    assert node.sdo[0x1008].raw == "A node to be talked to by others"
    for value in (-1000, -1, 0, 1, 1000):
        node.sdo["Signed long"].raw = value
        assert node.sdo["Signed long"].raw == value
    for value in (0, 255):
        node.sdo.download(0x2002, 0, bytes([value]), force_segment=True)
        assert node.sdo["Byte"].raw == value
    for length in [*range(0, 65), 127, 128, 889, 890, 1000, 4096]:
        data = pattern(length)
        node.sdo.download(0x2000, 0, data, force_segment=length % 2 == 0)
        assert node.sdo.upload(0x2000, 0) == data, f"{length} bytes"


def block(network, node, states):
    # 889 bytes are a block of 127 segments.
    sizes = [*range(1, 30), *(889 * k + d for k in (1, 2, 3, 8) for d in (-8, -7, -6, -1, 0, 1, 6, 7, 8)), 4096, 10_000]
    for length in sizes:
        for crc in (True, False):
            data = pattern(length)
            with node.sdo.open(0x2000, length & 0xFF, "wb", size=length, block_transfer=True, request_crc_support=crc) as f:
                f.write(data)
            assert node.sdo.upload(0x2000, length & 0xFF) == data, f"{length} bytes down, crc {crc}"
            with node.sdo.open(0x2000, length & 0xFF, "rb", block_transfer=True, request_crc_support=crc) as f:
                assert f.raw.size == length and f.raw.crc_supported == crc
                assert f.read() == data, f"{length} bytes up, crc {crc}"
    assert abort_code(lambda: node.sdo.open(0x5FFF, 0, "rb", block_transfer=True)) == 0x06020000
    # A CRC that does not match the data.
    stream = node.sdo.open(0x2000, 1, "wb", buffering=0, size=7, block_transfer=True)
    stream.send(b"1234567", end=True)
    stream._crc.process(b"!")
    assert abort_code(stream.close) == 0x05040004
    # Lost segments are requested again: 3 and 4 of the first block, 1 and 2 of the next.
    lost, send = [3, 4, 128, 129], node.sdo.send_request
    count = 0

    def forgetful(request):
        nonlocal count
        count += 1
        if count not in lost:
            send(request)

    data = pattern(2000)
    stream = node.sdo.open(0x2000, 2, "wb", size=len(data), block_transfer=True)
    node.sdo.send_request = forgetful
    stream.write(data)
    stream.flush()
    node.sdo.send_request = send
    stream.close()
    assert node.sdo.upload(0x2000, 2) == data
    assert count > 286 + len(lost), count


def aborts(network, node, states):
    sdo = node.sdo
    for act, code in (
        (lambda: sdo.upload(0x5FFF, 0), 0x06020000),
        (lambda: sdo.upload(0x1018, 9), 0x06090011),
        (lambda: sdo.upload(0x2007, 0), 0x06010001),
        (lambda: sdo.download(0x2006, 0, b"\1\2"), 0x06010002),
        (lambda: sdo.download(0x1000, 0, b"\1\2\3\4"), 0x06010002),
        (lambda: sdo.download(0x2004, 0, b"\1\2"), 0x06070013),
        (lambda: sdo.download(0x2003, 0, b"\1\2\3\4"), 0x06070012),
        (lambda: sdo.download(0x2003, 0, pattern(100)), 0x06070012),
        (lambda: sdo.download(0x2005, 0, struct.pack("<i", 1001)), 0x06090031),
        (lambda: sdo.download(0x2005, 0, struct.pack("<i", -1001)), 0x06090032),
        (lambda: sdo.download(0x1003, 0, b"\1"), 0x06090030),
    ):
        seen = abort_code(act)
        assert seen == code, f"0x{seen or 0:08X} instead of 0x{code:08X}"
    # An unexpected segment, a toggle bit that does not alternate, an unknown command.
    for request, code in ((b"\x60" + bytes(7), 0x05040001), (b"\xe0" + bytes(7), 0x05040001)):
        assert abort_code(lambda: sdo.request_response(request)) == code
    sdo.request_response(b"\x40\x08\x10\0\0\0\0\0")
    sdo.request_response(b"\x60" + bytes(7))
    assert abort_code(lambda: sdo.request_response(b"\x60" + bytes(7))) == 0x05030000
    assert sdo.upload(0x2006, 0) == struct.pack("<H", 4711), "it serves on"


def pdo(network, node, states):
    node.sdo[0x1017].raw = 50
    node.tpdo.read()
    node.rpdo.read()
    assert [v.index for v in node.tpdo[1].map] == [0x2002, 0x2003] and not node.tpdo[2].enabled
    # Remapped by python-canopen's own procedure: TPDO 2 by SYNC, RPDO 1 to three objects of other widths.
    two = node.tpdo[2]
    two.clear()
    for index in (0x2005, 0x2003, 0x2002):
        two.add_variable(index)
    two.trans_type, two.event_timer, two.enabled = 2, 0, True
    two.save()
    one = node.rpdo[1]
    one.clear()
    for index in (0x2002, 0x2005, 0x2003):
        one.add_variable(index)
    one.cob_id, one.trans_type = 0x222, 255
    one.save()
    two.read()
    one.read()
    assert [(v.index, v.length) for v in two.map] == [(0x2005, 32), (0x2003, 16), (0x2002, 8)]
    assert (two.trans_type, two.enabled, two.cob_id) == (2, True, 0x280 + NODE)
    assert [(v.index, v.length) for v in one.map] == [(0x2002, 8), (0x2005, 32), (0x2003, 16)] and one.cob_id == 0x222
    # Changes that must be refused: an object that cannot be mapped, too many bits, an active PDO.
    assert abort_code(lambda: node.sdo.download(0x1A01, 0, b"\0")) == 0x06010000
    node.sdo[0x1801][1].raw = 0xC0000285
    node.sdo[0x1A01][0].raw = 0
    assert abort_code(lambda: node.sdo[0x1A01][1].__setattr__("raw", 0x20000008)) == 0x06040041
    for sub in (1, 2, 3):
        node.sdo[0x1A01][sub].raw = 0x20040020
    assert abort_code(lambda: node.sdo[0x1A01][0].__setattr__("raw", 3)) == 0x06040042
    two.save()

    synced, events = [], []
    two.add_callback(lambda pdo: synced.append(tuple(v.raw for v in pdo.map)))
    node.tpdo[1].add_callback(lambda pdo: events.append(tuple(v.raw for v in pdo.map)))
    node.nmt.state = "OPERATIONAL"
    states.await_(OPERATIONAL, "start")
    until(lambda: events, "an event PDO at the start")
    one[0].raw, one[1].raw, one[2].raw = 0x5A, -777, -3
    one.transmit()
    until(lambda: events[-1] == (0x5A, -3), "the event PDO with what the RPDO brought")
    assert node.sdo[0x2005].raw == -777
    assert not synced
    for _ in range(10):
        network.sync.transmit()
        time.sleep(0.005)
    until(lambda: len(synced) == 5, f"every second SYNC: {synced}")
    assert synced[-1] == (-777, -3, 0x5A)
    # No PDO outside Operational.
    node.nmt.state = "PRE-OPERATIONAL"
    states.await_(PRE_OPERATIONAL, "pre-operational")
    for _ in range(4):
        network.sync.transmit()
    one[0].raw = 1
    one.transmit()
    time.sleep(0.05)
    assert len(synced) == 5 and node.sdo[0x2002].raw == 0x5A


def main(port, exchange):
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.1
    network.connect(interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False)
    node = network.add_node(NODE, str(HERE / "node.eds"))
    node.sdo.RESPONSE_TIMEOUT = 2.0
    states = States()
    node.nmt.add_heartbeat_callback(states.append)
    if exchange not in (block, lss):
        print("on")
        states.await_(BOOT_UP, "the boot-up message")
    exchange(network, node, states)
    network.disconnect()


main(int(sys.argv[1]), globals()[sys.argv[2]])
