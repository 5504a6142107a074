"""The figures of a survey's report, as SVG drawings narrow enough to be read on a phone. matplotlib, no display."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import matplotlib
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from shapely.geometry.base import BaseGeometry

from flightstack.swarm.wire import Phase
from mission.geometry.formation import Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Stage
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.truth import VehicleTrack
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.watch import Log, TreeMark
from simvehicle.world.air import World
from simvehicle.world.fields import GasField
from simvehicle.world.world_config import Obstacle

WIDTH_IN = 5.0
"""At this width 9-point text is still about 8 points high on a phone held upright."""
_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.7,
    "svg.fonttype": "path",
    "figure.facecolor": "white",
}
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#AA4499", "#8C6D00", "#56A0D0", "#882255", "#444444")
"""Told apart by colour-blind people too (after Okabe and Ito), and dark enough for print."""
_CONTOURS_PPM = (15.0, 50.0, 150.0, 500.0, 1500.0, 5000.0, 15000.0)
_CONTOUR_FILLS = ("#f7f0df", "#f2e3bf", "#ecd199", "#e5bb72", "#dba04e", "#cc8030", "#b65f1b", "#8f4310")
_PHASE_FILLS: dict[Phase, str] = {
    Phase.ARMING: "#d9d9d9",
    Phase.TAKEOFF: "#bdd7ee",
    Phase.FORMING: "#9bc2e6",
    Phase.SEARCHING: "#fff2b3",
    Phase.TRACKING: "#f4b183",
    Phase.HOLDING: "#e2b6e8",
    Phase.LEAVING: "#dfe8c4",
    Phase.RETURNING: "#c6e0b4",
    Phase.LANDING: "#a2cf8b",
    Phase.RTL: "#b4d7a3",
    Phase.CRASHED: "#c00000",
    Phase.PILOT: "#ff9b9b",
}
"""Phases on the ground stay white."""


MARGIN = 0.09
"""Room around what a map shows, in parts of its width."""

_MOMENTS = 40
"""Of the flight, over which the plume on a map is the mean."""


def colour(index: int) -> str:
    return _COLOURS[index % len(_COLOURS)]


def drawing(draw: Callable[[], Figure]) -> str:
    """A figure as SVG text; glyphs are outlines, so that it looks the same everywhere."""
    with matplotlib.rc_context(_STYLE):
        figure = draw()
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


# -- the map -------------------------------------------------------------------------------------------------


def survey_map(
    tracks: Mapping[int, VehicleTrack],
    homes: Mapping[int, tuple[float, float]],
    world: World,
    above_home_m: float,
    fence: BaseGeometry | None,
    log: Log,
    obstacles: Sequence[Obstacle] = (),
    *,
    whole_fence: bool,
) -> Figure:
    """North up, east right, metres from the origin: everything that has a place.

    `whole_fence` shows all of the geofence, otherwise the drawing is as near as the flight allows.
    """
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * 1.05), layout="constrained")
    axes = figure.add_subplot()
    west, east, south, north = extent(tracks, homes, world.gas.source_ned_m, fence if whole_fence else None)
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_aspect("equal")
    axes.set_xlabel("east of the origin, m")
    axes.set_ylabel("north of the origin, m")
    _gas(axes, world.gas, above_home_m, _flown_s(tracks))
    _obstacles(axes, obstacles)
    if fence is not None:
        _fence(axes, fence)
    for index, (drone, track) in enumerate(tracks.items()):
        every = slice(None, None, 5)
        way_m = track.position_ned_m[every]
        axes.plot(
            way_m[:, 1], way_m[:, 0], color=colour(index), linewidth=0.9, label=f"drone {drone}", zorder=3
        )
    for index, (drone, (north_m, east_m)) in enumerate(homes.items()):
        known = list(tracks).index(drone) if drone in tracks else index
        axes.plot(east_m, north_m, "s", color=colour(known), markersize=5, markeredgecolor="black", zorder=5)
        if not whole_fence:
            axes.annotate(
                str(drone),
                (east_m, north_m),
                xytext=(5, -9),
                textcoords="offset points",
                fontsize=8,
                zorder=5,
            )
    _finds(axes, world.gas.source_ned_m, log)
    _scale_and_arrows(axes, world.wind.mean_ned_mps)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False, fontsize=8, handlelength=1.6
    )
    return figure


Extent: TypeAlias = tuple[float, float, float, float]
"""(west, east, south, north), metres."""


def extent(
    tracks: Mapping[int, VehicleTrack],
    homes: Mapping[int, tuple[float, float]],
    source_ned_m: Vector3,
    fence: BaseGeometry | None,
) -> Extent:
    """The square that holds the flight, the homes, the source, and the fence if it is given."""
    points = [*homes.values()]
    for track in tracks.values():
        low, high = track.position_ned_m[:, :2].min(axis=0), track.position_ned_m[:, :2].max(axis=0)
        points += [(float(low[0]), float(low[1])), (float(high[0]), float(high[1]))]
    if math.isfinite(source_ned_m[0]):
        points.append(source_ned_m[:2])
    if fence is not None:
        south_m, west_m, north_m, east_m = fence.bounds
        points += [(south_m, west_m), (north_m, east_m)]
    south, north = min(p[0] for p in points), max(p[0] for p in points)
    west, east = min(p[1] for p in points), max(p[1] for p in points)
    half_m = max(north - south, east - west, 40.0) * (0.5 + MARGIN)
    middle_n, middle_e = (north + south) / 2.0, (west + east) / 2.0
    return middle_e - half_m, middle_e + half_m, middle_n - half_m, middle_n + half_m


def _flown_s(tracks: Mapping[int, VehicleTrack]) -> float:
    """The world's time at the end: its record begins with it."""
    return max((float(track.time_s[-1] - track.time_s[0]) for track in tracks.values()), default=0.0)


