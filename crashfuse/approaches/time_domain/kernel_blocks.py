"""The tangent kernel between conditions, in blocks of one pair each: no pair is computed twice.

A block depends on the LF networks and its two conditions alone, and not on what was measured there, so all folds of a
study, all subsets of a learning curve and all predictions share it.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt
from torch import Tensor

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import Tangent
from crashfuse.approaches.time_domain.threads import Crew, quick_threads
from crashfuse.approaches.time_domain.training import weights_of
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.code_digest import code_digest
from crashfuse.signals.pulse import FloatArray

_KIND = "tangent kernel"  # of cache entry: all pairs that are known for these networks
_MOST = 64  # conditions whose pairs are kept, 33 MB

Vector = tuple[float, ...]
Pair = tuple[Vector, Vector]


class KernelBlocks:
    """J(x) J(x')ᵀ of the mean of an ensemble's members, all weights together, times the number of members.

    Parameters
    ----------
    inputs : callable
        Input sequences of the networks for conditions of shape (n, 3).
    library : str
        Fingerprint of the CAE runs, which determine the inputs.
    cache : Cache, optional
        Storage for the blocks between the conditions of :meth:`among`.
    """

    def __init__(
        self,
        network: Tcn,
        config: TcnConfig,
        inputs: Callable[[FloatArray], Tensor],
        library: str,
        cache: Cache | None = None,
    ) -> None:
        self._network, self._config, self._inputs, self._cache = network, config, inputs, cache
        weights = hashlib.sha256(b"".join(weight.tobytes() for weight in weights_of(network).values())).hexdigest()
        settings = {"config": config.lf_settings, "code": code_digest(__name__)}
        self._key = {"library": library, "weights": weights, **settings}
        self._blocks: dict[Pair, npt.NDArray[np.float32]] = {}
        # of each member at the tests, for predictions at any number of conditions
        self._tangents: list[dict[Vector, Tangent]] = [{} for _ in range(network.members)]

    def among(self, vectors: FloatArray) -> FloatArray:
        """Kernel between all of these conditions, shape (n, n_times, n, n_times)."""
        ours = _tuples(vectors)
        pairs = {_pair(one, two) for one in ours for two in ours}
        self._look_up(pairs)
        if missing := sorted(pairs - self._blocks.keys()):
            self._blocks |= self._computed(missing)
            self._keep(ours)
        return self._joined(ours, ours)

    def beside(self, vectors: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Kernel between tests and one condition, shape (n, n_times, n_times), and of the latter alone."""
        ours, (new,) = _tuples(vectors), _tuples(vector[None])
        pairs = {_pair(one, new) for one in (*ours, new)}
        self._look_up(pairs)
        known = self._blocks
        if missing := sorted(pairs - self._blocks.keys()):
            self._blocks = known | self._computed(missing, ours)
        across, own = self._joined(ours, [new])[:, :, 0], self._joined([new], [new])[0, :, 0]
        self._blocks = known
        return across, own

    def _computed(self, pairs: Sequence[Pair], tests: Sequence[Vector] = ()) -> dict[Pair, npt.NDArray[np.float32]]:
        """Blocks of these pairs, one member a thread; of the tangents, 3 MB each, those at the tests are kept."""
        needed = {vector for pair in pairs for vector in pair}

        def of_member(member: int) -> list[npt.NDArray[np.float32]]:
            alone, kept = self._network.alone(member, self._config), self._tangents[member]
            at = kept | {v: Tangent.of(alone, self._inputs(np.array([v]))) for v in needed - kept.keys()}
            kept.update({vector: at[vector] for vector in needed.intersection(tests)})
            return [at[one].kernel_with(at[two]).cpu().numpy() for one, two in pairs]

        with quick_threads(self._network), Crew(self._network.members) as crew:
            by_member = np.array(crew.map(of_member, range(self._network.members)))
        return dict(zip(pairs, by_member.mean(axis=0, dtype=np.float64).astype(np.float32), strict=True))

    def _joined(self, ours: Sequence[Vector], theirs: Sequence[Vector]) -> FloatArray:
        blocks = np.array([[self._block(one, two) for two in theirs] for one in ours], dtype=np.float64)
        return np.ascontiguousarray(blocks.transpose(0, 2, 1, 3))

    def _block(self, one: Vector, two: Vector) -> npt.NDArray[np.float32]:
        return self._blocks[one, two] if one <= two else self._blocks[two, one].T

    def _look_up(self, pairs: Iterable[Pair]) -> None:
        """Read what is kept, unless all of these pairs are at hand."""
        if self._cache and not self._blocks.keys() >= set(pairs):
            self._blocks = (self._cache.find(_KIND, self._key, _unpacked) or {}) | self._blocks

    def _keep(self, latest: Sequence[Vector]) -> None:
        """Keep the blocks at hand, if they are too many those between the latest conditions."""
        if not self._cache:
            return
        conditions = sorted({vector for pair in self._blocks for vector in pair})
        if len(conditions) > _MOST:
            conditions = sorted(set(latest))
        if len(conditions) <= _MOST:
            chosen = set(conditions)
            self._cache.put(_KIND, self._key, _packed({p: b for p, b in self._blocks.items() if chosen >= set(p)}))


def _tuples(vectors: FloatArray) -> list[Vector]:
    return [tuple(vector) for vector in vectors.tolist()]


def _pair(one: Vector, two: Vector) -> Pair:
    return (one, two) if one <= two else (two, one)


def _packed(blocks: dict[Pair, npt.NDArray[np.float32]]) -> Entry:
    return {"pairs": np.array(list(blocks)), "blocks": np.array(list(blocks.values()))}


def _unpacked(entry: Entry) -> dict[Pair, npt.NDArray[np.float32]]:
    pairs = [(tuple(one), tuple(two)) for one, two in entry["pairs"].tolist()]
    return dict(zip(pairs, entry["blocks"], strict=True))
