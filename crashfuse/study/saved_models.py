"""Files of fitted approaches: arrays as safetensors, the rest as JSON in the header, no code.

A model belongs to the data that it learned from: it contains their fingerprint, and is loaded together with them. Its
predictions are bit-identical to those when it was saved.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
from safetensors.numpy import save

from crashfuse.approaches.base import Approach, FittedState
from crashfuse.approaches.metric_calibration import metric_errors
from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, Problem, UsageError, require_a
from crashfuse.execution.cache import Cache, Entry
from crashfuse.files.atomic import write_atomically
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.version import versions

_HEADER = "crashfuse"
_MOST_BYTES = 4 << 30
_AGAIN = "train it again with crashfuse train"


def save_model(fit: Fit, campaign: Campaign, path: str | Path) -> None:
    """Save an approach that was fitted to a campaign to a ``.safetensors`` file.

    Raises
    ------
    NotFittedError
        If the approach has not been fitted.
    OSError
        If the file cannot be written.
    UsageError
        If the fit is of another campaign.
    """
    require_a(Fit, fit, "crashfuse.Fit.of(campaign, approach)")
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    if fit.campaign.fingerprint != campaign.fingerprint:
        raise UsageError(f"The fit of {fit.approach.name} learned from other data than {campaign.name} holds.")
    write_atomically(Path(path), model_bytes(fit, campaign))


def model_file(approach: str) -> str:
    """File name of a model, the same in every folder of models."""
    return f"{approach}.safetensors"


def model_bytes(fit: Fit, campaign: Campaign) -> bytes:
    """The file content that :func:`save_model` writes."""
    approach = fit.approach
    learned = approach.learned()
    arrays = {name: np.ascontiguousarray(array) for name, array in learned.arrays.items()}
    record = {
        "approach": approach.name,
        "preset": fit.config.preset,
        "seed": fit.config.seed,
        "settings": _settings(approach),
        "device": approach.device,
        "campaign": campaign.name,
        "fingerprint": campaign.fingerprint,
        "versions": versions(),
        "seconds": round(fit.seconds, 3),
        "learned": learned.values,
    }
    text = json.dumps(record, sort_keys=True)
    return save(arrays, {_HEADER: text, "sha256": _digest(text, arrays)})


def load_model(path: str | Path, campaign: Campaign, *, cache: Cache | None = None) -> Fit:
    """Load a model together with the campaign that it learned from; the cache keeps the emulator of the CAE model.

    Raises
    ------
    DataError
        If the file is not a model, is truncated or altered, has the name of another approach, learned from other data,
        or was made with other versions of crashfuse, Python or the packages that compute.
    """
    path = Path(path)
    record, arrays = _read(path)
    try:
        _check(path, record, campaign)
        config = StudyConfig(preset=record["preset"], seed=int(record["seed"]))
        approach = config.create(record["approach"], cache)
        if json.loads(json.dumps(_settings(approach))) != record["settings"]:
            raise ValueError("settings that are not those of its preset")
        approach.restore(campaign, FittedState(record["learned"], arrays))
        left_out = approach.left_out(campaign)
        errors = metric_errors(left_out, campaign)
        return Fit(approach, config, float(record["seconds"]), left_out, errors, campaign)
    except (LookupError, TypeError, ValueError, RuntimeError, ArithmeticError, AttributeError, UsageError) as error:
        raise _unfit(path, f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}") from error


def _check(path: Path, record: dict[str, Any], campaign: Campaign) -> None:
    approach = record["approach"]
    if approach in CLASSES and path.stem != approach and path.name in map(model_file, CLASSES):
        raise DataError(Problem(str(path), f"a model of {path.stem}", f"one of {approach}", "give it its name back"))
    made, here = record["versions"], versions()
    if differing := [name for name in here if made.get(name) != here[name]]:
        expected, found = (", ".join(f"{name} {there.get(name)}" for name in differing) for there in (here, made))
        raise DataError(Problem(str(path), f"a model made with {expected}", f"one made with {found}", _AGAIN))
    if record["fingerprint"] != campaign.fingerprint:
        expected = f"a model of the data in {campaign.name} (fingerprint {campaign.fingerprint[:12]}…)"
        found = f"one of {record['campaign']} ({record['fingerprint'][:12]}…)"
        raise DataError(Problem(str(path), expected, found, f"{_AGAIN}, or take the campaign it belongs to"))


def _read(path: Path) -> tuple[dict[str, Any], Entry]:
    if not path.is_file():
        raise DataError(Problem(str(path), "a saved model", "no such file", "train it with crashfuse train"))
    if path.stat().st_size > _MOST_BYTES:
        raise _unfit(path, f"{path.stat().st_size / 2**30:.1f} GiB")
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            header = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
        record = json.loads(header[_HEADER])
        digest = header["sha256"]
        altered = digest != _digest(header[_HEADER], arrays)
    except MemoryError:
        raise
    except Exception as error:  # its header is foreign text, and its arrays may be of types that NumPy lacks
        raise _unfit(path, "a file that was cut off, or another kind of file") from error
    if altered:
        raise _unfit(path, "a file that was altered: its checksum is not that of its content")
    return record, arrays


def _unfit(path: Path, found: str) -> DataError:
    return DataError(Problem(str(path), "a model as crashfuse saved it", found, _AGAIN))


def _settings(approach: Approach) -> dict[str, object] | None:
    config = getattr(approach, "config", None)
    return None if config is None else asdict(config)


def _digest(text: str, arrays: Entry) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\n{name} {array.dtype} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