def _obstacles(axes: Axes, obstacles: Sequence[Obstacle]) -> None:
    """Hatched; those that the drones were not told of have a dashed line."""
    for one in obstacles:
        vertices = [(east, north) for north, east in (*one.outline(), one.outline()[0])]
        axes.add_patch(
            PathPatch(
                Path(vertices, closed=True), facecolor="#d9d9d9", edgecolor="#444444", hatch="////", linewidth=1.0,
                linestyle="--" if one.unknown else "-", zorder=2,
            )
        )  # fmt: skip
    for unknown in sorted({one.unknown for one in obstacles}):
        axes.plot(
            [], [], color="#444444", linewidth=1.0, linestyle="--" if unknown else "-",
            label="obstacle, unknown" if unknown else "obstacle",
        )  # fmt: skip


def _gas(axes: Axes, gas: GasField, above_home_m: float, end_s: float) -> None:
    """Filled contours of the excess at survey altitude, with their values written on them: its mean over the flight,
    since some plumes meander."""
    east_m, north_m = np.meshgrid(np.linspace(*axes.get_xlim(), 240), np.linspace(*axes.get_ylim(), 240))
    places_ned_m = np.stack([north_m, east_m, np.full_like(north_m, -above_home_m)], axis=-1)
    moments_s = np.linspace(0.0, end_s, _MOMENTS)
    moments_ppm = [gas.excesses_co2_ppm(places_ned_m.reshape(-1, 3), time_s) for time_s in moments_s.tolist()]
    excess_ppm = np.mean(moments_ppm, axis=0).reshape(north_m.shape)
    levels = [level for level in _CONTOURS_PPM if level < excess_ppm.max()]
    if not levels:
        return
    fills = _CONTOUR_FILLS[: len(levels)]
    axes.contourf(
        east_m, north_m, excess_ppm, [*levels, float(excess_ppm.max()) * 1.01], colors=fills, zorder=0
    )
    lines = axes.contour(east_m, north_m, excess_ppm, levels, colors="#7a5a20", linewidths=0.4, zorder=1)
    axes.clabel(lines, fmt=lambda ppm: f"{ppm:g} ppm", fontsize=7, colors="#5a3d0c")


