"""Predicted pulses for an occupant model: what is exported, how, and as which files.

The edges of the band of whole pulses are a sled laboratory's corridor, as ISO-MME, and no curves of a model: each is a
pulse that no vehicle has.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from string import ascii_uppercase, digits
from typing import Literal, get_args

import numpy as np

from crashfuse.approaches.base import WHOLE_S
from crashfuse.approaches.registry import LABELS
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import UsageError, one_of, require_a, several
from crashfuse.results.export.isomme import isomme_pulse
from crashfuse.results.export.solver_curves import SOLVERS, SolverCurve, solver_include
from crashfuse.results.fit_explanations import whole_sentences
from crashfuse.signals.pulse import DT_S, FloatArray, kinematics
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import campaign_facts
from crashfuse.units import MS, G, Sentence, UnitSystem, said, speed
from crashfuse.version import __version__

PulseFormat = Literal["isomme", "lsdyna", "radioss"]
PULSE_FORMATS: tuple[PulseFormat, ...] = get_args(PulseFormat)
"""ISO-MME, and includes for LS-DYNA and Radioss; each is a folder of the results."""

_OF_LOCATIONS = {*digits, *ascii_uppercase}
PulseFiles = Mapping[PulseFormat, Mapping[str, bytes]]  # content by path below the format's folder

LOCATION = "10VEHC000000"
"""Test object 1, no position, the vehicle, no fine location: the first 12 characters of an ISO-MME channel code."""

_REST_G = 0.5  # more at the end of the record is worth a remark


@dataclass(frozen=True, slots=True)
class PulseExport:
    """Which pulses go out, and how; a UsageError if a choice makes no sense.

    Parameters
    ----------
    formats : tuple of str
        Some of :data:`PULSE_FORMATS`.
    draws : int
        Number of whole draws beside the expected pulse, of approaches that have a band.
    seed : int
        Decides which draws; they are equally likely.
    location : str
        The first 12 characters of the ISO-MME channel codes: test object, position, main and fine locations.
    curve : SolverCurve, optional
        Units, sign, start, scale and id of a solver's curve; needed for the solvers' formats.
    """

    formats: tuple[PulseFormat, ...] = ("isomme",)
    draws: int = 0
    seed: int = 0
    location: str = LOCATION
    curve: SolverCurve | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "formats", several(self.formats))
        for name in self.formats:
            one_of("format of pulses", name, dict.fromkeys(PULSE_FORMATS))
        if self.curve is not None:
            require_a(SolverCurve, self.curve, 'crashfuse.SolverCurve("mm-ms-kg")')
        elif set(self.formats) & set(SOLVERS):
            raise UsageError("A curve for a solver needs the unit system of its model.")
        letters = {*str(self.location)}
        if not (isinstance(self.location, str) and len(self.location) == len(LOCATION) and letters <= _OF_LOCATIONS):
            raise UsageError(
                f"An ISO-MME location has 12 digits and capitals, such as {LOCATION}, not {self.location!r}."
            )
        for what, number in (("The number of draws", self.draws), ("The seed of draws", self.seed)):
            if not (isinstance(number, Integral) and number >= 0):
                raise UsageError(f"{what} is 0 or more, not {number!r}.")

    def files(
        self,
        campaign: Campaign,
        estimates: Sequence[Estimate],
        remarks: Sequence[str] = (),
        units: UnitSystem | None = None,
    ) -> PulseFiles:
        """The files of each format, which state these remarks, too; a UsageError if there are too few draws.

        What is for reading in them is in these units, by default the campaign's.
        """
        units = campaign.units if units is None else units
        written: dict[PulseFormat, dict[str, bytes]] = {name: {} for name in self.formats}
        cfc = campaign.channel_filter_class
        records = "taken as they are" if cfc is None else f"filtered with CFC {cfc:g}"
        origin = (
            f"From the campaign {campaign.name}, SHA-256 {campaign.fingerprint}.",
            f"Its records are {records}; the pulse is as band-limited as these.",
            *(fact.sentence for fact in campaign_facts(campaign)),
        )
        for place, pulse in enumerate((*outgoing(estimates, self.draws, self.seed), *corridors(estimates))):
            comments = [said(text, units) for text in (*pulse.comments_in(units), *remarks, *origin)]
            for name, files in written.items():
                if name == "isomme":
                    given = pulse.condition, pulse.accel_mps2, pulse.name, self.location, comments
                    files |= isomme_pulse(campaign, *given, moves=not pulse.edge)
                elif self.curve is not None and not pulse.edge:
                    path = f"{pulse.name}{SOLVERS[name].suffix}"
                    curve = replace(self.curve, number=self.curve.number + place)  # all fit into one model
                    files[path] = solver_include(name, pulse.title, comments, pulse.accel_mps2, curve)
        return written


@dataclass(frozen=True, eq=False, slots=True)
class OutgoingPulse:
    """A whole pulse of a prediction, or an edge of its corridor, with name and remarks."""

    approach: str
    which: str  # for files: ``expected``, ``representative``, ``apart``, ``draw_037`` or ``corridor_upper``, say
    label: str  # for readers
    condition: Condition
    accel_mps2: FloatArray = field(repr=False)
    remarks: tuple[str, ...] = ()
    edge: bool = False  # which no vehicle moves by

    @property
    def name(self) -> str:
        """Name for files: ``fused_56kph_expected``."""
        return f"{self.approach}_{self.condition.speed_name}_{self.which}"

    @property
    def title(self) -> str:
        """Name for a reader."""
        return f"{LABELS[self.approach]}, {self.label}, {self.condition.stated_speed}"

    def comments_in(self, units: UnitSystem) -> tuple[str, ...]:
        """That it is predicted, by what, at which condition: as typed, and in the reader's units."""
        made, there = f"Predicted by crashfuse {__version__}, not measured: {self.title}.", self.condition
        same = "" if there.units == units.endings else f" ({there.in_units(units)})"
        return made, f"Condition: {there.stated}{same}.", *self.remarks


