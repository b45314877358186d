#!/bin/sh
# rosfleet.multimaster: takes linux.sh back, for the router of the common network 192.168.1.0/24 (192.168.1.1).
# Linux (ip route). Copy it to the device and run it as root.
set -eu
ip route del 192.168.11.0/24 via 192.168.1.201 2> /dev/null || true
ip route del 192.168.10.0/24 via 192.168.1.202 2> /dev/null || true
ip route del 192.168.12.0/23 via 192.168.1.203 2> /dev/null || true
for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > "$file"; done