def _fence(axes: Axes, fence: BaseGeometry) -> None:
    for polygon in getattr(fence, "geoms", [fence]):
        for ring in (polygon.exterior, *polygon.interiors):
            vertices = [(east, north) for north, east in ring.coords]
            path = Path(vertices, closed=True)
            axes.add_patch(
                PathPatch(path, fill=False, edgecolor="#b00020", linewidth=1.2, linestyle="--", zorder=2)
            )
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    if fence.boundary.intersects(shapely.box(south, west, north, east)):
        axes.plot([], [], color="#b00020", linewidth=1.2, linestyle="--", label="geofence")


def _finds(axes: Axes, source_ned_m: Vector3, log: Log) -> None:
    contact, found = log.first(Stage.TRACK), log.first(Stage.FOUND)
    anchors = [mark.order.anchor_ned_m for mark in log.orders]
    if anchors:
        axes.plot(
            [a[1] for a in anchors], [a[0] for a in anchors], ".", color="black", markersize=2.5, zorder=4,
            label="waypoints of the swarm",
        )  # fmt: skip
    if contact is not None:
        north_m, east_m, _ = contact.order.anchor_ned_m
        axes.plot(
            east_m, north_m, "D", markerfacecolor="white", markeredgecolor="black", markersize=6, zorder=6,
            label="contact",
        )  # fmt: skip
    if math.isfinite(source_ned_m[0]):
        axes.plot(
            source_ned_m[1], source_ned_m[0], "o", markerfacecolor="none", markeredgecolor="black",
            markersize=11, markeredgewidth=1.4, zorder=6, label="true source",
        )  # fmt: skip
    if found is not None and found.order.source_ned_m is not None:
        north_m, east_m, _ = found.order.source_ned_m
        axes.plot(
            east_m, north_m, "x", color="black", markersize=8, markeredgewidth=1.8, zorder=7, label="estimate"
        )


