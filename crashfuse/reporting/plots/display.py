"""Display settings of accelerations: rated window, unit and sign."""

from dataclasses import dataclass
from typing import Literal

from crashfuse.study.config import WINDOWS_MS
from crashfuse.units import G

Unit = Literal["g", "m/s²"]


@dataclass(frozen=True, slots=True)
class Display:
    """The reader's display settings for all figures and tables.

    Parameters
    ----------
    window_ms : float
        The rating is computed over [0, window_ms); figures that show a test shade it.
    unit : {"g", "m/s²"}
        Unit of accelerations.
    deceleration : bool
        Show braking as positive; the data stay signed.
    """

    window_ms: float = WINDOWS_MS[-1]
    unit: Unit = "g"
    deceleration: bool = False

    @property
    def accel_scale(self) -> float:
        """Factor from signed m/s² to the axis' unit and sign."""
        return (1 / G if self.unit == "g" else 1.0) * (-1 if self.deceleration else 1)

    @property
    def accel_title(self) -> str:
        """Title of an acceleration axis, with its unit."""
        return f"{'Deceleration' if self.deceleration else 'Acceleration'} ({self.unit})"


DEFAULT = Display()
