#!/bin/sh
# Nine bits through a USB adapter: the kernel's ftdi_sio on a model of the FT232R, whose wire leads to the simulator's
# boards. The adapter is unplugged while a driver polls them, and returns under another number.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/rs485_lib.sh"
warm
by_id=/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_LAB00001-if00-port0
robot="--sim --run-dir /run/advee --set rs485.a.port=$by_id --set rs485.a.simulated_at=boards
    --set rs485.a.transport=parity --set rs485.a.low_latency=true"

adapter() { # COMMAND TEXT: to the model, and what it answers
    answers=$(wc -l <"$HOME/adapter")
    echo "$1" >&3
    within 30 answered || fail "the adapter does not answer to $1"
    tail -n 1 "$HOME/adapter" | grep "$2" || fail "output of the adapter: $(cat "$HOME/adapter")"
}

answered() { [ "$(wc -l <"$HOME/adapter")" -gt "$answers" ]; }

mkdir -p /run/advee
mkfifo "$HOME/commands"
touch "$HOME/adapter"
python3 lab/models/ftdi.py /run/advee/boards $by_id <"$HOME/commands" >>"$HOME/adapter" 2>&1 &
exec 3>"$HOME/commands"
"$ADVEE" run simulator $robot >"$HOME/simulator" 2>&1 &
within 30 [ -e /run/advee/boards ] || fail "$(cat "$HOME/simulator")"

step "polls through it"
adapter plug "ttyUSB0"
"$ADVEE" rs485 poll 0x20 get_ticks --count 20 --port $by_id --transport parity >"$HOME/poll" 2>&1 || fail "$(cat "$HOME/poll")"
cat "$HOME/poll"
grep -q "good .* 20  100.00 %" "$HOME/poll" || fail "not all polls were answered well"

step "the adapter is unplugged while a driver polls"
"$ADVEE" run driver_rs485a $robot >>"$log" 2>&1 &
driver=$!
expect "so1 (0x20 on rs485.a): firmware 1.0"
adapter unplug " 0 in others, 0 spoilt; 115385 Bd, latency 1 ms"
expect "rs485.a is down: "
sleep 2
once "rs485.a is down: "

step "it returns under another number"
adapter other "ttyUSB0"
adapter plug "ttyUSB1"
expect "rs485.a is up"
expect "so1 (0x20 on rs485.a): firmware 1.0"
once "rs485.a is up"
kill -INT $driver
wait $driver || fail "exit code $?"
