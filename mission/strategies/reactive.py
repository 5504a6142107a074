"""Flying a rule of `tick_rule`: an observation becomes its arguments, the velocity that it gives a decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np

from mission.geometry.formation import FloatArray, Layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Hold, Neighbour, Observation, OwnState, Velocity
from mission.strategies.declaration import Declaration, DeclarationParameters
from mission.strategies.entry import StrategyEntry
from mission.strategies.tick_rule import WORD, OwnSenses, TickRule, numbers

_STALE_S = 2.0
"""A neighbour that was last heard longer ago is where nobody knows."""
_WIND_STALE_S = 10.0
_LEAST_SIGMAS = 4.0
"""An excess of less than so many standard deviations is no contact."""
_CLIMB_PER_S = 0.5
_CLIMB_MPS = 1.0
"""The height is held by climbing at half the error a second, at most so fast."""
_USUAL_INTERVAL_S = 0.1
"""The first tick has none before it."""


class RuleWord(msgspec.Struct, frozen=True, array_like=True):
    """The numbers that a rule has written into its word."""

    strategy: str
    """Whose word it is: another strategy's numbers mean something else."""
    numbers: tuple[float, ...]


class ReactiveStrategy:
    """One drone that flies by a rule. As root it orders no more than the survey's stages: to search, that somebody
    has contact, and the end (`mission.strategies.declaration`)."""

    def __init__(
        self,
        name: str,
        rule: TickRule,
        parameters: msgspec.Struct,
        declaration: DeclarationParameters | None = None,
    ) -> None:
        """`parameters` are the rule's."""
        self._name = name
        self._rule = rule
        self._parameters = numbers(parameters)
        self._declaration = Declaration(declaration or DeclarationParameters())
        self._state = np.zeros(rule.state_size)
        self._word = np.zeros(rule.word_size)
        self._start: Vector3 | None = None
        self._before_s = -math.inf

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        order = observation.order
        if self._start is None:
            if order is None:
                return Decision(Hold())
            self._start = order.anchor_ned_m
        draw = float(rng.random())
        own = self._senses(observation, self._start, draw)
        self._before_s = observation.elapsed_s
        neighbours = self._neighbours(observation)
        north_mps, east_mps = self._rule.rule(
            own,
            neighbours,
            len(neighbours),
            beam_ranges(observation.ranges_m, self._rule.beams),
            self._state,
            self._word,
            self._parameters,
        )
        # A drone that forms up in a layer of its own comes to the swarm's height here.
        climb = _CLIMB_PER_S * (self._start[2] - observation.own.position_ned_m[2])
        down_mps = min(max(climb, -_CLIMB_MPS), _CLIMB_MPS)
        word = _pack(self._name, self._word) if self._rule.word_size else b""
        velocity = Velocity((float(north_mps), float(east_mps), down_mps))
        if order is None:
            return Decision(velocity, word=word)
        reading, ordered = self._declaration.step(observation, order, self._start, draw)
        return Decision(velocity, reading, ordered, word)

    def _senses(self, observation: Observation, start: Vector3, draw: float) -> OwnSenses:
        own = observation.own
        wind = own.wind if own.wind is not None and own.wind.age_s < _WIND_STALE_S else None
        interval_s = observation.elapsed_s - self._before_s
        return OwnSenses(
            own.position_ned_m[0] - start[0],
            own.position_ned_m[1] - start[1],
            own.velocity_ned_mps[0],
            own.velocity_ned_mps[1],
            _excess_ppm(own),
            wind.wind_ned_mps[0] if wind else 0.0,
            wind.wind_ned_mps[1] if wind else 0.0,
            observation.elapsed_s,
            interval_s if 0.0 < interval_s < math.inf else _USUAL_INTERVAL_S,
            draw,
        )

    def _neighbours(self, observation: Observation) -> FloatArray:
        """(n, WORD + word size) rows of those that fly within range, relative to this drone."""
        own = observation.own
        near = [other for other in observation.neighbours if self._hears(own, other)]
        rows = np.zeros((len(near), WORD + self._rule.word_size))
        for row, other in zip(rows, near, strict=True):
            row[:2] = np.subtract(other.position_ned_m[:2], own.position_ned_m[:2])
            row[2:WORD] = np.subtract(other.velocity_ned_mps[:2], own.velocity_ned_mps[:2])
            row[WORD:] = _unpack(self._name, other.word, self._rule.word_size)
        return rows

    def _hears(self, own: OwnState, other: Neighbour) -> bool:
        away_m = math.dist(own.position_ned_m[:2], other.position_ned_m[:2])
        flies = other.airborne and not other.adrift and other.age_s < _STALE_S
        return flies and away_m <= self._rule.range_m


