# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""How the programs of the lab tell what they do now."""


def say(text: str) -> None:
    """Print a line between the output of the tools."""
    print(f"\n== {text}", flush=True)
