#!/bin/sh
# The installed robot is driven from outside, through its web server, by package_web.py.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
debs
present || install_deb old

step "the web server is opened to the network, as in docs/install.md"
umask 077
od -An -tx1 -N 24 /dev/urandom | tr -d ' \n' >/opt/advee/conf/web.token
chown advee-web /opt/advee/conf/web.token
umask 022
sed -i 's|^listen = .*|listen = "0.0.0.0:8080"|; s|^hosts = .*|hosts = ["robot.lab"]|; s|^# token_file = .*|token_file = "web.token"|' \
    /opt/advee/conf/robot.toml
! is active || systemctl stop advee
running
from=$(truth x)

step "the driver outside gets the code, and nothing else"
"$advee" web code --json >"$LAB_SHARE/code.new"
mv "$LAB_SHARE/code.new" "$LAB_SHARE/code"
within 200 test -e "$LAB_SHARE/driven" || fail "it was not driven"
cat "$LAB_SHARE/driven"
to=$(truth x)
echo "it was at x = $from m, and is at $to m"
awk "BEGIN { exit !($to - $from > 0.2) }" || fail "it did not move"
motion
speed=$(truth speed)
awk "BEGIN { exit !($speed * $speed < 0.0001) }" || fail "it does not stand: $speed m/s"
systemctl stop advee
