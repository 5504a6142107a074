"""Which paper an experiment belongs to. A further paper adds its folder, and itself to this list."""

from __future__ import annotations

from simvehicle.experiments.experiment import Paper
from simvehicle.experiments.forces.forces_paper import FORCES
from simvehicle.experiments.lattice.lattice_paper import LATTICE
from simvehicle.experiments.locus.paper import LOCUS
from simvehicle.experiments.tracing.traced_paper import TRACING
from simvehicle.trials.trials_error import TrialsError

PAPERS: tuple[Paper, ...] = (LOCUS, LATTICE, TRACING, FORCES)


def paper_of(name: str) -> Paper:
    """The paper that has an experiment of this name; `TrialsError` names those that there are."""
    for paper in PAPERS:
        if name in paper.names:
            return paper
    names = ", ".join(name for paper in PAPERS for name in paper.names)
    raise TrialsError(f"no experiment is called {name!r}; there are {names}")
