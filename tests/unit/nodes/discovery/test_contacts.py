# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about names that lead elsewhere."""

from rosfleet_multimaster.discovery.contacts import Contacts
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.process import program


def test_what_is_said_of_a_master_that_is_not_known_is_not_kept():
    errors, loop = {}, Loop()
    known = []
    contacts = Contacts(
        loop,
        Workers(loop, 1),
        program.LimitedLog(),
        errors,
        lambda uri: uri in known,
        lambda address: True,
        lambda *result: True,
    )
    contact = Contact(1.0, "http://robot2:11311/", "robot2", "/master_discovery")
    contacts._compare(contact, "192.168.1.2", "", None)
    assert errors == {}
    known.append(contact.uri)
    contacts._compare(contact, "192.168.1.2", "", None)
    assert list(errors) == [contact.uri]
