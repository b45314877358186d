# rosfleet.multimaster: takes routeros.rsc back, for the gateway of dabo (192.168.10.1, 192.168.1.202).
# MikroTik RouterOS 7. Paste it into a terminal of the device, or copy it there and /import it.
/ip route remove [find comment~"^rosfleet.multimaster"]
/ip firewall raw remove [find comment~"^rosfleet.multimaster"]
/ip firewall address-list remove [find list=rosfleet]
