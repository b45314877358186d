# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit of registrations taken of another master: 5,000, or the room that the states of all masters leave (sync/state_room.py).

A master with more is reported.

Neither chance nor the other side selects them. Registrations that were taken before stay while they are offered; then
come the first ones by kind and name. Nodes of third masters are not registered and not counted: in a large fleet each
master has thousands. Their publishers for its own subscribers are kept as far as there is room, since these are sent
them (sync.py). Free of sockets, threads and clocks.
"""

from dataclasses import replace
from typing import Any, Container, Dict, Iterable, List, Mapping, Optional, Set, Tuple

from ...protocol.graph import Endpoints, State, keep_part
from ...protocol.messages import KINDS, Row, rows
from ...protocol.plain_text import quote
from .sync import RegistrationConflict, Remote, master_nodes

MOST = 5000  # registrations of one master


def limit_state(
    state: State,
    before: Optional[State] = None,
    most: int = MOST,
    own_uri: str = "",
    sync_remote_nodes: bool = False,
) -> State:
    """The state, or the part of it that is taken. `before`: the part that was taken until now.

    `own_uri`: of the master here; `sync_remote_nodes`: as in `sync.select`. Both decide which nodes are the master's own.
    """
    if size(state) <= most:
        return state
    everything = list(rows(state))
    mine = master_nodes(state, own_uri, sync_remote_nodes)
    own = [row for row in everything if row[2] in mine]
    old = set(rows(before)) if before is not None else set()
    own.sort(key=lambda row: (row not in old, row))
    taken = set(own[:most])
    taken.update(_list_foreign(everything, taken, mine)[: most - len(taken)])
    tables: Dict[str, Any] = {f"{kind}s": _keep_rows(kind, getattr(state, f"{kind}s"), taken) for kind in KINDS}
    users = {node for _kind, _name, node in taken}
    nodes = {name: node for name, node in state.nodes.items() if name in users}
    return replace(keep_part(state, nodes, **tables), left_out=max(0, len(own) - most))


def _list_foreign(everything: Iterable[Row], taken: Set[Row], mine: Container[str]) -> List[Row]:
    """List the foreign publishers that the taken subscribers hear."""
    heard = {name for kind, name, _node in taken if kind == "subscriber"}
    return sorted(row for row in everything if row[0] == "publisher" and row[1] in heard and row[2] not in mine)


def size(state: State) -> int:
    """The largest of the numbers of registrations, nodes, types and providers in a state; in a true state, that of registrations."""
    registrations = sum(len(nodes) for kind in KINDS for nodes in getattr(state, f"{kind}s").values())
    return max(registrations, len(state.nodes), len(state.types), len(state.providers))


def _keep_rows(kind: str, table: Endpoints, taken: Set[Row]) -> Dict[str, Tuple[str, ...]]:
    rest = {name: tuple(node for node in nodes if (kind, name, node) in taken) for name, nodes in table.items()}
    return {name: nodes for name, nodes in rest.items() if nodes}


def limit_refusals(remotes: Mapping[str, Remote]) -> List[RegistrationConflict]:
    """A refusal for each master that offers more than is taken, for the log, the status and /diagnostics."""
    return [
        RegistrationConflict(
            "limit", remote.announced.name, remote.announced.name, uri, str(min(MOST, size(remote.state)))
        )
        for uri, remote in sorted(remotes.items())
        if remote.state is not None and remote.state.left_out
    ]


def sentence(item: RegistrationConflict) -> str:
    """The sentence about a master that offers more than is taken."""
    return (
        f"{item.master} at {quote(item.uri)} offers more than {item.holder} registrations: {item.holder} of them are taken, and the"
        " others are not there. Leave out the topics that nobody needs, by filters or exports"
    )