def _scale_and_arrows(axes: Axes, wind_ned_mps: Vector3) -> None:
    """A bar of a round length, where north is, and where the wind goes."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    width_m, height_m = east - west, north - south
    rough_m = width_m / 4.0
    unit_m = 10.0 ** math.floor(math.log10(rough_m))
    length_m = max(step * unit_m for step in (1.0, 2.0, 5.0) if step * unit_m <= rough_m)
    left_m, low_m = west + 0.04 * width_m, south + 0.04 * height_m
    axes.plot(
        [left_m, left_m + length_m], [low_m, low_m], color="black", linewidth=2.5, solid_capstyle="butt"
    )
    axes.text(left_m + length_m / 2.0, low_m + 0.012 * height_m, f"{length_m:g} m", ha="center", va="bottom")
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.2}
    right_m, top_m = west + 0.95 * width_m, south + 0.97 * height_m
    axes.annotate("", (right_m, top_m), (right_m, top_m - 0.09 * height_m), arrowprops=arrow)
    axes.text(right_m, top_m - 0.095 * height_m, "N", ha="center", va="top", fontweight="bold")
    speed_mps = math.hypot(wind_ned_mps[0], wind_ned_mps[1])
    if speed_mps > 0.0:
        half_n, half_e = (0.045 * width_m * w / speed_mps for w in wind_ned_mps[:2])
        at_e, at_n = west + 0.84 * width_m, south + 0.925 * height_m
        axes.annotate("", (at_e + half_e, at_n + half_n), (at_e - half_e, at_n - half_n), arrowprops=arrow)
        axes.text(
            at_e, top_m - 0.095 * height_m, f"wind {speed_mps:.1f} m/s", ha="center", va="top", fontsize=8
        )


# -- over time -----------------------------------------------------------------------------------------------


def over_time(
    tracks: Mapping[int, VehicleTrack],
    log: Log,
    background_ppm: float,
    kills: Mapping[int, float],
    faults: Sequence[FaultSpec],
    freezes: Sequence[Freeze] = (),
) -> Figure:
    """CO2 at each drone, its altitude, and its phases, on one time axis; `faults` are those that happened."""
    drones = len(tracks)
    figure = Figure(figsize=(WIDTH_IN, 4.4 + 0.24 * drones), layout="constrained")
    co2, altitude, phases = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.4, 0.35 + 0.24 * drones))
    for index, (drone, track) in enumerate(tracks.items()):
        every = slice(None, None, 5)
        minutes = track.time_s[every] / 60.0
        co2.plot(
            minutes,
            track.co2_ppm[every] - background_ppm,
            color=colour(index),
            linewidth=0.9,
            label=f"{drone}",
        )
        altitude.plot(minutes, -track.position_ned_m[every, 2], color=colour(index), linewidth=0.9)
    co2.set_yscale("symlog", linthresh=10.0, linscale=0.5)
    co2.set_ylim(bottom=0.0)
    co2.yaxis.set_major_formatter(lambda ppm, _: f"{ppm:g}")
    co2.set_ylabel("excess CO2 in\nthe air, ppm")
    co2.legend(
        title="drone",
        ncols=min(drones, 10),
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        fontsize=8,
        title_fontsize=8,
        frameon=False,
        handlelength=1.2,
        columnspacing=1.2,
    )
    altitude.set_ylabel("above home, m")
    altitude.set_ylim(bottom=0.0)
    end_s = _end_s(tracks)
    _phases(phases, list(tracks), log, end_s, kills)
    for freeze in (one for one in freezes if one.drone in tracks):
        until_s = min(end_s, math.inf if freeze.until_s is None else freeze.until_s)
        phases.barh(
            list(tracks).index(freeze.drone), (until_s - freeze.at_s) / 60.0, left=freeze.at_s / 60.0, height=0.8,
            color="white", edgecolor="#888888", hatch="////", linewidth=0.3,
        )  # fmt: skip
    marks = [(log.first(Stage.TRACK), "contact"), (log.first(Stage.FOUND), "found")]
    lines = [(mark.time_s, text) for mark, text in marks if mark is not None]
    lines += [(at_s, f"kill {drone}") for drone, at_s in kills.items()]
    lines += [(freeze.at_s, f"freeze {freeze.drone}") for freeze in freezes]
    lines += [(fault.at_s, f"{fault.kind.replace('_', ' ')} {fault.drone}") for fault in faults]
    for at_s, text in _legible(lines, 0.02 * end_s):
        for axes in (co2, altitude, phases):
            axes.axvline(at_s / 60.0, color="black", linewidth=0.7, linestyle=":")
        altitude.annotate(
            text, (at_s / 60.0, 1.0), xycoords=("data", "axes fraction"), xytext=(2, -2),
            textcoords="offset points", rotation=90, ha="left", va="top", fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8},
        )  # fmt: skip
    phases.set_xlabel("minutes since the first take-off (simulated)")
    return figure


def _legible(lines: Sequence[tuple[float, str]], apart_s: float) -> list[tuple[float, str]]:
    """Marks (when, text) in order; those nearer to the one before than `apart_s` share its line and text."""
    shown: list[tuple[float, str]] = []
    for at_s, text in sorted(lines):
        if shown and at_s - shown[-1][0] < apart_s:
            shown[-1] = shown[-1][0], f"{shown[-1][1]}, {text}"
        else:
            shown.append((at_s, text))
    return shown


def _end_s(tracks: Mapping[int, VehicleTrack]) -> float:
    return max((float(track.time_s[-1]) for track in tracks.values()), default=0.0)


def _phases(axes: Axes, drones: Sequence[int], log: Log, end_s: float, kills: Mapping[int, float]) -> None:
    """One bar a drone, coloured by phase, from the drones' own messages; it ends with a killed agent."""
    used: set[Phase] = set()
    for row, drone in enumerate(drones):
        own = [mark for mark in log.phases if mark.drone == drone]
        for mark, following in zip(own, [*own[1:], None], strict=True):
            until_s = min(following.time_s if following else end_s, kills.get(drone, math.inf))
            fill = _PHASE_FILLS.get(mark.phase)
            if fill is None or until_s <= 0.0:
                continue
            used.add(mark.phase)
            start_s = max(mark.time_s, 0.0)
            axes.barh(
                row, (until_s - start_s) / 60.0, left=start_s / 60.0, color=fill, edgecolor="#888888",
                height=0.8, linewidth=0.3,
            )  # fmt: skip
    axes.set_yticks(range(len(drones)), [f"{drone}" for drone in drones])
    axes.set_ylabel("drone")
    axes.set_ylim(len(drones) - 0.5, -0.5)
    for phase in (p for p in _PHASE_FILLS if p in used):
        axes.barh(0, 0.0, color=_PHASE_FILLS[phase], edgecolor="#888888", linewidth=0.3, label=str(phase))
    if used:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.45), ncols=4, frameon=False, fontsize=8)


