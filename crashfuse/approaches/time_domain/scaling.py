"""Scaling of the inputs and outputs of a TCN: conditions and accelerations as numbers near 1."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from crashfuse.approaches.time_domain.config import TcnConfig
from crashfuse.signals.pulse import DT_S, GRID_S, FloatArray, kinematics
from crashfuse.signals.thinning import in_full

_POWERS = np.arange(1, 5)[:, None]  # of the speed in the expansion of the typical motion, which vanishes at speed 0
_CHUNK = 100  # runs integrated at once
_MOST_RUNS = 2000  # more would not change the typical motion


@dataclass(frozen=True, eq=False, slots=True)
class TypicalMotion:
    """Typical motion of the vehicles of CAE runs, by impact speed.

    Parameters
    ----------
    top_mps : float
        The library's highest speed.
    displacement_m, velocity_mps : ndarray, shape (4, n_times)
        Coefficients of the powers 1 to 4 of v0 / ``top_mps``, by least squares over the library.
    crush_m : float
        The library's highest maximum crush.
    """

    top_mps: float
    displacement_m: FloatArray
    velocity_mps: FloatArray
    crush_m: float

    @classmethod
    def of(cls, speed_mps: FloatArray, accel_mps2: FloatArray, stride: int) -> "TypicalMotion":
        """Fit to runs: speeds of shape (n,), pulses of shape (n, 1250)."""
        top = float(speed_mps.max())
        some = np.linspace(0, len(speed_mps) - 1, min(len(speed_mps), _MOST_RUNS)).astype(int)
        powers = (speed_mps[some] / top) ** _POWERS
        displacements, velocities, crush = [], [], 0.0
        for chunk in np.array_split(some, -(-some.size // _CHUNK)):
            motion = kinematics(accel_mps2[chunk].astype(np.float64), speed_mps[chunk], DT_S)
            displacements.append(motion.displacement_m[:, ::stride])
            velocities.append(motion.velocity_mps[:, ::stride])
            crush = max(crush, float(motion.displacement_m.max()))
        displacement, velocity = (
            np.linalg.lstsq(powers.T, np.concatenate(curves), rcond=None)[0] for curves in (displacements, velocities)
        )
        return cls(top, displacement, velocity, crush)

    def at(self, speed_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Share of the highest crush, and of the impact speed, over time: shape (n_times, n) each."""
        powers = (speed_mps / self.top_mps) ** _POWERS
        velocity_share = self.velocity_mps.T @ powers / np.maximum(speed_mps, 1e-2 * self.top_mps)
        return self.displacement_m.T @ powers / self.crush_m, velocity_share


@dataclass(frozen=True, eq=False, slots=True)
class Scaling:
    """Scaling of conditions and accelerations to numbers near 1, learned from the CAE runs alone.

    Parameters
    ----------
    centre, spread : tuple of float
        Mean and standard deviation of v0 (m/s), front and rear weight (kg).
    lowest, highest : tuple of float
        Limits of the library; conditions beyond them are clipped to them.
    accel_mps2 : float
        Root mean square of the accelerations, each divided by the factor for its speed.
    """

    centre: tuple[float, ...]
    spread: tuple[float, ...]
    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    accel_mps2: float
    motion: TypicalMotion

    @classmethod
    def of(cls, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> "Scaling":
        """Learn the scaling from conditions, shape (n, 3), and their pulses, shape (n, 1250)."""
        spread = np.maximum(vectors.std(axis=0), 1e-6 * np.abs(vectors).max(axis=0))
        centre, lowest, highest = vectors.mean(axis=0), vectors.min(axis=0), vectors.max(axis=0)
        motion = TypicalMotion.of(vectors[:, 0], accel_mps2, config.stride)
        ends = tuple(lowest.tolist()), tuple(highest.tolist())
        unit = cls(tuple(centre.tolist()), tuple(spread.tolist()), *ends, accel_mps2=1.0, motion=motion)
        sequences = accel_mps2[:, :: config.stride] / unit.outputs(vectors, config)[:, None]
        return replace(unit, accel_mps2=float(np.sqrt(np.mean(sequences**2))))

    def outputs(self, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Acceleration in m/s² that an output of 1 represents at each condition, shape (n,)."""
        floor = config.scale_floor
        scale: FloatArray = self.accel_mps2 * (floor + (1 - floor) * vectors[:, 0] / self.highest[0])
        return scale

    def inputs(self, vectors: FloatArray, config: TcnConfig) -> Tensor:
        """Input sequences for conditions of shape (n, 3): shape (n_times, n, n_inputs), float32."""
        vectors = np.clip(vectors, self.lowest, self.highest)
        time = GRID_S[:: config.stride, None] / GRID_S[-1]
        columns = [2 * time - 1, *((vectors - self.centre) / self.spread).T[:, None], *_waves(time, config.time_waves)]
        if config.travel_waves:
            travel, velocity = self.motion.at(vectors[:, 0])
            columns += [2 * travel - 1, *_waves(travel, config.travel_waves)]
            columns += [velocity, *_waves(velocity, config.velocity_waves)]
        shape = (len(time), len(vectors))
        return torch.from_numpy(np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1).astype(np.float32))

    def pulses(self, outputs: FloatArray, vectors: FloatArray, config: TcnConfig) -> FloatArray:
        """Pulses on the study grid, shape (n, 1250), from outputs of shape (n, n_times) at these conditions."""
        sequences: FloatArray = outputs * self.outputs(vectors, config)[:, None]
        return in_full(sequences, config.stride)

    def targets(self, vectors: FloatArray, accel_mps2: FloatArray, config: TcnConfig) -> Tensor:
        """Target outputs of the network for pulses of shape (n, 1250): shape (n_times, n), float32."""
        scaled = accel_mps2[:, :: config.stride] / self.outputs(vectors, config)[:, None]
        return torch.from_numpy(np.ascontiguousarray(scaled.T, dtype=np.float32))


def _waves(x: FloatArray, n: int) -> list[FloatArray]:
    """Sines and cosines of 1 to n half waves over 0 to 1."""
    return [wave(np.pi * k * x) for k in range(1, n + 1) for wave in (np.sin, np.cos)]
