"""Interpretation of a single foreign column header: role, unit, filter, direction; the axis of travel by motion."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from crashfuse.readers.vocabulary import (
    AXES,
    HEADERS,
    UNITS,
    UNPLACED,
    ChannelCode,
    key_and_value,
    names_a_parameter,
    plain,
    unit_named,
    words,
)
from crashfuse.signals.pulse import FloatArray

ColumnRole = Literal[
    "id", "time", "acceleration", "speed", "mass", "front_weight", "rear_weight", "front_share", "factor", "ignored"
]

# reasons why an acceleration is not the pulse
OTHER_DIRECTION, OF_A_DUMMY, A_LIMIT = "another direction than X", "a dummy's", "a limit, no signal"
_LIMIT = re.compile(r"(upper|lower|ober\w*|unter\w*)( (bound|limit|band|grenze|schranke))?")
_HEADERS = {name: re.compile(pattern) for name, pattern in HEADERS.items()}
_WEIGHT, _NOT_AS_TESTED, _OTHER_UNIT = (_HEADERS[name] for name in ("weight", "not_as_tested", "other_unit"))
_INCLUDING = re.compile(r"\b(incl|inkl|including|with|mit)\b.*")
_BODY, _DUMMY, _VEHICLE, _OTHER_AXIS = words("body"), words("body", "dummy"), words("vehicle"), words("direction")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")  # HeadAccX, DUMMYHead
_AHEAD, _OF_THE_VEHICLE = words("ahead"), words("vehicle_part")
_RAW = re.compile(r"\b(raw|roh(daten|signal)?|unfiltered|ungefiltert)\b")
_FILTER = re.compile(rf"{_RAW.pattern}|\b(filtered|filt|gefiltert|cfc ?\d{{1,4}})\b")
_NO_ACCELERATION = words("quantity")
_ALSO = {"acceleration": words("acceleration"), "time": words("time")}
_OF_A_CHANNEL, _NAME, _OF_A_TEST = words("key.channel"), words("key.name"), words("key.test")
_FEW_WORDS = 4
_CURVE = re.compile(r".*(force|kraft|velocity|displacement|geschwindigkeit|weg)( [xyz])?")
_REPEATED = re.compile(r" \(\d+\)$")  # what makes equal headers unique
_WIDE = str.maketrans("（）［］【】", "()[][]")
_LETTER = re.compile(r"(?<![^\W\d_])(a|acc|accel)?([ _.-]?)([xyz])(?![^\W\d_])", re.IGNORECASE)
_CODE = re.compile(r"(?<![^\W_])([0-9?_][0-9A-Z?_]{11}AC)([XYZ123])([0-9A-Z?_])(?![^\W_])", re.IGNORECASE)
_NUMBERS = "123"  # of the directions in some codes
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


def use_of(column: str, unit_cell: str) -> ColumnUse:
    """The role of a column by its header and the cell below it in a row of units; unrecognised, without a reason."""
    unit = _name_and_unit(column, unit_cell)[1]
    place, code = place_of(_REPEATED.sub("", column)), _code_of(column)
    why = f"its unit is {unit}" if unit else "its name says so"
    if code is not None and not code.is_acceleration:
        return ColumnUse(column, "ignored", None, "its code is no acceleration's")
    quantity = None if unit is None else next(q for q, units in UNITS.items() if unit in units)
    if quantity == "acceleration" or (unit is None and (code or _is("acceleration", place))):
        return _acceleration(ColumnUse(column, "acceleration", unit, why), place, unit_cell)
    if quantity == "time" or (unit is None and _is("time", place)):
        return ColumnUse(column, "time", unit, why)
    not_as_tested = _NOT_AS_TESTED.search(_INCLUDING.sub("", place)) is not None
    if quantity == "speed" or (unit is None and _is("speed", place)):
        return ColumnUse(column, "ignored") if not_as_tested else ColumnUse(column, "speed", unit, why)
    if quantity in ("mass", "share") or _WEIGHT.fullmatch(place):
        if not_as_tested:
            return ColumnUse(column, "ignored")
        usual: ColumnRole = "mass" if quantity == "mass" else "ignored"
        roles: tuple[ColumnRole, ...] = ("front_weight", "rear_weight", "mass")
        role = next((role for role in roles if _is(role, place)), usual)
        if quantity == "share":
            role = "front_share" if role == "front_weight" else "ignored"
        return ColumnUse(column, role, unit, why)
    if unit is None and re.fullmatch(r".*(front|vorn).*(share|anteil).*|.*(share|anteil).*(front|vorn).*", place):
        return ColumnUse(column, "front_share", None, why)
    return ColumnUse(column, "id", None, why) if unit is None and _is("id", place) else ColumnUse(column, "ignored")


def _acceleration(use: ColumnUse, place: str, unit_cell: str) -> ColumnUse:
    other = _other_unit(use.column, unit_cell)
    why_not = why_not_the_vehicle(use.column)
    if not why_not and (_LIMIT.fullmatch(place) or names_a_parameter(place)):
        why_not = A_LIMIT
    if not why_not and use.unit is None and _OTHER_UNIT.fullmatch(other.lower()):
        why_not = f"its unit is {other}"
    return replace(use, role="ignored", why=why_not) if why_not else use


def why_no_acceleration(column: str, unit_cell: str) -> str:
    """The reason why an unrecognised column cannot be an acceleration; empty if it may be one."""
    unit = _name_and_unit(column, unit_cell)[1]
    if names_a_dummy(column):
        return OF_A_DUMMY
    if other := unit or _other_unit(column, unit_cell):
        return f"its unit is {other}"
    return "its name is not an acceleration's" if _NO_ACCELERATION.search(place_of(column)) else ""


def why_not_the_vehicle(name: str) -> str:
    """Why the acceleration of this name or title is not the vehicle's along X; else empty."""
    code = _code_of(name)
    if _OTHER_AXIS.search(place_of(name)) or (code and not code.is_along_x):
        return OTHER_DIRECTION
    return OF_A_DUMMY if names_a_dummy(name) or (code and code.is_of_a_dummy) else ""


