# rosfleet.multimaster: takes routeros.rsc back, for the router of the common network 192.168.1.0/24 (192.168.1.1).
# MikroTik RouterOS 7. Paste it into a terminal of the device, or copy it there and /import it.
/ip route remove [find comment~"^rosfleet.multimaster"]
/ip firewall raw remove [find comment~"^rosfleet.multimaster"]
/ip firewall address-list remove [find list=rosfleet]
/ip settings set send-redirects=yes
