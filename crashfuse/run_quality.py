"""What the solver says of a CAE run, and limits on it: energy balance, hourglass energy, added mass."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

QUANTITIES: Mapping[str, str] = {
    "energy_change": "energy change",
    "hourglass_share": "hourglass energy",
    "added_mass_share": "added mass",
}
"""Columns of ``cae.csv`` and what each is called."""


@dataclass(frozen=True, slots=True)
class RunQuality:
    """What the solver says of one run, each a share; None where it is not recorded.

    Parameters
    ----------
    energy_change : float, optional
        Largest deviation of the total energy, less the work done from outside, from its value at the start, over that
        value; with its sign (negative: energy was lost).
    hourglass_share : float, optional
        Largest hourglass energy over the largest internal energy, both of the whole model, each at its own time.
    added_mass_share : float, optional
        Largest mass added by mass scaling, over the mass of the model without it.
    """

    energy_change: float | None = None
    hourglass_share: float | None = None
    added_mass_share: float | None = None

    @classmethod
    def of(cls, energy_change: float | None, hourglass: float | None, added_mass: float | None) -> Self:
        """Quality from computed shares: what lies beyond 1 counts as 1, what rounding put below 0 as 0."""
        shares = [None if share is None else min(max(share, 0.0), 1.0) for share in (hourglass, added_mass)]
        return cls(None if energy_change is None else min(max(energy_change, -1.0), 1.0), *shares)

    @property
    def recorded(self) -> bool:
        """Whether anything is recorded."""
        return self != RunQuality()


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """Limits on the quality of CAE runs, as shares; None where there is no limit.

    Parameters
    ----------
    name : str
        As in sentences.
    energy_change : float, optional
        The change of energy, in size, may reach it.
    hourglass_share, added_mass_share : float, optional
        The share must lie below it.
    """

    name: str
    energy_change: float | None = None
    hourglass_share: float | None = None
    added_mass_share: float | None = None

    @property
    def limited(self) -> tuple[str, ...]:
        """The quantities that have a limit."""
        return tuple(name for name in QUANTITIES if getattr(self, name) is not None)

    def exceeded(self, quality: RunQuality) -> tuple[str, ...]:
        """The quantities of a run that are recorded and beyond their limit."""
        found = []
        for name in self.limited:
            value, limit = getattr(quality, name), getattr(self, name)
            if value is not None and (abs(value) > limit if name == "energy_change" else value >= limit):
                found.append(name)
        return tuple(found)

    def missing(self, quality: RunQuality) -> tuple[str, ...]:
        """The quantities that have a limit but are not recorded for a run."""
        return tuple(name for name in self.limited if getattr(quality, name) is None)

    def __str__(self) -> str:
        terms = [
            f"{QUANTITIES[name]} {'at most' if name == 'energy_change' else 'below'} {100 * getattr(self, name):g} %"
            for name in self.limited
        ]
        return f"{self.name} ({', '.join(terms)})"


NAMED_LIMITS: Mapping[str, QualityLimits] = {
    # Euro NCAP, Crash Protection Virtual Testing Protocol 1.0.2 (2025), section 5: largest hourglass energy of the full
    # setup over its largest internal energy; mass added by mass scaling over the mass at the beginning of the run.
    "euro-ncap-vt-2025": QualityLimits("Euro NCAP virtual testing 2025", hourglass_share=0.10, added_mass_share=0.05),
    # NCHRP Web-Only Document 179 (2011), Table E-1: energy at the end of the run against its start; hourglass energy at
    # the end below 5 % of the initial energy and below 10 % of the internal energy at the end; added mass over the
    # mass at the start. The internal energy can't outgrow the initial energy by more than the energy change, so a share
    # below 5 % of it meets both limits on hourglass energy.
    "nchrp-179": QualityLimits("NCHRP 179", energy_change=0.10, hourglass_share=0.05, added_mass_share=0.05),
}
"""Sets of limits by their names in ``campaign.toml``."""
