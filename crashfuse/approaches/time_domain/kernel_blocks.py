"""The tangent kernel between conditions, in blocks of one pair each: no pair is computed twice.

A block depends on the LF networks and its two conditions alone, and not on what was measured there, so all folds of a
study, all subsets of a learning curve and all predictions share it.
"""

import hashlib
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.approaches.time_domain.network import Tcn
from crashfuse.approaches.time_domain.tangent_kernel import Tangent
from crashfuse.approaches.time_domain.threads import quick_threads, side_by_side
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
        self._network, self._inputs, self._cache = network, inputs, cache
        weights = hashlib.sha256(b"".join(weight.tobytes() for weight in weights_of(network).values())).hexdigest()
        settings = {"config": config.lf_settings, "code": code_digest(__name__)}
        self._key = {"library": library, "weights": weights, **settings}
        self._blocks: dict[Pair, npt.NDArray[np.float32]] = {}
        # at the tests, 3 MB a test and member, for predictions at any number of conditions
        self._at_tests: tuple[list[Vector], Tangent] | None = None

    def among(self, vectors: FloatArray) -> FloatArray:
        """Kernel between all of these conditions, shape (n, n_times, n, n_times)."""
        ours = _tuples(vectors)
        pairs = {_pair(one, two) for one in ours for two in ours}
        if missing := self._missing(pairs):
            self._blocks |= self._computed(missing)
            self._keep(ours)
        return self._joined(ours, ours)

    def beside(self, vectors: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Kernel between tests and one condition, shape (n, n_times, n_times), and of the latter alone."""
        ours, (new,) = _tuples(vectors), _tuples(vector[None])
        pairs = {_pair(one, new) for one in (*ours, new)}
        if not self._missing(pairs):
            return self._joined(ours, [new])[:, :, 0], self._joined([new], [new])[0, :, 0]
        conditions = sorted(set(ours))
        if self._at_tests is None or self._at_tests[0] != conditions:
            self._at_tests = conditions, self._tangent(conditions)
        tests, here = self._at_tests[1], self._tangent([new])

        def of_member(own: slice) -> npt.NDArray[np.float32]:
            few, many = here.part(members=own), tests.part(members=own)  # that order of a product is the quicker one
            return torch.cat([few.kernel_with(many), few.kernel_with(few)], dim=2)[0].T.cpu().numpy()

        n_times = here.first.shape[1]
        kernel = self._mean(of_member).astype(np.float64).reshape(-1, n_times, n_times)
        return kernel[[conditions.index(vector) for vector in ours]], kernel[-1]

    def _computed(self, pairs: set[Pair]) -> dict[Pair, npt.NDArray[np.float32]]:
        """Blocks of these pairs."""
        conditions = sorted({vector for pair in pairs for vector in pair})
        partners = [[n for n, two in enumerate(conditions) if (one, two) in pairs] for one in conditions]
        tangent = self._tangent(conditions)
        n_times = tangent.first.shape[1] // len(conditions)

        def of_member(own: slice) -> list[npt.NDArray[np.float32]]:
            at, found = tangent.part(members=own), []
            for number, others in enumerate(partners):
                if others:
                    first, last = others[0], others[-1] + 1
                    here, beyond = (
                        at.part(slice(a * n_times, b * n_times)) for a, b in ((number, number + 1), (first, last))
                    )
                    blocks = here.kernel_with(beyond)[0].cpu().numpy().reshape(n_times, -1, n_times)
                    found += [blocks[:, other - first] for other in others]
            return found

        order = [(conditions[one], conditions[two]) for one, own in enumerate(partners) for two in own]
        return dict(zip(order, self._mean(of_member), strict=True))

    def _tangent(self, conditions: Sequence[Vector]) -> Tangent:
        with quick_threads(self._network):
            return Tangent.of(self._network, self._inputs(np.array(conditions)))

    def _mean(self, work: Callable[[slice], npt.ArrayLike]) -> npt.NDArray[np.float32]:
        """Mean of what is computed of each member, one a thread."""
        members = [slice(number, number + 1) for number in range(self._network.members)]
        with quick_threads(self._network):
            by_member = side_by_side(work, members)
        return np.asarray(np.array(by_member).mean(axis=0, dtype=np.float64), dtype=np.float32)

    def _joined(self, ours: Sequence[Vector], theirs: Sequence[Vector]) -> FloatArray:
        blocks = np.array([[self._block(one, two) for two in theirs] for one in ours], dtype=np.float64)
        return np.ascontiguousarray(blocks.transpose(0, 2, 1, 3))

    def _block(self, one: Vector, two: Vector) -> npt.NDArray[np.float32]:
        return self._blocks[one, two] if one <= two else self._blocks[two, one].T

    def _missing(self, pairs: set[Pair]) -> set[Pair]:
        """Those of these pairs that are neither at hand nor kept; what is kept is read once."""
        if self._cache and not self._blocks:
            self._blocks = self._cache.find(_KIND, self._key, _unpacked) or {}
        return pairs - self._blocks.keys()

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