def outgoing(estimates: Sequence[Estimate], draws: int, seed: int) -> Iterator[OutgoingPulse]:
    """Of each approach the expected pulse, a representative one, and draws chosen by the seed."""
    if draws and all(estimate.draws_mps2 is None for estimate in estimates):
        names = ", ".join(estimate.approach for estimate in estimates)
        raise UsageError(f"There are no draws of {names}: no band.")
    for estimate in estimates:
        pulses = {"expected": ("expected pulse", estimate.accel_mps2, "An average: softer than any test.")}
        if estimate.draws_mps2 is not None:
            n = len(estimate.draws_mps2)
            if draws > n:
                raise UsageError(f"The approach {estimate.approach} has {n} draws; ask for at most these.")
            chosen = np.sort(np.random.default_rng(seed).choice(n, draws, replace=False))
            representative, *drawn = estimate.representative_pulses(chosen.tolist())
            pulses["representative"] = ("representative pulse", representative, "As a middling test here shows it.")
            for way, (fold, own) in zip(("others", "apart"), estimate.by_fold.items(), strict=False):
                label = f"representative pulse if it folds as {fold}"
                pulses[way] = label, own.representative_pulses()[0], "One of two ways in which tests here fold."
            for number, pulse in zip(chosen.tolist(), drawn, strict=True):
                remark = f"One of {n} equally likely pulses."
                pulses[f"draw_{number + 1:03d}"] = f"draw {number + 1}", pulse, remark
        for which, (label, accel, remark) in pulses.items():
            remarks = (remark, *_unfinished(accel, estimate.condition), *estimate.notes)
            yield OutgoingPulse(estimate.approach, which, label, estimate.condition, accel, remarks)


def corridors(estimates: Iterable[Estimate]) -> Iterator[OutgoingPulse]:
    """Both edges of each approach's band of whole pulses, if any, up to 60 ms."""
    for estimate in estimates:
        condition, band = estimate.condition, estimate.whole_band()
        for edge, accel in zip(("lower", "upper"), band or (), strict=False):
            remarks = ("An edge, no pulse.", *whole_sentences([estimate]), *estimate.notes)
            until, label = accel[: round(WHOLE_S / DT_S)], f"{edge} edge of the corridor"
            yield OutgoingPulse(estimate.approach, f"corridor_{edge}", label, condition, until, remarks, edge=True)


def _unfinished(accel_mps2: FloatArray, condition: Condition) -> tuple[str, ...]:
    motion = kinematics(accel_mps2, condition.speed_mps, DT_S)
    end, last_g = f"The pulse ends at {accel_mps2.size * DT_S / MS:g} ms", accel_mps2[-1] / G
    if not np.isfinite(motion.t0_s):
        return (Sentence(f"{end}, while the vehicle still moves forward at {{}}.", speed(motion.velocity_mps[-1])),)
    return (f"{end} with {last_g:.1f} g left.",) if abs(last_g) > _REST_G else ()
