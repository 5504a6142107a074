"""How a swarm whose drones fly each by itself ends its survey: the source declared, with its variance, or not.

Every drone gathers what it hears of the air: its own readings, and its neighbours' with their states. Whoever the
root does not hear tells its reading up the tree. The root alone estimates (`mission.estimation.source_filter`), and
declares the source once its place is known well enough for long enough. A drone that becomes the root begins its
estimate anew, from all that it has heard itself: nothing has to be handed over by the one that was lost
(docs/decisions/0016-how-a-reactive-swarm-declares.md).
"""

from __future__ import annotations

import math
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading, Scalar
from mission.estimation.plume_evidence import Evidence
from mission.estimation.source_filter import SourceEstimate, SourceFilter
from mission.geometry.frames import Vector3
from mission.strategies.contract import Observation, Order, Stage

_PERIOD_S: Final = 1.0
"""Between two readings that count, and two estimates."""
_FRESH_S: Final = 1.5
"""What is older is of another place, or of another air."""
_HEARD_S: Final = 2.0
_WIND_STALE_S: Final = 10.0
_WIND_MEAN_M: Final = 30.0
"""A plume lies along the wind's mean over the time in which it flowed to where it was met: it is averaged over so
much of the air's way."""
_WIND_MEAN_S: Final = 10.0
"""But no gust counts."""
_CALM_MPS: Final = 0.5
_MODEL_SD_M: Final = 5.0
"""What the model of the plume leaves uncertain, however many readings there are: in torn plumes between rocks, which
it does not know, flights declared places that were 3 to 10 m off when the readings alone told 1 to 2 m."""


class DeclarationParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a reactive swarm ends its survey; every reactive strategy has these parameters beside its rule's own."""

    declared_sd_m: Annotated[float, Meta(gt=0.0)] = 5.0
    """The source counts as found while the readings leave its place no larger a standard deviation than this, along
    the axis on which it is known worst, ..."""
    declared_for_s: Annotated[float, Meta(ge=0.0)] = 60.0
    """... for so long, ..."""
    declared_contacts: Annotated[int, Meta(ge=1)] = 25
    """... and gas was met in so many places of 4 m."""
    declared_least_ppm: Annotated[float, Meta(gt=2.0, lt=50_000.0)] = 100.0
    """What has less excess at its vent is no source that is looked for."""
    source_within_m: Annotated[float, Meta(gt=0.0, le=10_000.0)] = 200.0
    """Of where the swarm began: farther away no source is expected."""
    given_up_share: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.1
    """The area is exhausted when the probability that there is a source in it is less than this."""
    given_up_after_s: Annotated[float, Meta(gt=0.0)] = 1200.0
    """The search is given up so long after the drones began to form up."""


