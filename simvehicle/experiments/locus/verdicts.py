"""Does what the paper reports hold for the model as the paper and the authors' program describe it?"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from simvehicle.experiments.claims import BEGINS, above, begins_to_fail, larger_deviation, larger_mean, within
from simvehicle.experiments.experiment import Experiment, Outcome, Verdict
from simvehicle.experiments.locus.definitions import by_rate
from simvehicle.experiments.statistics import Interval, bootstrap, mean_difference, mean_ratio
from simvehicle.experiments.table import columns, select
from simvehicle.trials.cell import Cell


def judge(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    """A verdict on each claim that the experiment's cells can decide."""
    if by_rate(experiment):
        return _by_rate(experiment, rows)
    found = _by_size(experiment, rows)
    if experiment.name == "locus-2":
        found += _perturbed(experiment, rows)
    return found + _beyond(experiment, rows)


_EVENTS = (("contact_s", "contact"), ("source_s", "max flux"))


def _by_strategy(experiment: Experiment, strategy: str) -> dict[int, Cell]:
    """Cells of the experiment's first plume by swarm size."""
    plume = experiment.cells[0].plume
    return {c.drones: c for c in experiment.cells if c.strategy == strategy and c.plume == plume}


_RIVALS = {"mobs": "MoBS", "mobs-authors": "the program's MoBS"}
"""MoBS by the paper's text and by its authors' program."""
_REPORTED = (5, 10, 20)
"""The swarm sizes that the paper shows."""


