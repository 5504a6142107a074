"""LoCUS hybrid: each drone alone on golden spokes until the first contact, then LoCUS around the drone that made it.

The rules are those of the trials (`simvehicle.trials`): `mobs_next` on the spokes, `nearest_first` for the places
around the caller, `locus_next` from there on. What a flight does otherwise, and why:

* The drones form up before they part, and each one's spokes begin in its own slot: points may all begin in one
  place, drones may not. If the formation has contact at once, LoCUS goes on as it stands, and they part where it has
  lost it.
* A drone that has contact stays where it was and says so in its word; the root, which hears the words of all, orders
  everybody around the lowest-numbered drone of those that it hears of first. In a trial the call reaches everybody in
  the same tick. The radios must reach over the whole search either way: a tree whose members fly alone has links as
  long as the spokes.
* Places around the caller are seats in the order's note, not slots of the tree: slots change by healing alone. Who is
  lost later is replaced by seating everybody anew, and nobody flies underneath.
* The search alone is given up after `search_limit_s`; from the first contact on LoCUS has ends of its own.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, Stage
from mission.strategies.entry import StrategyEntry
from mission.strategies.locus.note import LocusNote, noted
from mission.strategies.locus.rule import locus_next
from mission.strategies.locus.seats import nearest_first
from mission.strategies.locus.strategy import Locus, LocusParameters, seated
from mission.strategies.mobs import MobsFlight, MobsParameters, contact_of, first_bearing_rad, mobs_next
from mission.strategies.packed import Packed, is_contact


class HybridParameters(LocusParameters, frozen=True, forbid_unknown_fields=True, kw_only=True):
    spoke_m: Annotated[float, Meta(gt=0.0)] = 100.0
    """Length of a spoke (paper: the arena's radius)."""
    spoke_step_m: Annotated[float, Meta(gt=0.0)] = 10.0
    """Distance between waypoints on a spoke; contact is looked for all the way (paper: 1 m)."""
    search_limit_s: Annotated[float, Meta(gt=0.0)] = 1200.0
    """Without contact so long after the drones began to form up, the search is given up."""


class AloneNote(msgspec.Struct, frozen=True, array_like=True, tag="locus-hybrid-alone"):
    """The order's note while each drone flies alone; afterwards it is LoCUS' own."""


class ContactWord(msgspec.Struct, frozen=True, array_like=True, tag="locus-hybrid"):
    contact: Reading

    def __post_init__(self) -> None:
        if not is_contact(self.contact):
            raise ValueError("the contact in the word is none")


_ALONE = Packed(AloneNote)
_WORD = Packed(ContactWord)


class LocusHybrid:
    """One drone's part; see the module's text."""

    Parameters = HybridParameters

    def __init__(self, layout: Layout, parameters: HybridParameters | None = None) -> None:
        self._layout = layout
        self._p = parameters or HybridParameters()
        self._locus = Locus(layout, self._p)
        self._flight: MobsFlight | None = None
        self._contact: Reading | None = None

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        order = observation.order
        if order is not None and _ALONE.unpack(order.note) is not None:
            return self._alone(observation, order, rng)
        decision = self._locus.decide(observation, rng)
        if order is None or order.apart or decision.order is None or decision.order.stage is not Stage.SEARCH:
            return decision
        # The formation has no contact: they part.
        parted = msgspec.structs.replace(
            decision.order, anchor_ned_m=order.anchor_ned_m, note=_ALONE.pack(AloneNote()), apart=True
        )
        return Decision(Hold(), decision.reading, parted)

    def _alone(self, observation: Observation, order: Order, rng: np.random.Generator) -> Decision:
        own, p = observation.own, self._p
        if self._flight is None:
            spokes = MobsParameters(
                radius_m=p.spoke_m, step_m=p.spoke_step_m, arrival_m=p.arrival_m, settle_mps=p.settle_mps,
                settle_s=0.0, blocked_s=p.blocked_s,
            )  # fmt: skip
            bearing_rad = first_bearing_rad(own.drone, rng)
            self._flight = MobsFlight(self._own_centre(observation, order), bearing_rad, spokes)
        if self._contact is None:
            self._contact = contact_of(own, p.detection_ppm, p.detection_sigmas)
        next_order = self._next(observation, order) if observation.tree.root == own.drone else None
        if self._contact is not None:
            word = _WORD.pack(ContactWord(self._contact))
            return Decision(GoTo(self._contact.position_ned_m), order=next_order, word=word)
        target = self._flight.step(observation.elapsed_s, own, 0.0, rng)
        return Decision(GoTo(target), order=next_order)

    def _own_centre(self, observation: Observation, order: Order) -> Vector3:
        north_m, east_m = self._layout.offset_m(observation.tree.slot)
        anchor_n, anchor_e, anchor_d = order.anchor_ned_m
        return anchor_n + north_m, anchor_e + east_m, anchor_d

    def _next(self, observation: Observation, order: Order) -> Order | None:
        """At the root: everybody around the first who has contact, or home when the time is over."""
        heard = {n.drone: _WORD.unpack(n.word) for n in observation.neighbours}
        contacts = {drone: word.contact for drone, word in heard.items() if word is not None}
        if self._contact is not None:
            contacts[observation.own.drone] = self._contact
        if not contacts:
            over = observation.elapsed_s > self._p.search_limit_s
            ended = msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.GIVE_UP)
            return ended if over else None
        north_m, east_m, _ = contacts[min(contacts)].position_ned_m
        anchor = (north_m, east_m, order.anchor_ned_m[2])
        called = msgspec.structs.replace(
            order, sequence=order.sequence + 1, stage=Stage.FORM, anchor_ned_m=anchor
        )
        return seated(noted(called, LocusNote(0.0, anchor)), observation)


ENTRY = StrategyEntry(
    name="locus-hybrid",
    make=LocusHybrid,
    parameters=HybridParameters,
    rules=(mobs_next, nearest_first, locus_next),
    note=AloneNote,
    word=ContactWord,
    legs=True,
)
