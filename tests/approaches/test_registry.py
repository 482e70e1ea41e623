"""What is not there is named with what there is."""

import pytest

from crashfuse.approaches.base import Settings
from crashfuse.approaches.registry import create
from crashfuse.errors import UsageError


def test_what_is_not_there_is_named_with_what_there_is() -> None:
    with pytest.raises(UsageError, match="no approach 'crystal ball'; choose from cae, lf_tcn, "):
        create("crystal ball", Settings())
    with pytest.raises(UsageError, match="no preset 'slow'; choose from fast, paper"):
        Settings(preset="slow")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="no device 'abacus'; choose from auto, cpu, cuda"):
        Settings(device="abacus")  # type: ignore[arg-type]
