"""Time histories of Radioss in memory, as the solver writes them, and the CSV that its converter makes of them."""

import struct
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G
from tests.importing.crashes import SPEED_MPS, half_sine_g

MASS_KG = 1700.0
NODES, WALLS, ACCELEROMETERS = 0, 102, 108
CODES = {name: code for code, name in enumerate(["DX", "DY", "DZ", "VX", "VY", "VZ", "AX", "AY", "AZ"], start=1)}
ACCELEROMETER_CODES = {name: code for code, name in enumerate(["AX", "AY", "AZ", "WX", "WY", "WZ"], start=1)}
GLOBAL_LABELS = [
    *("INTERNAL ENERGY", "KINETIC ENERGY", "X-MOMENTUM", "Y-MOMENTUM", "Z-MOMENTUM", "MASS", "TIME STEP"),
    *("ROTATION ENERGY", "EXTERNAL WORK", "SPRING ENERGY", "CONTACT ENERGY", "HOURGLASS ENERGY"),
    *("ELASTIC CONTACT ENERGY", "FRICTIONAL CONTACT ENERGY", "DAMPING CONTACT ENERGY ", "PLASTIC WORK", "ADDED MASS"),
    *("PERCENTAGE ADDED MASS", "INLET MASS", "OUTLET MASS", "INLET ENERGY", "OUTLET ENERGY"),
]

Converter = Literal["2022", "doubled", "today"]
"""Versions of the converter: the first knows 12 or 15 global histories, the second wrote one label twice."""


