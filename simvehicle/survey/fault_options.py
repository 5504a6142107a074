"""Faults of vehicles and instruments as the command line says them: "co2-unplug:2@90"."""

from __future__ import annotations

import re
from typing import cast

import msgspec

from mission.documents.yaml_file import DocumentError
from simvehicle.faults.fault_table import FAULTS, FaultKind, FaultSpec

_FAULT = re.compile(
    r"^(?:(?P<which>[A-Za-z0-9_-]+)-)??(?P<kind>unplug|stuck|lying|gps[_-]loss|gps[_-]jump|battery[_-]low|failsafe"
    r"|motor|tumble|silence|range[_-]silent|range[_-]lying)"
    r":(?P<drone>\d+)@(?P<at>\d+(?:\.\d+)?)(?:-(?P<until>\d+(?:\.\d+)?))?$"
)
_FAULT_FORM = (
    "write INSTRUMENT-unplug:DRONE@SECONDS, or instead of INSTRUMENT-unplug: INSTRUMENT-stuck, INSTRUMENT-lying, "
    "gps-loss, gps-jump, battery-low, remote-control-failsafe, ground-link-failsafe, motor, tumble, silence, "
    "range-silent or range-lying; with -SECONDS behind if it mends itself"
)


def parse_fault(text: str) -> FaultSpec:
    """A fault as the command line says it: "co2-unplug:2@90", "gps-loss:3@60-75" (from 60 s to 75 s)."""
    match = _FAULT.match(text)
    kind = match["kind"].replace("-", "_") if match is not None else ""
    needs = FAULTS[cast(FaultKind, kind)].needs if match is not None else ()
    if match is None or bool(needs) != (match["which"] is not None):
        raise DocumentError(f"--fault {text}", _FAULT_FORM)
    which: dict[str, str] = (
        {needs[0]: match["which"].replace("-", "_" if kind == "failsafe" else "-")} if needs else {}
    )
    try:
        fault: FaultSpec = msgspec.convert(
            {
                "drone": int(match["drone"]),
                "at_s": float(match["at"]),
                "kind": kind,
                "until_s": float(match["until"]) if match["until"] else None,
                **which,
            },
            FaultSpec,
        )
    except msgspec.ValidationError as error:
        raise DocumentError(f"--fault {text}", _FAULT_FORM) from error
    return fault


def fault_option(fault: FaultSpec) -> str:
    """As `parse_fault` reads it."""
    which = fault.instrument or (fault.unheard or "").replace("_", "-")
    until = "" if fault.until_s is None else f"-{fault.until_s:g}"
    return f"{which}{'-' if which else ''}{fault.kind.replace('_', '-')}:{fault.drone}@{fault.at_s:g}{until}"
