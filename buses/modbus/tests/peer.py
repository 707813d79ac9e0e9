"""pymodbus at the other end: peer.py server|client tcp|rtu PORT. Frames of either kind over a TCP connection."""

import asyncio
import sys

from pymodbus import FramerType
from pymodbus.client import ModbusTcpClient
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import ModbusTcpServer

UNIT = 17


async def serve(framer, port):
    """Registers 0 to 19 of each table; a register has its address + 100, an odd bit is set."""
    def block(values):
        # The first one has the number 1, which is address 0.
        return ModbusSequentialDataBlock(1, values)

    bits = [address % 2 == 1 for address in range(20)]
    words = [address + 100 for address in range(20)]
    device = ModbusDeviceContext(di=block(bits), co=block(bits[:]), ir=block(words), hr=block(words[:]))
    context = ModbusServerContext(devices={UNIT: device}, single=False)
    server = ModbusTcpServer(context, framer=framer, address=("127.0.0.1", port))
    await server.serve_forever()


def ask(framer, port):
    client = ModbusTcpClient("127.0.0.1", port=port, framer=framer, timeout=3)
    assert client.connect()

    def done(answer):
        assert not answer.isError(), answer
        return answer

    def bits(read):
        return done(read(0, count=10, device_id=UNIT)).bits[:10]

    def words(read):
        return done(read(0, count=4, device_id=UNIT)).registers

    assert bits(client.read_discrete_inputs) == [False, True] * 5
    assert words(client.read_input_registers) == [100, 101, 102, 103]
    done(client.write_coil(3, False, device_id=UNIT))
    done(client.write_coils(4, [True, False, True], device_id=UNIT))
    assert bits(client.read_coils) == [False, True, False, False, True, False, True, True, False, True]
    done(client.write_register(0, 0xBEEF, device_id=UNIT))
    done(client.write_registers(1, [1, 0xFFFF], device_id=UNIT))
    assert words(client.read_holding_registers) == [0xBEEF, 1, 0xFFFF, 103]
    refused = client.read_holding_registers(19, count=2, device_id=UNIT)
    assert refused.isError() and refused.exception_code == 2, refused
    refused = client.mask_write_register(address=0, and_mask=1, or_mask=1, device_id=UNIT)
    assert refused.isError() and refused.exception_code == 1, refused
    client.close()
    print("done")


role, kind, port = sys.argv[1], sys.argv[2], int(sys.argv[3])
framer = {"tcp": FramerType.SOCKET, "rtu": FramerType.RTU}[kind]
if role == "server":
    asyncio.run(serve(framer, port))
else:
    ask(framer, port)
