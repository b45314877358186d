#!/bin/sh
# rosfleet.multimaster: takes openwrt.sh back, for the router of the common network 192.168.1.0/24 (192.168.1.1).
# OpenWrt 21.02 and later (uci). Paste it into a shell of the device.
for section in $({ uci -q show network; uci -q show firewall; } | sed -n 's/^\([a-z]*\.rosfleet_[a-z0-9_]*\)=.*/\1/p'); do
    uci delete "$section"
done
uci commit network
uci commit firewall
/etc/init.d/network reload
/etc/init.d/firewall reload
rm -f /etc/sysctl.d/90-rosfleet-multimaster.conf
for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > "$file"; done
