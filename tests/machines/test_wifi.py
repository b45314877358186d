# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Wi-Fi by the kernel's simulated radios (mac80211_hwsim): a station saves power, roams between two access points, and loses both.

All radios are in one machine. The air has no losses and no distance. About five minutes for each manager if nothing else runs.
"""

import contextlib
import json
from dataclasses import replace

import pytest
import vm
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.network import LINKS
from foreign import SEEN
from setups.links import wait_until

HOST, OTHER, OWN = "ana", "10.9.0.5", "10.9.0.11"
FIRST = {"destination": "10.70.1.0/24", "gateway": OTHER}
OURS = f"10.70.1.0/24 via {OTHER} dev wlan0 proto static"
MEMBERS = [{"name": name, "address": address} for name, address in ((HOST, OWN), ("other", OTHER))]
POINT = "systemctl reset-failed 2>/dev/null; systemd-run --quiet --collect --unit ap{n} -p NetworkNamespacePath=/run/netns/air hostapd /run/ap{n}.conf"
START = "; ".join(POINT.format(n=n) for n in (1, 2))
# Two access points of one network and their bridge, which has the address of another computer, are in a namespace: the air.
AIR = f"""set -e
modprobe mac80211_hwsim radios=4
ip netns add air
iw phy phy1 set netns name air
iw phy phy2 set netns name air
ip -n air link add br0 type bridge
ip -n air address add 10.9.0.1/24 dev br0
ip -n air address add {OTHER}/24 dev br0
ip -n air link set br0 up
for n in 1 2; do
  printf '%s\\n' interface=wlan$n bridge=br0 ssid=lab hw_mode=g channel=$((n * 5 - 4)) >/run/ap$n.conf
  printf '%s\\n' wpa=2 wpa_key_mgmt=WPA-PSK rsn_pairwise=CCMP wpa_passphrase=of-the-lab >>/run/ap$n.conf
done
printf '%s\\n' interface=wlan3 ssid=own hw_mode=g channel=11 >/run/ap3.conf
{START}
"""
# As people configure a station, with Ubuntu's file of power saving beside NetworkManager.
STATIONS = {
    "networkd": """
umask 077
printf 'ctrl_interface=/run/wpa_supplicant\\nnetwork={\\n  ssid="lab"\\n  psk="of-the-lab"\\n}\\n' >/etc/wpa_supplicant/wpa_supplicant-wlan0.conf
umask 022
printf '[Match]\\nName=wlan0\\n\\n[Network]\\nAddress=10.9.0.11/24\\nIPv6AcceptRA=no\\n' >/etc/systemd/network/20-wlan0.network
networkctl reload
systemctl enable --now --quiet wpa_supplicant@wlan0
""",
    "networkmanager": """
