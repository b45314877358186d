# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Debian packages by apt itself, out of a folder of the computer: installed, taken back, and what others installed stays."""

import pytest

HOST = "kobuki2computer"
OURS, THEIRS = "ros-test-fkie-node", "ros-test-fkie-messages"
# Two of a kind, of which Debian wants one at a time, as chrony and systemd-timesyncd.
NEW, OLD = "ros-test-clock-new", "ros-test-clock-old"
ONE_OF_A_KIND = "Provides: ros-test-clock\\nConflicts: ros-test-clock\\nReplaces: ros-test-clock\\n"
#: Builds packages without content, and makes their folder a package source.
SOURCE = """
set -e
mkdir -p /srv/source; cd /srv/source
for name in {names}; do
    mkdir -p build/DEBIAN
    printf 'Package: %s\\nVersion: 1.3.2\\nArchitecture: all\\nMaintainer: nobody\\n' $name >build/DEBIAN/control
    case $name in *-clock-*) printf '{kind}' >>build/DEBIAN/control;; esac
    echo 'Description: a test' >>build/DEBIAN/control
    dpkg-deb --build build $name.deb >/dev/null
    {{ dpkg-deb --field $name.deb; printf 'Filename: ./%s.deb\\nSize: %s\\nSHA256: %s\\n\\n' \\
        $name $(stat -c %s $name.deb) $(sha256sum $name.deb | cut -d' ' -f1); }} >>Packages
    rm -r build
done
echo 'deb [trusted=yes] file:/srv/source ./' >/etc/apt/sources.list.d/test.list
apt-get update -o Dir::Etc::sourceparts=- -o Dir::Etc::sourcelist=/etc/apt/sources.list.d/test.list >/dev/null
"""


@pytest.fixture(autouse=True)
def _source(lab):
    lab.run(HOST, SOURCE.format(names=f"{OURS} {THEIRS} {NEW} {OLD}", kind=ONE_OF_A_KIND))
    yield
    lab.run(
        HOST,
        f"dpkg --purge {OURS} {THEIRS} {NEW} {OLD}; rm -r /srv/source /etc/apt/sources.list.d/test.list",
        check=False,
    )


def installed(lab):
    state = f"dpkg-query --show --showformat '${{db:Status-Abbrev}} ${{Package}}\\n' {OURS} {THEIRS} {NEW} {OLD} 2>/dev/null"
    return {line.split()[1] for line in lab.run(HOST, state, check=False).splitlines() if line.startswith("ii")}


def brought(lab, *names, **options):
    return lab.module(HOST, "multimaster_packages", {"names": list(names), **options})


def test_packages_are_installed_and_taken_back_by_apt(lab):
    lab.run(HOST, f"apt-get install -y {THEIRS} >/dev/null")
    status, output = brought(lab, OURS, THEIRS)
    assert status == 0 and "CHANGED" in output and installed(lab) == {OURS, THEIRS}, output
    assert OURS in lab.run(HOST, "cat /etc/rosfleet-multimaster/packages")
    status, output = brought(lab, OURS, THEIRS)
    assert status == 0 and "SUCCESS" in output, output
    status, output = brought(lab, keep=True)
    assert "SUCCESS" in output and installed(lab) == {OURS, THEIRS}, output
    status, output = brought(lab)
    assert status == 0 and "CHANGED" in output and installed(lab) == {THEIRS}, output
    assert "absent" in lab.run(HOST, "test -e /etc/rosfleet-multimaster/packages || echo absent")


def test_a_package_without_a_source_is_a_sentence_and_no_rest(lab):
    status, output = brought(lab, "ros-test-of-nobody", OURS)
    assert status != 0 and "E: Unable to locate package ros-test-of-nobody" in output, output
    assert "run it on this computer by hand" in output
    status, output = brought(lab)
    assert status == 0 and not installed(lab), output


def test_what_a_package_replaces_is_back_after_it(lab):
    lab.run(HOST, f"apt-get install -y {OLD} >/dev/null")
    status, output = brought(lab, NEW, OURS)
    assert status == 0 and installed(lab) == {NEW, OURS}, output
    assert f"# {NEW} replaced {OLD}\n" in lab.run(HOST, "cat /etc/rosfleet-multimaster/packages")
    status, output = brought(lab, OURS)
    assert status == 0 and f"1 removed, {OLD} is back." in output and installed(lab) == {OLD, OURS}, output
    status, output = brought(lab)
    assert status == 0 and installed(lab) == {OLD}, output
