#!/bin/sh
# rosfleet.multimaster: the way to the networks of the robots, for the router of the common network 192.168.1.0/24 (192.168.1.1).
# OpenWrt 21.02 and later (uci). Paste it into a shell of the device.
# To take it back: openwrt.remove.sh. Using it again replaces its former lines.
#
#   tibi: 192.168.11.0/24 by 192.168.1.201
#   dabo: 192.168.10.0/24 by 192.168.1.202
#   car: 192.168.12.0/23 by 192.168.1.203
#
# The interface of the common network: lan (router_config_interfaces sets another).
for section in $({ uci -q show network; uci -q show firewall; } | sed -n 's/^\([a-z]*\.rosfleet_[a-z0-9_]*\)=.*/\1/p'); do
    uci delete "$section"
done
uci batch <<'END'
set network.rosfleet_192_168_11_0_24=route
set network.rosfleet_192_168_11_0_24.interface='lan'
set network.rosfleet_192_168_11_0_24.target='192.168.11.0/24'
set network.rosfleet_192_168_11_0_24.gateway='192.168.1.201'
set network.rosfleet_192_168_10_0_24=route
set network.rosfleet_192_168_10_0_24.interface='lan'
set network.rosfleet_192_168_10_0_24.target='192.168.10.0/24'
set network.rosfleet_192_168_10_0_24.gateway='192.168.1.202'
set network.rosfleet_192_168_12_0_23=route
set network.rosfleet_192_168_12_0_23.interface='lan'
set network.rosfleet_192_168_12_0_23.target='192.168.12.0/23'
set network.rosfleet_192_168_12_0_23.gateway='192.168.1.203'
set firewall.rosfleet_192_168_11_0_24=nat
set firewall.rosfleet_192_168_11_0_24.name='No translation towards tibi'
set firewall.rosfleet_192_168_11_0_24.family='ipv4'
set firewall.rosfleet_192_168_11_0_24.proto='all'
set firewall.rosfleet_192_168_11_0_24.src='*'
set firewall.rosfleet_192_168_11_0_24.dest_ip='192.168.11.0/24'
set firewall.rosfleet_192_168_11_0_24.target='ACCEPT'
set firewall.rosfleet_192_168_10_0_24=nat
set firewall.rosfleet_192_168_10_0_24.name='No translation towards dabo'
set firewall.rosfleet_192_168_10_0_24.family='ipv4'
set firewall.rosfleet_192_168_10_0_24.proto='all'
set firewall.rosfleet_192_168_10_0_24.src='*'
set firewall.rosfleet_192_168_10_0_24.dest_ip='192.168.10.0/24'
set firewall.rosfleet_192_168_10_0_24.target='ACCEPT'
set firewall.rosfleet_192_168_12_0_23=nat
set firewall.rosfleet_192_168_12_0_23.name='No translation towards car'
set firewall.rosfleet_192_168_12_0_23.family='ipv4'
set firewall.rosfleet_192_168_12_0_23.proto='all'
set firewall.rosfleet_192_168_12_0_23.src='*'
set firewall.rosfleet_192_168_12_0_23.dest_ip='192.168.12.0/23'
set firewall.rosfleet_192_168_12_0_23.target='ACCEPT'
END
uci commit network
uci commit firewall
/etc/init.d/network reload
/etc/init.d/firewall reload
printf 'net.ipv4.conf.%s.send_redirects=0\n' all default > /etc/sysctl.d/90-rosfleet-multimaster.conf
for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$file"; done