@dataclass(frozen=True)
class RadiossRun:
    """A car in mm, ms and kg, whose cell has the half sine of the other tests; its engine rebounds more.

    Parameters
    ----------
    curves : tuple of str
        Variables of the two nodes.
    gauge : tuple of str
        Variables of an accelerometer beside the cell, in a skew of its own that looks backwards.
    layout : int
        Code of the form: 3040 (titles of 40 characters), 3050 or 4021 (of 100, and factors of the units).
    pushed : bool
        Seen from a frame that travels with it: at rest when it is struck.
    more_nodes : int
        Beside the two, without titles, and with the motion of the engine.
    """

    curves: tuple[str, ...] = ("DX", "VX", "AX")
    gauge: tuple[str, ...] = ()
    layout: int = 3040
    step_ms: float = 0.1
    begin_ms: float = 0.0
    end_ms: float = 120.0
    axis: str = "X"
    globals_: int = 22
    factors: tuple[float, float, float] = (1.0, 1e-3, 1e-3)
    titles: tuple[str, str] = ("engine", "cell")
    pushed: bool = False
    more_nodes: int = 0

    @property
    def time_ms(self) -> FloatArray:
        """States since the start of the crash."""
        first, last = round(self.begin_ms / self.step_ms), round(self.end_ms / self.step_ms)
        return self.step_ms * np.arange(first, last, dtype=np.float64)

    def motion(self) -> dict[str, FloatArray]:
        """Displacement, velocity and acceleration of the cell against its direction of travel."""
        whole = replace(self, begin_ms=0.0).time_ms
        accel = half_sine_g(whole * 1e-3) * G * 1e-3  # mm/ms²
        velocity = SPEED_MPS + _integral(accel, self.step_ms)
        velocity = velocity - (SPEED_MPS if self.pushed else 0.0)
        found = {"A": -accel, "V": -velocity, "D": -_integral(velocity, self.step_ms)}
        return {kind: values[-self.time_ms.size :] for kind, values in found.items()}

    def groups(self) -> list[tuple[int, str, list[tuple[int, str]], tuple[str, ...]]]:
        """Kind, title, elements and variables of each group."""
        found: list[tuple[int, str, list[tuple[int, str]], tuple[str, ...]]] = []
        if self.gauge:
            found.append((ACCELEROMETERS, "gauges", [(9, "rear seat")], self.gauge))
        if self.curves:
            others = [(1000 + i, "") for i in range(self.more_nodes)]
            found.append((NODES, "mains", [(690, self.titles[0]), (758, self.titles[1]), *others], self.curves))
        found.append((WALLS, "wall", [(1, "w")], ("FNX", "FNY")))
        return found

    def states(self) -> FloatArray:
        """All numbers: time, global histories, energy of a part, groups."""
        motion, zero = self.motion(), np.zeros(self.time_ms.size)
        share = np.arange(self.time_ms.size) / self.time_ms.size
        energy = MASS_KG * SPEED_MPS**2 / 2
        told = np.zeros((len(GLOBAL_LABELS), zero.size))
        told[1] = MASS_KG * motion["V"] ** 2 / 2
        told[2 + "XYZ".index(self.axis)] = MASS_KG * motion["V"]
        for place, part in ((0, 0.8), (7, 0.01), (10, 0.02), (11, 0.04)):
            told[place] = part * share * energy
        told[8] = told[[0, 1, 7, 10, 11]].sum(axis=0) - energy + 0.03 * share * energy  # 3 % are lost
        told[5], told[17] = MASS_KG, 1.25
        columns = [self.time_ms, *told[: self.globals_], zero]
        for kind, _, elements, curves in self.groups():
            for number, _ in elements:
                columns += [self._curve(kind, number, curve, motion, zero) for curve in curves]
        return np.column_stack(columns)

    def _curve(self, kind: int, number: int, curve: str, motion: Any, zero: Any) -> Any:
        if kind == WALLS:
            return MASS_KG * (motion["V"] + SPEED_MPS) if curve == "FNX" else zero
        if curve[1] != self.axis:
            return 0.02 * motion["A"] if curve[0] == "A" else zero
        if kind == ACCELEROMETERS:
            return -motion["A"] if curve[0] == "A" else -(motion["V"] + SPEED_MPS)
        values = motion[curve[0]]
        unbraked = {"V": -SPEED_MPS, "D": -SPEED_MPS * self.time_ms, "A": 0.0}[curve[0]]
        return unbraked + (1.0 if number == 758 else 1.2) * (values - unbraked)

    def binary(self) -> bytes:
        """As ``hist1.F`` and ``hist2.F`` write it."""
        width = 100 if self.layout >= 3050 else 40

        def title(text: str) -> bytes:
            return text.encode().ljust(width)

        content = record(self.layout, b"Nova".ljust(80)) + record(b"today".ljust(80))
        if self.layout >= 3050:
            content += record(2) + record(100) + record(np.array(self.factors, ">f4").tobytes())
        groups = self.groups()
        content += record(1, 1, 1, 1, len(groups), self.globals_)
        content += record(*range(1, self.globals_ + 1)) if self.globals_ else b""
        content += record(1, title("rail"), 0, 1, 1, 1) + record(1)
        content += record(1, title("steel")) + record(1, title("shell"))
        content += record(0, 0, 0, 1, 0, title("GLOBAL MODEL")) + record(1)
        sizes = [1, self.globals_, 1]
        for number, (kind, name, elements, curves) in enumerate(groups, start=1):
            content += record(number, kind, 0, len(elements), len(curves), title(name))
            content += b"".join(record(each, title(of)) for each, of in elements)
            known = {NODES: CODES, ACCELEROMETERS: ACCELEROMETER_CODES, WALLS: {"FNX": 1, "FNY": 2}}[kind]
            content += record(*(known[curve] for curve in curves))
            sizes.append(len(elements) * len(curves))
        ends = np.cumsum([size for size in sizes if size])[:-1]
        for state in self.states().astype(">f4"):
            content += b"".join(record(part.tobytes()) for part in np.split(state, ends))
        return content

    def csv(self, version: Converter = "today", *, titled: bool = False, number: str = "%e") -> bytes:
        """As the converter writes it; titled if the run wrote its titles (``/TH/TITLE``)."""
        width = 100 if self.layout >= 3050 else 40
        known = 15 if self.globals_ == 15 else 12
        labels = GLOBAL_LABELS[: known if version == "2022" else max(15, self.globals_)]
        labels = [*labels, "PLASTIC WORK"] if version == "doubled" and self.globals_ >= 16 else labels
        cells = ["time", *labels, f"{'rail':{width}} IE "]
        place = 2 + self.globals_
        states = self.states()
        for kind, name, elements, curves in self.groups():
            for each, of in elements:
                for curve in curves:
                    end = f"{curve:10} " if titled else f"var {place}"
                    cells.append(f"{name:{width}} {each} {of:{width}} {' ' if titled else ''}{end}")
                    if titled and kind == WALLS:
                        states[:, place] = np.gradient(states[:, place], states[:, 0])  # a force again
                    place += 1
        rows = "\n".join(",".join(number % value for value in row) for row in states.astype(np.float32).tolist())
        return (",".join(f'"{cell}"' for cell in cells) + "\n" + rows + "\n").encode()


def record(*parts: object) -> bytes:
    """A record of Fortran: its length, integers and bytes, its length."""
    body = b"".join(part if isinstance(part, bytes) else struct.pack(">i", part) for part in parts)
    return struct.pack(">i", len(body)) + body + struct.pack(">i", len(body))


def _integral(values: Any, step: float) -> Any:
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2)]) * step