def names_a_dummy(column: str) -> bool:
    """Whether a header names a dummy or a part of it, which its compartment is not."""
    return any(_DUMMY.search(_VEHICLE.sub("", place_of(one))) for one in (column, _HUMP.sub(" ", column)))


def named_above(lines: Iterable[str]) -> tuple[str, ...]:
    """What lines above a table name its curve: values of keys such as ``Channel: Driver head X``, or few words."""
    named = []
    lines = [*lines]
    is_listing = sum(_numbered_channel(line)[0] is not None for line in lines) > 1
    for line in lines:
        key, value = key_and_value(line)
        if is_listing and _numbered_channel(line)[0]:
            continue
        name = plain(key)
        if value and (_OF_A_TEST.search(name) or (value[0].isdigit() and _CURVE.fullmatch(name))):
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
    key, value = key_and_value(line)
    return (re.fullmatch(r"\D+(\d+)", key) if _OF_A_CHANNEL.search(plain(key)) else None), value


def _names_a_curve(text: str) -> bool:
    name, use = plain(text), use_of(text, "")
    has_axis = re.search(r"\b(a?[xyz]|acc\w*)\b", name) is not None
    if name.count(" ") >= _FEW_WORDS + 2 * has_axis:
        return False
    is_acceleration = use.role == "acceleration" or use.why in (OTHER_DIRECTION, OF_A_DUMMY)
    is_part = _BODY.search(_VEHICLE.sub("", name)) or (has_axis and is_ahead(text))
    return bool(is_acceleration or is_part or _CURVE.fullmatch(name))


def is_key(text: str) -> bool:
    """Whether a cell is the key of a line about the test or its channels."""
    return any(pattern.search(plain(text)) for pattern in (_OF_A_CHANNEL, _NAME, _OF_A_TEST))


