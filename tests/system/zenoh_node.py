"""One node of a swarm in a process of its own: says who it hears, until its standard input ends.

Arguments: name, listen endpoints, connect endpoints (both comma-separated, may be empty); or name and a file with a
`swarm` section. Prints one JSON object a tick: the senders heard in it, who is alive, in whose names something
was ever heard that no node says, and how many of each sender's numbered events never came.
"""

from __future__ import annotations

import collections
import json
import pathlib
import re
import select
import sys
import time

import msgspec
import yaml

from flightstack.config import SwarmConfig
from flightstack.swarm.topics import EVENT, STATE, TOPICS
from flightstack.transport.certificates import beside
from flightstack.transport.zenoh_transport import ZenohTransport

TICK_S = 0.05
STATE_SAID = b"s" * 200
EVENT_SAID = re.compile(rb"event (\d+)")


def _open(name: str, *network: str) -> ZenohTransport:
    if len(network) == 2:
        return ZenohTransport("mesh", name, *map(_endpoints, network), (STATE, EVENT))
    file = pathlib.Path(network[0])
    swarm = beside(msgspec.convert(yaml.safe_load(file.read_text())["swarm"], SwarmConfig), file.parent)
    return ZenohTransport(
        swarm.name, name, swarm.listen, swarm.connect, TOPICS.values(), swarm.tls, swarm.members
    )


def _endpoints(text: str) -> list[str]:
    return [part for part in text.split(",") if part]


def main() -> None:
    transport = _open(*sys.argv[1:])
    forged: set[str] = set()
    newest: dict[str, int] = {}
    missing: collections.Counter[str] = collections.Counter()
    longest_s, turn = 0.0, 0
    while not select.select([sys.stdin], [], [], 0)[0]:
        began_s = time.monotonic()
        turn += 1
        transport.publish(STATE, STATE_SAID)
        transport.publish(EVENT, b"event %d" % turn)
        messages = transport.receive()
        heard = sorted({message.sender for message in messages})
        for message in messages:
            event = EVENT_SAID.fullmatch(message.payload)
            if event is not None:
                number = int(event[1])
                missing[message.sender] += number - newest.get(message.sender, number - 1) - 1
                newest[message.sender] = number
            elif message.payload != STATE_SAID:
                forged.add(message.sender)
        longest_s = max(longest_s, time.monotonic() - began_s)
        said = {
            "heard": heard,
            "alive": sorted(transport.alive()),
            "forged": sorted(forged),
            "missing": dict(missing),
        }
        sys.stdout.write(json.dumps(said) + "\n")
        sys.stdout.flush()
        time.sleep(TICK_S)
    transport.close()


if __name__ == "__main__":
    main()
