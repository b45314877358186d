# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The parameters of a roscore behind real XML-RPC, as rosmaster has them: a value gives way to a namespace without a word.

tests/systems/test_data_flow.py tries the same with real roscores.
"""

import threading

from rosfleet_multimaster.edge.core.shares import Shares
from rosfleet_multimaster.edge.process.room import Room
from running_sync import serve


class ParameterServer:
    """A tree of parameters. `changes` has the calls that change something."""

    def __init__(self):
        self.tree, self.changes, self.asked, self.lock = {}, [], 0, threading.Lock()
        self.before = self.after = lambda: None  # a change
        self.wrong = {}  # name -> what it answers instead
        self.server, self.uri = serve({"system.multicall": self.multicall, "getParam": self.get})
        self.server.room = Room(Shares(1 << 30, 1 << 30, ()), 0, 0.0)  # a roscore gives values that no node would

    def multicall(self, calls):
        self.asked += 1
        methods = {
            "getParam": self.get,
            "getParamNames": lambda caller: [1, "", sorted(self.leaves(self.tree))],
            "setParam": self.set,
            "deleteParam": self.delete,
        }
        return [[methods[call["methodName"]](*call["params"])] for call in calls]

    def get(self, _caller, name):
        if name in self.wrong:
            return self.wrong[name]
        value = self.tree
        for part in name.split("/")[1:]:
            if not isinstance(value, dict) or part not in value:
                return [-1, "not set", 0]
            value = value[part]
        return [1, "", value]

    def set(self, _caller, name, value):
        self.before()
        with self.lock:
            *parents, last = name.split("/")[1:]
            within = self.tree
            for part in parents:
                if not isinstance(within.get(part), dict):
                    within[part] = {}
                within = within[part]
            within[last] = value
            self.changes.append(("set", name))
        self.after()
        return [1, "", 0]

    def delete(self, caller, name):
        self.before()
        above, _slash, last = name.rpartition("/")
        code, _text, within = self.get(caller, above) if above else (1, "", self.tree)
        if code != 1 or not isinstance(within, dict) or last not in within:
            return [-1, "not set", 0]
        with self.lock:
            del within[last]
            self.changes.append(("delete", name))
        self.after()
        return [1, "", 0]

    def leaves(self, tree, at=""):
        for name, value in tree.items():
            if isinstance(value, dict):
                yield from self.leaves(value, f"{at}/{name}")
            else:
                yield f"{at}/{name}"

    def is_asked_after(self, count):
        return self.asked > count

    def own(self):
        """The parameters, without the record."""
        return {name: value for name, value in self.tree.items() if name != "rosfleet_multimaster"}
