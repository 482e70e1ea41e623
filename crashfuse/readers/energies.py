"""The quality of a run from its global histories, whichever solver wrote them."""

from dataclasses import dataclass

import numpy as np

from crashfuse.run_quality import QUANTITIES, RunQuality
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import number

_OF = {
    "energy_change": "the energy at the start",
    "hourglass_share": "the largest internal energy",
    "added_mass_share": "the mass at the start",
}


@dataclass(frozen=True, eq=False, slots=True)
class Energies:
    """Global histories of a run in its own units, each of shape (n,); None where the solver did not write one.

    Parameters
    ----------
    total : ndarray
        Kinetic, internal, contact, hourglass and whatever else is kept or lost: all energy.
    work : ndarray
        Work done from outside.
    internal, hourglass : ndarray
        Of the whole model.
    added_mass : ndarray
        Mass added by mass scaling over the mass without it.
    """

    total: FloatArray | None = None
    work: FloatArray | None = None
    internal: FloatArray | None = None
    hourglass: FloatArray | None = None
    added_mass: FloatArray | None = None

    @property
    def quality(self) -> RunQuality:
        """The largest change of energy, share of hourglass energy and share of added mass."""
        hourglass, internal, share = _largest(self.hourglass), _largest(self.internal), None
        if hourglass is not None and internal is not None and internal > 0:
            share = hourglass / internal
        return RunQuality.of(self._energy_change(), share, _largest(self.added_mass))

    def _energy_change(self) -> float | None:
        """The deviation of the total energy, less the work, that is largest in size, over the energy at the start."""
        if self.total is None or self.work is None or not self.total.size or not self.total[0] > 0:
            return None
        change = (self.total - self.work) - (self.total[0] - self.work[0])
        if not np.isfinite(change).all():
            return None
        return float(change[np.abs(change).argmax()] / self.total[0])


def completed(quality: RunQuality, by: RunQuality) -> RunQuality:
    """Quality with what is not recorded taken from another source."""
    told = {name: getattr(quality, name) for name in QUANTITIES}
    return RunQuality(**{name: getattr(by, name) if value is None else value for name, value in told.items()})


def quality_sentence(quality: RunQuality, source: str) -> str:
    """What a source says of a run."""
    parts = [
        f"{QUANTITIES[name]} {number(100 * value, '.3g')} % of {of}"
        if (value := getattr(quality, name)) is not None
        else f"{QUANTITIES[name]} not recorded"
        for name, of in _OF.items()
    ]
    return f"Run quality ({source}): {', '.join(parts)}."


def _largest(values: FloatArray | None) -> float | None:
    if values is None or not values.size or not np.isfinite(values).all():
        return None
    return float(values.max())
