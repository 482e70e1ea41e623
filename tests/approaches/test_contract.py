"""What every approach promises; each that is registered has to keep it."""

import pytest

from crashfuse.approaches.base import Settings
from crashfuse.approaches.registry import CLASSES, create
from crashfuse.testing import ApproachContract

pytestmark = pytest.mark.usefixtures("quick_networks")

for _name, _approach in CLASSES.items():
    _marks = [pytest.mark.slow] if _approach.trains_networks or _approach.made_of else []
    globals()[f"Test_{_name}"] = type(
        f"Test_{_name}", (ApproachContract,), {"approach": type(create(_name, Settings())), "pytestmark": _marks}
    )
