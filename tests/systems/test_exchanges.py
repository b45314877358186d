# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Exchanges with a discovery node of another robot, as multimaster_fkie 1.3.2 would have them.

The other robot is played from the files in exchanges/ (their language is in lab/nodes/programs/peer_script.py); the real
nodes run as the collection installs them. In the files $number is the port of the peer's XML-RPC server, another one in
each exchange, $port the same as it stands in a record, and $name the name of its master.
"""

import json
import struct
from pathlib import Path

import pytest
import yaml

HERE = Path(__file__).parent
FILES = sorted((HERE / "exchanges").glob("*.yml"))
PLAYER = HERE.parents[1] / "lab" / "nodes" / "programs" / "peer_script.py"
# Each exchange has an address of its own: one that did not say who it is is asked twice in 30 s, and not again.
ADDRESSES = [f"192.168.1.{40 + number}" for number in range(len(FILES))]
SETTING = {"real": "192.168.1.31", "group": "226.0.0.0", "port": 11511}
# Upstream's rate, a heartbeat each 50 s, so that those do not look like answers.
RARELY = 's/"heartbeat_hz": [0-9.]*/"heartbeat_hz": 0.02/'


@pytest.fixture(scope="module")
def exchanges(new_lab):
    """The real robot after site.yml, and the computer that plays another one's."""
    with new_lab("systems-exchanges", HERE / "exchanges" / "inventory") as lab:
        status, output = lab.play("site.yml", "--limit", "bundled")
        assert status == 0, output
        lab.run("peer", "echo 192.168.1.31 real >> /etc/hosts; cat > /run/player.py", stdin=PLAYER.read_text())
        lab.run("peer", "".join(f"ip address add {address}/24 dev eth0; " for address in ADDRESSES))
        lab.run("real", f"sed -i '{RARELY}' /etc/rosfleet-multimaster/master_discovery.json")
        lab.run("real", "systemctl restart multimaster-discovery; sleep 6")  # it asks all for its first 5 s
        yield lab


@pytest.mark.parametrize("file, address", [*zip(FILES, ADDRESSES)], ids=[path.stem for path in FILES])
def test_the_real_nodes_answer_as_upstream_expects(exchanges, file, address):
    number = 11621 + FILES.index(file)
    known = {"number": str(number), "port": struct.pack("<H", number).hex(), "name": f"peer{number}"}
    script = {**SETTING, "address": address, "known": known, "steps": yaml.safe_load(file.read_text())}
    said = exchanges.run("peer", "python3 /run/player.py 2>&1", check=False, stdin=json.dumps(script))
    assert said == "ok\n", said + exchanges.run("real", "journalctl --unit 'multimaster-*' --output cat --lines 40")
