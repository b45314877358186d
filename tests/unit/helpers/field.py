# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files as people have them (tests/unit/fixtures/field), and mixtures of them, for property tests.

FIELD_EXAMPLES is how many mixtures each property tries; `make test-long` tries many. They are the same in each run;
FIELD_SEED is a number with which they are others.
"""

import codecs
import os
import pathlib

from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st

FOLDER = pathlib.Path(__file__).parents[1] / "fixtures" / "field"
EXAMPLES = int(os.environ.get("FIELD_EXAMPLES") or 40)
SEED = os.environ.get("FIELD_SEED")


def tries(share=1.0, shrink=True):
    """Set how many examples a property tries: a share of FIELD_EXAMPLES, less where each one runs a program.

    `shrink`: look for a smaller example of a failure, which takes many more of them.
    """
    phases = [phase for phase in Phase if shrink or phase not in (Phase.shrink, Phase.explain)]
    checks = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
    count = max(3, int(EXAMPLES * share))
    chosen = settings(
        max_examples=count, deadline=None, phases=phases, suppress_health_check=checks, derandomize=not SEED
    )
    return (lambda test: seed(int(SEED))(chosen(test))) if SEED else chosen


#: The files that people have in another form than this repository may: by the stem of their names.
FORMS = {
    "byte_order_mark": lambda content: codecs.BOM_UTF8 + content,
    "crlf": lambda content: content.replace(b"\n", b"\r\n"),
    "latin_1": lambda content: content.decode().encode("latin-1"),
}


def read(kind):
    """Read the files of a kind as people have them: name -> bytes."""
    files = sorted((FOLDER / kind).iterdir())
    return {path.name: FORMS.get(path.stem, bytes)(path.read_bytes()) for path in files}


def pieces(kind):
    """List what mixtures are made of: whole files, and their paragraphs."""
    found = [content for content in read(kind).values() if content]
    return found + [part + b"\n" for content in found for part in content.split(b"\n\n") if part.strip()]


@st.composite
def mixtures(draw, kind, most=6):
    """Draw a file out of pieces of several files, with the slips of people."""
    content = b"".join(draw(st.lists(st.sampled_from(pieces(kind)), max_size=most)))
    return draw(st.sampled_from(SLIPS))(content)


def double_a_line(content):
    lines = content.split(b"\n")
    return b"\n".join([*lines[: len(lines) // 2 + 1], *lines[len(lines) // 2 :]])


#: What becomes of a file in the hands of people and their editors.
SLIPS = (
    lambda content: content,
    lambda content: content,
    lambda content: content.rstrip(b"\n"),
    lambda content: content.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"),
    lambda content: content.replace(b"\n", b"  \t\n"),
    lambda content: content.replace(b" ", b"\t"),
    lambda content: content.replace(b" ", b"\xc2\xa0", 1),
    lambda content: b"\xef\xbb\xbf" + content,
    lambda content: content[: len(content) * 2 // 3],
    double_a_line,
)
