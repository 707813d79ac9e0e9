"""python-canopen's SDO client: `client.py PORT`. Measures once for each input line and prints six figures:
expedited downloads and uploads per second, then kB/s of segmented and of block transfers, down and up."""
import sys
import time

import canopen

EXPEDITED, SEGMENTED, BLOCK = 1000, 3500, 70_000


def pattern(length):
    return bytes((n * n // 7 + 31 * n) & 0xFF for n in range(length))


def seconds(act):
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


def repeat(act):
    for _ in range(EXPEDITED):
        act()


def block_download(sdo, data):
    with sdo.open(0x2000, 0, "wb", size=len(data), block_transfer=True) as stream:
        stream.write(data)


def block_upload(sdo, data):
    with sdo.open(0x2000, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == data


def main(port):
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False)
    sdo = network.add_node(1, canopen.ObjectDictionary()).sdo
    sdo.RESPONSE_TIMEOUT = 2.0
    short, long = pattern(SEGMENTED), pattern(BLOCK)
    for _ in sys.stdin:
        took = [
            seconds(lambda: repeat(lambda: sdo.download(0x2000, 2, b"\1\2\3\4"))),
            seconds(lambda: repeat(lambda: sdo.upload(0x2000, 2))),
            seconds(lambda: sdo.download(0x2000, 1, short)),
            seconds(lambda: sdo.upload(0x2000, 1)),
            seconds(lambda: block_download(sdo, long)),
            seconds(lambda: block_upload(sdo, long)),
        ]
        work = [EXPEDITED, EXPEDITED, SEGMENTED / 1e3, SEGMENTED / 1e3, BLOCK / 1e3, BLOCK / 1e3]
        print(*(amount / time for amount, time in zip(work, took)))
    network.disconnect()


main(int(sys.argv[1]))
