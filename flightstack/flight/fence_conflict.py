"""What of an autopilot's own fence stands against a survey: its limits must lie outside of the agent's.

Where they do not, the autopilot holds the drone back, or takes it home, in the middle of the survey and among the
others. So the drone does not start; the numbers tell by how much, and what to change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from flightstack.autopilot import OwnFence
from flightstack.config import LimitsConfig
from mission.geometry.frames import LocalFrame, Vector3
from mission.geometry.geofence import Circle, Geofence, LocalFence, Vertex

HEIGHT_SLACK_M = 0.5


def fence_conflict(
    autopilots: OwnFence, home_ned_m: Vector3, own: LocalFence | None, limits: LimitsConfig, frame: LocalFrame
) -> str:
    """Why this drone cannot fly its survey inside of its autopilot's fence, with how to mend it; "" if it can."""
    found = [*_heights(autopilots, home_ned_m, limits), *_areas(autopilots, home_ned_m, own, limits, frame)]
    return "; ".join(found)


def _heights(autopilots: OwnFence, home_ned_m: Vector3, limits: LimitsConfig) -> Iterator[str]:
    home_above_origin_m = -home_ned_m[2]
    if autopilots.ceiling_m is not None:
        highest_m = autopilots.ceiling_m - autopilots.margin_m + home_above_origin_m
        if limits.ceiling_above_home_m > highest_m + HEIGHT_SLACK_M:
            needed_m = limits.ceiling_above_home_m - home_above_origin_m + autopilots.margin_m
            yield (
                f"the autopilot's own ceiling ({autopilots.ceiling_name} {autopilots.ceiling_m:g} m"
                f"{_held_back(autopilots)}) is below limits.ceiling_above_home_m "
                f"{limits.ceiling_above_home_m:g} m: lower that to {max(highest_m, 0.0):.0f}, or set "
                f"{autopilots.ceiling_name} to {needed_m:.0f}"
            )
    if autopilots.floor_m is not None:
        lowest_m = autopilots.floor_m + autopilots.margin_m + home_above_origin_m
        if limits.floor_above_home_m < lowest_m - HEIGHT_SLACK_M:
            yield (
                f"the autopilot's own floor ({autopilots.floor_name} {autopilots.floor_m:g} m"
                f"{_held_back(autopilots)}) is above limits.floor_above_home_m {limits.floor_above_home_m:g} m: "
                f"raise that to {lowest_m:.0f}, or lower {autopilots.floor_name}"
            )


def _areas(
    autopilots: OwnFence, home_ned_m: Vector3, own: LocalFence | None, limits: LimitsConfig, frame: LocalFrame
) -> Iterator[str]:
    parts = [*_limits(autopilots, home_ned_m, frame)]
    if not parts:
        return
    if own is None:
        kinds = ", ".join(kind for kind, _, _ in parts)
        yield (
            f"the autopilot keeps a fence of its own ({kinds}), but this drone's file has no geofence: give it one "
            "that lies inside, or turn the autopilot's off"
        )
        return
    for kind, mend, fence in parts:
        beyond_m = own.sticks_out_m(limits.fence_margin_m, LocalFence(frame, fence), autopilots.margin_m)
        if beyond_m > 0.0:
            yield (
                f"the autopilot's own fence ({kind}{_held_back(autopilots)}) is tighter than this drone's geofence, "
                f"by up to {beyond_m:.0f} m: make the geofence smaller, or {mend(beyond_m)}"
            )


def _limits(
    autopilots: OwnFence, home_ned_m: Vector3, frame: LocalFrame
) -> Iterator[tuple[str, Callable[[float], str], Geofence]]:
    """Every area that the autopilot keeps to: what it is, how to change it, and its shape."""

    def upload(_beyond_m: float) -> str:
        return "upload this drone's fence to the autopilot (gcs fence upload)"

    if autopilots.radius_m is not None:
        radius_m, name = autopilots.radius_m, autopilots.radius_name
        home = frame.to_geodetic(home_ned_m)
        circle = Circle(home.latitude_deg, home.longitude_deg, radius_m)

        def widen(beyond_m: float) -> str:
            return f"set {name} to {radius_m + beyond_m + 1.0:.0f} or more"

        yield f"{name} {radius_m:g} m around home", widen, Geofence(inclusion_circles=(circle,))
    if autopilots.any_inclusion and autopilots.inclusions:
        yield "uploaded areas", upload, _fence(autopilots.inclusions, inside=True)
    else:
        for area in autopilots.inclusions:
            yield _named("inclusion", area), upload, _fence((area,), inside=True)
    for area in autopilots.exclusions:
        yield _named("exclusion", area), upload, _fence((area,), inside=False)


def _fence(areas: tuple[tuple[Vertex, ...] | Circle, ...], *, inside: bool) -> Geofence:
    circles = tuple(area for area in areas if isinstance(area, Circle))
    polygons = tuple(area for area in areas if not isinstance(area, Circle))
    if inside:
        return Geofence(inclusion=polygons, inclusion_circles=circles)
    return Geofence(exclusion=polygons, exclusion_circles=circles)


def _named(kind: str, area: tuple[Vertex, ...] | Circle) -> str:
    if isinstance(area, Circle):
        return f"uploaded {kind} circle of {area.radius_m:g} m"
    return f"uploaded {kind} polygon of {len(area)} points"


def _held_back(autopilots: OwnFence) -> str:
    return f", AVOID_ENABLE holds {autopilots.margin_m:g} m before it" if autopilots.margin_m else ""
