"""How good a swarm's radio is, as a file says it: the air between two nodes, and how much a node can send.

What is lost over a distance follows the log-distance path loss model with log-normal shadowing (T. S. Rappaport,
"Wireless Communications: Principles and Practice", 2nd edition 2002, sections 4.9.1 and 4.9.2): the received power
falls by 10 n dB for every tenfold of the distance, n = 2 in free space, and varies around that with a standard
deviation in dB. A message is lost where it falls below the receiver's sensitivity. The share of that is a normal
distribution's; the logistic curve of 1.702 times its argument stands for it and is never 0.01 away from it.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from msgspec import Meta

from flightstack.config import Section
from flightstack.transport.terrain import Ridge
from mission.geometry.frames import Vector3

Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=3600.0)]
NodeName = Annotated[int, Meta(ge=1, le=250)] | str
"""A drone's number, or a ground station's name."""

OUT_OF_REACH_LOSS: Final = 0.99
"""Where more than this is lost there is no link: no connection of a reliable protocol outlives it."""
_REFERENCE_M: Final = 1.0
"""The near end of the model; nearer antennas are reckoned to be this far apart."""
_LIGHT_MPS: Final = 299_792_458.0
_LOGISTIC_FOR_NORMAL: Final = 1.702


class LinkBudget(Section, frozen=True, kw_only=True):
    """What a link has to lose, in dB. The defaults are a Wi-Fi mesh or telemetry radio of 100 mW in the 2.4 GHz band
    with two small rod antennas above open rock: 0.5 % are lost at 300 m, 5 % at 500 m, half at 1 km."""

    transmit_dbm: Annotated[float, Meta(ge=-30.0, le=60.0)] = 20.0
    antennas_dbi: Annotated[float, Meta(ge=-60.0, le=60.0)] = 4.0
    """Gains of both antennas together, less what their cables and their misalignment take."""
    frequency_hz: Annotated[float, Meta(ge=1e6, le=1e11)] = 2.44e9
    path_loss_exponent: Annotated[float, Meta(ge=1.5, le=6.0)] = 2.4
    """2 in free space, 2.2 to 2.7 low above open ground, 3 and more behind trees and walls."""
    sensitivity_dbm: Annotated[float, Meta(ge=-150.0, le=-20.0)] = -88.0
    """The received power at which half of the messages are lost."""
    shadowing_db: Annotated[float, Meta(ge=0.1, le=20.0)] = 4.0
    """Standard deviation of the received power: how gradually a link ends."""

    def received_dbm(self, distance_m: float) -> float:
        """Mean received power at `distance_m` from the sender."""
        return self._at_reference_dbm - 10.0 * self.path_loss_exponent * math.log10(
            max(distance_m, _REFERENCE_M) / _REFERENCE_M
        )

    def loss(self, distance_m: float) -> float:
        """Probability that a message is lost over `distance_m`; it never falls with the distance. 1: out of reach."""
        margin_db = self.received_dbm(distance_m) - self.sensitivity_dbm
        exponent = _LOGISTIC_FOR_NORMAL * margin_db / self.shadowing_db
        lost = 1.0 / (1.0 + math.exp(min(exponent, 700.0)))  # e^710 is no number any more
        return 1.0 if lost > OUT_OF_REACH_LOSS else lost

    @property
    def _at_reference_dbm(self) -> float:
        free_space_db = 20.0 * math.log10(4.0 * math.pi * _REFERENCE_M * self.frequency_hz / _LIGHT_MPS)
        return self.transmit_dbm + self.antennas_dbi - free_space_db


class RadioModel(Section, frozen=True, kw_only=True):
    """The radio of a whole swarm. By default it is perfect: everything arrives at once, everywhere, in order."""

    loss: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    """Probability that a message vanishes, wherever the nodes are; a reliable one is sent again and comes later."""
    link_budget: LinkBudget | None = None
    """What is lost over the distance, on top of `loss`; None: nothing."""
    range_m: Annotated[float, Meta(gt=0.0, le=1e6)] | None = None
    """Nothing is heard beyond it; None: everybody hears everybody, as far as the link budget goes."""
    ridges: tuple[Ridge, ...] = ()
    """Terrain: who is hidden from another by one of them does not hear it."""
    dead_links: tuple[tuple[NodeName, NodeName], ...] = ()
    """One way each: of [sender, receiver] the receiver never hears the sender. Others may hear it, and it them."""
    delay_s: Seconds = 0.0
    jitter_s: Seconds = 0.0
    """Mean of an exponential delay on top of `delay_s`; it does not reorder."""
    duplication: Probability = 0.0
    """Of best-effort messages, as the next."""
    reordering: Probability = 0.0
    """A message is held back for `held_back_s`, so that later ones overtake it."""
    held_back_s: Seconds = 0.3
    bandwidth_bytes_per_s: Annotated[float, Meta(ge=1.0, le=1e12)] | None = None
    """What a node can send, each message once a receiver and with its headers; None: everything at once."""
    queue_bytes: Annotated[int, Meta(ge=0, le=1 << 30)] = 32_768
    """What may wait at a node that has more to send. Beyond it the oldest best-effort messages are dropped, while
    reliable ones wait."""

    @property
    def places_matter(self) -> bool:
        """Whether what is heard depends on where the nodes are."""
        return self.range_m is not None or self.link_budget is not None or bool(self.ridges)

    def loss_between(self, a_ned_m: Vector3, b_ned_m: Vector3) -> float:
        """Probability that a message is lost on the way, `range_m` and `loss` aside. 1: out of reach."""
        if any(ridge.hides(a_ned_m, b_ned_m) for ridge in self.ridges):
            return 1.0
        return 0.0 if self.link_budget is None else self.link_budget.loss(math.dist(a_ned_m, b_ned_m))
