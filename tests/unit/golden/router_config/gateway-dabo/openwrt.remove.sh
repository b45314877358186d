#!/bin/sh
# rosfleet.multimaster: takes openwrt.sh back, for the gateway of dabo (192.168.10.1, 192.168.1.202).
# OpenWrt 21.02 and later (uci). Paste it into a shell of the device.
for section in $({ uci -q show network; uci -q show firewall; } | sed -n 's/^\([a-z]*\.rosfleet_[a-z0-9_]*\)=.*/\1/p'); do
    uci delete "$section"
done
uci commit network
uci commit firewall
/etc/init.d/network reload
/etc/init.d/firewall reload
