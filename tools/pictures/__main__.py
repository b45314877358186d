# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the pictures of the pages, docs/images/*.svg, out of the shipped inventories and the code.

With `--check` nothing is written; a picture that is not the generated one is an error.
"""

from __future__ import annotations

import sys

from .shipped import ROOT

sys.path.insert(0, str(ROOT / "roles/nodes/files/python"))

from .gallery import FOLDER, PICTURES  # noqa: E402


def main() -> int:
    """Write or compare each picture."""
    different = 0
    for name, draw in PICTURES.items():
        path, drawn = FOLDER / f"{name}.svg", draw()
        if path.exists() and path.read_text(encoding="utf-8") == drawn:
            continue
        different += 1
        if "--check" in sys.argv[1:]:
            print(f"{path.relative_to(ROOT)} is not what the code and the inventories say; run `make pictures`.")
        else:
            path.write_text(drawn, encoding="utf-8")
    return int("--check" in sys.argv[1:] and different > 0)


if __name__ == "__main__":
    sys.exit(main())
