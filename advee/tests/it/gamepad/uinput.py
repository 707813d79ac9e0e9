"""Gamepad on /dev/uinput (linux/uinput.h): lines `key 0|1` and `abs VALUE` on stdin; removed at the end of input."""

import fcntl
import os
import struct
import sys

EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
BTN_SOUTH, BTN_TL = 0x130, 0x136
AXES = (0, 1, 3, 4)
UI_SET_EVBIT, UI_SET_KEYBIT, UI_SET_ABSBIT = 0x40045564, 0x40045565, 0x40045567
UI_DEV_CREATE, UI_DEV_DESTROY = 0x5501, 0x5502

uinput = os.open("/dev/uinput", os.O_WRONLY)
for kind in (EV_KEY, EV_ABS):
    fcntl.ioctl(uinput, UI_SET_EVBIT, kind)
for button in (BTN_SOUTH, BTN_TL):
    fcntl.ioctl(uinput, UI_SET_KEYBIT, button)
greatest, least, none = [0] * 64, [0] * 64, [0] * 64
for axis in AXES:
    fcntl.ioctl(uinput, UI_SET_ABSBIT, axis)
    greatest[axis], least[axis] = 32767, -32768
# struct uinput_user_dev
device = struct.pack("=80s4HI", b"advee uinput pad", 3, 0x1209, 1, 1, 0)
os.write(uinput, device + struct.pack("=256i", *greatest, *least, *none, *none))
fcntl.ioctl(uinput, UI_DEV_CREATE)


def tell(kind, code, value):
    for event in ((kind, code, value), (EV_SYN, 0, 0)):
        os.write(uinput, struct.pack("@llHHi", 0, 0, *event))


for line in sys.stdin:
    word, value = line.split()
    tell(EV_KEY if word == "key" else EV_ABS, BTN_TL if word == "key" else 1, int(value))
fcntl.ioctl(uinput, UI_DEV_DESTROY)
