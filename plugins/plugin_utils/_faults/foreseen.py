# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings of predict and watch: ends of packets after site.yml (RF-7xx), losses during a watch (RF-8xx)."""

from __future__ import annotations

from collections.abc import Mapping

from .fault import (
    COMPUTER,
    NETWORK,
    Advice,
    Fault,
    Key,
    change,
    hand,
    keep_settings,
    on,
    site,
    site_of_all,
    verify_again,
)
from .filters import MAKERS

PREDICTED, WATCHED = "predicted", "watched"
_PLAN = "the plan was followed, hop by hop"
_FILTER = hand(f"accept packets between the robots' networks on {{place}}, {MAKERS}")


def _predict(number: int, sentence: str, *do: Advice, look: str = "ip rule; ip route", at: str = COMPUTER) -> Fault:
    """Make a row of predict: {what} is the network, {hop} the next machine, {traffic} the kind of packets."""
    place = "{there}" if at == NETWORK else "{place}"
    return Fault(f"RF-7{number:02}", sentence, do=do, look=(Advice(place, look),), why=_PLAN, at=(at,))


#: by the outcome of a trace of the model of the network
PREDICTIONS: Mapping[Key, Fault] = {
    (PREDICTED, "no route"): _predict(
        1,
        "{place} has no route to {what}",
        change("set multimaster_routes: default or networks, for the robot of {place}"),
        site_of_all(),
    ),
    (PREDICTED, "closed"): _predict(
        2,
        "{place} has a rule or a route that leads nowhere for {what}",
        hand("delete it on {place}: ip rule del or ip route del, with its words"),
        look="ip rule; ip route show table all type unreachable; ip route show table all type blackhole",
    ),
    (PREDICTED, "no address"): _predict(
        3,
        "{place} has no address to send from",
        hand("give its interface the address of the inventory"),
        look="ip -br address",
    ),
    (PREDICTED, "nobody"): _predict(
        4,
        "{place} sends packets for {what} to {hop}, where nobody answers",
        change("set multimaster_gateway or multimaster_address to the address of the machine that is to answer"),
        site_of_all(),
        look="ip route; ip neighbour",
    ),
    (PREDICTED, "off"): _predict(5, "{place} is off", hand("switch {place} on"), look="ip -br address"),
    (PREDICTED, "down"): _predict(
        6, "the interface of {place} to {what} is down", on("ip link set dev <interface> up"), look="ip -br link"
    ),
    (PREDICTED, "link down"): _predict(
        7,
        "{place} is down",
        hand("switch on the switch or the access point of {place}"),
        look="ip -br link",
        at=NETWORK,
    ),
    (PREDICTED, "apart"): _predict(
        8,
        "{place} keeps its clients apart",
        hand("switch off client isolation on the access point of {place}"),
        look="ip neighbour",
        at=NETWORK,
    ),
    (PREDICTED, "filtered"): _predict(
        9, "a packet filter on {place} drops {traffic}", _FILTER, look="nft -a list ruleset"
    ),
    (PREDICTED, "rejected"): _predict(
        10, "a packet filter on {place} refuses {traffic}", _FILTER, look="nft -a list ruleset"
    ),
    (PREDICTED, "not forwarded"): _predict(
        11,
        "{place} does not pass packets on to {what}",
        keep_settings("forwarding", {"net.ipv4.ip_forward": 1}),
        look="sysctl -a --pattern 'ip_forward|[.]forwarding'",
    ),
    (PREDICTED, "reverse path"): _predict(
        12,
        "{place} drops packets for {what} that come in on another interface than the one that leads back",
        keep_settings("rp-filter", {"net.ipv4.conf.all.rp_filter": 2}),
        look="sysctl -a --pattern rp_filter; ip route",
    ),
    (PREDICTED, "too large"): _predict(
        13,
        "{place} takes no {traffic} for {what}",
        hand("give all interfaces of a network one MTU, such as: ip link set dev eth0 mtu 1500"),
        look="ip -br link",
    ),
    (PREDICTED, "circle"): _predict(
        14,
        "{place} sends packets for {what} back to where it came from",
        hand("delete the route on {place} that leads back: ip route del, with the words of the look"),
        site_of_all("sets the planned one"),
    ),
    (PREDICTED, "elsewhere"): _predict(
        15,
        "{place} has {hop}, the address of another machine, too",
        hand("give {place} another address, in its network manager or in DHCP"),
        look="ip -br address; ip neighbour",
    ),
    (PREDICTED, "translated"): _predict(
        16,
        "{place} translates addresses (masquerading) of packets that leave it for {what}",
        hand("delete the rule on {place} that masquerades packets to the robots' networks"),
        look="nft -a list ruleset; iptables -t nat -S",
    ),
}