nmcli device set wlan3 managed no
printf '[connection]\\nwifi.powersave = 3\\n' >/etc/NetworkManager/conf.d/default-wifi-powersave-on.conf
nmcli general reload conf
umask 077
printf '[connection]\\nid=lab\\ntype=wifi\\ninterface-name=wlan0\\n[wifi]\\nssid=lab\\n[wifi-security]\\nkey-mgmt=wpa-psk\\npsk=of-the-lab\\n\
[ipv4]\\nmethod=manual\\naddress1=10.9.0.11/24\\n[ipv6]\\nmethod=disabled\\n' >/etc/NetworkManager/system-connections/lab.nmconnection
nmcli connection reload
""",
}
FOREIGN = """
ip route replace 10.50.0.0/24 via 10.9.0.1 dev wlan0
ip route replace 10.52.0.0/24 via 10.9.0.1 dev wlan0 proto bird
ip route replace default via 10.9.0.1 dev wlan0 table 100
ip rule delete pref 1000 2>/dev/null
ip rule add from 10.9.8.0/24 table 100 pref 1000
"""
MONITOR = (
    "systemd-run --quiet --collect --unit watch -p StandardOutput=file:/run/watch ip -ts monitor route address; sleep 2"
)


@pytest.fixture(scope="module", params=STATIONS)
def manager(request):
    return request.param


@pytest.fixture(scope="module")
def lab(manager, new_machines):
    host = replace(vm.make_host(HOST, ["192.168.1.11/24"], manager, "bookworm"), disk="wifi")
    with new_machines(f"machines-wifi-{manager}", [host]) as found:
        found.run(HOST, AIR)
        found.run(HOST, "set -e" + STATIONS[manager])
        wait_for_air(found)
        yield found


def hears(lab):
    return not lab.run(HOST, f"ping -q -c 1 -W 1 {OTHER} >/dev/null || echo lost", check=False)


def wait_for_air(lab):
    wait_until(lambda: hears(lab), 120, "the station is in the network")


def power(lab, interface="wlan0"):
    return lab.run(HOST, f"iw dev {interface} get power_save").strip()


def save_power(lab, state):
    lab.run(HOST, f"iw dev wlan0 set power_save {state}")


def observe(lab):
    """What the verification's module reads of this computer: its answer, and its interfaces by name."""
    arguments = {"name": HOST, "is_router": True, "members": MEMBERS, "masters": [], "patience": 1}
    status, output = lab.module(HOST, "multimaster_verify", arguments)
    assert status == 0, output
    answer = json.JSONDecoder().raw_decode(output, output.index("{"))[0]
    return answer, {entry["interface"]: entry for entry in answer["forwarding"]["interfaces"]}


def access_point(lab):
    """The number of the access point of the station."""
    near = lab.run(HOST, "iw dev wlan0 link").split()[2]
    return next(n for n in (1, 2) if near == address_of(lab, n))


def address_of(lab, n):
    return lab.run(HOST, f"ip netns exec air cat /sys/class/net/wlan{n}/address").strip()


def look_around(lab, address):
    """Let the station find an access point, which it forgets after a while."""
    look = f"wpa_cli -i wlan0 scan >/dev/null; sleep 2; wpa_cli -i wlan0 scan_results | grep -c {address}"
    wait_until(lambda: lab.run(HOST, look, check=False).strip() == "1", 60, f"the station finds {address}")


def roam(lab):
    """Let the station go to the other access point."""
    target = 3 - access_point(lab)
    look_around(lab, address_of(lab, target))
    assert lab.run(HOST, f"wpa_cli -i wlan0 roam {address_of(lab, target)}").strip() == "OK"
    wait_for_air(lab)
    assert access_point(lab) == target


def lost_by(lab, action):
    """The lines of addresses, rules and routes that an action loses, and the deletions meanwhile."""
    lab.run(HOST, FOREIGN)
    before = lab.run(HOST, SEEN).splitlines()
    lab.run(HOST, MONITOR)
    action(lab)
    lab.run(HOST, "sleep 3; systemctl stop watch")
    after = lab.run(HOST, SEEN).splitlines()
    return [line for line in before if line not in after], lab.run(HOST, "grep Deleted /run/watch", check=False)


def lose_all(lab):
    """End both access points for a while."""
    lab.run(HOST, "systemctl stop ap1 ap2")
    gone = f"ip -brief address show wlan0 | grep {OWN}/24"
    wait_until(lambda: not lab.run(HOST, gone, check=False), 60, "the manager drops the address")
    assert "wlan0" not in observe(lab)[1]  # of interfaces without an address the module tells nothing
    lab.run(HOST, START)
    wait_for_air(lab)


def has_ours(lab):
    return any(line.startswith(OURS) for line in lab.run(HOST, "ip route").splitlines())


@pytest.mark.parametrize("state", ["on", "off"])
def test_the_module_reads_what_the_driver_does(lab, state):
    save_power(lab, state)
    interfaces = observe(lab)[1]
    assert interfaces["wlan0"]["power_save"] is (state == "on")
    assert interfaces["wlan0"]["state"] == "up" and interfaces["wlan0"]["addresses"] == [OWN]
    assert interfaces["eth0"]["power_save"] is None


