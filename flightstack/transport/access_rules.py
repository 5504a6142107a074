"""Who may say what in an encrypted swarm: zenoh's access control, by the common name of a node's certificate.

Every node holds these rules and keeps them where messages come in, so that it needs to trust nobody else to keep
them. A node is known by its certificate, not by what it writes into a key: `drone-3` speaks as 3 and nobody
else, a station under its own name and those of its operator's commands (`NAME-…`). Who is not named here is not
told anything either.

Rules act on a connection. What comes through a router comes in the router's name, which may relay for everybody: a
router is trusted, and must hold the same rules for those who connect to it.

Source: https://zenoh.io/docs/manual/access-control
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

from flightstack.config import SwarmConfig, TlsConfig
from flightstack.swarm.topics import COMMAND, GROUND, REPORT, TOPICS, TRAFFIC, Topic

ALIVE: Final = "alive"
"""Where in the keys' name space nodes show that they are connected."""
_GROUND_ONLY: Final = (COMMAND, GROUND, REPORT, TRAFFIC)
_DRONE_NAME: Final = re.compile(r"drone-\d+")


def common_name(node: int | str) -> str:
    """What stands in the certificate of a drone or of a ground station."""
    return f"drone-{node}" if str(node).isdecimal() else str(node)


def speakers_of(topic: Topic, members: Iterable[int], tls: TlsConfig) -> list[str]:
    """Under which names a topic may be spoken of (last words of keys): drones, stations, stations' commands."""
    drones = [] if topic in _GROUND_ONLY else [str(member) for member in members]
    return drones + [name for station in tls.stations for name in (station, f"{station}-$*")]


def access_rules(swarm: str, members: Iterable[int], tls: TlsConfig) -> dict[str, Any]:
    """zenoh's `access_control` for a node of the swarm whose drones are `members`."""
    everything = f"flightstack/{swarm}/**"
    by_drones = [name for name, topic in TOPICS.items() if topic not in _GROUND_ONLY] + [ALIVE]
    rules = [
        _rule("listen", "ingress", _LISTENING, [everything]),
        _rule("be told", "egress", (*_SPEAKING, *_LISTENING), [everything]),
    ]
    speakers = {common_name(m): [f"flightstack/{swarm}/{topic}/{m}" for topic in by_drones] for m in members}
    for station in tls.stations:
        speakers[station] = [f"flightstack/{swarm}/*/{station}", f"flightstack/{swarm}/*/{station}-$*"]
    for router in tls.routers:
        speakers[router] = [everything]
    rules += [_rule(f"speak as {name}", "ingress", _SPEAKING, keys) for name, keys in speakers.items()]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in speakers],
        "policies": [
            {"rules": ["listen", "be told", f"speak as {name}"], "subjects": [name]} for name in speakers
        ],
    }


def name_clashes(stations: Sequence[str], routers: Sequence[str]) -> list[str]:
    """Names of stations and routers by which one could speak for another, one sentence each."""
    names = (*stations, *routers)
    found = [f"{name!r} stands twice; every node needs its own name" for name in sorted(_repeated(names))]
    found += [f"{name!r} is a drone's name; choose another" for name in names if _DRONE_NAME.fullmatch(name)]
    for station in stations:
        found += [
            f"{other!r} begins like the names of {station!r}'s commands; choose another"
            for other in names
            if other.startswith(f"{station}-")
        ]
    return found


def access_problems(swarm: SwarmConfig) -> list[tuple[str, str]]:
    """What is wrong with the names in a configuration file: (field, what and how to mend it)."""
    if swarm.tls is None:
        return []
    found = [("swarm.tls", problem) for problem in name_clashes(swarm.tls.stations, swarm.tls.routers)]
    if swarm.tls.routers and swarm.site is None:
        found.append(("swarm.tls", "a router relays between sites; say at which this node is: swarm.site"))
    if swarm.site is not None and not swarm.tls.routers:
        found.append(
            ("swarm.site", "nothing from other sites is believed; name the router in swarm.tls.routers")
        )
    return found


_SPEAKING: Final = ("put", "liveliness_token")
_LISTENING: Final = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")


def _rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": list(keys),
    }


def _repeated(names: Sequence[str]) -> set[str]:
    return {name for name in names if names.count(name) > 1}
