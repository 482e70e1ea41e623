"""What data show of themselves: the tables, figures and files that rooms above make, imported when first asked for.

Their names and homes stand in ``views.pyi``. Methods such as ``study.plot`` and ``campaign.tests_frame`` go through
here, so that no module of data imports a view.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec

import lazy_loader

P = ParamSpec("P")


def as_plotly(draw: Callable[P, Any]) -> Callable[P, Any]:
    """The method ``plot`` to a method ``draw``: the same drawing as a Plotly figure."""

    @wraps(draw)
    def plot(*args: P.args, **kwargs: P.kwargs) -> object:
        return draw(*args, **kwargs).figure()

    return plot


__getattr__, __dir__, __all__ = lazy_loader.attach_stub("crashfuse", __file__)
