"""An archive of past vehicles that nobody had to learn."""

import numpy as np
import pandas as pd

from crashfuse.approaches.displacement_domain.hierarchical_bias import SCATTER
from crashfuse.approaches.mixture import PRIOR
from crashfuse.campaign import Campaign
from crashfuse.vehicle_archive import PastVehicle, Prior, VehicleArchive


def made_archive(*campaigns: Campaign) -> VehicleArchive:
    """An archive of three vehicles, the last ones these; what they teach leaves the network as it is."""
    others = [PastVehicle(name, f"runs of {name}", (f"test of {name}",)) for name in ("Sedan", "Van", "Coupe")]
    vehicles = [PastVehicle(own.name, own.cae.fingerprint, tuple(t.digest for t in own.tests)) for own in campaigns]
    vehicles = [*others[: 3 - len(vehicles)], *vehicles]
    names = [vehicle.name for vehicle in vehicles]
    rows = [
        {"vehicle": name, "n_tests": n, "predicted": 9, "rating": 0.85, "rating_without": 0.8, "inside": 0.95}
        | {"inside_without": 0.94, "width": 0.9}
        for name in names
        for n in (1, 2)
    ]
    without = [_prior(names[:place] + names[place + 1 :]) for place in range(len(names))]
    return VehicleArchive(tuple(vehicles), _prior(names), tuple(without), pd.DataFrame(rows))


def _prior(names: list[str]) -> Prior:
    errors = {"peak": np.array([-1.0, 1.0] * len(names))}
    return Prior(tuple(names), {}, PRIOR, errors, np.full((6, 60), -1.0), SCATTER)
