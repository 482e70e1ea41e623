"""Files of fitted approaches: arrays as safetensors, the rest as JSON in the header, no code.

A model is loaded together with the data that it learned from, whose fingerprint it has, and predicts the same bits.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crashfuse.approaches.base import Approach, FittedState
from crashfuse.approaches.metric_calibration import metric_errors
from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign import Campaign
from crashfuse.errors import DataError, UsageError, as_path, refusal, refuse_if, require_a
from crashfuse.execution.cache import Cache, Entry
from crashfuse.execution.run import Run
from crashfuse.files.atomic import write_atomically
from crashfuse.files.tensors import read_tensors, tensor_bytes
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.version import versions

_AGAIN = "train it again with crashfuse train"


def save_model(fit: Fit, campaign: Campaign, path: str | Path) -> None:
    """Save an approach that was fitted to this campaign to a ``.safetensors`` file."""
    require_a(Fit, fit, "crashfuse.Fit.of(campaign, approach)")
    require_a(Campaign, campaign, "crashfuse.load_campaign(folder)")
    if fit.campaign.fingerprint != campaign.fingerprint:
        raise UsageError(f"The fit of {fit.approach.name} learned from other data than {campaign.name} holds.")
    write_atomically(as_path(path, "a saved model"), model_bytes(fit, campaign))


def model_file(approach: str) -> str:
    """File name of a model, the same in every folder of models."""
    return f"{approach}.safetensors"


def model_bytes(fit: Fit, campaign: Campaign) -> bytes:
    """The file content that :func:`save_model` writes."""
    approach = fit.approach
    learned = approach.learned()
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
    return tensor_bytes(record, learned.arrays)


def load_model(path: str | Path, campaign: Campaign, *, cache: Cache | None = None) -> Fit:
    """Load a model together with the campaign that it learned from; the cache keeps the emulator of the CAE model.

    A DataError if the file is no model, is altered, has the name of another approach, learned from other data, or was
    made with other versions of crashfuse, Python or the packages that compute.
    """
    path = as_path(path, "a saved model")
    record, arrays = _read(path)
    try:
        _check(path, record, campaign)
        config = StudyConfig(preset=record["preset"], seed=int(record["seed"]))
        approach = config.create(record["approach"])
        if json.loads(json.dumps(_settings(approach))) != record["settings"]:
            raise ValueError("settings that are not those of its preset")
        approach.restore(campaign, FittedState(record["learned"], arrays), Run.of(campaign, cache))
        left_out = approach.left_out(campaign)
        errors = metric_errors(left_out, campaign, approach.usual_errors)
        return Fit(approach, config, float(record["seconds"]), left_out, errors, campaign)
    except (LookupError, TypeError, ValueError, RuntimeError, ArithmeticError, AttributeError, UsageError) as error:
        raise _unfit(path, f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}") from error


def _check(path: Path, record: dict[str, Any], campaign: Campaign) -> None:
    approach = record["approach"]
    if approach in CLASSES and path.stem != approach and path.name in map(model_file, CLASSES.declared):
        raise refusal(str(path), f"a model of {path.stem}", f"one of {approach}", "give it its name back")
    made, here = record["versions"], versions()
    if differing := [name for name in here if made.get(name) != here[name]]:
        expected, found = (", ".join(f"{name} {there.get(name)}" for name in differing) for there in (here, made))
        raise refusal(str(path), f"a model made with {expected}", f"one made with {found}", _AGAIN)
    if record["fingerprint"] != campaign.fingerprint:
        expected = f"a model of the data in {campaign.name} (fingerprint {campaign.fingerprint[:12]}…)"
        found = f"one of {record['campaign']} ({record['fingerprint'][:12]}…)"
        raise refusal(str(path), expected, found, f"{_AGAIN}, or take the campaign it belongs to")


def _read(path: Path) -> tuple[dict[str, Any], Entry]:
    refuse_if(not path.is_file(), str(path), "a saved model", "no such file", "train it with crashfuse train")
    try:
        return read_tensors(path)
    except ValueError as error:
        raise _unfit(path, str(error)) from error


def _unfit(path: Path, found: str) -> DataError:
    return refusal(str(path), "a model as crashfuse saved it", found, _AGAIN)


def _settings(approach: Approach) -> dict[str, object] | None:
    config = getattr(approach, "config", None)
    return None if config is None else asdict(config)
