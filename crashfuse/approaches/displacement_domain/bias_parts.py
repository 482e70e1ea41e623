"""The parts of the hierarchical bias: their meaning, their priors, and the columns that they vary over."""

from collections.abc import Iterable

from crashfuse.approaches.displacement_domain.covariance import LogNormal, Part
from crashfuse.units import G

_S, _V0, _FRONT, _REAR, _TREND, _HUMPS, _SHARE, _STOPPING, _CRUSHING, FIRST_FACTOR = range(10)
TEST = -1
LENGTH_UNITS = {
    _S: "s in m",
    _V0: "v0 in m/s",
    _FRONT: "front weight in kg",
    _REAR: "rear weight in kg",
    _SHARE: "v/v0",
}
FORCE_UNIT = 10 * G  # the ratio enters with its standard deviation where the CAE model decelerates at 10 g

# With one to three tests the priors decide. Their medians are what random vehicles of many kinds taught
# (benchmarks/bias_priors.py), rounded; their spreads are wider than those found there. No campaign took part.
_REACH = (_S, LogNormal(0.1, 0.3))
_SHORT = (_S, LogNormal(0.047, 0.3))
_SPEED = (_V0, LogNormal(9.0, 0.5))
_WEIGHT = LogNormal(300.0, 0.5)
_STOP_REACH = (_SHARE, LogNormal(0.2, 0.4))
_OVER_DISPLACEMENT = (
    Part("shared", LogNormal(0.41, 0.5), ((_REACH,),), times=_CRUSHING),
    Part("by speed", LogNormal(0.55, 0.5), ((_SHORT,), (_SPEED,)), times=_CRUSHING),
    Part("by weight", LogNormal(0.21, 0.7), ((_REACH,), ((_FRONT, _WEIGHT), (_REAR, _WEIGHT))), times=_CRUSHING),
    Part("ratio", LogNormal(0.37, 0.7), (((_S, LogNormal(0.5, 0.3)),),), times=_TREND),
    Part("humps", LogNormal(1.05, 0.5), (((_S, LogNormal(0.43, 0.3)),),), times=_HUMPS),
    Part("own", LogNormal(0.17, 0.6), (((_S, LogNormal(0.027, 0.3)),),), times=_CRUSHING, same=TEST),
)
OVER_VELOCITY = (
    Part("stop by speed", LogNormal(0.74, 0.7), ((_STOP_REACH,), ((_V0, LogNormal(5.5, 0.5)),)), times=_STOPPING),
    Part("own stop", LogNormal(0.53, 0.5), ((_STOP_REACH,),), times=_STOPPING, same=TEST),
)
_FACTOR_SCALE = LogNormal(0.3, 0.7)
NOISE = LogNormal(0.03, 0.7)

_EVEN_G, _GROWING_G, _UNRESOLVED_G = 0.3, 1.5, 0.15
_SCATTER_REACH = (_S, LogNormal(0.05, 0.2))
GROWTH_UNIT_M = 0.5


def bias_parts(factor_columns: Iterable[tuple[str, int]]) -> tuple[Part, ...]:
    """All parts of the bias, including one for each of these factors, given by name and column."""
    by_factor = (
        Part(f"by {name}", _FACTOR_SCALE, ((_REACH,),), times=_CRUSHING, same=column) for name, column in factor_columns
    )
    return (*_OVER_DISPLACEMENT[:-1], *by_factor, _OVER_DISPLACEMENT[-1], *OVER_VELOCITY)


def scatter_parts(
    factor_columns: Iterable[tuple[str, int]], growth_column: int, unit_mps2: float
) -> tuple[tuple[Part, ...], LogNormal]:
    """Parts of the bias up to the stop with the scatter of tests in two parts, and the noise, for :class:`Scatter`.

    Scatter has physical units, independent of how wrong the CAE model is: a sensor's few tenths of a g throughout, and
    a part that grows with crush, as every fold begins where the last one ended. The unit is the root mean square of the
    bias.
    """
    common = [part for part in bias_parts(factor_columns) if part.same != TEST and part not in OVER_VELOCITY]
    unit = unit_mps2 / G
    even = Part("even", LogNormal(_EVEN_G / unit, 0.7), ((_SCATTER_REACH,),), times=_CRUSHING, same=TEST)
    growing = Part("growing", LogNormal(_GROWING_G / unit, 0.4), ((_SCATTER_REACH,),), times=growth_column, same=TEST)
    return (*common, even, growing), LogNormal(_UNRESOLVED_G / unit, 0.5)
