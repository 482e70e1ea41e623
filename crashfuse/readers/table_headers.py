"""Interpretation of a single foreign column header: role, unit, filter, direction; the axis of travel by motion."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from crashfuse.readers import vocabulary
from crashfuse.readers.vocabulary import HEADERS, UNITS, ChannelCode, mentions, plain, unit_named, words
from crashfuse.signals.pulse import FloatArray

ColumnRole = Literal[
    "id", "time", "acceleration", "speed", "mass", "front_weight", "rear_weight", "front_share", "factor", "ignored"
]

# reasons why an acceleration is not the pulse
OTHER_DIRECTION, OF_A_DUMMY, A_LIMIT = "another direction than X", "a dummy's", "a limit, no signal"
_BODY, _DUMMY, _VEHICLE = words("body"), words("body", "dummy"), words("vehicle")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")  # HeadAccX, DUMMYHead
_ALSO = {"acceleration": words("acceleration"), "time": words("time")}
_OF_A_CHANNEL, _NAME, _OF_A_TEST = words("key.channel"), words("key.name"), words("key.test")
_FEW_WORDS = 4
_REPEATED = re.compile(r" \(\d+\)$")  # what makes equal headers unique
_WIDE = str.maketrans("（）［］【】", "()[][]")
_LETTER = re.compile(r"(?<![^\W\d_])(a|acc|accel)?([ _.-]?)([xyz])(?![^\W\d_])", re.IGNORECASE)
_CODE = re.compile(r"(?<![^\W_])([0-9?_][0-9A-Z?_]{11}AC)([XYZ123])([0-9A-Z?_])(?![^\W_])", re.IGNORECASE)
_MANY_TIMES = 2.0
_BEGINNING = 100  # that part of the record tells its zero
_SMALL = 0.1  # of the peak


@dataclass(frozen=True, slots=True)
class ColumnUse:
    """The role assigned to one column, and a short reason for display."""

    column: str
    role: ColumnRole
    unit: str | None = None  # a name from UNITS; None if unknown or not needed
    why: str = ""

    @property
    def is_unknown(self) -> bool:
        """Whether nothing speaks for any role."""
        return self.role == "ignored" and not self.why


class Heading:
    """A header or title, and the cell below it in a row of units; ``place`` are its words without unit and filter."""

    def __init__(self, text: str, unit_cell: str = "") -> None:
        self.text, self.unit_cell = text, unit_cell
        self.name = _name_and_unit(text, "")[0] or text  # without its unit
        self.code = ChannelCode.parsed(re.split(r"[^\w?]", text.strip())[0]) or ChannelCode.parsed(self.name)
        self.place = " ".join(HEADERS["filter"].sub("", plain(self.name)).split())  # equal for raw and filtered signals
        if self.code is not None:
            self.place = self.code.sensor.lower()

    @property
    def unit(self) -> str | None:
        """Our name of the unit in the cell below it, else in itself."""
        return _name_and_unit(self.text, self.unit_cell)[1]

    @property
    def use(self) -> ColumnUse:
        """The role of its column; unrecognised, without a reason."""
        column, unit, place = self.text, self.unit, Heading(_REPEATED.sub("", self.text)).place
        why = f"its unit is {unit}" if unit else "its name says so"
        quantity = next((quantity for quantity, units in UNITS.items() if unit in units), None)

        def says(role: ColumnRole) -> bool:
            return quantity == role or (unit is None and _is(role, place))

        if self.code is not None and not self.code.is_acceleration:
            return ColumnUse(column, "ignored", None, "its code is no acceleration's")
        if says("acceleration") or (unit is None and self.code):
            why_not = self._why_not_the_pulse(place)
            return ColumnUse(column, "ignored" if why_not else "acceleration", unit, why_not or why)
        if says("time"):
            return ColumnUse(column, "time", unit, why)
        is_weight = quantity in ("mass", "share") or HEADERS["weight"].fullmatch(place)
        if says("speed") or is_weight:
            if HEADERS["not_as_tested"].search(HEADERS["including"].sub("", place)):
                return ColumnUse(column, "ignored")
            if says("speed"):
                return ColumnUse(column, "speed", unit, why)
            roles: tuple[ColumnRole, ...] = ("front_weight", "rear_weight", "mass")
            role = next((role for role in roles if _is(role, place)), "mass" if quantity == "mass" else "ignored")
            if quantity == "share":
                role = "front_share" if role == "front_weight" else "ignored"
            return ColumnUse(column, role, unit, why)
        by_name: tuple[ColumnRole, ...] = ("front_share", "id")
        named = next(filter(says, by_name), None)
        return ColumnUse(column, named, None, why) if named else ColumnUse(column, "ignored")

    def _why_not_the_pulse(self, place: str) -> str:
        if why_not := self.why_not_the_vehicle:
            return why_not
        if HEADERS["limit"].fullmatch(place) or mentions(place, "parameter"):
            return A_LIMIT
        is_other = self.unit is None and HEADERS["other_unit"].fullmatch(self._other_unit.lower())
        return f"its unit is {self._other_unit}" if is_other else ""

    @property
    def why_no_acceleration(self) -> str:
        """The reason why an unrecognised column cannot be an acceleration; empty if it may be one."""
        if self.names_a_dummy:
            return OF_A_DUMMY
        if other := self.unit or self._other_unit:
            return f"its unit is {other}"
        return "its name is not an acceleration's" if words("quantity").search(self.place) else ""

    @property
    def why_not_the_vehicle(self) -> str:
        """Why the acceleration of this name or title is not the vehicle's along X; else empty."""
        if words("direction").search(self.place) or (self.code and not self.code.is_along_x):
            return OTHER_DIRECTION
        return OF_A_DUMMY if self.names_a_dummy or (self.code and self.code.is_of_a_dummy) else ""

    @property
    def names_a_dummy(self) -> bool:
        """Whether it names a dummy or a part of it, which its compartment is not."""
        places = self.place, Heading(_HUMP.sub(" ", self.text)).place
        return any(_DUMMY.search(_VEHICLE.sub("", place)) for place in places)

    @property
    def is_ahead(self) -> bool:
        """Whether it names a part ahead of the passenger cell, which stops first."""
        return words("ahead").search(self.place) is not None

    @property
    def filter_order(self) -> float:
        """Sort key, least filtered first: raw, not stated, higher class before lower, filtered without a class."""
        if self.code is not None:
            return self.code.order[-1]
        if self.cutoff_hz is not None:
            return 2 + 1 / max(self.cutoff_hz, 1.0)
        name = plain(self.text)
        return 0.0 if HEADERS["raw"].search(name) else 4.0 if HEADERS["filter"].search(name) else 1.0

    @property
    def likelihood(self) -> tuple[int, bool, int, bool, float]:
        """Sort key of accelerations, the likeliest pulse first."""
        by_code = (vocabulary.UNPLACED, False, 0) if self.code is None else self.code.order
        return *by_code, words("vehicle_part").search(plain(self.text)) is None, self.filter_order

    @property
    def cutoff_hz(self) -> float | None:
        """The −3 dB frequency of the CFC in it, if it names one (SAE J211-1: 1.667 times the class)."""
        if self.code is not None:
            return self.code.cutoff_hz
        match = re.search(r"\bcfc ?(\d{1,4})\b", plain(self.text))
        return float(match.group(1)) / 0.6 if match else None

    def along(self, axis: str) -> str:
        """It with the names of an axis and of x exchanged: ``ay`` along y is what ``ax`` is along x."""
        other = {axis: "x", "x": axis}
        if axis == "x":
            return self.text

        def letter(match: re.Match[str]) -> str:
            new = other.get(match[3].lower(), match[3])
            return f"{match[1] or ''}{match[2]}{new.upper() if match[3].isupper() else new}"

        def code(match: re.Match[str]) -> str:
            named = vocabulary.AXES[int(match[2]) - 1] if match[2].isdecimal() else match[2].lower()
            return f"{match[1]}{other.get(named, named).upper()}{match[3]}"

        return _CODE.sub(code, self.text) if _CODE.search(self.text) else _LETTER.sub(letter, self.text)

    @property
    def _other_unit(self) -> str:
        if cell := self.unit_cell.strip("[](){}- "):
            return cell if unit_named(cell) is None else ""
        for opening, inside in re.findall(r"([\[({])\s*([^\])}]*[^\])}\s])", self.text.translate(_WIDE)):
            if unit_named(inside) is None and (opening == "[" or HEADERS["other_unit"].fullmatch(inside.lower())):
                return str(inside)
        return ""


