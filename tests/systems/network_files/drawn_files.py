# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Network files as people have them, drawn by chance: path -> content."""

import field
import yaml
from hypothesis import strategies as st

ETHERNETS = ("eth0", "eth1", "enp3s0", "lan0")

# /etc/network/interfaces

BEGINNINGS = (
    "auto {0}",
    "allow-hotplug {0}",
    "auto lo {0}",
    "auto /{0}*",
    "allow-auto {0}\nauto {0}",
    "# auto {0}\nauto {0}",
)
FAMILIES = {
    "cidr": "iface {0} inet static\n    address {1}.7/24\n",
    "netmask": "iface {0} inet static\n\taddress\t{1}.7\n\tnetmask 255.255.255.0\n\tbroadcast {1}.255\n",
    "length": "iface {0} inet static\n  address {1}.7\n  # of the lab\n  netmask 24\n  dns-nameservers 8.8.8.8 \\\n     1.1.1.1\n",
    "commands": "iface {0} inet manual\n    up ip link set $IFACE up\n    up ip address add {1}.7/24 dev $IFACE\n"
    "    down ip address flush dev $IFACE\n",
    "inherited": "iface lab-{0} inet static\n    netmask 255.255.255.0\n\niface {0} inet static inherits lab-{0}\n    address {1}.7\n",
    "mapped": "mapping {0}\n    script /bin/cat\n    map {0}-lab\n\niface {0}-lab inet static\n    address {1}.7/24\n",
    "route": "iface {0} inet static\n    address {1}.7/24\n    up ip route add {2}.0.0/16 via {1}.9 || true\n",
    "gateway": "iface {0} inet static\n    address {1}.7/24\n    gateway {1}.1\n    metric 7{3}\n",
    "alias": "iface {0} inet manual\n\nauto {0}:1\niface {0}:1 inet static\n    address {1}.7/24\n",
    "aliases": "iface {0} inet static\n    address {1}.7/24\nauto {0}:0 {0}:lab\niface {0}:0 inet static\n    address {2}.0.7/24\n"
    "iface {0}:lab inet static\n    address {2}.1.7\n    netmask 255.255.255.0\n",
    "twice": "iface {0} inet static\n    address {1}.7/24\niface {0} inet static\n    address {2}.0.7/24\niface {0} inet6 auto\n",
    "lease": "iface {0} inet dhcp\n    hostname robot\n",
    "silent": "no-scripts {0}\niface {0} inet static\n    address {1}.7/24\n",
    "loud": "no-scripts /{0}*\niface {0} inet static\n    address {1}.7/24\n",  # a pattern of ``auto`` alone
    "all_silent": "no-scripts lo {0}*\niface {0} inet static\n    address {1}.7/24\n",
}
SOURCES = ("source /etc/network/interfaces.d/*", "source-directory /etc/network/interfaces.d", "source interfaces.d/*")
SLIPS = (bytes, bytes, bytes, lambda text: text.rstrip(b"\n"), lambda text: text.replace(b"    ", b"\t"),
         lambda text: text.replace(b"\n", b"  \n"), lambda text: text.replace(b"\n\n", b"\n\n\n# \xc3\xbcber\n\n"))  # fmt: skip


@st.composite
def interfaces(draw):
    """Draw files of ifupdown: (files, the links without hooks)."""
    main, others, silent = ["auto lo\niface lo inet loopback\n"], {}, set()
    for number, link in enumerate(draw(st.lists(st.sampled_from(ETHERNETS), min_size=1, max_size=3, unique=True)), 1):
        family = draw(st.sampled_from(sorted(FAMILIES)))
        silent |= {link} if "silent" in family else set()
        begin = draw(st.sampled_from(BEGINNINGS)).format(link)
        stanza = f"{begin}\n{FAMILIES[family].format(link, f'192.168.{number}', f'172.{20 + number}', number)}"
        if draw(st.booleans()):
            others[f"/etc/network/interfaces.d/{link}"] = stanza.encode()
        else:
            main.append(stanza)
    if others:
        main.insert(draw(st.integers(0, len(main))), draw(st.sampled_from(SOURCES)) + "\n")
    content = draw(st.sampled_from(SLIPS))("\n".join(main).encode())
    return {"/etc/network/interfaces": content, **others}, silent