# -- the tree ------------------------------------------------------------------------------------------------


def swarm_trees(trees: Sequence[TreeMark], layout: Layout, order: Sequence[int]) -> Figure:
    """Who held which slot and was whose parent, one panel for each assignment; arrows point to the parent."""
    columns = min(len(trees), 2)
    rows = math.ceil(len(trees) / columns)
    figure = Figure(figsize=(WIDTH_IN, 0.3 + 2.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(trees) :]:
        axes.set_axis_off()
    before: dict[int, int] = {}
    places = [
        layout.offset_m(slot) for slot in range(max(s for mark in trees for s in mark.slots.values()) + 1)
    ]
    reach_m = max(max(abs(n), abs(e)) for n, e in places) + 0.5 * layout.spacing_m
    for axes, mark in zip(panels, trees, strict=False):
        axes.set_xlim(-reach_m, reach_m)
        axes.set_ylim(-reach_m, reach_m)
        _tree(axes, mark, layout, order)
        gone, moved = (
            sorted(set(before) - set(mark.slots)),
            sorted(d for d, slot in mark.slots.items() if before.get(d, slot) != slot),
        )
        news = [f"lost {', '.join(map(str, gone))}"] if gone else []
        news += [f"moved {', '.join(map(str, moved))}"] if moved else []
        back = sorted(set(mark.slots) - set(before)) if before else []
        news += [f"back {', '.join(map(str, back))}"] if back else []
        title = "at the start" if not before else f"after {mark.time_s / 60.0:.1f} min"
        axes.set_title(title + (": " + "; ".join(news) if news else ""), fontsize=9)
        before = mark.slots
    return figure


def _tree(axes: Axes, mark: TreeMark, layout: Layout, order: Sequence[int]) -> None:
    holder = {slot: drone for drone, slot in mark.slots.items()}
    for slot, drone in holder.items():
        north_m, east_m = layout.offset_m(slot)
        parent = layout.parent(slot)
        if parent is not None and parent in holder:
            to_n, to_e = layout.offset_m(parent)
            axes.annotate(
                "", (to_e, to_n), (east_m, north_m),
                arrowprops={"arrowstyle": "-|>", "color": "#555555", "shrinkA": 9, "shrinkB": 9},
            )  # fmt: skip
        fill = colour(list(order).index(drone)) if drone in order else "#444444"
        axes.plot(east_m, north_m, "o", color=fill, markersize=16)
        axes.text(
            east_m, north_m, str(drone), color="white", ha="center", va="center_baseline", fontweight="bold"
        )
    slots = range(max(holder, default=0) + 1)
    for slot in set(slots) - set(holder):
        north_m, east_m = layout.offset_m(slot)
        axes.plot(east_m, north_m, "o", markerfacecolor="white", markeredgecolor="#999999", markersize=16)
    axes.set_aspect("equal")
    axes.set_axis_off()