def named_above(lines: Iterable[str]) -> tuple[str, ...]:
    """What lines above a table name its curve: values of keys such as ``Channel: Driver head X``, or few words."""
    named, lines = list[str](), [*lines]
    is_listing = sum(_numbered_channel(line)[0] is not None for line in lines) > 1
    for line in lines:
        key, value = vocabulary.key_and_value(line)
        if is_listing and _numbered_channel(line)[0]:
            continue
        name = plain(key)
        if value and (_OF_A_TEST.search(name) or (value[0].isdigit() and HEADERS["curve"].fullmatch(name))):
            continue
        text = value if value and (_OF_A_CHANNEL.search(name) or _NAME.search(name)) else key
        is_list = len({"x", "y", "z"} & set(plain(text).split())) > 1 or len(re.split("[,;|\t]", text)) > 2
        if not is_list and ((value and _OF_A_CHANNEL.search(name)) or _names_a_curve(text)):
            named.append(text)
    return tuple(named)


def listed_channels(lines: Iterable[str], width: int) -> dict[int, str]:
    """The channels that lines above a table list, ``Channel 2: Tunnel X``, by the places of their columns."""
    listed = {int(key[1]): value for key, value in map(_numbered_channel, lines) if key and value}
    first = min(listed, default=0) if len(listed) == width else -(0 in listed)
    return {number - first: value for number, value in listed.items()} if len(listed) > 1 else {}


