"""A bridge from I2C to 1-Wire (DS2482-100) and a thermometer on it (DS18B20), as used by the kernel's drivers ds2482
and w1_therm. Sources: the commands and status bits of drivers/w1/masters/ds2482.c; the ROM search, the commands
and the scratchpad of drivers/w1/w1.c and slaves/w1_therm.c."""

# Commands of the bridge.
RESET, SET_POINTER, CONFIGURE, WIRE_RESET, WIRE_BIT, WIRE_WRITE, WIRE_READ, TRIPLET = 0xF0, 0xE1, 0xD2, 0xB4, 0x87, 0xA5, 0x96, 0x78
STATUS, DATA, CONFIGURATION = 0xF0, 0xE1, 0xC3  # its registers, as the pointer names them
PRESENT, HIGH, WAS_RESET, BIT, SECOND_BIT, DIRECTION = 0x02, 0x08, 0x10, 0x20, 0x40, 0x80  # of the status
# Commands on the wire.
SEARCH, MATCH, SKIP, READ_ROM = 0xF0, 0x55, 0xCC, 0x33
CONVERT, READ_SCRATCHPAD, READ_SUPPLY, WRITE_SCRATCHPAD = 0x44, 0xBE, 0xB4, 0x4E


def crc8(data):
    """The CRC of 1-Wire: x^8 + x^5 + x^4 + 1, the least bit first."""
    crc = 0
    for byte in data:
        for bit in range(8):
            crc = crc >> 1 ^ (0x8C if (crc ^ byte >> bit) & 1 else 0)
    return crc


class Ds18b20:
    """`code` is its family and serial number, seven bytes."""

    def __init__(self, code):
        self.code = code + bytes([crc8(code)])
        self.celsius = 25.0
        self.there = True
        self.scratchpad = bytearray([0x50, 0x05, 0x4B, 0x46, 0x7F, 0xFF, 0x0C, 0x10])  # 85 degrees: nothing was measured yet
        self.reset()

    def reset(self):
        self.state, self.heard, self.says = "rom", b"", b""
        return self.there

    def bit_of_code(self, number):
        return self.code[number // 8] >> number % 8 & 1

    def write(self, byte):
        self.heard += bytes([byte])
        if self.state == "rom":
            first = self.heard[0]
            if first == SEARCH:
                self.state, self.place = "search", 0
            elif first == SKIP or first == MATCH and self.heard[1:] == self.code:
                self.state, self.heard = "chosen", b""
            elif first == READ_ROM:
                self.says = self.code
            elif len(self.heard) > 8:
                self.state = "quiet"
        elif self.state == "chosen":
            self.command(self.heard[0])

    def command(self, command):
        if command == CONVERT:
            self.scratchpad[:2] = int(self.celsius * 16).to_bytes(2, "little", signed=True)
            self.says = b"\xff"  # done already
        elif command == READ_SCRATCHPAD:
            self.says = bytes(self.scratchpad) + bytes([crc8(self.scratchpad)])
        elif command == READ_SUPPLY:
            self.says = b"\xff"  # by a wire of its own
        elif command == WRITE_SCRATCHPAD and len(self.heard) == 4:
            self.scratchpad[2:5] = self.heard[1:]

    def read(self):
        byte, self.says = self.says[:1] or b"\xff", self.says[1:]
        return byte[0]


class Ds2482:
    def __init__(self, wire):
        self.wire = wire
        self.status = HIGH | WAS_RESET
        self.configuration = 0
        self.data = 0
        self.pointer = STATUS
        self.command = None

    def there(self):
        return [one for one in self.wire if one.there]

    def start(self, reading):
        if not reading:
            self.command = None
        return True

    def write(self, byte):
        if self.command is None:
            self.command = byte
            if byte not in (RESET, WIRE_RESET, WIRE_READ):
                return byte in (SET_POINTER, CONFIGURE, WIRE_BIT, WIRE_WRITE, TRIPLET)
        self.do(self.command, byte)
        return True

    def do(self, command, value):
        if command == SET_POINTER:
            self.pointer = value
            return
        self.status, self.pointer = HIGH, STATUS
        if command == RESET:
            self.status, self.configuration = HIGH | WAS_RESET, 0
        elif command == CONFIGURE:
            self.configuration, self.pointer = value & 0xF, CONFIGURATION
        elif command == WIRE_RESET:
            # All of them, not only the first.
            self.status |= PRESENT if [one for one in self.there() if one.reset()] else 0
        elif command == WIRE_WRITE:
            for one in self.there():
                one.write(value)
        elif command == WIRE_READ:
            self.data = 0xFF
            for one in self.there():
                self.data &= one.read()
        elif command == WIRE_BIT:
            # A read slot; no device is busy long enough to hold it low.
            self.status |= BIT if value & 0x80 else 0
        elif command == TRIPLET:
            self.triplet(value >> 7)

    def triplet(self, wanted):
        """Two bits are read, a code bit of all devices and its complement, one is written: devices that differ drop
        out."""
        searched = [one for one in self.there() if one.state == "search"]
        bits = {one.bit_of_code(one.place) for one in searched}
        one, zero = 1 in bits, 0 in bits
        direction = wanted if one and zero else 0 if zero else 1
        self.status |= (0 if zero else BIT) | (0 if one else SECOND_BIT) | (DIRECTION if direction else 0)
        for device in searched:
            stays = device.bit_of_code(device.place) == direction
            device.place += 1
            if not stays or device.place == 64:
                device.state = "quiet"

    def read(self):
        return {STATUS: self.status, DATA: self.data, CONFIGURATION: self.configuration}.get(self.pointer, 0xFF)
