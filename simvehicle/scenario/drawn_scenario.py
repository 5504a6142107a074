"""Scenarios by chance: a small survey and a few of the table's faults, the same for the same seed."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable
from typing import Any, Final

_FEWEST, _MOST = 5, 10
_LONGEST_FAULT_S = 40.0
_LAST_BEGINS_S = 90.0
"""Such a search takes some 80 s, and the way home 60 s: later faults would meet nobody in the air."""
_FAULTS: Final = range(1, 5)
_COMMANDS: Final = ("start", "pause", "resume", "abort", "rtl", "land")
_TO_ONE: Final = ("rtl", "land")
_GIVES_BACK: Final = ("resume", "rtl", "land")
"""Commands after which a pilot's vehicle is its agent's again."""
_LAST_WORD_S: Final = 2.0
"""From the end of all faults to the operator's last command."""


class _Draw:
    def __init__(self, seed: int) -> None:
        self._random = random.Random(f"scenario {seed}")
        self.count = self._random.randint(_FEWEST, _MOST)
        self.drones = list(range(1, self.count + 1))
        self.seed = seed

    def document(self) -> dict[str, Any]:
        rng = self._random
        flavour = rng.choice(("ardupilot", "px4"))
        loss = rng.choice((0.0, 0.0, 0.1, 0.2, 0.3))
        faults: list[dict[str, Any]] = []
        swarm_faults: list[dict[str, Any]] = []
        for _ in range(rng.choice(_FAULTS)):
            kind = rng.choice((*_SWARM_KINDS, *_VEHICLE_KINDS))
            if kind in _SWARM_KINDS:
                swarm_faults.append(self._timed({"kind": kind, **_SWARM_KINDS[kind](self)}))
                swarm_faults += self._given_back(swarm_faults[-1])
            else:
                faults.append(self._timed({"kind": kind, **_VEHICLE_KINDS[kind](self)}))
        swarm_faults += self._last_word([*faults, *swarm_faults])
        return {
            "name": f"drawn-{self.seed}",
            "origin": {"latitude_deg": 38.404, "longitude_deg": 14.963, "amsl_m": 300.0},
            "launch_line": {"count": self.count, "flavour": flavour, "spacing_m": 6.0, "towards_deg": 50.0},
            "formation": {"spacing_m": 10.0, "radio_range_m": 80.0},
            "limits": {"separation_m": 4.0, "ceiling_above_home_m": 120.0},
            "geofence": {
                "inclusion": [
                    [[38.4053, 14.9613], [38.4053, 14.9647], [38.4027, 14.9647], [38.4027, 14.9613]]
                ]
            },
            "strategy": {
                "name": "locus",
                "parameters": {"step_m": 6.0, "patience": 4, "search_radius_m": 50.0},
            },
            "wind": {"speed_mps": 3.0, "from_deg": 320.0},
            "plume": {
                "type": "gaussian",
                "source_north_m": 10.0,
                "source_east_m": -20.0,
                "vent_sd_m": 4.0,
                "emission_kgps": 2.5,
            },
            "ready_after_s": 3.0,
            "seed": self.seed,
            "radio": {"loss": loss},
            "ground_brings_home": rng.random() < 0.8,
            "faults": faults,
            "swarm_faults": swarm_faults,
        }

    def _timed(self, fault: dict[str, Any]) -> dict[str, Any]:
        at_s = round(self._random.uniform(0.0, _LAST_BEGINS_S), 1)
        fault["at_s"] = at_s
        if "until_s" in fault:
            fault["until_s"] = round(at_s + fault["until_s"], 1)
        return fault

    def _given_back(self, fault: dict[str, Any]) -> list[dict[str, Any]]:
        """What ends a pilot's hour; every second one keeps the vehicle."""
        if fault["kind"] != "pilot" or self._random.random() < 0.5:
            return []
        at_s = round(fault["at_s"] + self._random.uniform(0.5, _LONGEST_FAULT_S), 1)
        word = self._random.choice(_GIVES_BACK)
        return [{"kind": "command", "command": word, "drone": fault["drone"], "at_s": at_s}]

    def _last_word(self, faults: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """A swarm that was paused is told to go on when everybody hears again: otherwise it waits for ever."""
        if not any(fault.get("command") == "pause" for fault in faults):
            return []
        last_s = max(fault.get("until_s", fault["at_s"]) for fault in faults)
        return [{"kind": "command", "command": "resume", "at_s": round(last_s + _LAST_WORD_S, 1)}]

    def one(self) -> dict[str, Any]:
        return {"drone": self._random.choice(self.drones)}

    def one_for_a_while(self) -> dict[str, Any]:
        return {**self.one(), **self.a_while()}

    def a_while(self) -> dict[str, Any]:
        """Counted from the fault's beginning until `_timed` knows that."""
        return {"until_s": self._random.uniform(0.5, _LONGEST_FAULT_S)}

    def one_way(self) -> dict[str, Any]:
        drone, towards = self._random.sample(self.drones, 2)
        return {"drone": drone, "towards": towards, **self.a_while()}

    def parts(self) -> dict[str, Any]:
        order = self._random.sample(self.drones, self.count)
        cuts = sorted(self._random.sample(range(1, self.count), self._random.choice((1, 2))))
        bounds = [0, *cuts, self.count]
        parts = [sorted(order[a:b]) for a, b in itertools.pairwise(bounds)]
        return {"parts": parts, **self.a_while()}

    def burst(self) -> dict[str, Any]:
        return {"loss": self._random.choice((0.5, 0.8, 0.95)), **self.a_while()}

    def jump(self) -> dict[str, Any]:
        return {**self.one(), "by_s": round(self._random.uniform(0.2, 30.0), 1)}

    def word(self) -> dict[str, Any]:
        word = self._random.choice(_COMMANDS)
        return {"command": word, **(self.one() if word in _TO_ONE else {})}

    def instrument(self) -> dict[str, Any]:
        return {"instrument": "co2", **self.one_for_a_while()}

    def liar(self) -> dict[str, Any]:
        return {**self.instrument(), "by_ppm": self._random.choice((-400.0, 100.0, 2000.0))}

    def astray(self) -> dict[str, Any]:
        return {**self.one_for_a_while(), "by_m": round(self._random.uniform(-20.0, 20.0), 1)}

    def failsafe(self) -> dict[str, Any]:
        return {**self.one_for_a_while(), "unheard": "remote_control"}


_SWARM_KINDS: Final[dict[str, Callable[[_Draw], dict[str, Any]]]] = {
    "kill": _Draw.one,
    "freeze": _Draw.one_for_a_while,
    "reboot": _Draw.one_for_a_while,
    "radio_dead": _Draw.one_for_a_while,
    "one_way": _Draw.one_way,
    "partition": _Draw.parts,
    "loss": _Draw.burst,
    "clock_jump": _Draw.jump,
    "pilot": _Draw.one,
    "ground_gone": _Draw.a_while,
    "command": _Draw.word,
}
_VEHICLE_KINDS: Final[dict[str, Callable[[_Draw], dict[str, Any]]]] = {
    "unplug": _Draw.instrument,
    "stuck": _Draw.instrument,
    "lying": _Draw.liar,
    "gps_loss": _Draw.one_for_a_while,
    "gps_jump": _Draw.astray,
    "failsafe": _Draw.failsafe,
    "battery_low": _Draw.one,
    "motor": _Draw.one,
    "tumble": _Draw.one,
    "silence": _Draw.one_for_a_while,
}


def draw(seed: int) -> dict[str, Any]:
    """The document of a scenario's file."""
    return _Draw(seed).document()
