"""The claims of the fluxotaxis paper's second study, judged on paired worlds and starts, and what explains them.

Two strategies are compared by the Wilcoxon rank-sum test over all trials, as the paper does, and by Student's
interval of the paired difference over the worlds' means: trials of one world are not independent, so that the first
alone would call chance significant. A claim holds where both agree; where they do not, it is undecided.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from scipy import stats

from simvehicle.experiments.experiment import Experiment, Outcome, Verdict
from simvehicle.experiments.tracing.traced_table import arrivals, mean_interval, share_words

_SIGNIFICANT = 0.05
_FEWEST = 3
"""Worlds from which a mean is taken for more than chance."""
_ARRIVES = ("fluxotaxis", "anemotaxis", "chemotaxis", "casting")
"""The order of arrival in the paper's table III, first to last."""
_ARRIVES_4 = ("fluxotaxis", "anemotaxis", "casting", "chemotaxis")
"""Table IV's."""
_LOCALISES = ("fluxotaxis", "chemotaxis", "anemotaxis", "casting")
"""Of table III, most to least."""
_LOCALISES_4 = ("fluxotaxis", "anemotaxis", "chemotaxis", "casting")


def judge(experiment: Experiment, rows: pd.DataFrame) -> list[Verdict]:
    """A verdict on each claim that the rows can decide."""
    flown = set(rows["strategy"])
    if experiment.name == "tracing":
        return list(_leaders(rows, flown))
    third = experiment.name == "fluxo-3"
    found = []
    orders = (
        (_ARRIVES if third else _ARRIVES_4, "arrives before", False),
        (_LOCALISES if third else _LOCALISES_4, "localises more than", True),
    )
    for order, words, localises in orders:
        found += [
            compare(rows, better, worse, f"{better} {words} {worse}", localises=localises)
            for better, worse in itertools.pairwise(order)
            if {better, worse} <= flown
        ]
    if rows["robots"].nunique() > 1:
        for strategy in (name for name in ("fluxotaxis", "chemotaxis", "anemotaxis") if name in flown):
            mine = rows[rows["strategy"] == strategy]
            found.append(_growth(mine, f"{strategy}: larger swarms arrive sooner", localises=False))
            found.append(_growth(mine, f"{strategy}: larger swarms localise more", localises=True))
    if third and "fluxotaxis" in flown and rows["obstacle_share"].nunique() > 1:
        found += [
            _leads(rows, flown, "fluxotaxis arrives first whatever the obstacles", localises=False),
            _leads(rows, flown, "fluxotaxis localises most whatever the obstacles", localises=True),
        ]
    return found


def compare(rows: pd.DataFrame, better: str, worse: str, claim: str, *, localises: bool) -> Verdict:
    """The verdict on "`better` has the larger count" or "arrives in fewer steps" than `worse`, on the same trials."""
    first, second = _paired(rows, better), _paired(rows, worse)
    if len(first) < 2:
        return Verdict(claim, "undecided", "fewer than two paired trials")
    a, b = _values(first, localises), _values(second, localises)
    test = stats.ranksums(a, b)
    probability, ahead = float(test.pvalue), float(test.statistic) * (1.0 if localises else -1.0)
    gain = a - b if localises else b - a
    low, high = mean_interval(first, gain)
    unit = "" if localises else " steps"
    censored = "" if localises else f"; never arrived: {_censored(first)} and {_censored(second)}"
    statistic = (
        f"mean {a.mean():.0f} and {b.mean():.0f}{unit}, median {np.median(a):.0f} and {np.median(b):.0f}; gain "
        f"{gain.mean():+.0f} (95 % {low:+.0f}..{high:+.0f} over {first['world'].nunique()} worlds), ahead in "
        f"{np.mean(gain > 0.0):.0%}, level in {np.mean(gain == 0.0):.0%} of {len(a)} trials; rank-sum p = "
        f"{probability:.2g}{censored}"
    )
    both = probability < _SIGNIFICANT and (low > 0.0 < ahead or high < 0.0 > ahead)
    outcome: Outcome = "undecided" if not both else "holds" if ahead > 0.0 else "does not hold"
    return Verdict(claim, outcome, statistic)


def _leaders(rows: pd.DataFrame, flown: set[str]) -> Iterator[Verdict]:
    """Of each condition: whether the strategy with the best mean is surely ahead of the next."""
    if len(flown) < 2:
        return
    for condition, mine in rows.groupby("condition", sort=False):
        for localises in (False, True):
            means = _means(mine, flown, localises=localises)
            first, second = ranked(means, localises=localises)[:2]
            words = "localises most" if localises else "arrives first"
            yield compare(
                mine, first, second, f"{condition}: {first} {words}, then {second}", localises=localises
            )


