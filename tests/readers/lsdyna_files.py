"""LS-DYNA's own files in memory: LSDA containers byte by byte from the published layout, and ASCII nodout.

Widths and words of the ASCII form are those that the solver's converter from binout writes.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G
from tests.importing.crashes import DURATION_S, PEAK_MPS2, SPEED_MPS, half_sine_g

SYSTEMS = {
    **{"mm/ms²": (1e3, 1e3, 1.0), "mm/s²": (1e3, 1.0, 1e-3), "m/s²": (1.0, 1.0, 1.0), "g mm ms": (1e3, 1e3, 1e3)},
    **{"kg mm s": (1e3, 1.0, 1.0), "t m s": (1.0, 1.0, 1e-3), "g cm s": (1e2, 1.0, 1e3)},
    **{"ft": (1 / 0.3048, 1.0, 1 / 14.5939), "inch": (1 / 0.0254, 1.0, 1 / 175.1268)},
}
"""Consistent systems by a name, the usual ones by their acceleration: lengths in a metre, times in a second, masses in
a kg."""
MASS_KG = 1700.0
TYPES = {"i1": 1, "i2": 2, "i4": 3, "i8": 4, "u1": 5, "u2": 6, "u4": 7, "u8": 8, "f4": 9, "f8": 10}

Values = npt.NDArray[np.generic]
Folders = Mapping[str, Mapping[str, Values]]


@dataclass(frozen=True)
class Layout:
    """Sizes of the integers, byte order, how folders are named, and folders a symbol table."""

    length: int = 8
    offset: int = 8
    command: int = 1
    kind: int = 1
    order: str = "<"
    relative: bool = False
    folders_a_table: int = 1000


def lsda(folders: Folders, layout: Layout = Layout()) -> bytes:
    """An LSDA file with these variables by folder."""
    code = {1: "B", 2: "H", 4: "I", 8: "Q"}
    sizes = (layout.length, layout.offset, layout.command, layout.kind)

    def integer(value: int, width: int) -> bytes:
        return struct.pack(f"{layout.order}{code[width]}", value)

    def record(command: int, body: bytes, length: int | None = None) -> bytes:
        whole = len(body) + layout.length + layout.command if length is None else length
        return integer(whole, layout.length) + integer(command, layout.command) + body

    content = bytearray(bytes([8, *sizes, layout.order == "<", 0, 0]) + record(7, integer(0, layout.offset)))
    items, here = list(folders.items()), "/"
    for at in range(0, len(items), layout.folders_a_table):
        link, table = len(content) - layout.offset, b""
        for path, variables in items[at : at + layout.folders_a_table]:
            is_beside = here.rsplit("/", 1)[0] == path.rsplit("/", 1)[0] and here != path
            move = f"../{path.rsplit('/', 1)[1]}" if is_beside and layout.relative else path
            here = path
            content += record(2, move.encode())
            table += record(2, move.encode())
            for name, values in variables.items():
                kind = integer(TYPES[values.dtype.str[1:]], layout.kind)
                place, count = integer(len(content), layout.offset), integer(values.size, layout.length)
                data = values.astype(f"{layout.order}{values.dtype.str[1:]}").tobytes()
                content += record(3, kind + bytes([len(name)]) + name.encode() + data)
                table += record(4, name.encode() + kind + place + count)
        content[link : link + layout.offset] = integer(len(content), layout.offset)
        table += record(6, integer(0, layout.offset))
        content += record(5, b"", len(table) + layout.length + layout.command) + table
    return bytes(content)


def chars(text: str, width: int = 80) -> Values:
    """Text as a binout keeps it."""
    return np.frombuffer(text.encode("latin-1").ljust(width), "i1")


def floats(values: Mapping[str, Any]) -> dict[str, Values]:
    """Numbers as a binout keeps them."""
    return {name: np.array(of, "f4", ndmin=1) for name, of in values.items()}


@dataclass(frozen=True)
class Run:
    """A car with a half-sine pulse, run into a wall: nodes by number with title and how their pulse is scaled."""

    unit: str = "mm/ms²"
    direction: int = 1
    nodes: Mapping[int, tuple[str, float]] = field(
        default_factory=lambda: {
            1001: ("DRIVER SIDE REAR CROSSMEMBER", 1.0),
            1002: ("REAR CROSSMEMBER RIGHT", 1.0),
            2001: ("ENGINE TOP", 1.3),
            2002: ("DRIVER HEAD REAR SEAT", 0.9),
        }
    )
    end_s: float = 0.15
    step_s: float = 1e-4
    noise_g: float = 0.0
    axis: str = "x"
    database: str = "nodout"
    rest_s: float = 0.0  # before its velocity is set
    has_wall: bool = False

    @property
    def time_s(self) -> FloatArray:
        return self.step_s * np.arange(round((self.rest_s + self.end_s) / self.step_s) + 1)

    def columns(self, scale: float, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time, velocity and acceleration of a node in the run's units; at rest once its velocity is gone."""
        length, time, _ = SYSTEMS[self.unit]
        time_s = self.time_s - self.rest_s
        noise = np.random.default_rng(seed).normal(0.0, self.noise_g * G, time_s.size)
        accel = scale * half_sine_g(time_s) * G + noise
        angle = np.pi * np.clip(time_s / DURATION_S, 0.0, 1.0)
        velocity = SPEED_MPS - scale * PEAK_MPS2 * DURATION_S / np.pi * (1 - np.cos(angle))
        velocity[time_s < -self.step_s / 2] = 0.0
        per_s = self.direction * length / time
        return self.time_s * time, per_s * velocity, per_s / time * accel

    def folders(
        self, numbers: Sequence[int] | None = None, states: slice = slice(None)
    ) -> dict[str, dict[str, Values]]:
        """Folders of a binout with these nodes and states."""
        chosen = [number for number in self.nodes if numbers is None or number in numbers]
        columns = [self.columns(self.nodes[number][1], number) for number in chosen]
        length, time, mass = SYSTEMS[self.unit]
        metadata: dict[str, Values] = {"title": chars("Nova full frontal"), "ids": np.array(chosen, "i8")}
        if named := [number for number in chosen if self.nodes[number][0]]:
            legend = np.concatenate([chars(self.nodes[number][0]) for number in named])
            metadata |= {"legend": legend, "legend_ids": np.array(named, "i8")}
        folders: dict[str, dict[str, Values]] = {f"/{self.database}/metadata": metadata}
        zeros = np.zeros(len(chosen), "f4")
        still = {f"{axis}_{what}": zeros for axis in "xyz" for what in ("velocity", "acceleration")}
        for state in range(self.time_s.size)[states]:
            velocity, accel = (np.array([of[kind][state] for of in columns], "f4") for kind in (1, 2))
            folders[f"/{self.database}/d{state + 1:06d}"] = {
                **{"time": np.array([columns[0][0][state]], "f4"), "cycle": np.array([10 * state], "i4"), **still},
                **{f"{self.axis}_velocity": velocity, f"{self.axis}_acceleration": accel},
            }
        energy = 0.5 * MASS_KG * mass * (SPEED_MPS * length / time) ** 2
        for state, (at_s, share) in enumerate(({0.0: 1e-3} | {self.rest_s: 1.0}).items(), start=1):
            told = {"time": at_s * time, "kinetic_energy": share * energy, "total_energy": share * energy}
            folders[f"/glstat/d{state:06d}"] = floats(told)
        for state, accel in enumerate(self.columns(1.0, 0)[2][states] if self.has_wall else ()):
            force = -MASS_KG * mass * accel / 2 * np.ones(2)
            told = {"time": columns[0][0][state], "x_force": force, "y_force": 0 * force}
            folders[f"/rwforc/forces/d{state + 1:06d}"] = floats(told)
        return folders

    def binout(
        self, layout: Layout = Layout(), numbers: Sequence[int] | None = None, states: slice = slice(None)
    ) -> bytes:
        """A binout of the run, or a shard of it."""
        return lsda(self.folders(numbers, states), layout)

    def nodout(self, *, exponent: str = "E") -> bytes:
        """An ASCII nodout of the run."""
        lines = [" Nova full frontal", "                         ls-dyna (version mpp s R)     date 11/21/2026", ""]
        named = [(number, title) for number, (title, _) in self.nodes.items() if title]
        if named:
            lines += ["{BEGIN LEGEND}", " Entity #        Title"]
            lines += [f"{number:9d}     {title}" for number, title in named] + ["{END LEGEND}", ""]
        columns = {number: self.columns(scale, number) for number, (_, scale) in self.nodes.items()}
        moving = np.eye(3)["xyz".index(self.axis)]
        shaking = np.array([-3.0, -1.0, -2.0]) * (moving == 0)
        for state, time in enumerate(next(iter(columns.values()))[0]):
            stamp = (
                f"\n\n\n n o d a l   p r i n t   o u t   f o r   t i m e  s t e p{state:8d}"
                f"                              ( at time{time:12.5E} )\n"
            )
            words = "x-disp     y-disp      z-disp      x-vel       y-vel       z-vel      x-accl      y-accl      "
            lines += [stamp, f" nodal point  {words}z-accl      x-coor      y-coor      z-coor"]
            for number, (_, velocity, accel) in columns.items():
                along = [*velocity[state] * moving, *accel[state] * moving + shaking]
                lines.append(_row(number, [0.0, 0.0, -1.0, *along, 100.0, -200.0, 3.0], exponent))
            turns = "x-rot      y-rot       z-rot       x-rot vel   y-rot vel   z-rot vel   x-rot acc   y-rot acc   "
            lines += [stamp, f" nodal point  {turns}z-rot acc"]
            lines += [_row(number, [9.0] * 9, exponent) for number in columns]
        return "\n".join(lines).encode() + b"\n"


