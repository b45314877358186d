#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# Fetches what fkie_mas needs beside ROS into .work/mas, which the lab's computers get as a folder: the lab has no network.
# Python packages of needs.txt, for any Python 3: those with compiled parts work without them, or have them for all versions.
# The programs screen and its library of this machine's Debian, which is the lab's or newer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

target=.work/mas
cmp --silent tests/interop/needs.txt "$target/needs.txt" && exit
rm -rf "$target"
mkdir -p "$target"
chmod 755 "$target"
printf 'interop: fetching what fkie_mas needs into %s ...\n' "$target"
.work/venv/bin/python -m pip install -qq --disable-pip-version-check --no-compile --require-hashes --requirement tests/interop/needs.txt --target "$target/python"
(cd "$target" && apt-get -qq download screen libutempter0 2>/dev/null && for package in *.deb; do dpkg-deb --extract "$package" programs; done && rm ./*.deb)
cp tests/interop/needs.txt "$target/"
