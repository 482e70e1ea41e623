"""The components of the mixture: what the approaches and the raw CAE say of a crash that was not learned from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from crashfuse.approaches.left_out import STRIDE, LeftOut
from crashfuse.approaches.nearness import nearness
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.signals.pulse import FloatArray

COMPONENTS = ("time domain", "displacement domain", "pre-trained network", "raw CAE")


class Component(NamedTuple):
    """An expected pulse, and draws of whole pulses, shape (n_draws, n_times)."""

    mean: FloatArray
    draws: FloatArray

    def widened(self, factor: float) -> FloatArray:
        """The draws, their deviations from the mean times a factor."""
        return self.mean + factor * (self.draws - self.mean)


class Unseen(NamedTuple):
    """What each component, thinned, says of a test that it has not seen, and how near the tests that it saw are."""

    number: int
    components: list[Component]
    nearness: float


@dataclass(frozen=True, eq=False, slots=True)
class Tests:
    """What was measured in each test and what the raw CAE says of it.

    Attributes
    ----------
    speeds_mps : ndarray, shape (n,)
    measured_mps2, cae_mps2 : ndarray, shape (n, 1250)
    """

    speeds_mps: FloatArray
    measured_mps2: FloatArray
    cae_mps2: FloatArray

    @classmethod
    def of(cls, campaign: Campaign, model: CaeModel) -> Self:
        """Compare a campaign's tests with the CAE model."""
        speeds = np.array([test.condition.speed_mps for test in campaign.tests])
        measured = np.array([test.pulse.accel_mps2 for test in campaign.tests])
        return cls(speeds, measured, np.array([model.pulse(test.condition).accel_mps2 for test in campaign.tests]))

    def nearness(self, speed_mps: float, without: Sequence[int] = ()) -> float:
        """Nearness in speed to the other tests."""
        return nearness(speed_mps, np.delete(self.speeds_mps, without))

    def raw(self, cae_mps2: FloatArray, speed_mps: float, without: Sequence[int] = ()) -> Component:
        """The CAE pulse; its draws have the errors of the other tests, scaled with speed, with either sign."""
        ratios = speed_mps / np.delete(self.speeds_mps, without)[:, None]
        errors = np.delete(self.measured_mps2 - self.cae_mps2, without, axis=0) * ratios
        either = np.concatenate([errors, -errors]) if len(errors) else np.zeros_like(cae_mps2)[None]
        return Component(cae_mps2, cae_mps2 + either)

    def unseen(self, parts: Sequence[LeftOut], without: Sequence[Sequence[int]]) -> list[Unseen]:
        """Thinned components for tests that all parts predicted; ``without`` are those left out with each."""
        found = []
        for number, out in enumerate(without):
            own = [np.flatnonzero(part.numbers == number) for part in parts]
            if not all(rows.size for rows in own):
                continue
            components = [
                Component(part.mean_mps2[row], part.draws_mps2[row].astype(np.float64))
                for part, (row,) in zip(parts, own, strict=True)
            ]
            speed = float(self.speeds_mps[number])
            raw = self.raw(self.cae_mps2[number], speed, out)
            components.append(Component(raw.mean[::STRIDE], raw.draws[:, ::STRIDE]))
            found.append(Unseen(number, components, self.nearness(speed, out)))
        return found


def mixed(components: Sequence[Component], weights: FloatArray, n_draws: int, seed: int) -> Component:
    """The weighted mean, and draws from each component in proportion to its weight."""
    rng = np.random.default_rng(seed)
    shares = np.diff(np.floor(np.cumsum(weights) * n_draws + 0.5).astype(int), prepend=0)
    chosen = [
        component.draws[rng.choice(len(component.draws), size=share, replace=bool(share > len(component.draws)))]
        for component, share in zip(components, shares, strict=True)
    ]
    return Component(weights @ np.array([component.mean for component in components]), np.concatenate(chosen))


def thinned_out(mixtures: Mapping[int, Component]) -> LeftOut:
    """Thinned mixtures for left-out tests, by test number."""
    means = np.array([mixture.mean for mixture in mixtures.values()])
    draws = np.array([mixture.draws for mixture in mixtures.values()], dtype=np.float32)
    return LeftOut(np.array(list(mixtures), dtype=np.int64), means, draws)
