# rosfleet.multimaster: the way to the networks of the robots, for the gateway of dabo (192.168.10.1, 192.168.1.202).
# MikroTik RouterOS 7. Paste it into a terminal of the device, or copy it there and /import it.
# To take it back: routeros.remove.rsc. Using it again replaces its former lines.
#
#   tibi: 192.168.11.0/24 by 192.168.1.201
#   car: 192.168.12.0/23 by 192.168.1.203
#
# The maker's firewall lets untracked packets pass; one of your own must do so, too.
/ip route remove [find comment~"^rosfleet.multimaster"]
/ip firewall raw remove [find comment~"^rosfleet.multimaster"]
/ip firewall address-list remove [find list=rosfleet]
/ip route add dst-address=192.168.11.0/24 gateway=192.168.1.201 comment="rosfleet.multimaster: tibi"
/ip route add dst-address=192.168.12.0/23 gateway=192.168.1.203 comment="rosfleet.multimaster: car"
/ip firewall address-list add list=rosfleet address=192.168.10.0/24 comment="rosfleet.multimaster"
/ip firewall address-list add list=rosfleet address=192.168.1.0/24 comment="rosfleet.multimaster: common network"
/ip firewall address-list add list=rosfleet address=192.168.11.0/24 comment="rosfleet.multimaster: tibi"
/ip firewall address-list add list=rosfleet address=192.168.12.0/23 comment="rosfleet.multimaster: car"
/ip firewall raw add chain=prerouting action=notrack src-address-list=rosfleet dst-address-list=rosfleet dst-address-type=!local comment="rosfleet.multimaster"
