"""A node with a certificate that says again what was said before, in a process of its own, until its input ends.

One argument: JSON with zenoh's configuration by path (`options`), keys of answers to listen to (`listens`), and what
to put: `rounds`, each a list of (key, message in hexadecimal digits). A line of input begins the next round.
Prints one JSON object a turn: how often each command was answered, how many messages were put, and how
many nodes it is connected to.
"""

from __future__ import annotations

import collections
import json
import select
import sys
import time

import zenoh

from flightstack.swarm.topics import OUTCOME

PERIOD_S = 0.01


def main() -> None:
    orders = json.loads(sys.argv[1])
    config = zenoh.Config()
    for path, value in orders["options"].items():
        config.insert_json5(path, json.dumps(value))
    answers: collections.Counter[str] = collections.Counter()
    rounds, said = iter(orders["rounds"]), 0
    waiting: collections.deque[tuple[str, str]] = collections.deque()
    current: list[tuple[str, str]] = []

    def hear(sample: zenoh.Sample) -> None:
        answers[OUTCOME.codec.decode(sample.payload.to_bytes()).command] += 1

    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(orders["listens"], hear, allowed_origin=zenoh.Locality.REMOTE)
        while True:
            if select.select([sys.stdin], [], [], 0)[0]:
                if not sys.stdin.readline():
                    break
                current = next(rounds)
                waiting.extend(current)
            if waiting:
                key, payload = waiting.popleft()
                session.put(key, bytes.fromhex(payload), congestion_control=zenoh.CongestionControl.BLOCK)
                said += 1
            connected = len(list(session.info.peers_zid()))
            line = {"heard": [], "connected": connected, "said": said, "answers": dict(answers)}
            sys.stdout.write(json.dumps(line) + "\n")
            sys.stdout.flush()
            time.sleep(PERIOD_S)
        subscriber.undeclare()


if __name__ == "__main__":
    main()
