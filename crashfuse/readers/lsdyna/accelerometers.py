"""Which nodes of a run are its accelerometers.

LS-DYNA does not record it: titles (``*DATABASE_HISTORY_NODE_ID``) tell; without titles, nodes that travel as far as
most others are proposed.
"""

import re
from collections.abc import Sequence

import numpy as np

from crashfuse.readers.lsdyna.histories import History, integral

_ALIKE = 0.1  # of the median travel
_DUMMY = re.compile(r"\b(dummy|head|neck|chest|thorax|pelvis|femur|tibia|foot|spine)\b", re.I)
_PLACES = (
    (
        r"(?=.*\b(rear|rr|hinten)\b)(?=.*(cross|x ?mem|x ?mbr|floor|sill|seat|tunnel))",
        "at the rear, behind the crush",
    ),
    (r"\b(c\.?o?\.?g|cent(er|re) of gravity|schwerpunkt)\b", "at the centre of gravity"),
    (r"tunnel", "on the tunnel"),
    (r"\b(sill|rocker)", "on the sills"),
    (r"\bb ?pillar", "on the B-pillars"),
)


def titled_nodes(nodes: Sequence[History]) -> tuple[list[History], str] | None:
    """The nodes whose titles say that they are where accelerometers are, and the reason; None if no title does."""
    for words, where in _PLACES:
        named = [node for node in nodes if re.search(words, _words(node.title), re.I) and not on_a_dummy(node)]
        if named:
            named = _finest(named)
            return named, f"Nodes {where}: {_listed(named)}; {_average(named)}."
    return None


def on_a_dummy(node: History) -> bool:
    """Whether a node is one of a dummy, by its title."""
    return _DUMMY.search(_words(node.title)) is not None


def proposed_nodes(nodes: Sequence[History]) -> tuple[list[History], str]:
    """The nodes to average, and the reason."""
    if titled := titled_nodes(nodes):
        return titled
    nodes = _finest(nodes)
    travels = np.array([np.abs(integral(node.velocity, node.time)).max() for node in nodes])
    if len(nodes) == 1 or not np.isfinite(travels).any():
        return list(nodes), f"No titles say which nodes are accelerometers; {_listed(nodes)}: {_average(nodes)}."
    middle = np.nanmedian(travels)
    alike = [n for n, travel in zip(nodes, travels, strict=True) if abs(travel - middle) <= _ALIKE * middle]
    chosen = alike or list(nodes)
    why = f"No titles say which nodes are accelerometers; {len(chosen)} of {len(nodes)} travel alike"
    return chosen, f"{why} ({_listed(chosen)}): {_average(chosen)}. Choose others if some lie in the crush."


def _finest(nodes: Sequence[History]) -> list[History]:
    """The nodes that were written most often (``nodouthf``), since only nodes of one clock can be averaged."""
    most = max(node.time.size for node in nodes)
    return [node for node in nodes if node.time.size == most]


def _listed(nodes: Sequence[History]) -> str:
    shown = ", ".join(f"{node.name}{f' ({node.title})' if node.title else ''}" for node in nodes[:6])
    return f"{shown} and {len(nodes) - 6} more" if len(nodes) > 6 else shown


def _average(nodes: Sequence[History]) -> str:
    return "their average is the pulse" if len(nodes) > 1 else "it is the pulse"


def _words(title: str) -> str:
    """A title as words: LEFT_REAR_SEAT_XMBR, rear-floor, RearSeat."""
    return re.sub(r"[_-]+|(?<=[a-z])(?=[A-Z])", " ", title)
