"""A geofence in a YAML file: its areas, or the name of the file that holds them."""

from __future__ import annotations

import pathlib
from typing import TypeAlias

from mission.documents.plan_file import read_fence
from mission.documents.yaml_file import DocumentError, line_of
from mission.geometry.geofence import Geofence


class FenceSection(Geofence, frozen=True, forbid_unknown_fields=True):
    """Areas of (latitude, longitude) vertices, or a `file` with a fence, of any format that plans are read from."""

    file: str | None = None
    """Relative to the YAML file."""


FenceChoice: TypeAlias = FenceSection | str | None
"""A `geofence:` in a file; a word alone is the file's name."""


def read_section(choice: FenceChoice, file: str, text: str) -> tuple[Geofence | None, tuple[str, ...]]:
    """The areas of a `geofence:` of the YAML file named `file`, from the file that it names if it does; and what
    that file holds besides, one sentence each. `DocumentError` for a fence that is no fence to fly in."""
    if choice is None:
        return None, ()
    field = "geofence" if isinstance(choice, str) or choice.file is None else "geofence.file"
    line = line_of(text, field)
    section = FenceSection(file=choice) if isinstance(choice, str) else choice
    areas = (section.inclusion, section.exclusion, section.inclusion_circles, section.exclusion_circles)
    if section.file is None:
        fence = Geofence(*areas)
        for problem in fence.problems():
            raise DocumentError(file, problem, line=line, field="geofence")
        return fence, ()
    if any(areas):
        raise DocumentError(file, "give either a file or areas, not both", line=line, field="geofence.file")
    path = pathlib.Path(file).parent / section.file
    try:
        fence, warnings = read_fence(path)
    except DocumentError as error:
        raise DocumentError(file, str(error), line=line, field=field) from error
    return fence, tuple(f"{path}: {warning}" for warning in warnings)
