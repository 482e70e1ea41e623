"""What past vehicles teach the next one before its tests do, and the file that holds it: an archive of vehicles.

It holds no pulse. For each of its vehicles it also knows what all others teach, by which that one is judged.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from crashfuse.crash_test import CrashTest
from crashfuse.errors import NO_FILE, UsageError, as_path, refusal, refuse_if
from crashfuse.files.atomic import write_atomically
from crashfuse.files.tensors import Arrays, read_tensors, tensor_bytes
from crashfuse.signals.pulse import FloatArray
from crashfuse.units import read_out, signed

LEAST_VEHICLES = 3
_FEW = 4  # tests: with more, archives change little
_AGAIN = "learn it again with crashfuse learn-archive"


@dataclass(frozen=True, eq=False)
class Prior:
    """What some vehicles teach the next one."""

    vehicles: tuple[str, ...]  # their names
    network: Arrays  # weights of the pre-trained network that were tuned to them, by name
    logits: FloatArray  # prior mean of the fused weights, as :data:`crashfuse.approaches.mixture.PRIOR`
    errors: Mapping[str, FloatArray]  # standardised, by metric: mean minus and plus deviation, for each vehicle
    bias: FloatArray  # mean of their CAE models' errors over crush, as much of it as carries over, shape (6, 60)
    cae: FloatArray  # mean of their CAE models' accelerations over crush, and the deviation from it, shape (2, 5, 60)
    helps: bool = True  # whether these, each left out, were predicted better with the others, on average
    share: float = 1.0  # how far they count: the probability that the next one is like them
    taken_out: str = ""  # the vehicle that is to be judged, if it was in the archive
    record: pd.DataFrame = field(default_factory=pd.DataFrame)  # of the whole archive, to be shown

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all that predictions depend on."""
        digest = hashlib.sha256(repr((self.vehicles, self.helps, self.share)).encode())
        for name, array in self.arrays.items():
            digest.update(f"{name} {array.shape}".encode() + array.tobytes())
        return digest.hexdigest()

    @property
    def arrays(self) -> dict[str, Any]:
        """All arrays by name."""
        weights = {f"network {name}": weight for name, weight in sorted(self.network.items())}
        errors = {f"error {name}": errors for name, errors in self.errors.items()}
        return {**weights, **errors, "logits": self.logits, "bias": self.bias, "cae": self.cae}

    @property
    def sentence(self) -> str:
        """Who teaches, in words."""
        names = read_out(self.vehicles)
        sentence = f"An archive of past vehicles teaches this one as far as it is like them: {names}."
        if not self.helps:
            sentence = f"The archive of {names} is not used: left out, they were not predicted better with it."
        return sentence + (f" {self.taken_out}, which this is, was taken out of it." if self.taken_out else "")

    @property
    def of_bias(self) -> "Prior":
        """What they teach of the bias alone."""
        return replace(self, network={}, logits=np.zeros((4, 5)), errors={}, taken_out="", share=1.0)


@dataclass(frozen=True, slots=True)
class PastVehicle:
    """A vehicle of an archive: its name, fingerprints of its CAE runs and tests, and the number of the tests."""

    name: str
    cae: str
    tests: tuple[str, ...]

    def is_of(self, cae: str, tests: Sequence[CrashTest]) -> bool:
        """Whether any of these tests, or these CAE runs, were learned from."""
        return self.cae == cae or not {test.digest for test in tests}.isdisjoint(self.tests)