def _growth(mine: pd.DataFrame, claim: str, *, localises: bool) -> Verdict:
    """Whether a quantity goes the claimed way with the size of the swarm: Spearman's correlation in each world."""
    ranks = []
    for _, world in mine.groupby("world"):
        values = _values(world, localises)
        if np.ptp(values) > 0.0:
            ranks.append(float(stats.spearmanr(world["robots"], values).statistic))
    means = {int(robots): float(_values(group, localises).mean()) for robots, group in mine.groupby("robots")}
    told = ", ".join(f"{robots}: {mean:.0f}" for robots, mean in means.items())
    if len(ranks) < 2:
        return Verdict(claim, "undecided", f"mean by robots {told}; fewer than two worlds in which it varies")
    half = float(stats.t.ppf(0.975, len(ranks) - 1) * np.std(ranks, ddof=1) / math.sqrt(len(ranks)))
    mean, sign = float(np.mean(ranks)), 1.0 if localises else -1.0
    outcome: Outcome = (
        "holds" if sign * mean > half else "does not hold" if sign * mean < -half else "undecided"
    )
    return Verdict(
        claim,
        outcome,
        f"mean by robots {told}; rank correlation with the size {mean:+.2f} (95 % {mean - half:+.2f}.."
        f"{mean + half:+.2f}, {len(ranks)} worlds)",
    )


def _leads(rows: pd.DataFrame, flown: set[str], claim: str, *, localises: bool) -> Verdict:
    """Whether fluxotaxis' mean is the best at every share of obstacles."""
    told, first = [], 0
    shares = sorted(rows["obstacle_share"].unique())
    for share in shares:
        means = _means(rows[rows["obstacle_share"] == share], flown, localises=localises)
        best = ranked(means, localises=localises)[0]
        first += best == "fluxotaxis"
        told.append(f"{share_words(share)}: {best} {means[best]:.0f}, fluxotaxis {means['fluxotaxis']:.0f}")
    outcome: Outcome = "holds" if first == len(shares) else "does not hold" if first == 0 else "undecided"
    if int(rows.groupby("obstacle_share")["world"].nunique().min()) < _FEWEST:
        outcome = "undecided"
        told.append(f"fewer than {_FEWEST} worlds of some share")
    return Verdict(claim, outcome, "; ".join(told))


def ranked(means: dict[str, float], *, localises: bool) -> list[str]:
    """The strategies, the best mean first."""
    return sorted(means, key=lambda name: -means[name] if localises else means[name])


def explained(experiment: Experiment, rows: pd.DataFrame) -> str:
    """Markdown: which strategy wins in which air, with the plume's statistics."""
    conditions = list(dict.fromkeys(rows["condition"]))
    everything = rows
    rows = rows[rows["condition"] == conditions[0]]
    worlds = rows.groupby("world").first()
    starts = experiment.trials
    flown = list(dict.fromkeys(rows["strategy"]))
    sizes = ", ".join(map(str, sorted(rows["robots"].unique())))
    under = f" under {len(conditions)} conditions" if len(conditions) > 1 else ""
    text = (
        f"## What was flown\n\n{_counted(len(worlds), 'world')} with {_counted(starts, 'start')} each, for every "
        f"strategy and swarms of {sizes} robots{under}: {_counted(len(everything), 'trial')} of "
        f"{int(rows['limit_steps'].max())} steps. Who "
        "does not arrive counts with all steps (censored). Intervals are over the worlds' means, 95 %.\n\n"
        "## Who wins when\n\n"
        "By regime, and by how intermittent the plume is (the share of the time in which a place in the plume "
        "smells nothing; median over the plume). Peak to mean: the 99th percentile over the mean at such places.\n\n"
        "| worlds | how many | intermittency | peak to mean | first to arrive | steps | localises most | count |\n"
        "| --- | --- | --- | --- | --- | --- | --- | --- |\n"
    )
    for words, numbers in _groups(worlds):
        mine = rows[rows["world"].isin(numbers)]
        some = worlds.loc[numbers]
        text += f"| {words} | {len(numbers)} | {some['intermittency'].mean():.2f} "
        text += f"| {some['peak_to_mean'].mean():.1f} | "
        text += " | ".join(_winner(mine, flown, localises=localises) for localises in (False, True)) + " |\n"
    text += "\n" + _correlated(rows, worlds, flown)
    return text + (_ranking(everything, flown) if experiment.name == "tracing" else "")


