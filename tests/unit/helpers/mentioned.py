# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts of a sentence: tests compare which host, variable, value and file it names, and not how it is worded."""

import re


def mentions(told, *facts):
    """Return True if a sentence names all these facts, or, of several sentences or lines, one of them does.

    A name within a longer one is another name: "kobuki1" is not in "kobuki1computer".
    """
    assert facts
    sentences = told.splitlines() if isinstance(told, str) else list(told)
    words = [re.compile(rf"(?<![\w-]){re.escape(str(fact))}(?!\w)") for fact in facts]
    return any(all(word.search(sentence) for word in words) for sentence in sentences)