def _by_size(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    found: list[Verdict] = []
    for strategy, rival in _RIVALS.items():
        locus, mobs = _by_strategy(experiment, "locus"), _by_strategy(experiment, strategy)
        sizes = sorted(locus.keys() & mobs.keys())
        every: dict[str, dict[int, Verdict]] = {}
        for size in sizes:
            a, b = locus[size], mobs[size]
            if experiment.name == "locus-1":
                if size == 5:
                    found += [
                        larger_mean(
                            rows, a, b, name, f"5 drones: LoCUS' mean time to {what} is below {rival}'"
                        )
                        for name, what in _EVENTS
                    ]
                if size in (10, 20):
                    claim = f"{size} drones: {rival} makes contact sooner on average"
                    found.append(larger_mean(rows, b, a, "contact_s", claim))
            else:
                claim = f"LoCUS' mean time to max flux is below {rival}'"
                verdict = larger_mean(rows, a, b, "source_s", f"{size} drones: {claim}")
                every.setdefault(claim, {})[size] = verdict
            for name, what in _EVENTS:
                if experiment.name == "locus-1" or name == "source_s":
                    claim = f"LoCUS' deviation of the time to {what} is below {rival}'"
                    verdict = larger_deviation(rows, a, b, name, f"{size} drones: {claim}")
                    every.setdefault(claim, {})[size] = verdict
        found += _of_every_size(every)
    return found


def _of_every_size(every: dict[str, dict[int, Verdict]]) -> list[Verdict]:
    """The verdicts of few sizes; of many those of the sizes that the paper shows, and at which the others hold."""
    found: list[Verdict] = []
    for claim, verdicts in every.items():
        if len(verdicts) <= 2 * len(_REPORTED):
            found += verdicts.values()
            continue
        found += [verdicts[size] for size in _REPORTED if size in verdicts]
        by_outcome: dict[Outcome, list[int]] = {"holds": [], "undecided": [], "does not hold": []}
        for size, one in verdicts.items():
            by_outcome[one.verdict].append(size)
        words = [
            f"{outcome} at {', '.join(map(str, sizes))}"
            for outcome, sizes in by_outcome.items()
            if sizes and len(sizes) < len(verdicts)
        ]
        outcome: Outcome = "does not hold" if by_outcome["does not hold"] else "undecided"
        outcome = "holds" if len(by_outcome["holds"]) == len(verdicts) else outcome
        range_words = f"{min(verdicts)} to {max(verdicts)} drones"
        found.append(Verdict(f"{range_words}: {claim} at every size", outcome, "; ".join(words) or "at all"))
    return found


_LONGEST_MIN = {5: 344.0, 10: 124.0, 20: 31.0}
"""The paper's outliers of MoBS in the perturbed plume."""
_HUNDREDS = 2000
"""Draws of a hundred trials."""
_SHORT_RATIO = 1.25
"""How much longer LoCUS may take from contact to maximum in the perturbed plume and still "remain short"."""


def _perturbed(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    found = []
    locus = _by_strategy(experiment, "locus")
    for strategy, rival in _RIVALS.items():
        for size, cell in sorted(_by_strategy(experiment, strategy).items()):
            if size not in _LONGEST_MIN:
                continue
            times = columns(rows, cell, "source_s") / 60.0
            longest_min = float(np.nanmax(times, initial=0.0))
            rival_min = (
                float(np.nanmax(columns(rows, locus[size], "source_s"), initial=0.0)) / 60.0
                if size in locus
                else math.inf
            )
            found += [
                Verdict(
                    f"{size} drones: {rival} has outliers far beyond LoCUS' longest trial "
                    f"(paper: {_LONGEST_MIN[size]:.0f} min)",
                    "holds" if longest_min > 1.25 * rival_min else "does not hold",
                    f"longest MoBS trial {longest_min:.0f} min, longest LoCUS trial {rival_min:.0f} min",
                ),
                _longest(times, size, rival),
            ]
    claim = (
        "LoCUS' time from contact to max flux stays short in the perturbed plume "
        f"(below {_SHORT_RATIO} times the smooth plume's)"
    )
    short: dict[int, Verdict] = {}
    for smooth in experiment.compared:
        cell = locus[smooth.drones]
        after_smooth = columns(rows, smooth, "source_s") - columns(rows, smooth, "contact_s")
        after = columns(rows, cell, "source_s") - columns(rows, cell, "contact_s")
        both = np.isfinite(after_smooth) & np.isfinite(after)
        if both.sum() < 2:
            continue
        low, high = bootstrap(mean_ratio, after_smooth[both], after[both])
        short[smooth.drones] = Verdict(
            f"{smooth.drones} drones: {claim}",
            "holds" if high < _SHORT_RATIO else "does not hold" if low > _SHORT_RATIO else "undecided",
            f"smooth {after_smooth[both].mean() / 60:.1f} min, perturbed {after[both].mean() / 60:.1f} min, "
            f"ratio {mean_ratio(after_smooth[both], after[both]):.2f} (95 % {low:.2f}..{high:.2f})",
        )
    found += _of_every_size({claim: short})
    return found


def _longest(times_min: np.ndarray, size: int, rival: str) -> Verdict:
    """Whether the longest of the paper's 100 trials could be that of any 100 of ours."""
    times_min = times_min[np.isfinite(times_min)]
    claim = f"{size} drones: the longest of 100 trials of {rival} takes {_LONGEST_MIN[size]:.0f} min"
    if len(times_min) < 2:
        return Verdict(claim, "undecided", "fewer than two trials")
    draws = np.random.default_rng(20201203).choice(times_min, (_HUNDREDS, 100))
    low, middle, high = np.quantile(draws.max(axis=1), (0.025, 0.5, 0.975))
    return Verdict(
        claim,
        "holds" if low <= _LONGEST_MIN[size] <= high else "does not hold",
        f"longest of any 100 of {len(times_min)} trials: {middle:.0f} min (95 % {low:.0f}..{high:.0f})",
    )


def _beyond(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    """The paper's discussion: spread search wins for large swarms. Tested at the largest size."""
    found = []
    largest = max(cell.drones for cell in experiment.cells)
    for strategy, name in (("locus-hybrid", "spokes, then gathering,"), ("locus-multi", "sub-swarms")):
        mine = _by_strategy(experiment, strategy).get(largest)
        for rival in ("locus", *_RIVALS):
            other = _by_strategy(experiment, rival).get(largest)
            if mine is not None and other is not None:
                claim = (
                    f"{largest} drones: {name} reach max flux sooner than {rival} (prediction of the paper)"
                )
                found.append(larger_mean(rows, mine, other, "source_s", claim))
    return found


# --- Failure rates ---

_CLAIMS: dict[str, dict[tuple[str, bool], tuple[Interval, str]]] = {
    "locus-3": {
        ("locus", True): ((1e-4, 1e-3), "between 1e-4 and 1e-3"),
        ("locus", False): ((3e-6, 3e-5), "at about 1e-5 (3e-6 to 3e-5)"),
        ("mobs", False): ((1e-4, 1e-3), "between 1e-4 and 1e-3"),
    },
    "locus-4": {
        ("locus", True): ((3e-3, 3e-2), "at about 1e-2 (3e-3 to 3e-2)"),
        ("locus", False): ((3e-5, 3e-4), "at about 1e-4 (3e-5 to 3e-4)"),
        ("mobs", False): ((3e-3, 3e-2), "at about 1e-2 (3e-3 to 3e-2)"),
    },
}
"""(strategy, healing) -> the range of rates in which the paper sees it begin to fail, and its words."""


def _by_rate(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    found = []
    plumes = list(dict.fromkeys(cell.plume for cell in experiment.cells))
    sizes = sorted({cell.drones for cell in experiment.cells})
    for plume in plumes:
        for size in sizes:
            group = [c for c in experiment.cells if c.plume == plume and c.drones == size]
            lines = dict.fromkeys((c.strategy, c.healing, c.unhealed) for c in group)
            for strategy, healing, unhealed in lines:
                claimed = _CLAIMS[experiment.name].get(("mobs" if strategy in _RIVALS else strategy, healing))
                if claimed is None:
                    continue
                (low, high), words = claimed
                cells = [
                    c for c in group if (c.strategy, c.healing, c.unhealed) == (strategy, healing, unhealed)
                ]
                begin, sure = begins_to_fail(rows, cells)
                who = (
                    strategy if strategy in _RIVALS else f"{strategy} with{'' if healing else 'out'} healing"
                )
                who += " (nobody goes on)" if unhealed == "nobody" else ""
                found.append(
                    Verdict(
                        f"{plume} plume, {size} drones: {who} begins to fail {words}",
                        within((begin, sure), (low, high)),
                        f"success falls below {BEGINS:.0%} between {begin:.0e} and {sure:.0e}",
                    )
                )
            found += _healing_pays(rows, plume, size, group)
    return found


def _healing_pays(rows: pd.DataFrame, plume: str, size: int, group: list[Cell]) -> list[Verdict]:
    """Healing against none, over all rates at which either succeeds sometimes, trial by trial."""
    locus = [c for c in group if c.strategy == "locus"]
    kinds = [c.unhealed for c in locus if not c.healing]
    kind = "reached" if "reached" in kinds else "nobody"  # the better of the two
    on = {c.failure_rate: c for c in locus if c.healing}
    off = {c.failure_rate: c for c in locus if not c.healing and c.unhealed == kind}
    healed, plain = [], []
    for rate in sorted(on.keys() & off.keys()):
        a = select(rows, on[rate])["success"].to_numpy(dtype=np.float64)
        b = select(rows, off[rate])["success"].to_numpy(dtype=np.float64)
        if 0.0 < a.mean() + b.mean() < 2.0:
            healed.append(a)
            plain.append(b)
    if not healed:
        return []
    claim = f"{plume} plume, {size} drones: healing makes LoCUS succeed more often"
    first, second = np.mean(plain, axis=0), np.mean(healed, axis=0)
    if len(first) < 2:
        return [Verdict(claim, "undecided", "fewer than two paired trials")]
    low, high = bootstrap(mean_difference, first, second)
    statistic = (
        f"success over {len(healed)} rates: {first.mean():.1%} without, {second.mean():.1%} with healing; "
        f"difference {mean_difference(first, second):+.1%} (95 % {low:+.1%}..{high:+.1%})"
    )
    return [Verdict(claim, above((low, high), 0.0), statistic)]
