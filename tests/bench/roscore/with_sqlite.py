# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The bundled roscore with sqlite3 in the place of its journal, to compare the two. SYNCHRONOUS is normal or full.

It is done as well as it can be: WAL, a statement for each thing that changed, checkpoints in a thread of their own.
"""

import json
import os
import sqlite3
import threading
import time

from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.roscore import __main__ as roscore
from rosfleet_multimaster.roscore import store
from rosfleet_multimaster.roscore.core import store_format
from rosfleet_multimaster.roscore.core.registry import USERS, Record, Registry

FILE = "registrations.sqlite"


def opened(folder):
    """A connection."""
    connection = sqlite3.connect(os.path.join(folder, FILE), check_same_thread=False, isolation_level=None)
    for pragma in ("journal_mode=WAL", f"synchronous={os.environ['SYNCHRONOUS']}", "wal_autocheckpoint=0"):
        connection.execute(f"PRAGMA {pragma}").fetchall()
    connection.execute("CREATE TABLE IF NOT EXISTS state (thing TEXT PRIMARY KEY, record TEXT) WITHOUT ROWID")
    return connection


def thing(record):
    """The thing that a record is about, as a key."""
    return json.dumps(record.row[:4] if record.kind in USERS else record.row[:2])


class Store:
    """As roscore/store.py has it."""

    def __init__(self, folder, lock, parts):
        os.makedirs(folder, exist_ok=True)
        self._lock, self._parts = lock, parts
        self._writer, self._cleaner = opened(folder), opened(folder)
        self._dirty = threading.Event()

    def start(self, _snapshot=None):
        with self._lock:
            self._writer.execute("BEGIN")
            self._writer.execute("DELETE FROM state")
            for part in self._parts():
                self._write(part)
            self._writer.execute("COMMIT")
        threading.Thread(target=self._keep, daemon=True).start()

    def add(self, records):
        self._writer.execute("BEGIN")
        self._write(records)
        self._writer.execute("COMMIT")
        self._dirty.set()

    def _write(self, records):
        for record in records:
            if record.kind == "delete" or not record.is_there:
                self._writer.execute("DELETE FROM state WHERE thing = ?", (thing(record),))
            else:
                self._writer.execute("REPLACE INTO state VALUES (?, ?)", (thing(record), json.dumps(record.row)))

    def wait(self):
        return True

    def sync(self):
        self._cleaner.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()

    def _keep(self):
        while True:
            self._dirty.wait()
            time.sleep(store.SYNC)
            self._dirty.clear()
            self.sync()


def read(folder):
    """As roscore/store.py has it."""
    if not os.path.exists(os.path.join(folder, FILE)):
        return None
    found = Registry()
    for (text,) in opened(folder).execute("SELECT record FROM state"):
        found.apply(Record.from_row(json.loads(text)))
    return store_format.Content(found, store.read_boot_id(), 0, 0, False, False, 0)


if __name__ == "__main__":
    store.Store, store.read = Store, read
    program.run(roscore.main)
