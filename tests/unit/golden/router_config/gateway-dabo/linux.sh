#!/bin/sh
# rosfleet.multimaster: the way to the networks of the robots, for the gateway of dabo (192.168.10.1, 192.168.1.202).
# Linux (ip route). Copy it to the device and run it as root.
# To take it back: linux.remove.sh. Do so before a robot goes or gets another address.
#
#   tibi: 192.168.11.0/24 by 192.168.1.201
#   car: 192.168.12.0/23 by 192.168.1.203
#
# A reboot forgets it: have it run at every boot.
# Rules that masquerade towards the common network must leave out that and the networks above.
set -eu
ip route replace 192.168.11.0/24 via 192.168.1.201
ip route replace 192.168.12.0/23 via 192.168.1.203