def mixed_interfaces():
    """Draw /etc/network/interfaces out of pieces of the files of several people."""
    return field.mixtures("interfaces", most=4).map(lambda content: {"/etc/network/interfaces": content})


# netplan

NAMES = ("00-installer-config", "01-netcfg", "50-cloud-init", "90-NM-x", "99_config", "config", "robot netz", "zwei")
ADDRESSES = {
    "lease": lambda net: {"dhcp4": True},
    "words": lambda net: {"dhcp4": "no", "dhcp6": "off", "optional": "yes", "addresses": [f"{net}.7/24"]},
    "gateway4": lambda net: {"addresses": [f"{net}.7/24"], "gateway4": f"{net}.1"},
    "route": lambda net: {"addresses": [f"{net}.7/24"], "routes": [{"to": "172.20.0.0/16", "via": f"{net}.9", "metric": 50}]},
    "policy": lambda net: {"addresses": [f"{net}.7/24"], "routing-policy": [{"from": f"{net}.7", "table": 52}]},
    "labels": lambda net: {"addresses": [f"{net}.7/24", {f"{net}.8/24": {"label": "lab:1", "lifetime": 0}}], "mtu": 1400},
}  # fmt: skip


def _match(draw, link):
    mac = f"52:54:00:aa:bb:0{('lan0', 'eth0', 'eth1', 'eth2', '', '', 'enp3s0').index(link)}"
    return draw(
        st.sampled_from(
            [
                (link, {}),
                (link, {"match": {"name": link}}),
                (f"any-{link}", {"match": {"name": f"{link[:-1]}[{link[-1]}]"}}),
                (f"id-{link}", {"match": {"macaddress": mac.upper()}}),
                (link, {"match": {"macaddress": mac}, "set-name": link}),
            ]
        )
    )


@st.composite
def netplans(draw):
    """Draw files of netplan, of which several may say something of one definition."""
    files = {}

    def put(section, name, settings, renderer=None, file=None):
        file = file or draw(st.sampled_from(NAMES))
        network = files.setdefault(file, {"version": 2})
        network.setdefault(section, {}).setdefault(name, {}).update(settings)
        if renderer:
            network["renderer"] = renderer

    for number, link in enumerate(draw(st.lists(st.sampled_from(ETHERNETS), min_size=1, max_size=3, unique=True)), 1):
        name, match = _match(draw, link)
        settings = ADDRESSES[draw(st.sampled_from(sorted(ADDRESSES)))](f"192.168.{number}")
        if draw(st.booleans()):
            put("ethernets", name, match)
            put("ethernets", name, settings)
        else:
            put("ethernets", name, {**match, **settings}, draw(st.sampled_from([None, "networkd"])))
    if draw(st.booleans()):
        point = {
            "lab": {"password": "0123456789"},
            "büro / 2": {"auth": {"key-management": "psk", "password": "01234567"}},
        }
        put("wifis", "wlan0", {"access-points": point, "dhcp4": True, "regulatory-domain": "ES"})
    if draw(st.booleans()):
        put("bridges", "br0", {"interfaces": [], "addresses": ["192.168.9.1/24"], "parameters": {"stp": False}})
    if draw(st.booleans()):
        file = draw(st.sampled_from(NAMES))  # netplan wants both in one, or the link before
        put("ethernets", "eno1", {"optional": True}, file=file)
        put("vlans", "eth0.20", {"id": 20, "link": "eno1", "addresses": ["192.168.20.1/24"]}, file=file)
    spell = draw(st.sampled_from([_plainly, _by_anchors, _in_json]))
    return {f"/etc/netplan/{name}.yaml": spell(network) for name, network in files.items()}


def _plainly(network):
    return b"# of the robot\n---\n" + yaml.safe_dump({"network": network}, allow_unicode=True).encode()