def _ranking(rows: pd.DataFrame, flown: Sequence[str]) -> str:
    """Every strategy's means by regime in the plain worlds, and under each condition over all regimes."""
    plain = rows[rows["condition"] == rows["condition"].iloc[0]]
    parts = [(str(regime), mine) for regime, mine in plain.groupby("regime", sort=False)]
    parts += [(str(condition), mine) for condition, mine in rows.groupby("condition", sort=False)]
    text = "## Ranking\n\n"
    for words, localises in (("Mean arrival, steps", False), ("Mean localisation count", True)):
        text += f"{words}, with the rank in brackets.\n\n"
        text += "| strategy | " + " | ".join(name for name, _ in parts) + " |\n"
        text += "| --- " * (len(parts) + 1) + "|\n"
        means = [_means(mine, flown, localises=localises) for _, mine in parts]
        ranks = [ranked(one, localises=localises) for one in means]
        for strategy in ranks[len(parts) - rows["condition"].nunique()]:  # by the plain worlds
            cells = [
                f"{one[strategy]:.0f} ({rank.index(strategy) + 1})"
                for one, rank in zip(means, ranks, strict=True)
            ]
            text += f"| {strategy} | " + " | ".join(cells) + " |\n"
        text += "\n"
    return text


def _winner(mine: pd.DataFrame, flown: Sequence[str], *, localises: bool) -> str:
    """The best strategy and the next, and what they have."""
    means = _means(mine, flown, localises=localises)
    ahead = ranked(means, localises=localises)[:2]
    return f"{', then '.join(ahead)} | {', '.join(f'{means[name]:.0f}' for name in ahead)}"


def _groups(worlds: pd.DataFrame) -> list[tuple[str, list[int]]]:
    """(name, numbers of worlds): each regime, and thirds by intermittency."""
    found = [(str(regime), group.index.to_list()) for regime, group in worlds.groupby("regime", sort=False)]
    if len(worlds) >= 3:
        order = worlds["intermittency"].sort_values(kind="stable").index.to_numpy()
        parts = np.array_split(order, 3)
        found += [
            (words, part.tolist())
            for words, part in zip(
                ("least intermittent third", "middle third", "most intermittent third"), parts, strict=True
            )
        ]
    return found


def _correlated(rows: pd.DataFrame, worlds: pd.DataFrame, flown: Sequence[str]) -> str:
    """What goes with a world's statistics: rank correlations over the worlds."""
    if len(worlds) < 5:
        return ""
    text = (
        "Rank correlation (Spearman) over the worlds of each strategy's mean with the plume's statistics; in bold "
        "what chance gives in fewer than 5 of 100 cases:\n\n"
        "| strategy | arrival: intermittency | peak to mean | share of the ground | localisation: intermittency | "
        "peak to mean | share of the ground |\n| --- | --- | --- | --- | --- | --- | --- |\n"
    )
    for strategy in flown:
        mine = rows[rows["strategy"] == strategy]
        cells = []
        for localises in (False, True):
            means = pd.Series(_values(mine, localises)).groupby(mine["world"].to_numpy()).mean()
            for name in ("intermittency", "peak_to_mean", "plume_share"):
                statistic = worlds.loc[means.index, name].to_numpy()
                cells += [_rank_correlation(means.to_numpy(), statistic)]
        text += f"| {strategy} | " + " | ".join(cells) + " |\n"
    return text + "\n"


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> str:
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 5 or np.ptp(a[both]) == 0.0 or np.ptp(b[both]) == 0.0:
        return "-"
    found = stats.spearmanr(a[both], b[both])
    words = f"{found.statistic:+.2f}"
    return f"**{words}**" if found.pvalue < _SIGNIFICANT else words


def _paired(rows: pd.DataFrame, strategy: str) -> pd.DataFrame:
    """A strategy's trials, in an order that is the same for all."""
    mine = rows[rows["strategy"] == strategy]
    return mine.sort_values(["condition", "world", "robots", "trial"])


def _values(mine: pd.DataFrame, localises: bool) -> np.ndarray:
    return mine["localisation"].to_numpy(dtype=np.float64) if localises else arrivals(mine)


def _means(mine: pd.DataFrame, flown: Sequence[str] | set[str], *, localises: bool) -> dict[str, float]:
    return {name: float(_values(mine[mine["strategy"] == name], localises).mean()) for name in sorted(flown)}


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _censored(mine: pd.DataFrame) -> int:
    return int((~mine["success"]).sum())
