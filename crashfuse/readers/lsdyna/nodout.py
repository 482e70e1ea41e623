"""Histories of nodes in LS-DYNA's ASCII ``nodout``."""

import re
from array import array
from collections.abc import Iterable, Mapping

import numpy as np

from crashfuse.errors import DataError, Problem, printable
from crashfuse.readers.lsdyna.histories import MOST_NODES, MOST_VALUES, Histories, History, kept_of, too_much
from crashfuse.readers.lsdyna.text import lines_of, number

_TIME = re.compile(rb"at time\s*([-+.\dEeDd]+)")
_ROW = re.compile(rb"\s*(\d+)(?=[\s+-]|$)(.*)", re.DOTALL)  # a negative number may directly follow the node number
_NUMBER = re.compile(rb"[-+]?\d+\.\d*(?:[EeDd][-+]?\d+|[-+]\d+)?")


def read_nodout(chunks: Iterable[bytes], where: str, most: int) -> Histories:
    """Read an ASCII ``nodout`` as a stream; everything but the nodes' translation is skipped.

    If there are more than ``most`` nodes, those with a title are kept first. An unreadable row raises a DataError.
    """
    times: list[float] = []
    titles: dict[str, str] = {}
    series: dict[str, tuple[array[float], array[float]]] = {}
    lines = lines_of(chunks, where)
    title = printable(next(lines, b"").decode("latin-1").strip())
    columns: list[bytes] = []
    now, total, in_legend = np.nan, 0, False
    for line in lines:
        if line.startswith(b"{"):
            in_legend = b"BEGIN" in line
        elif in_legend:
            node, _, text = line.decode("latin-1").strip().partition(" ")
            if node.isdecimal() and len(titles) < MOST_NODES:
                titles[str(int(node))] = printable(text.strip())
        elif b"at time" in line and (header := _TIME.search(line)) is not None:
            columns, now = [], number(header.group(1).decode(), where)
        elif b"nodal point" in line:
            columns = line.split()[2:]
            if not {b"x-accl", b"x-vel"} <= set(columns):
                columns = []  # table of nodal rotations
                continue
            if len(times) == 1:
                kept, total = kept_of(list(series), titles, most), len(series)
                series = {name: values for name, values in series.items() if name in kept}
            times.append(now)
            if len(times) * max(len(series), 1) > MOST_VALUES:
                raise too_much(where)
        elif columns and (row := _ROW.match(line)) is not None:
            name = row.group(1).decode("latin-1")
            if len(times) == 1 and name.isdecimal() and len(series) < MOST_NODES:
                series.setdefault(name, (array("d"), array("d")))
            if name in series:
                values = _NUMBER.findall(row.group(2))
                if len(values) != len(columns):
                    break  # truncated, or cannot be parsed
                for into, column in zip(series[name], (b"x-accl", b"x-vel"), strict=True):
                    into.append(number(values[columns.index(column)].decode(), where))
    return _assembled(title, times, titles, series, max(total, len(series)), next(lines, None) is None, where)


def _assembled(
    title: str,
    times: list[float],
    titles: Mapping[str, str],
    series: "Mapping[str, tuple[array[float], array[float]]]",
    total: int,
    to_the_end: bool,
    where: str,
) -> Histories:
    counts = {len(values) for pair in series.values() for values in pair}
    whole = min(counts, default=0)
    if not to_the_end or whole < len(times) - 1 or max(counts, default=0) > len(times):
        found = f"one that cannot be read after state {whole}"
        raise DataError(Problem(where, "rows with all values of each node", found, "copy it again from the run"))
    if not whole:
        raise DataError(Problem(where, "the accelerations of nodes (x-accl)", "none", "choose the nodout of a run"))
    notes = ("Its last state is incomplete and left out.",) if whole < len(times) else ()
    time = np.array(times[:whole])
    nodes = tuple(
        History(name, titles.get(name, ""), time, np.array(accel[:whole]), np.array(velocity[:whole]))
        for name, (accel, velocity) in series.items()
    )
    return Histories(title, nodes, total, None, notes)
