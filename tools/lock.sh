#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# Writes requirements-dev.txt out of requirements-dev.in: every package that is needed, with the hashes of all its files, so
# for every machine and Python from 3.11 on. Versions that are in it already stay, unless 'make lock UPGRADE=yes'.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv=0.13.9
venv=.work/lock
options=(--quiet --universal --python-version 3.11 --generate-hashes --no-annotate --no-header --no-emit-index-url)
[[ ${1:-} == yes ]] && options+=(--upgrade)

python3 -m venv --clear "$venv"
"$venv/bin/python" -m pip install -qq --disable-pip-version-check "uv==$uv"
touch requirements-dev.txt
cp requirements-dev.txt "$venv/locked.txt"
"$venv/bin/uv" pip compile "${options[@]}" --output-file "$venv/locked.txt" requirements-dev.in >/dev/null
{
  sed -n '1,2p' requirements-dev.in
  printf '#\n# Written by make lock out of requirements-dev.in. Do not edit it.\n'
  grep -v '^#' "$venv/locked.txt"
} >requirements-dev.txt
rm -rf "$venv"
