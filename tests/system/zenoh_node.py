"""One node of a swarm in a process of its own: says who it hears, until its standard input ends.

Arguments: name, listen endpoints, connect endpoints (both comma-separated, may be empty). Prints one JSON object a
tick: the senders heard in it, and who is alive.
"""

from __future__ import annotations

import json
import select
import sys
import time

from flightstack.swarm.topics import EVENT, STATE
from flightstack.transport.zenoh_transport import ZenohTransport

TICK_S = 0.05


def _endpoints(text: str) -> list[str]:
    return [part for part in text.split(",") if part]


def main() -> None:
    name, listen, connect = sys.argv[1:4]
    transport = ZenohTransport("mesh", name, _endpoints(listen), _endpoints(connect), (STATE, EVENT))
    longest_s = 0.0
    while not select.select([sys.stdin], [], [], 0)[0]:
        began_s = time.monotonic()
        transport.publish(STATE, b"s" * 200)
        transport.publish(EVENT, b"e")
        heard = sorted({message.sender for message in transport.receive()})
        longest_s = max(longest_s, time.monotonic() - began_s)
        sys.stdout.write(json.dumps({"heard": heard, "alive": sorted(transport.alive())}) + "\n")
        sys.stdout.flush()
        time.sleep(TICK_S)
    transport.close()


if __name__ == "__main__":
    main()
