"""Somebody else's software on the swarm's network, in a process of its own, until its standard input ends.

One argument: JSON with zenoh's configuration by path (`options`), the keys to listen to (`listens`), and those to put
something under (`keys`), so many `bytes`, by turns as fast as `period_s` allows. Prints one JSON object a turn: how
many nodes it is connected to, and the keys that it has heard from others.
"""

from __future__ import annotations

import json
import select
import sys

import zenoh


def main() -> None:
    orders = json.loads(sys.argv[1])
    config = zenoh.Config()
    for path, value in orders["options"].items():
        config.insert_json5(path, json.dumps(value))
    heard: set[str] = set()
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(
            orders["listens"],
            lambda sample: heard.add(str(sample.key_expr)),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        while not select.select([sys.stdin], [], [], orders["period_s"])[0]:
            for key in orders["keys"]:
                session.put(key, b"forged".ljust(orders["bytes"], b"!"))
            said = {"connected": len(list(session.info.peers_zid())), "heard": sorted(heard)}
            sys.stdout.write(json.dumps(said) + "\n")
            sys.stdout.flush()
        subscriber.undeclare()


if __name__ == "__main__":
    main()
