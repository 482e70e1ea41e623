"""Reader of LS-DYNA runs: ``binout`` (one file or many) or ASCII ``nodout``; one run, or one folder or job per run."""

from contextlib import ExitStack
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np

from crashfuse.errors import DataError, Problem, collecting
from crashfuse.files.archive import Budget, Limits, Member, refuse
from crashfuse.readers.axes import AXES, Travel
from crashfuse.readers.energies import quality_sentence
from crashfuse.readers.lsdyna.accelerometers import proposed_nodes
from crashfuse.readers.lsdyna.binout import read_binout
from crashfuse.readers.lsdyna.energies import States, glstat_text, kinetic_energy, matsum_text, quality_of
from crashfuse.readers.lsdyna.histories import Histories, channel_of, is_aliased
from crashfuse.readers.lsdyna.nodout import read_nodout
from crashfuse.readers.lsdyna.run_files import RunFiles, belongs, runs_of
from crashfuse.readers.lsdyna.unit_system import mass_kg, units_of
from crashfuse.readers.members import opened_members
from crashfuse.readers.quantities import speed, weight
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.travel import axis_of_travel, checked_travel
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.wording import Sentence

LSDYNA_LIMITS = Limits(total_bytes=1 << 40, member_bytes=64 << 30, members=500_000)
"""Size limits of a library; only the needed part of a binout is read, however long it is."""

_MOST_UNZIPPED = 256 << 20  # bytes of a zipped binout, which must be read in memory
_MOST_NODES, _FEWEST_NODES, _MOST_IN_ALL = 200, 20, 20_000  # kept for a single run, per run of many, for all runs


def read_lsdyna(path: Path, travel: Travel | None = None, limits: Limits = LSDYNA_LIMITS) -> tuple[Record, ...]:
    """Read LS-DYNA runs: the accelerations of their nodes along the axis of travel, else of their rigid bodies.

    The path is a ``binout``, any file of its family, a ``nodout``, the folder of a run or of many, or a zip. Each run
    is a record with the name of its job or folder as id, the initial speed of its nodes, and the mass that follows from
    the kinetic energy (``glstat``) at that speed.

    Parameters
    ----------
    travel : str, optional
        The direction of travel; by default that in which the nodes set out.
    """
    kind = "binout or nodout of LS-DYNA"
    with opened_members(path, belongs, kind, limits) as (members, budget):
        zipped = path.suffix.lower() == ".zip"
        runs = runs_of(members, path)
        if not runs:
            raise DataError(Problem(path.name, kind, "none", "choose the folder of a run"))
        most = min(_MOST_NODES, max(_MOST_IN_ALL // len(runs), _FEWEST_NODES))
        records: list[Record] = []
        problems: list[Problem] = []
        for run_id, files in runs.items():
            with collecting(problems), np.errstate(all="ignore"):  # damaged data may hold any number
                histories = _histories(files, budget, most, travel, zipped=zipped)
                records.append(_record(run_id, path.name if len(runs) == 1 else run_id, histories, travel))
        refuse(problems, path.name)
    return tuple(records)


def _histories(files: RunFiles, budget: Budget, most: int, travel: Travel | None, *, zipped: bool) -> Histories:
    """Read the binout of a run, or its nodout if the binout has no nodes."""
    found, glstat, matsum = Histories("", (), 0), States(), States()
    with ExitStack() as opened:
        families = [
            [
                (_unzipped(file, budget) if zipped else opened.enter_context(file.opened()), file.where)
                for file in family
            ]
            for family in files.families()
        ]
        if families:
            found, glstat, matsum = read_binout(families, most, travel)
    if not any(node.name.isdecimal() for node in found.nodes):
        for text in (files.text[kind] for kind in ("nodouthf", "nodout") if kind in files.text):
            more = read_nodout(text.chunks(budget), text.where, most, travel)
            found = more.beside(found) if found.nodes and found.nodes[0].name.isdecimal() else more
    if not glstat and (whole := files.text.get("glstat")) is not None:
        glstat = glstat_text(whole.chunks(budget), whole.where)
    if not matsum and (parts := files.text.get("matsum")) is not None:
        matsum = matsum_text(parts.chunks(budget), parts.where)
    if not found.nodes:
        advice = "ask the solver for it (*DATABASE_NODOUT, *DATABASE_HISTORY_NODE)"
        raise DataError(Problem(files.first, "accelerations of nodes (nodout) or rigid bodies", "none", advice))
    notes = (*found.notes, *_missing_end(found, glstat))
    return replace(found, notes=notes, kinetic_energy=kinetic_energy(glstat), quality=quality_of(glstat, matsum))


def _missing_end(run: Histories, glstat: States) -> list[str]:
    """A warning if the energies go on after the nodes end: a part of their file is missing."""
    nodes, energies = max(float(node.time[-1]) for node in run.nodes), sorted(glstat)
    if len(energies) < 3 or energies[-1] - nodes <= 2 * max(np.diff(energies)):
        return []
    return [f"Careful: the nodes end at {nodes:.4g} but the energies at {energies[-1]:.4g}; copy all files of the run."]


def _unzipped(file: Member, budget: Budget) -> IO[bytes]:
    content = BytesIO()
    for chunk in file.chunks(budget):
        if content.tell() + len(chunk) > _MOST_UNZIPPED:
            expected = f"a binout of at most {_MOST_UNZIPPED >> 20} MiB in a zip"
            raise DataError(Problem(file.where, expected, "more", "unpack the zip and import the folder"))
        content.write(chunk)
    return content


def _record(run_id: str, source: str, run: Histories, travel: Travel | None) -> Record:
    nodes = [node for node in run.nodes if node.name.isdecimal()] or list(run.nodes)
    proposed, why = proposed_nodes(nodes)
    per_second, unit, units_told = units_of(proposed, source)
    # velocity unit = acceleration unit times time unit
    per_mps = None if unit is None else ACCELERATION_UNITS[unit] * per_second
    own = float(np.median([abs(node.velocity[0]) for node in proposed]))
    largest = max(float(np.nan_to_num(np.abs(node.velocity)).max()) for node in proposed)
    travels, moves = checked_travel(run.start, (own, largest), run.fastest, per_mps, travel, source)
    steps = [f"LS-DYNA run{f', {run.title}' if run.title else ''}.", *run.notes, units_told, travels, why]
    if any(map(is_aliased, proposed)):
        steps.append("Accelerations that do not add up to the nodes' velocities are taken from the velocities.")
    if run.total > len(run.nodes):
        steps.append(f"{len(run.nodes)} of {run.total} nodes are kept, those with a title first.")
    speed_mps = mass = None
    no_speed = f"a {units_told[0].lower()}{units_told[1:].rstrip('.')}"
    if not moves:
        no_speed = f"nodes at rest along {AXES[axis_of_travel(run.start, travel)]} at the start"
    elif per_mps is not None and np.isfinite(own):
        speed_mps, mass, no_speed = own * per_mps, mass_kg(run.kinetic_energy, proposed), ""
        steps.append(Sentence("Speed {}, at which these nodes set out.", speed(speed_mps, form=".4g")))
    if mass is not None:
        steps.append(Sentence("Mass {}, from the kinetic energy at that speed (glstat).", weight(mass)))
    steps.append(quality_sentence(run.quality, "glstat, matsum"))
    channels = tuple(channel_of(node, per_second, unit) for node in run.nodes)
    names = tuple(node.name for node in proposed)
    condition = PartialCondition(speed_mps, mass)
    return Record(run_id, source, condition, channels, names, tuple(steps), no_speed=no_speed, quality=run.quality)
