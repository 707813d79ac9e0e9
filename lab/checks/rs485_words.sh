#!/bin/sh
# A port that has two bytes for each word, the ninth bit first, as those of the TS-7800's own driver, on a bus with
# boards at ports with parity, which were written from docs/facts/boards.md alone: what one side sends is what the other
# receives.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/rs485_lib.sh"
warm
master=/dev/ttyLAB20

board() { # PORT ADDRESS
    python3 lab/models/board9.py "/dev/ttyLAB$1" "$2" >"$HOME/board$1" &
    within 30 grep -q ready "$HOME/board$1" || fail "the board at $1 does not start"
}

rs485() { # EXIT-STATUS TRANSPORT COMMAND...: at our port; what it says goes to $log
    expected=$1 transport=$2 status=0
    shift 2
    "$ADVEE" rs485 "$@" --port $master --transport "$transport" >"$log" 2>&1 || status=$?
    [ $status = "$expected" ] || fail "advee rs485 $*: exit status $status"
}

says() { grep -e "$1" "$log" || fail "not in the output: $1"; } # TEXT

board 21 0x20
board 22 0x01 # an address that may be taken for a ninth bit

step "the kernel's port itself: what is written is what a port with parity receives, and the other way round"
python3 - <<'END'
import os, termios, time, sys

def port(number, parity):
    file = os.open(f"/dev/ttyLAB{number}", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    settings = termios.tcgetattr(file)
    settings[0] = termios.INPCK | termios.PARMRK if parity else 0
    settings[1] = settings[3] = 0
    settings[2] = termios.CS8 | termios.CREAD | termios.CLOCAL | (termios.PARENB | 0o10000000000 if parity else 0)
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(file, termios.TCSANOW, settings)
    return file

def same(what, sender, text, receiver, expected):
    os.write(sender, bytes.fromhex(text))
    termios.tcdrain(sender)
    time.sleep(0.02)
    seen = os.read(receiver, 100).hex(" ")
    print(f"{what}: {seen}")
    if seen != expected:
        sys.exit(f"FAILED: {what}: {seen}, not {expected}")

words, parity = port(20, False), port(23, True)
same("an address and a byte", words, "01 42 00 41", parity, "ff 00 42 41")
same("a first byte that is no ninth bit is not sent", words, "42 00 41", parity, "41")
same("a byte with parity", parity, "43", words, "00 43")
END

step "boards are found and answer, with every byte in their answers"
rs485 0 ninth-first scan --first 1 --last 33
says "^0x01 .* 1\.2 "
says "^0x20 .* 1\.2 "
says "2 boards on $master; 33 addresses asked"
rs485 0 ninth-first poll 0x20 version --count 20
says "good .* 20  100.00 %"
rs485 0 ninth-first version 0x01
says "board 0x01: version 1.2, then \[01\]"

step "in the other order nobody is found"
rs485 1 two-byte scan --first 32 --last 33
says "nobody answers"

step "a robot's driver reaches the boards there"
"$ADVEE" run driver_rs485a --set rs485.a.port=$master --set rs485.a.baud=115200 >"$log" 2>&1 &
driver=$!
# These boards know their version and nothing else.
expect "so1 (0x20 on rs485.a) does not know instruction 0x01"
kill $driver
wait $driver || fail "exit code $?"
news

! grep -h dropped "$HOME"/board* || fail "a frame had a gap"