def reactive_strategy(name: str, rule: TickRule) -> StrategyEntry:
    """The registry's entry of a strategy that is nothing but a rule: it flies, and it runs in trials.

    In flight it has the parameters of `DeclarationParameters` beside the rule's. `TypeError` where both have one of
    the same name.
    """
    in_flight = _with_declaration(name, rule.parameters)

    def make(layout: Layout, given: msgspec.Struct) -> ReactiveStrategy:
        del layout  # a reactive swarm holds no formation once it has formed up
        own, declaration = _only(rule.parameters, given), _only(DeclarationParameters, given)
        return ReactiveStrategy(name, rule, own, declaration)

    return StrategyEntry(
        name=name,
        make=make,
        parameters=rule.parameters,
        in_flight=in_flight,
        rules=(rule.rule,),
        word=RuleWord,
        ticks=rule,
    )


def _with_declaration(name: str, own: type[msgspec.Struct]) -> type[msgspec.Struct]:
    """A struct with the fields of a rule's parameters and then those of the declaration."""
    twice = set(own.__struct_fields__) & set(DeclarationParameters.__struct_fields__)
    if twice:
        raise TypeError(
            f"strategy {name}: its rule has a parameter {', '.join(sorted(twice))}, which every reactive strategy "
            "has already: call it otherwise"
        )
    usual = {**_defaults(own()), **_defaults(DeclarationParameters())}
    fields = [
        (field.name, field.type, usual[field.name])
        for kind in (own, DeclarationParameters)
        for field in msgspec.structs.fields(kind)
    ]

    def check_both(given: msgspec.Struct) -> None:
        _only(own, given)
        _only(DeclarationParameters, given)

    return msgspec.defstruct(
        f"{own.__name__}InFlight",
        fields,
        frozen=True,
        kw_only=True,
        forbid_unknown_fields=True,
        namespace={"__post_init__": check_both},
    )


def _defaults(parameters: msgspec.Struct) -> dict[str, Any]:
    return {name: getattr(parameters, name) for name in parameters.__struct_fields__}


S = TypeVar("S", bound=msgspec.Struct)


def _only(kind: type[S], given: msgspec.Struct) -> S:
    """The part of the parameters that is `kind`'s; what is missing is as usual."""
    names = set(kind.__struct_fields__) & set(given.__struct_fields__)
    return kind(**{name: getattr(given, name) for name in names})


def beam_ranges(ranges_m: Sequence[tuple[float, float]], beams: int) -> FloatArray:
    """(beams,) the least range within half a beam's angle of each beam's bearing; `inf` where nothing is near."""
    found = np.full(beams, math.inf)
    for bearing_rad, range_m in ranges_m if beams else ():
        beam = round(bearing_rad * beams / (2.0 * math.pi)) % beams
        if range_m < found[beam]:  # no number is less
            found[beam] = range_m
    return found


def _excess_ppm(own: OwnState) -> float:
    """The excess over what noise may give, 0 without contact or without a trustworthy estimate."""
    co2 = own.excess_co2_ppm
    if co2 is None or not math.isfinite(co2.mean) or not co2.variance >= 0.0:
        return 0.0
    return co2.mean if co2.mean > _LEAST_SIGMAS * math.sqrt(co2.variance) else 0.0


def _pack(name: str, word: FloatArray) -> bytes:
    return msgspec.msgpack.encode(RuleWord(name, tuple(word.tolist())))


def _unpack(name: str, data: bytes, size: int) -> tuple[float, ...]:
    """A neighbour's word; zeros where it has said none of this strategy's, or anything but numbers."""
    try:
        word = msgspec.msgpack.decode(data, type=RuleWord) if data else None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        word = None  # a broken or hostile neighbour is one that says nothing
    if word is None or word.strategy != name or len(word.numbers) != size:
        return (0.0,) * size
    return word.numbers if all(map(math.isfinite, word.numbers)) else (0.0,) * size
