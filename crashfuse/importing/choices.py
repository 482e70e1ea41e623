"""User choices for an import."""

from dataclasses import dataclass, field, replace
from typing import Literal

from crashfuse.errors import UsageError, one_of, printable, require_a, require_number, several
from crashfuse.readers.axle_weights import AxleWeights
from crashfuse.readers.record import PartialCondition
from crashfuse.readers.unit_spelling import acceleration_unit

_LONGEST_GAP_M = 10.0  # at 56 km/h more than half a second


def require_filter_class(cfc: object) -> None:
    """Raise a UsageError if this is no channel filter class, "none" or None."""
    if cfc not in (None, "none") and not (isinstance(cfc, int | float) and 1 <= cfc <= 1000):
        raise UsageError(f'A channel filter class is 60, 180, 600, 1000 or "none", not {printable(repr(cfc), 20)}.')


@dataclass(frozen=True, slots=True)
class Choices:
    """User settings that replace detection; None or empty means detect.

    Parameters
    ----------
    channels : tuple of str
        Names of the channels to average.
    unit : str, optional
        Unit of the acceleration, as :func:`crashfuse.readers.unit_spelling.acceleration_unit` takes it.
    deceleration_sign : {"negative", "positive"}, optional
        Whether the file writes deceleration as negative or as positive numbers.
    time_zero_s : float, optional
        Time of first contact in the file's own time.
    gap_m : float, optional
        Distance that CAE runs move before they meet the barrier; a run that decelerates before is left as it is.
    front_share : float, optional
        Share of the mass on the front axle, for files that state only the total mass.

    Raises
    ------
    UsageError
        If there is no such unit, sign or filter class, or a number is none or in another unit.
    """

    channels: tuple[str, ...] = ()
    unit: str | None = None
    deceleration_sign: Literal["negative", "positive"] | None = None
    time_zero_s: float | None = None
    gap_m: float | None = None
    channel_filter_class: float | Literal["none"] | None = None
    condition: PartialCondition = field(default_factory=PartialCondition)
    front_share: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", several(self.channels))
        if self.unit is not None:
            object.__setattr__(self, "unit", acceleration_unit(self.unit))
        if self.deceleration_sign is not None:
            one_of("sign of a deceleration", self.deceleration_sign, dict.fromkeys(("negative", "positive")))
        require_filter_class(self.channel_filter_class)
        require_a(PartialCondition, self.condition, "crashfuse.PartialCondition()")
        for name in ("time_zero_s", "gap_m", "front_share"):
            if (value := getattr(self, name)) is not None:
                require_number(name, value)
        if self.gap_m is not None and not 0 <= self.gap_m <= _LONGEST_GAP_M:
            meant = f"{self.gap_m:g} mm are {1e-3 * self.gap_m:g} m"
            raise UsageError(f"gap_m is from 0 to {_LONGEST_GAP_M:g} m, not {self.gap_m:g}: {meant}.")

    @property
    def weights(self) -> AxleWeights:
        """The weights as far as the user gave them."""
        return replace(self.condition.weights, front_share=self.front_share)