def _watch(number: int, sentence: str, look: str, *do: Advice) -> Fault:
    """Make a row of watch: {what} is the value, {found} and {expected} are what it is and was."""
    again = verify_again("names the faults of now")
    return Fault(
        f"RF-8{number:02}", sentence, do=do or (again,), look=(on(look),), why="a value was read before and after"
    )


#: The kinds that are nearest to the reason come first.
LOSSES: Mapping[Key, Fault] = {
    (WATCHED, "computer"): _watch(
        1, "{place} does not answer: {found}", "journalctl -b -1 -n 50", hand("switch {place} on")
    ),
    (WATCHED, "readings"): _watch(2, "{place} cannot look at its own values: {found}", "df -h; free -m"),
    (WATCHED, "link"): _watch(
        3,
        "the link {what} of {place} is {found}, and was {expected}",
        "dmesg --ctime | tail -20; ip -s link",
        hand("plug the cable of {place} in anew, or bring it nearer to the access point"),
    ),
    (WATCHED, "address"): _watch(
        4,
        "the address {what} of {place} is {found}, and was on {expected}",
        "ip -br address; journalctl -n 50 -u NetworkManager -u systemd-networkd",
        hand("reserve the address in DHCP, or give it by hand"),
    ),
    (WATCHED, "service"): _watch(5, "{what} on {place}: {found}", "systemctl list-units --all 'multimaster-*'"),
    (WATCHED, "route"): _watch(
        6,
        "the route of {place} to {what} is {found}, and was {expected}",
        "ip rule; ip route; journalctl -n 50 -u NetworkManager -u systemd-networkd",
        site("sets its routes again"),
    ),
    (WATCHED, "setting"): _watch(
        7, "{what} on {place} is {found}, and was {expected}", "journalctl -n 50 -u systemd-sysctl"
    ),
    (WATCHED, "hosts"): _watch(8, "{what} on {place} was changed", "stat /etc/hosts; grep -n rosfleet /etc/hosts"),
    (WATCHED, "clock"): _watch(9, "the clock of {place} was {found}", "timedatectl; chronyc tracking"),
    (WATCHED, "membership"): _watch(
        10,
        "no program on {place} is a member of the group on {what}",
        "ip maddress; systemctl status multimaster-discovery",
    ),
    (WATCHED, "port"): _watch(
        11, "{place} cannot connect to the discovery node of {what}: {found}", "ip route; nft list ruleset"
    ),
    (WATCHED, "master"): _watch(
        12, "{place} hears no heartbeat of {what}", "timeout 5 tcpdump -n -i any udp port 11511"
    ),
    (WATCHED, "group"): _watch(
        13,
        "{place} hears no heartbeat of {what} on the group",
        "ip maddress; timeout 5 tcpdump -n -i any udp port 11511",
    ),
}
#: Of several losses, and of a value that no row above has.
SUMMARIES: Mapping[Key, Fault] = {
    (WATCHED, "snooping"): Fault(
        "RF-821",
        "{what} computers hear no heartbeat on the group any more, and the rest still works: the network does not pass the group on. "
        "A switch with IGMP snooping and without a querier forgets a group after about 260 s.",
        do=(
            hand("switch IGMP snooping off on the switch, or a querier on"),
            change("set multimaster_transport: both", "robots also find each other without the group"),
            site_of_all(),
        ),
        look=(Advice("any computer of the fleet", "timeout 10 tcpdump -n -i any igmp"),),
        why="several computers lose several masters at once",
    ),
    (WATCHED, "value"): _watch(22, "{what} on {place} is {found}", "journalctl -n 50"),
}