@dataclass(frozen=True, eq=False)
class VehicleArchive:
    """An archive: what its vehicles teach, all of them and all but each, and how that came out on the one left out."""

    vehicles: tuple[PastVehicle, ...]
    whole: Prior
    without: tuple[Prior, ...]
    record: pd.DataFrame
    seed: int = 0

    @property
    def sentence(self) -> str:
        """How its vehicles, each left out, were predicted with the others and without, in words."""
        return record_sentence(self.record)

    def prior_for(self, name: str, cae: str, tests: Sequence[CrashTest]) -> Prior:
        """What the archive teaches a vehicle with these CAE runs and tests: that vehicle is taken out of it."""
        same = [number for number, vehicle in enumerate(self.vehicles) if vehicle.is_of(cae, tests)]
        if len(same) > 1:
            names = read_out([self.vehicles[number].name for number in same])
            raise UsageError(f"{name} shares tests or CAE runs with {names} of the archive: take one archive without.")
        taken_out, prior = (self.vehicles[same[0]].name, self.without[same[0]]) if same else ("", self.whole)
        return replace(prior, taken_out=taken_out, record=self.record)

    def save(self, path: str | Path) -> None:
        """Write it to a ``.cfa`` file."""
        write_atomically(as_path(path, "an archive"), self.content)

    @property
    def content(self) -> bytes:
        """The content of its file."""
        priors = [self.whole, *self.without]
        arrays = {f"{n} {name}": array for n, prior in enumerate(priors) for name, array in prior.arrays.items()}
        vehicles, helps = [astuple(vehicle) for vehicle in self.vehicles], [prior.helps for prior in priors]
        record = self.record.to_dict("split", index=False)
        return tensor_bytes({"vehicles": vehicles, "helps": helps, "record": record, "seed": self.seed}, arrays)


def record_sentence(record: pd.DataFrame) -> str:
    """How the vehicles of an archive, each left out, were predicted with the others and without, in words."""
    few = record[record["n_tests"] <= _FEW]
    by_vehicle = (few["rating"] - few["rating_without"]).groupby(few["vehicle"]).mean()
    return (
        f"Each of its {len(by_vehicle)} vehicles left out and predicted from 1 to {few['n_tests'].max()} tests, the "
        f"others changed the mean rating by {signed(by_vehicle.mean(), 3)} ({signed(by_vehicle.min(), 3)} to "
        f"{signed(by_vehicle.max(), 3)}): so few vehicles say little of the next."
    )


def load_archive(path: str | Path) -> VehicleArchive:
    """Read an archive; a DataError if the file is none."""
    path = as_path(path, "an archive")
    refuse_if(not path.is_file(), str(path), "an archive of vehicles", NO_FILE, "make it with crashfuse learn-archive")
    try:
        record, arrays = read_tensors(path)
        vehicles = tuple(PastVehicle(str(name), str(cae), tuple(tests)) for name, cae, tests in record["vehicles"])
        names = [vehicle.name for vehicle in vehicles]
        priors = [
            _prior(number, tuple(names[: number - 1] + names[number:] if number else names), arrays, helps)
            for number, helps in enumerate(record["helps"])
        ]
        if len(vehicles) < LEAST_VEHICLES or len(priors) != len(vehicles) + 1:
            raise ValueError(f"{len(vehicles)} vehicles and {len(priors)} times what they teach")
        whole, *without = priors
        return VehicleArchive(vehicles, whole, tuple(without), pd.DataFrame(**record["record"]), int(record["seed"]))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        found = str(error) if isinstance(error, ValueError) else "one of another version, or another kind of file"
        raise refusal(str(path), "an archive as crashfuse saved it", found, _AGAIN) from error


def _prior(number: int, vehicles: tuple[str, ...], arrays: Arrays, helps: object) -> Prior:
    mine = {name.partition(" ")[2]: array for name, array in arrays.items() if name.partition(" ")[0] == str(number)}
    if not all(np.isfinite(array).all() for array in mine.values()):
        raise ValueError("numbers that are not finite")
    parts = {
        kind: {name.removeprefix(kind): array for name, array in mine.items() if name.startswith(kind)}
        for kind in ("network ", "error ")
    }
    if [mine[name].shape for name in ("logits", "bias", "cae")] != [(4, 5), (6, 60), (2, 5, 60)]:
        raise ValueError("weights of other approaches")
    return Prior(vehicles, parts["network "], mine["logits"], parts["error "], mine["bias"], mine["cae"], bool(helps))
