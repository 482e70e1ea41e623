"""What a TCN is fed with and what its output means: conditions and accelerations as numbers near 1."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from crashfuse.approaches.tcn import TcnConfig
from crashfuse.pulse import GRID_S, FloatArray


@dataclass(frozen=True, slots=True)
class Scaling:
    """How conditions and accelerations become numbers near 1; learned from the CAE runs alone.

    Parameters
    ----------
    centre, spread : tuple of float
        Mean and standard deviation of v0 (m/s), front and rear weight (kg).
    lowest, highest : tuple of float
        Ends of the library: beyond them the network gets what it would get there.
    accel_mps2 : float
        Root mean square of the accelerations, each divided by what its speed makes of it.
    """

    centre: tuple[float, ...]
    spread: tuple[float, ...]
    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    accel_mps2: float

    @classmethod
    def of(cls, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> "Scaling":
        """Learn the scaling from conditions, shape (n, 3), and their pulses, shape (n, 1250)."""
        spread = np.maximum(vectors.std(axis=0), 1e-6 * np.abs(vectors).max(axis=0))
        centre, lowest, highest = vectors.mean(axis=0), vectors.min(axis=0), vectors.max(axis=0)
        unit = cls(tuple(centre.tolist()), tuple(spread.tolist()), tuple(lowest.tolist()), tuple(highest.tolist()), 1.0)
        sequences = accel_mps2[:, :: config.stride] / unit.outputs(vectors, config)[:, None]
        return replace(unit, accel_mps2=float(np.sqrt(np.mean(sequences**2))))

    def outputs(self, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Acceleration that an output of 1 means for each condition, m/s², shape (n,)."""
        floor = config.scale_floor
        scale: FloatArray = self.accel_mps2 * (floor + (1 - floor) * vectors[:, 0] / self.highest[0])
        return scale

    def inputs(self, vectors: FloatArray, config: TcnConfig) -> Tensor:
        """Input sequences for conditions of shape (n, 3): shape (n_times, n, n_inputs), float32."""
        vectors = np.clip(vectors, self.lowest, self.highest)
        time = GRID_S[:: config.stride, None] / GRID_S[-1]
        travel = time * vectors[None, :, 0] / self.highest[0]
        columns = [2 * time - 1, *((vectors - self.centre) / self.spread).T[:, None]]
        columns += [wave(np.pi * k * time) for k in range(1, config.time_waves + 1) for wave in (np.sin, np.cos)]
        if config.travel_waves:
            columns.append(2 * travel - 1)
        columns += [wave(np.pi * k * travel) for k in range(1, config.travel_waves + 1) for wave in (np.sin, np.cos)]
        shape = (len(time), len(vectors))
        return torch.from_numpy(np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1).astype(np.float32))

    def pulses(self, outputs: FloatArray, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Pulses on the study grid, shape (n, 1250), that outputs of shape (n, n_times) at these conditions mean."""
        sequences: FloatArray = outputs * self.outputs(vectors, config)[:, None]
        if config.stride == 1:
            return sequences
        spline: FloatArray = CubicSpline(GRID_S[:: config.stride], sequences, axis=1)(GRID_S)
        return spline

    def targets(self, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> Tensor:
        """What the network should put out for pulses of shape (n, 1250): shape (n_times, n), float32."""
        scaled = accel_mps2[:, :: config.stride] / self.outputs(vectors, config)[:, None]
        return torch.from_numpy(np.ascontiguousarray(scaled.T, dtype=np.float32))
