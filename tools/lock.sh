#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# Writes requirements-lab.txt, requirements-dev.txt, requirements-quick.txt and tests/interop/needs.txt out of the files .in: every package that is
# needed, with the hashes of all its files, so for every machine and Python from 3.11 on, or 3.10 for 'make quick'. Versions that are in it already
# stay, unless 'make lock UPGRADE=yes'. A package of two of them has one version in both.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv=0.13.9
venv=.work/lock
options=(--quiet --universal --python-version 3.11 --generate-hashes --no-annotate --no-header --no-emit-index-url)
upgrade=()
[[ ${1:-} == yes ]] && upgrade=(--upgrade)

python3 -m venv --clear "$venv"
"$venv/bin/python" -m pip install -qq --disable-pip-version-check "uv==$uv"
lock() { # NAME [OPTION...]
  touch "$1.txt"
  cp "$1.txt" "$venv/locked.txt"
  "$venv/bin/uv" pip compile "${options[@]}" "${upgrade[@]}" "${@:2}" --output-file "$venv/locked.txt" "$1.in" >/dev/null
  {
    sed -n '1,2p' "$1.in"
    printf '#\n# Written by make lock out of %s.in. Do not edit it.\n' "$1"
    grep -v '^#' "$venv/locked.txt"
  } >"$1.txt"
}

lock requirements-dev
lock requirements-lab --constraint requirements-dev.txt
lock tests/interop/needs --constraint requirements-dev.txt
# Python 3.10 needs older versions of some. So those of the tests are preferred, as those in the file, and are no constraint.
cp requirements-dev.txt requirements-quick.txt
options=("${options[@]/3.11/3.10}")
upgrade=()
lock requirements-quick
rm -rf "$venv"
