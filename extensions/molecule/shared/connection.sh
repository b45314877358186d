#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# An inventory script: how the hosts of a scenario's inventory are reached. A script and no file, so that it is always there:
# without it, the addresses of the shipped inventory would be called, which on somebody's network are real machines.
set -euo pipefail
cd "$MOLECULE_SCENARIO_DIRECTORY/../../.."
exec .work/venv/bin/python lab/lab.py inventory --print \
  --name "molecule-$MOLECULE_SCENARIO_NAME" --inventory "${LAB_INVENTORY:-inventory/${LAYOUT:-single_computer}}"
