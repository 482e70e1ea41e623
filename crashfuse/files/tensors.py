"""Files of arrays with a record: safetensors with JSON in the header, and a checksum over both; no code."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import safetensors
from safetensors.numpy import save

Arrays = Mapping[str, npt.NDArray[Any]]

_HEADER = "crashfuse"
_MOST_BYTES = 4 << 30


def tensor_bytes(record: Mapping[str, object], arrays: Arrays) -> bytes:
    """The content of a file."""
    text = json.dumps(record, sort_keys=True)
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(dict(arrays), {_HEADER: text, "sha256": checksum(text, arrays)})


def read_tensors(path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """The record and the arrays of a file; a ValueError says what is wrong with it."""
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{path.stat().st_size / 2**30:.1f} GiB")
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            header = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
        record = json.loads(header[_HEADER])
        altered = header["sha256"] != checksum(header[_HEADER], arrays)
    except MemoryError:
        raise
    except Exception as error:  # its header is foreign text, and its arrays may be of types that NumPy lacks
        raise ValueError("a file that was cut off, or another kind of file") from error
    if altered or not isinstance(record, dict):
        raise ValueError("a file that was altered: its checksum is not that of its content")
    return record, arrays


def checksum(text: str, arrays: Arrays) -> str:
    """SHA-256 of a header and arrays."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\n{name} {array.dtype} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
