# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the table of variables into README.md from where the variables are specified; `--check` only compares."""

import pathlib
import sys

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import variables

README = pathlib.Path(__file__).parent.parent / "README.md"
BEGIN = "<!-- variables: generated from plugins/plugin_utils/_fleet/variables.py by `make readme` -->\n"
END = "<!-- end of variables -->\n"


def with_table(text: str) -> str:
    """The README with the current table between its two marks."""
    head, _begin, rest = text.partition(BEGIN)
    _old, _end, tail = rest.partition(END)
    return f"{head}{BEGIN}\n{variables.markdown_table()}\n{END}{tail}"


def main() -> int:
    before = README.read_text(encoding="utf-8")
    after = with_table(before)
    if "--check" in sys.argv[1:]:
        if before != after:
            print(
                "README.md: the table of variables is not the one of plugins/plugin_utils/_fleet/variables.py; run `make readme`."
            )
        return int(before != after)
    README.write_text(after, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
