# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the tables of measurements into the pages.

With `--check` nothing is written; a table that is not the generated one is an error.
"""

from __future__ import annotations

import pathlib
import sys
from collections.abc import Iterator

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), *(str(ROOT / "tests/bench" / folder) for folder in ("", "network", "site"))]

import figures  # noqa: E402
import growth  # noqa: E402
import in_tree  # noqa: E402

from tools.marks import Table, write  # noqa: E402


def list_measured_tables() -> Iterator[Table]:
    """List the tables of the figures that are kept in the tree."""
    page, bench = "docs/understand/performance.md", "tests/bench/{}/README.md"
    network, grown = in_tree.read("network"), in_tree.read("growth")
    sources = [str((in_tree.FOLDER / f"{name}.json").relative_to(ROOT)) for name in ("network", "growth")]
    yield Table(page, "network", sources[0], lambda _old: figures.table(network["systems"], network["titles"]))
    yield Table(bench.format("network"), "crowd", sources[0], lambda _old: figures.crowd_table(network["crowd"]))
    yield Table(bench.format("site"), "site", sources[1], lambda _old: growth.runs_table(grown))
    yield Table(page, "plans", sources[1], lambda _old: growth.plans_table(grown))
    yield Table(bench.format("site"), "functions", sources[1], lambda _old: growth.functions_table(grown))


if __name__ == "__main__":
    sys.exit(write(list_measured_tables(), "readme"))