def _other_unit(column: str, unit_cell: str) -> str:
    if cell := unit_cell.strip("[](){}- "):
        return cell if unit_named(cell) is None else ""
    for opening, inside in re.findall(r"([\[({])\s*([^\])}]*[^\])}\s])", column.translate(_WIDE)):
        if unit_named(inside) is None and (opening == "[" or _OTHER_UNIT.fullmatch(inside.lower())):
            return str(inside)
    return ""


def _name_and_unit(column: str, unit_cell: str) -> tuple[str, str | None]:
    """Split a header into name and unit: ``a_x (g)``, ``Zeit [ms]``, ``AX_m/s^2``, ``t/ms``, ``time in s``."""
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
    return _HEADERS[role].fullmatch(name) is not None or (role in _ALSO and _ALSO[role].search(name) is not None)


def _code_of(column: str) -> ChannelCode | None:
    return ChannelCode.parsed(re.split(r"[^\w?]", column.strip())[0]) or ChannelCode.parsed(bare_name(column))


def place_of(column: str) -> str:
    """The plain words of a header without unit and filter, equal for raw and filtered signals."""
    if (code := _code_of(column)) is not None:
        return code.sensor.lower()
    return " ".join(_FILTER.sub("", plain(bare_name(column))).split())


def is_ahead(column: str) -> bool:
    """Whether it names a part ahead of the passenger cell, which stops first."""
    return _AHEAD.search(place_of(column)) is not None


def filter_order(column: str) -> float:
    """Sort key, least filtered first: raw, not stated, higher class before lower, filtered without a class."""
    if (code := _code_of(column)) is not None:
        return code.order[-1]
    name, cutoff = plain(column), cutoff_of(column)
    if cutoff is not None:
        return 2 + 1 / max(cutoff, 1.0)
    return 0.0 if _RAW.search(name) else 4.0 if _FILTER.search(name) else 1.0


def likelihood(column: str) -> tuple[int, bool, int, bool, float]:
    """Sort key of accelerations, the likeliest pulse first."""
    code = _code_of(column)
    by_code = (UNPLACED, False, 0) if code is None else code.order
    return *by_code, _OF_THE_VEHICLE.search(plain(column)) is None, filter_order(column)


def cutoff_of(column: str) -> float | None:
    """The −3 dB frequency of the CFC in a header, if it names one (SAE J211-1: 1.667 times the class)."""
    if (code := _code_of(column)) is not None:
        return code.cutoff_hz
    match = re.search(r"\bcfc ?(\d{1,4})\b", plain(column))
    return float(match.group(1)) / 0.6 if match else None


def names_a_test(title: str) -> bool:
    """Whether a title above columns is the name of a test or a run: Test 1, Versuch 7, V2."""
    form = r"(test|run|versuch|lauf|crash|sim(ulation)?|v|t) ?((nr|no|number) )?\w*\d\w*"
    return re.fullmatch(form, plain(title)) is not None


def bare_name(column: str) -> str:
    """Return a header without its unit."""
    return _name_and_unit(column, "")[0] or column


def exchange_axes(header: str, axis: str) -> str:
    """A header with the names of an axis and of x exchanged: ``ay`` along y is what ``ax`` is along x."""
    if axis == "x":
        return header
    other = {axis: "x", "x": axis}

    def letter(match: re.Match[str]) -> str:
        found = match.group(3)
        new = other.get(found.lower(), found)
        return f"{match.group(1) or ''}{match.group(2)}{new.upper() if found.isupper() else new}"

    def code(match: re.Match[str]) -> str:
        found = match.group(2)
        named = AXES[_NUMBERS.index(found)] if found in _NUMBERS else found.lower()
        return f"{match.group(1)}{other.get(named, named).upper()}{match.group(3)}"

    return _CODE.sub(code, header) if _CODE.search(header) else _LETTER.sub(letter, header)


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
    """The largest change of velocity, without an offset from the beginning and what is small."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    finite = finite - finite[: max(finite.size // _BEGINNING, 1)].mean()
    size = np.abs(finite)
    return float(np.abs(np.cumsum(np.where(size > _SMALL * size.max(), finite, 0.0))).max())
