#!/bin/sh
# The courier with its lidar on a kernel's serial port, and the emulated device at the port wired to it. It drives; the
# lidar falls silent, and then the ports are removed while it drives: the robot stops, and drives on when they return.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/rs485_lib.sh"
warm
# A bus with a pair of wires in each direction.
port=/dev/ttyLAB10 device=/dev/ttyLAB11
ports=/sys/bus/platform/drivers/lab_uart9
courier="$ADVEE --config conf/courier"

moves() { awk "BEGIN { exit !($(truth speed) > 0.1) }"; }
stands() { awk "BEGIN { s = $(truth speed); exit !(s < 0.01 && s > -0.01) }"; }
scans() { "$ADVEE" lcm echo LL_DATA_SCAN --for 0.5 | grep -q 'name="top"'; }
process() { "$ADVEE" state driver_lidar | awk '$1 == "driver_lidar" { print $5, $6 }'; } # PID, number of restarts

step "start"
# The inputs of all modules are not recorded: the guest's processor has enough to do with the guard by a lidar.
$courier up --headless --sim --goal none --run-dir /run/advee --set web.enabled=false --set world.people=0 \
    --set log.inputs=false \
    --set lidar.top.port=$port --set lidar.top.simulated_at=$device >>"$log" 2>&1 &
up=$!
expect "all 8 modules RUN" 60
[ ! -e /run/advee/lidar-top ] || fail "the simulator has a pseudo-terminal besides $device"
within 10 scans || fail "no scan arrives"
$courier --run-dir /run/advee lidar monitor --for 1.2 | tee "$HOME/lidar"
grep -q "^top  *OK  *10\.[0-9] " "$HOME/lidar" || fail "the lidar does not measure ten times a second"
began=$(process)
[ "${began#* }" = 0 ] || fail "driver_lidar was restarted: $began"

step "drive"
$courier --run-dir /run/advee drive 0.3 --rotation 0.3 >"$HOME/drive" 2>&1 &
hand=$!
within 20 moves || fail "it does not drive: $(cat "$HOME/drive")"
[ "$(count LidarLost)" = 0 ] || fail "the lidar is lost on an undisturbed wire"

step "the lidar falls silent while it drives"
$courier --run-dir /run/advee fault lidar.top silent --for 3
expect "LidarLost.*lidar top is silent"
within 3 stands || fail "it drives without its lidar"
expect "LidarLost.*lidar top measures"
within 20 moves || fail "it does not drive on: $(cat "$HOME/drive")"
once "lidar top is silent"

step "the ports are removed while it drives"
echo lab_uart9 >$ports/unbind
[ ! -e $port ] || fail "$port is still there"
expect "driver_lidar.* lidar.top is down: "
expect "LidarLost.*lidar top is not connected"
within 3 stands || fail "it drives without its lidar"
"$ADVEE" state driver_lidar | grep ERROR || fail "driver_lidar is not in ERROR"
sleep 2
stands || fail "it drives without its lidar"
once "driver_lidar.* lidar.top is down: "

step "the ports return"
echo lab_uart9 >$ports/bind
expect "driver_lidar.* lidar.top is up"
expect "LidarLost.*lidar top measures"
within 20 moves || fail "it does not drive on: $(cat "$HOME/drive")"
[ "$(process)" = "$began" ] || fail "driver_lidar was restarted: $began before, $(process) now"

kill -INT $hand
wait $hand || fail "advee drive: exit code $?"
kill -INT $up
wait $up || fail "exit code $?"
