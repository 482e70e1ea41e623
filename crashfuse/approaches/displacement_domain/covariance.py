r"""Covariance of a function that is a sum of parts: shared by all tests, by similar tests, or by none.

A :class:`Part` is one term of the covariance between rows x and x',

.. math::

    \sigma^2 \; w(x)\,w(x') \; [\text{same}] \;
    \prod_g k\Big(\sqrt{\textstyle\sum_{i \in g} (x_i - x_i')^2 / \ell_i^2}\Big),

with the Matérn-5/2 correlation k in each group g of columns, an optional known factor w, and an optional restriction
to rows that agree in one column, such as the test number or the powertrain.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from crashfuse.signals.pulse import FloatArray


@dataclass(frozen=True, slots=True)
class LogNormal:
    """Prior of a positive hyperparameter: its median, and the standard deviation of its logarithm."""

    median: float
    spread: float


@dataclass(frozen=True, slots=True)
class Part:
    """One term of the covariance."""

    name: str
    scale: LogNormal  # of its standard deviation σ, relative to the root mean square of the training output
    groups: tuple[tuple[tuple[int, LogNormal], ...], ...]  # of columns with their length scales, a correlation each
    times: int | None = None  # column of w, which multiplies the function
    same: int | None = None  # column each of whose values has an independent function

    @property
    def priors(self) -> tuple[LogNormal, ...]:
        """Priors of the scale and of the length scales, in the order of the hyperparameters."""
        return (self.scale, *(prior for group in self.groups for _, prior in group))


class Covariance:
    """Covariance between rows x, shape (n, n_columns + 1), and z, shape (m, n_columns + 1).

    Distances and factors, which no hyperparameter changes, are computed once, and only where a part is not zero.
    """

    def __init__(self, parts: Sequence[Part], x: FloatArray, z: FloatArray) -> None:
        self._ends, self._shape = np.cumsum([len(part.priors) for part in parts]), (len(x), len(z))
        self._parts = []
        for part in parts:
            rows, columns = _reach(part, x, z), _reach(part, z, x)
            squares = [[np.subtract.outer(x[rows, i], z[columns, i]) ** 2 for i, _ in group] for group in part.groups]
            self._parts.append(((rows, columns), _factor(part, x[rows], z[columns]), squares))

    def __call__(self, log_hyperparameters: FloatArray) -> FloatArray:
        """Covariance, shape (n, m), given the logarithms of σ and the length scales part by part."""
        covariance, logs_of_parts = np.zeros(self._shape), np.split(log_hyperparameters, self._ends[:-1])
        for (place, factor, squares), logs in zip(self._parts, logs_of_parts, strict=True):
            covariance[place] += _term(factor, squares, logs)[0]
        return covariance


class TrainingCovariance:
    """Covariance of rows and its derivatives, only where a part is not zero in the lower triangle (``entries``)."""

    def __init__(self, parts: Sequence[Part], x: FloatArray) -> None:
        self._ends = np.cumsum([len(part.priors) for part in parts])
        self.entries = rows, columns = np.tril_indices(len(x))
        self._parts = []
        for part in parts:
            factor = _factor(part, x, x)[rows, columns]
            where = np.flatnonzero(factor)
            one, two = x[rows[where]], x[columns[where]]
            squares = [[(one[:, column] - two[:, column]) ** 2 for column, _ in group] for group in part.groups]
            self._parts.append((where, factor[where], squares))

    def with_derivatives(self, logs: FloatArray) -> tuple[FloatArray, list[tuple[np.ndarray, list[FloatArray]]]]:
        """Covariance, its upper triangle zero, and each part's places in it with its derivatives."""
        values, derivatives = np.zeros(len(self.entries[0])), []
        for (where, factor, squares), own in zip(self._parts, np.split(logs, self._ends[:-1]), strict=True):
            term, slopes = _term(factor, squares, own, slopes=True)
            values[where] += term
            derivatives.append((where, [2 * term, *slopes]))
        n = int(self.entries[0][-1]) + 1
        covariance = np.zeros((n, n))
        covariance[self.entries] = values
        return covariance, derivatives


def _term(
    factor: FloatArray, squares: Sequence[Sequence[FloatArray]], logs: FloatArray, *, slopes: bool = False
) -> tuple[FloatArray, list[FloatArray]]:
    scaled, inverse_squares = np.exp(2 * logs[0]) * factor, iter(np.exp(-2 * logs[1:]))
    shares = [[square * next(inverse_squares) for square in group] for group in squares]
    distances = [np.sqrt(5 * reduce(np.add, group)) for group in shares]
    decays = [np.exp(-u) for u in distances]
    matern = [(1 + u + u**2 / 3) * decay for u, decay in zip(distances, decays, strict=True)]
    term = reduce(np.multiply, matern, scaled)
    derivatives: list[FloatArray] = []
    for g, group in enumerate(shares if slopes else ()):
        slope = 5 / 3 * (1 + distances[g]) * decays[g]  # -2 dk/d(r²): times a column's share of r², dk/d(log length)
        common = reduce(np.multiply, matern[:g] + matern[g + 1 :], scaled * slope)
        derivatives.extend(common * share for share in group)
    return term, derivatives


def _reach(part: Part, x: FloatArray, z: FloatArray) -> slice:  # of rows x, outside of which it is zero
    reached = np.ones(len(x), dtype=bool) if part.times is None else x[:, part.times] != 0
    if part.same is not None:
        reached &= np.isin(x[:, part.same], z[:, part.same])
    places = np.flatnonzero(reached)
    return slice(places[0], places[-1] + 1) if places.size else slice(0)


def _factor(part: Part, x: FloatArray, z: FloatArray) -> FloatArray:
    factor = np.ones((len(x), len(z)))
    if part.times is not None:
        factor *= np.multiply.outer(x[:, part.times], z[:, part.times])
    if part.same is not None:
        factor *= np.equal.outer(x[:, part.same], z[:, part.same])
    return factor
