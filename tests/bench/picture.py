# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Pictures, as files that are the same for the same figures. matplotlib takes a second to load, so only what draws imports this."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")
matplotlib.rcParams.update({"font.size": 9, "axes.spines.top": False, "savefig.dpi": 110})

from matplotlib import pyplot  # noqa: E402


def save(figure: Any, path: Path) -> None:
    """Write a figure as PNG, and close it."""
    figure.savefig(path, metadata={"Software": None})
    pyplot.close(figure)
