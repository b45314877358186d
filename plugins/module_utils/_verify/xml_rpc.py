# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""XML-RPC with a time limit."""

import typing
import xmlrpc.client

CALL = 5.0  # seconds that an XML-RPC call may take


class _Transport(xmlrpc.client.Transport):
    """HTTP with a time limit: a node that accepts and never answers must not hold the probe."""

    def make_connection(self, host: typing.Any) -> typing.Any:
        connection = xmlrpc.client.Transport.make_connection(self, host)
        connection.timeout = CALL
        return connection


def server(uri: str) -> typing.Any:
    """Return an XML-RPC server that is asked with a time limit."""
    return xmlrpc.client.ServerProxy(uri, transport=_Transport())
