#!/bin/sh
# A thermometer on 1-Wire, behind a bridge on I2C: the kernel's ds2482, w1 and w1_therm with models/ds2482.py at their other
# end, read by the robot's driver.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. lab/checks/i2c_adapter.sh
# What udev would do.
modprobe -a ds2482 w1_therm
echo ds2482 0x1a >"/sys/bus/i2c/devices/i2c-${adapter#*-}/new_device"
sensor=/sys/bus/w1/devices/28-000000000001
within 30 test -e $sensor/w1_slave || fail "the kernel found no thermometer: $(dmesg | tail -5)"

step "it is read"
"$ADVEE" run driver_aux --set i2c.aux.bus="$adapter" --set w1.folder=/sys/bus/w1/devices >"$log" 2>&1 &
driver=$!
model battery 31.5
told 'name="battery" value=31.5' 8
step "too hot"
model battery 55
expect "battery is at 55.0 °C, above its limit of 50 °C"
model battery 20
expect "battery is at 20.0 °C, below its limit"
step "it is pulled"
model battery off
expect "battery (28-000000000001 on w1): not connected" 60
model battery on
expect "battery (28-000000000001 on w1): connected" 60
told 'name="battery" value=20.0' 8
kill $driver
wait $driver || fail "exit code $?"