def _by_anchors(network):
    """Spell a file in which equal lists and mappings are one, by an anchor."""
    text = yaml.safe_dump({"network": network}, indent=4, default_flow_style=None).encode()
    return text.replace(b"dhcp4: true", b"dhcp4: &lease yes\n            dhcp6: *lease") if b"{" not in text else text


def _in_json(network):
    return yaml.safe_dump({"network": network}, default_flow_style=True, width=1000).rstrip("\n").encode()


# Keyfiles of NetworkManager

FIRST = {
    "plain": "[connection]\nid={0}\nuuid=6f0d8a52-1111-4222-8333-94a5b6c7d8e{2}\ntype=ethernet\ninterface-name={1}\n",
    "unnamed": "# made by hand; no id\n[connection]\ntype=ethernet\ninterface-name={1}\n\n[ethernet]\n",
    "wide": "[connection]\n\tid = {0}\n\tuuid = 6f0d8a52-1111-4222-8333-94a5b6c7d8e{2}\n\ttype = ethernet\n\tinterface-name = {1}\n",
    "old": "[connection]\nid={0}\nuuid=6f0d8a52-1111-4222-8333-94a5b6c7d8e{2}\ntype=802-3-ethernet\ninterface-name={1}\npermissions=\n",
    "apart": "[connection]\nid={0}\ntype=ethernet\n\n[ipv6]\nmethod=ignore\n\n[connection]\ninterface-name={1}\nautoconnect-priority=-999\n",
    "by_address": "[connection]\nid={0}\ntype=ethernet\nuuid=6f0d8a52-1111-4222-8333-94a5b6c7d8e{2}\n[match]\ninterface-name={1};\n",
}
REST = {
    "static": "[ipv4]\nmethod=manual\naddress1={0}.7/24\n",
    "routes": "[ipv4]\naddress1={0}.7/24,{0}.1\nroute1=10.0.0.0/8,{0}.9,50\nroute1_options=onlink=true,mtu=1400\nmethod=manual\ndns={0}.1;\n",
    "old_routes": "[ipv4]\nmethod=manual\naddresses1={0}.7;24;{0}.1;\nroutes1=10.9.0.0;16;{0}.9;5;\n",
    "two": "[ipv4]\nmethod=manual\naddress2={0}.8/24\naddress1={0}.7/24\nnever-default=true\n# of the lab\nroute-metric=70\n",
    "both": "[ipv4]\nmethod=manual\naddress1={0}.7/24\n\n[ipv6]\nmethod=manual\naddress1=fd00:{1}::7/64\nroute1=fd00:99::/64,fd00:{1}::1\n",
    "table": "[ipv4]\nmethod=manual\naddress1={0}.7/24\nroute-table=254\nroute1=10.8.0.0/16,{0}.9,0\nroute1_options=table=52\n",
    "rule": "[ipv4]\nmethod=manual\naddress1={0}.7/24\nrouting-rule1=priority 99 from {0}.7/32 table 52\n\n[proxy]\n\n[user]\nlab.note=Büro\n",
}
TITLES = ("Wired connection 1", "robot: lab\\\\wired", "Büro / 2", "netplan-eth0", "lo")


@st.composite
def keyfiles(draw):
    """Draw profiles of NetworkManager, each of its own link."""
    files = {}
    for number, link in enumerate(draw(st.lists(st.sampled_from(ETHERNETS), min_size=1, max_size=2, unique=True)), 1):
        text = draw(st.sampled_from(sorted(FIRST.values()))).format(draw(st.sampled_from(TITLES)), link, number)
        text += draw(st.sampled_from(["", "\n"])) + draw(st.sampled_from(sorted(REST.values()))).format(
            f"192.168.{number}", number
        )
        ending = draw(st.sampled_from(["", ".nmconnection"]))
        name = draw(st.sampled_from([link, f"Wired connection {number}", f"Büro {number}"]))
        files[f"/etc/NetworkManager/system-connections/{name}{ending}"] = draw(st.sampled_from(SLIPS[:4]))(
            text.encode()
        )
    return files