def _numbered_channel(line: str) -> tuple[re.Match[str] | None, str]:
    key, value = vocabulary.key_and_value(line)
    return (re.fullmatch(r"\D+(\d+)", key) if _OF_A_CHANNEL.search(plain(key)) else None), value


def _names_a_curve(text: str) -> bool:
    name, heading = plain(text), Heading(text)
    has_axis = re.search(r"\b(a?[xyz]|acc\w*)\b", name) is not None
    if name.count(" ") >= _FEW_WORDS + 2 * has_axis:
        return False
    is_acceleration = heading.use.role == "acceleration" or heading.use.why in (OTHER_DIRECTION, OF_A_DUMMY)
    is_part = _BODY.search(_VEHICLE.sub("", name)) or (has_axis and heading.is_ahead)
    return bool(is_acceleration or is_part or HEADERS["curve"].fullmatch(name))


def is_key(text: str) -> bool:
    """Whether a cell is the key of a line about the test or its channels."""
    return any(pattern.search(plain(text)) for pattern in (_OF_A_CHANNEL, _NAME, _OF_A_TEST))


def _name_and_unit(column: str, unit_cell: str) -> tuple[str, str | None]:
    """Split ``a_x (g)``, ``Zeit [ms]``, ``AX_m/s^2``, ``t/ms``, ``time in s``."""
    if (unit := unit_named(unit_cell)) is not None:
        return column, unit
    if repeated := _REPEATED.search(column):
        name, unit = _name_and_unit(column[: repeated.start()], "")
        return name + repeated[0], unit
    column = column.translate(_WIDE)
    for match in re.finditer(r"[\[({]([^\])}]*(?:\([^)]*\)[^\])}]*)?)[\])}]", column):
        if (unit := unit_named(match.group(1))) is not None:
            return " ".join((column[: match.start()] + column[match.end() :]).split()).strip(" _-,"), unit
    for match in re.finditer(r"[\s_/,;:，：-]+(?:in[\s_]+)?", column):
        if match.start() and (unit := unit_named(column[match.end() :])) is not None:
            return column[: match.start()].strip(" _-,/"), unit
    return column, unit_named(column) if len(column) > 1 else None


def _is(role: ColumnRole, name: str) -> bool:
    return HEADERS[role].fullmatch(name) is not None or (role in _ALSO and _ALSO[role].search(name) is not None)


def axis_by_motion(columns: Mapping[str, tuple[str, ...]], values: Callable[[str], FloatArray]) -> tuple[str, str]:
    """The axis of travel, of columns by the axis that their headers name, and a sentence if it is not plainly x."""
    if set(columns) <= {"x"}:
        return "x", ""
    gains = {axis: float(np.median([_gain(values(name)) for name in names])) for axis, names in columns.items()}
    best = max(columns, key=gains.__getitem__)
    if best == "x" or ("x" in columns and not gains[best] > _MANY_TIMES * gains["x"]):
        return "x", ""
    return best, f"Careful: travel along {best}, by the change of velocity; else give --travel."


def _gain(values: FloatArray) -> float:
    """The largest change of velocity, without offset and noise."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    finite = finite - finite[: max(finite.size // _BEGINNING, 1)].mean()
    size = np.abs(finite)
    return float(np.abs(np.cumsum(np.where(size > _SMALL * size.max(), finite, 0.0))).max())