def _row(number: int, values: Iterable[float], exponent: str) -> str:
    first, *rest = (f"{value:.4E}".replace("E", exponent) for value in values)
    return f"{number:9d}{first:>13}" + "".join(f"{value:>12}" for value in rest)


@dataclass(frozen=True)
class Energies:
    """What glstat and matsum say of a run, at the start, in between and at the end."""

    total: tuple[float, ...] = (100.0, 97.0, 99.0)
    work: tuple[float, ...] = (0.0, 1.0, 1.0)
    internal: tuple[float, ...] = (0.0, 80.0, 75.0)
    hourglass: tuple[float, ...] | None = (0.0, 3.0, 4.0)
    added_percent: tuple[float, ...] | None = (1.5, 1.5, 2.5)
    time: tuple[float, ...] = (0.0, 50.0, 100.0)

    @property
    def whole(self) -> dict[str, tuple[float, ...]]:
        """Of all parts together, by the names of variables."""
        named = {"time": self.time, "kinetic_energy": self.total, "internal_energy": self.internal}
        named |= {} if self.hourglass is None else {"hourglass_energy": self.hourglass}
        named |= {"external_work": self.work, "total_energy": self.total}
        return named | ({} if self.added_percent is None else {"percent_increase": self.added_percent})

    def glstat_folders(self) -> dict[str, dict[str, Values]]:
        states = range(len(self.time))
        return {f"/glstat/d{n + 1:06d}": floats({name: of[n] for name, of in self.whole.items()}) for n in states}

    def matsum_folders(self) -> dict[str, dict[str, Values]]:
        """Folders of a binout with two parts, one of which takes a quarter."""
        columns = zip(self.time, self.internal, self.hourglass or (0.0,) * len(self.time), strict=True)
        parts = np.array([0.25, 0.75], "f4")
        return {
            f"/matsum/d{n:06d}": floats({"time": t, "internal_energy": parts * inner, "hourglass_energy": parts * lost})
            for n, (t, inner, lost) in enumerate(columns, start=1)
        }

    def glstat(self) -> bytes:
        """The same as text, word by word as the solver's converter writes it."""
        lines = [" Nova full frontal", "                         ls-dyna (version mpp s R)     date 11/21/2026"]
        wall = " stonewall energy...............   9.90000E+01 wall# 1"
        for state, time in enumerate(self.time):
            lines += [f"\n\n dt of cycle{10 * state:8d} is controlled by shell          31 of part       12\n"]
            lines += [f" time...........................{time:14.5E}", " time step......................   1.00000E-03"]
            for name, values in self.whole.items():
                label = name.replace("_", " ") + " " * (name == "hourglass_energy")
                if name == "percent_increase":
                    lines += ["\n\n added mass.....................   2.00000E+01"]
                    label = "percentage increase"
                lines += [f" {label:.<31}{values[state]:14.5E}"] * (name != "time")
                lines += [wall] * (name == "internal_energy")
                ratio = f" total energy / initial energy..{self.total[state] / self.total[0]:14.5E}"
                lines += [ratio] * (name == "total_energy")
        return "\n".join(lines).encode() + b"\n"

    def matsum(self) -> bytes:
        """The same by part, as text."""
        lines = [" Nova full frontal", "{BEGIN LEGEND}", " Entity #        Title", "        1     rail", "{END LEGEND}"]
        for time, *energies in zip(self.time, self.internal, self.hourglass or self.work, strict=True):
            lines.append(f"\n\n time ={time:13.4E}")
            for part, share in (("    1   ", 0.25), ("  100001", 0.75)):
                internal, hourglass = (share * energy for energy in energies)
                lines += [f" mat.#={part}          inten={internal:13.4E}     kinen={0.0:13.4E}"]
                lines += [" x-mom=   0.0000E+00     y-mom=   0.0000E+00     z-mom=   0.0000E+00"]
                lines += [f"                         hgeng={hourglass:13.4E}     +mass=   1.0000E+00"]
        return "\n".join(lines).encode() + b"\n"
