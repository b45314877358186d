#!/bin/sh
# rosfleet.multimaster: the way to the networks of the robots, for the router of the common network 192.168.1.0/24 (192.168.1.1).
# Linux (ip route). Copy it to the device and run it as root.
# To take it back: linux.remove.sh. Do so before a robot goes or gets another address.
#
#   tibi: 192.168.11.0/24 by 192.168.1.201
#   dabo: 192.168.10.0/24 by 192.168.1.202
#   car: 192.168.12.0/23 by 192.168.1.203
#
# A reboot forgets it: have it run at every boot.
set -eu
ip route replace 192.168.11.0/24 via 192.168.1.201
ip route replace 192.168.10.0/24 via 192.168.1.202
ip route replace 192.168.12.0/23 via 192.168.1.203
for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$file"; done
