"""The live display: `gcs watch`."""

from __future__ import annotations

import time

from rich.console import Console
from rich.live import Live

from gcs.connection import Connection
from gcs.display.fleet_table import screen
from gcs.errors import GroundError
from gcs.fleet.observe import Observer

REFRESH_S = 0.5


def watch(connection: Connection) -> None:
    """Draw the fleet twice a second until Ctrl-C. `GroundError` where there is no terminal to draw on."""
    console = Console()
    if not console.is_terminal:
        raise GroundError("gcs watch needs a terminal; `gcs status --json` is for programs")
    if console.is_dumb_terminal:
        raise GroundError(
            "gcs watch cannot draw on this terminal (TERM says it is dumb): set TERM, to xterm-256color say, or "
            "use `gcs status`"
        )
    clock = connection.clock()
    transport = connection.open(connection.node("watch"))
    observer = Observer(connection, clock.now_s())
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while True:
                now_s = clock.now_s()
                observer.step(now_s, transport.receive())
                live.update(
                    screen(
                        connection.swarm,
                        observer.view.rows(now_s),
                        observer.alarms(now_s),
                        observer.view.events,
                        station=observer.station(now_s),
                        now_s=now_s,
                        height=console.size.height,
                        width=console.size.width,
                    ),
                    refresh=True,
                )
                time.sleep(REFRESH_S)
    except KeyboardInterrupt:
        return
    finally:
        transport.close()