def test_an_access_point_is_not_said_to_save_power(lab):
    """As where interfaces save power from the beginning: the kernel tells it of an access point, too."""
    lab.run(
        HOST,
        f"iw dev wlan3 set power_save on; {POINT.format(n=3).replace('-p NetworkNamespacePath=/run/netns/air ', '')}",
    )
    lab.run(HOST, "ip address add 10.8.0.1/24 dev wlan3")
    wait_until(lambda: "type AP" in lab.run(HOST, "iw dev wlan3 info"), 30, "the access point is there")
    try:
        assert power(lab, "wlan3") == "Power save: on"
        assert "Operation not supported" in lab.run(HOST, "iw dev wlan3 set power_save off", check=False)
        assert observe(lab)[1]["wlan3"]["power_save"] is None
    finally:
        lab.run(HOST, "systemctl stop ap3; ip address flush dev wlan3")


def test_the_told_commands_end_the_saving_of_power(lab, manager):
    """Also where NetworkManager has Ubuntu's file, by which each connection saves power."""
    now, later = (advice.text.format(device="wlan0") for advice in LINKS["link", "power_save"].do)
    save_power(lab, "on")
    lab.run(HOST, now)
    assert power(lab) == "Power save: off"
    roam(lab)
    assert power(lab) == "Power save: off"
    if manager == "networkmanager":
        reconnect = "nmcli -w 60 connection down lab && nmcli -w 60 connection up lab"
        lab.run(HOST, reconnect)
        assert power(lab) == "Power save: on"
        lab.run(HOST, later)
        lab.run(HOST, reconnect)
        assert power(lab) == "Power save: off"
        wait_for_air(lab)


@pytest.mark.parametrize("action", [roam, lose_all], ids=["roam", "loss"])
def test_ours_are_there_afterwards_and_no_more_is_lost_than_without_us(lab, action):
    without, _deleted = lost_by(lab, action)
    status, output = lab.module(HOST, "routes", {"routes": [FIRST]})
    assert status == 0, output
    lost, deleted = lost_by(lab, action)
    wait_until(lambda: has_ours(lab), 60, "the route is there again")
    assert set(lost) <= set(without), deleted
    assert not any(line.startswith(OURS) for line in lost)
    status, output = lab.module(HOST, "routes", {"routes": []})
    assert status == 0, output
    assert not has_ours(lab)


@contextlib.contextmanager
def advised(lab, manager):
    """The setting that docs/start/machines.md advises for networkd, within the block. NetworkManager needs none."""
    if manager != "networkd":
        yield
        return
    file = "/etc/systemd/network/20-wlan0.network"
    lab.run(HOST, f"sed -i 's/^Address/IgnoreCarrierLoss=3s\\n&/' {file}; networkctl reload; sleep 3")
    wait_for_air(lab)
    try:
        yield
    finally:
        lab.run(HOST, f"sed -i /^Ignore/d {file}; networkctl reload; sleep 3")
        wait_for_air(lab)


def test_nothing_is_lost_at_a_roam_with_the_advised_setting(lab, manager):
    with advised(lab, manager):
        lost, deleted = lost_by(lab, roam)
    assert lost == [], deleted


def test_a_station_that_roams_all_the_time_is_heard(lab):
    """The questions of the module come through: it tries each three times."""
    there, back = (address_of(lab, n) for n in (3 - access_point(lab), access_point(lab)))
    look_around(lab, there)
    before = observe(lab)[1]["wlan0"]["carrier_changes"]
    loop = f"while :; do for to in {there} {back}; do wpa_cli -i wlan0 roam $to; sleep 4; done; done"
    lab.run(HOST, f"systemd-run --quiet --collect --unit roams bash -c '{loop}'")
    try:
        answer, _interfaces = observe(lab)
    finally:
        lab.run(HOST, "systemctl stop roams")
    wait_for_air(lab)
    after = observe(lab)[1]["wlan0"]["carrier_changes"]
    assert after >= before + 2
    (other,) = (entry for entry in answer["members"] if entry["name"] == "other")
    assert other["ping_address"]["ok"]
