# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Debian's cloud-init with user data that makes it write /etc/hosts at every boot, as that of Raspberry Pi Imager does."""

import pytest

HOST = "kobuki1computer"
ENTRIES = [
    {"address": "192.168.1.229", "names": ["kobuki1computer"]},
    {"address": "192.168.1.239", "names": ["kobuki2computer"]},
]
GUARD = "/etc/systemd/system/cloud-init*.service.d/*-rosfleet-multimaster.conf /etc/rosfleet-multimaster/cloud-init.cfg"
SEED = "/var/lib/cloud/seed/nocloud"
ONLY_HOSTS = "/etc/cloud/cloud.cfg.d/99-lab.cfg"
DISABLED = "/etc/cloud/cloud-init.disabled"
# The one module that is under test; the others would make accounts and host keys anew.
SETTINGS = """
datasource_list: [NoCloud]
network: {config: disabled}
cloud_init_modules: [update_etc_hosts]
cloud_config_modules: []
cloud_final_modules: []
"""


@pytest.fixture
def boot(lab):
    """Boots the computer with this user data and a new instance; returns its hosts file."""

    def boot(instance, user_data):
        lab.run(HOST, f"mkdir -p {SEED}; cat > {SEED}/user-data", stdin=f"#cloud-config\n{user_data}\n")
        lab.run(HOST, f"printf 'instance-id: {instance}\\nlocal-hostname: {HOST}\\n' > {SEED}/meta-data")
        lab.run(HOST, ": > /var/log/cloud-init.log")
        lab.reboot(HOST)
        lab.wait_until_up(HOST)
        status = lab.run(HOST, "timeout 150 cloud-init status --wait", check=False)
        log = lab.run(HOST, "cat /var/log/cloud-init.log", check=False)
        assert "status: done" in status and "config-update_etc_hosts ran successfully" in log, log[-3000:]
        assert instance in lab.run(HOST, "cat /var/lib/cloud/data/instance-id")
        return lab.run(HOST, "cat /etc/hosts")

    lab.run(HOST, f"rm {DISABLED}; cat > {ONLY_HOSTS}", stdin=SETTINGS)
    yield boot
    lab.run(HOST, f"touch {DISABLED}; rm -rf {SEED} {ONLY_HOSTS}; cloud-init clean --logs")


def test_the_bindings_survive_user_data_and_a_run_repairs_them(lab, boot):
    before = lab.run(HOST, "cat /etc/hosts")
    assert before.count("# rosfleet.multimaster") >= 2
    for value in ("true", "localhost"):
        assert boot(f"with-{value}", f"{{manage_etc_hosts: {value}}}") == before, value
        assert lab.run(HOST, f"getent ahostsv4 {HOST}").startswith("192.168.1.229 ")

    # Without the guard the same boot loses them, and the next run brings back both: the files are those of before.
    guard = lab.run(HOST, f"sha256sum {GUARD}")
    lab.run(HOST, f"rm {GUARD}")
    lost = boot("unguarded", "manage_etc_hosts: true")
    assert "# rosfleet.multimaster" not in lost and f"127.0.1.1 {HOST}" in lost
    status, output = lab.module(HOST, "hosts_entries", {"entries": ENTRIES})
    assert status == 0 and "cloud-init is kept from writing the file at boot" in output, output
    repaired = lab.run(HOST, "cat /etc/hosts")
    assert all(f"{entry['address']}\t{entry['names'][0]} # rosfleet" in repaired for entry in ENTRIES)
    assert lab.run(HOST, f"getent ahostsv4 {HOST}").startswith("192.168.1.229 ")
    assert lab.run(HOST, f"sha256sum {GUARD}") == guard

    # The lab's file again, for the tests that come after this one.
    lab.run(HOST, "cat > /etc/hosts", stdin=before)
    status, output = lab.module(HOST, "hosts_entries", {"entries": ENTRIES})
    assert status == 0 and lab.run(HOST, "cat /etc/hosts") == before, output