class Declaration:
    """One drone's part. `step` once a tick."""

    def __init__(self, parameters: DeclarationParameters) -> None:
        self._p = parameters
        self._evidence = Evidence()
        self._due_s = -math.inf
        self._winds = 0
        self._wind_mps = (0.0, 0.0)
        self._downwind = (0.0, 0.0)
        self._told: dict[int, Reading] = {}
        """The newest reading of each drone that came up the tree."""
        self._own: Reading | None = None
        self._filter: SourceFilter | None = None
        """At the root."""
        self._narrow_since_s: float | None = None
        self._estimate: SourceEstimate | None = None

    def step(
        self, observation: Observation, order: Order, start_ned_m: Vector3, draw: float
    ) -> tuple[Reading | None, Order | None]:
        """This drone's reading for the root, where that does not hear it, and at the root the next order if it is
        due. `start_ned_m`: where the swarm began; `draw`: uniform in [0, 1), this tick's."""
        is_root = observation.tree.root == observation.own.drone
        if not is_root:
            self._filter = None
        if observation.elapsed_s >= self._due_s:
            self._due_s = observation.elapsed_s + _PERIOD_S
            self._gather(observation, order)
            if is_root and not order.stage.ends_survey:
                self._judge(observation.elapsed_s, start_ned_m, draw)
        return self._own, self._next(observation.elapsed_s, order, start_ned_m) if is_root else None

    # -- every drone ------------------------------------------------------------------------------------------

    def _gather(self, observation: Observation, order: Order) -> None:
        own, now_s = observation.own, observation.elapsed_s
        self._look_at_the_wind(observation)
        self._take(now_s, own.position_ned_m, own.excess_co2_ppm)
        heard = {own.drone}
        for other in observation.neighbours:
            if other.age_s > _HEARD_S:
                continue
            heard.add(other.drone)
            if other.airborne and not other.adrift and other.age_s <= _FRESH_S:
                self._take(now_s, other.position_ned_m, other.excess_co2_ppm)
        for reading in observation.readings:
            if reading.drone not in heard and reading != self._told.get(reading.drone):
                self._told[reading.drone] = reading
                self._take_reading(now_s, reading)
        co2 = _fresh(own.excess_co2_ppm)
        self._own = None
        if observation.tree.root not in heard and co2 is not None:
            self._own = Reading(own.drone, order.sequence, own.position_ned_m, co2.mean, co2.variance)

    def _take(self, now_s: float, position_ned_m: Vector3, co2: Scalar | None) -> None:
        co2 = _fresh(co2)
        if co2 is not None:
            north_m, east_m, _ = position_ned_m
            self._evidence.take(now_s, north_m, east_m, co2.mean, co2.variance, self._downwind)

    def _take_reading(self, now_s: float, reading: Reading) -> None:
        self._take(now_s, reading.position_ned_m, Scalar(reading.excess_co2_ppm, reading.variance_ppm2, 0.0))

    def _look_at_the_wind(self, observation: Observation) -> None:
        known = [observation.own.wind, *(n.wind for n in observation.neighbours if n.age_s <= _FRESH_S)]
        winds = [wind.wind_ned_mps for wind in known if wind is not None and wind.age_s < _WIND_STALE_S]
        if not winds:
            return
        self._winds += 1
        mean_s = max(_WIND_MEAN_S, _WIND_MEAN_M / max(math.hypot(*self._wind_mps), _CALM_MPS))
        share = max(1.0 / self._winds, _PERIOD_S / mean_s)
        north_mps, east_mps = (
            before + share * (math.fsum(axis) / len(winds) - before)
            for before, axis in zip(self._wind_mps, list(zip(*winds, strict=True))[:2], strict=True)
        )
        self._wind_mps = north_mps, east_mps
        speed_mps = math.hypot(north_mps, east_mps)
        self._downwind = (
            (north_mps / speed_mps, east_mps / speed_mps) if speed_mps > _CALM_MPS else (0.0, 0.0)
        )

    # -- the root ---------------------------------------------------------------------------------------------

    def _judge(self, now_s: float, start_ned_m: Vector3, draw: float) -> None:
        """What is known of the source now."""
        if self._filter is None:
            rng = np.random.default_rng(int(draw * 2**53))
            self._filter = SourceFilter(start_ned_m[:2], self._p.source_within_m, rng)
            self._narrow_since_s = None
        self._filter.update(self._evidence)
        self._estimate = self._filter.estimate(self._p.declared_least_ppm)
        found = (
            self._estimate.complete
            and self._evidence.contact_cells >= self._p.declared_contacts
            and self._estimate.peak_ppm >= self._p.declared_least_ppm
            and self._estimate.sd_m <= self._p.declared_sd_m
        )
        if not found:
            self._narrow_since_s = None
        elif self._narrow_since_s is None:
            self._narrow_since_s = now_s

    def _next(self, now_s: float, order: Order, start_ned_m: Vector3) -> Order | None:
        if order.stage.ends_survey:
            return None
        following = msgspec.structs.replace(order, sequence=order.sequence + 1, apart=True)
        estimate, since_s = self._estimate, self._narrow_since_s
        if not order.apart:
            return msgspec.structs.replace(following, stage=Stage.SEARCH)
        if estimate is not None and since_s is not None and now_s - since_s >= self._p.declared_for_s:
            source = (estimate.north_m, estimate.east_m, start_ned_m[2])
            return msgspec.structs.replace(
                following,
                stage=Stage.FOUND,
                anchor_ned_m=source,
                source_ned_m=source,
                source_sd_m=_sd_m(estimate),
            )
        exhausted = (
            estimate is not None and estimate.complete and estimate.strong_share < self._p.given_up_share
        )
        if exhausted or now_s > self._p.given_up_after_s:
            return msgspec.structs.replace(following, stage=Stage.GIVE_UP)
        if order.stage is not Stage.TRACK and self._evidence.contact_cells:
            return msgspec.structs.replace(following, stage=Stage.TRACK)
        return None


def _sd_m(estimate: SourceEstimate) -> float:
    """What is told: of the readings and of the model."""
    return math.hypot(estimate.sd_m, _MODEL_SD_M)


def _fresh(co2: Scalar | None) -> Scalar | None:
    return co2 if co2 is not None and co2.age_s <= _FRESH_S else None
