"""Reader of TDMS, National Instruments' container of measured channels, and of their scales; files are untrusted.

A file is a sequence of segments: a lead-in, objects (file, groups, channels) with properties, and raw data in repeated
chunks, channel after channel or interleaved ("TDMS File Format Internal Structure", NI). DAQmx is not supported.

``NI_Scale[n]_…`` are properties of a channel, its group or its file, the first that has any; the last scale gives the
values, and each names its input: another scale, or the numbers as stored (as in the public package npTDMS).
"""

import re
import struct
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from crashfuse.errors import printable, refusal, refuse_if
from crashfuse.readers.members import CUT_SHORT, ONE_TEST, OTHER_KIND
from crashfuse.signals.pulse import FloatArray

_UNSCALED = 0xFFFFFFFF  # as an input: the numbers as stored
_TYPE = re.compile(r"ni_scale\[(\d{1,4})\]_scale_type")
_MOST_STEPS = 16  # of one channel
_MOST_NUMBERS = 10_000  # of a polynomial or table
_PHYSICAL = "export it in physical units"

Properties = Mapping[str, str | float]  # properties of a channel, its group and its file by their names in lower case

_LEAD_IN = struct.Struct("<4sI")
_METADATA, _NEW_LIST, _RAW, _INTERLEAVED, _BIG_ENDIAN, _DAQMX = (1 << bit for bit in (1, 2, 3, 5, 6, 7))
_NUMBERS = dict(enumerate("bhiqBHIQfd", start=1)) | {0x19: "f", 0x1A: "d", 0x21: "B"}
_TIMESTAMP = 0x44
_OTHERS = {0: 1, _TIMESTAMP: 16, 0x0B: 16, 0x1B: 16, 0x08000C: 8, 0x10000D: 16}  # bytes of types that are skipped
_TEXT, _NO_DATA, _AS_BEFORE, _WITHOUT_END = 0x20, 0xFFFFFFFF, 0, 0xFFFFFFFFFFFFFFFF
_PATH = re.compile(r"/'((?:[^']|'')*)'")
_MOST_METADATA = 8 << 20  # bytes, all segments together
_MOST_VISITS = 1_000_000  # object entries, all segments together
_MOST_VALUES = 5_000_000  # per channel


class _UnusableScale(ValueError):
    """A scale that no accelerometer has."""


class _Scales:
    def __init__(self, properties: Properties) -> None:
        self._properties, self._left = properties, _MOST_STEPS
        indices = (int(match[1]) for name in properties if (match := _TYPE.fullmatch(name)))
        count = self._whole("ni_number_of_scales", float(max(indices, default=-1) + 1))
        self.count = 0 if str(properties.get("ni_scaling_status")).lower() == "scaled" else count

    def _whole(self, name: str, usual: float | None = None) -> int:
        number = self._properties.get(name, usual)
        if not isinstance(number, float) or not number.is_integer():
            raise _UnusableScale(f"{name} {number}")
        return int(number)

    def applied(self, index: int, values: FloatArray) -> FloatArray:
        if index == _UNSCALED:
            return values
        self._left -= 1
        if self._left < 0:
            raise _UnusableScale(f"more than {_MOST_STEPS} scales, or scales in a circle")
        kind = self._properties.get(f"ni_scale[{index}]_scale_type", "none")
        prefix = f"ni_scale[{index}]_{kind}_".lower()

        def number(name: str) -> float:
            if isinstance(value := self._properties.get(prefix + name), float):
                return value
            raise _UnusableScale(f"scale {index} ({kind}) without {name}")

        def numbers(name: str, usual: float | None = None) -> FloatArray:
            if 0 < (count := self._whole(f"{prefix}{name}_size", usual)) <= _MOST_NUMBERS:
                return np.array([number(f"{name}[{n}]") for n in range(count)])
            raise _UnusableScale(f"scale {index} ({kind}) with {count:,} {name}")

        def source(name: str = "input_source") -> FloatArray:
            return self.applied(self._whole(prefix + name, float(_UNSCALED)), values)

        match kind:
            case "Linear":
                return source() * number("slope") + number("y_intercept")
            case "Polynomial":
                return np.polynomial.polynomial.polyval(source(), numbers("coefficients", 4.0))
            case "Table":
                inputs, outputs = numbers("pre_scaled_values"), numbers("scaled_values")
                order = -1 if inputs[0] > inputs[-1] else 1
                if inputs.shape != outputs.shape or not (order * np.diff(inputs) > 0).all():
                    raise _UnusableScale("a table that goes up and down")
                return np.interp(source(), inputs[::order], outputs[::order])
            case "Add":
                return source("left_operand_input_source") + source("right_operand_input_source")
            case "Subtract":  # the right one less the left one, as National Instruments' own programs do
                return source("right_operand_input_source") - source("left_operand_input_source")
            case "AdvancedAPI":
                return source()
        raise _UnusableScale(f"scale {index} of the kind {kind}")


class _Layout(NamedTuple):  # of one object in each chunk of raw data
    kind: int
    values: int
    width: int
    size: int


# a channel's numbers in a segment: chunks times count, their code, offset, and strides in bytes
_Extent = tuple[tuple[int, int], str, int, tuple[int, int]]


@dataclass(slots=True)
class TdmsChannel:
    """A channel of a TDMS file."""

    group: str
    name: str
    properties: dict[str, str | float] = field(default_factory=dict)
    _layout: _Layout | None = None
    _extents: list[_Extent] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class TdmsFile:
    """A TDMS file; the values of its channels are read on demand."""

    properties: dict[str, str | float]
    channels: tuple[TdmsChannel, ...]
    _groups: Mapping[str, TdmsChannel]
    _content: bytes
    _where: str

    def properties_of(self, channel: TdmsChannel) -> ChainMap[str, str | float]:
        """Of a channel, else of its group, else of the file."""
        group = self._groups.get(channel.group)
        return ChainMap(channel.properties, group.properties if group else {}, self.properties)

    def size(self, channel: TdmsChannel) -> int:
        """How many numbers a channel holds."""
        return sum(chunks * count for (chunks, count), *_ in channel._extents)

    def values(self, channel: TdmsChannel) -> FloatArray:
        """The numbers of a channel, scaled; a DataError for too many or unusable scales."""
        place = f"{self._where}: {printable(channel.name)}"
        refuse_if(self.size(channel) > _MOST_VALUES, place, f"at most {_MOST_VALUES:,} values", "more", ONE_TEST)
        parts = [np.ndarray(shape, code, self._content, at, by).ravel() for shape, code, at, by in channel._extents]
        with np.errstate(all="ignore"):  # damaged data may hold any number
            values = np.concatenate(parts).astype(np.float64) if parts else np.empty(0)
            try:
                levels = self.properties_of(channel).maps
                scales = next((scales for scales in map(_Scales, levels) if scales.count), None)
                return values if scales is None else scales.applied(scales.count - 1, values)
            except _UnusableScale as error:
                raise refusal(place, "scales that give an acceleration", printable(str(error)), _PHYSICAL) from error


def parse_tdms(content: bytes, where: str) -> TdmsFile:
    """Read the metadata of a file; a DataError if it is no TDMS, or damaged."""
    reader = _Reader(content, where)
    while len(content) - reader.at >= 28:
        reader.segment()
    root, items = reader.objects.get("/"), [*reader.objects.values()]
    groups = {item.group: item for item in items if item.group and not item.name}
    channels = tuple(item for item in items if item.name)
    return TdmsFile(root.properties if root else {}, channels, groups, content, where)


class _Reader:
    def __init__(self, content: bytes, where: str) -> None:
        self.at, self.objects = 0, dict[str, TdmsChannel]()
        self._content, self._where, self._order = content, where, "<"
        self._present: dict[str, TdmsChannel] = {}  # in this segment, in the order of their raw data
        self._metadata_bytes = self._visits = 0

    def segment(self) -> None:
        tag, contents = _LEAD_IN.unpack_from(self._content, self.at)
        self._refuse_if(tag != b"TDSm", OTHER_KIND if self.at == 0 else "no segment in its place")
        self._order = ">" if contents & _BIG_ENDIAN else "<"
        self.at += _LEAD_IN.size
        _, to_next, to_raw = self._unpack("IQQ")
        start, size = self.at, len(self._content)
        end = size if to_next == _WITHOUT_END else start + to_next
        self._refuse_if(contents & _DAQMX, "raw data of DAQmx", _PHYSICAL)
        self._refuse_if(end > size or start + to_raw > end, CUT_SHORT)
        if contents & _METADATA:
            self._read_objects(anew=bool(contents & _NEW_LIST))
        self._visits += len(self._present)
        self._refuse_if(self._visits > _MOST_VISITS, "too many objects", ONE_TEST)
        if contents & _RAW:
            self._find_data(start + to_raw, end, interleaved=bool(contents & _INTERLEAVED))
        self.at = end

    def _read_objects(self, *, anew: bool) -> None:
        if anew:
            self._present = {}
        for _ in range(self._unpack("I")[0]):
            path = self._text()
            group, name, *_ = [*(part.replace("''", "'") for part in _PATH.findall(path)), "", ""]
            item = self.objects.setdefault(path, TdmsChannel(group, name))
            (index,) = self._unpack("I")
            if index == _NO_DATA:
                self._present.pop(path, None)
            else:
                if index != _AS_BEFORE:
                    item._layout = self._layout()
                self._refuse_if(item._layout is None, "a channel without a type")
                self._present[path] = item
            for _ in range(self._unpack("I")[0]):
                name, value = self._text(), self._value()
                if value is not None:
                    item.properties[name.lower()] = value

    def _layout(self) -> _Layout:
        kind, dimensions, count = self._unpack("IIQ")
        if kind == _TEXT:
            size = self._unpack("Q")[0]
            return _Layout(kind, count, size // max(count, 1), size)
        is_unknown = dimensions != 1 or (kind not in _NUMBERS and kind not in _OTHERS)
        self._refuse_if(is_unknown, "an unknown type of data", "export it as float")
        width = struct.calcsize(f"={_NUMBERS[kind]}") if kind in _NUMBERS else _OTHERS[kind]
        return _Layout(kind, count, width, count * width)

    def _find_data(self, start: int, end: int, *, interleaved: bool) -> None:
        layouts = [(item, item._layout) for item in self._present.values() if item._layout is not None]
        chunk, row = (sum(getattr(layout, name) for _, layout in layouts) for name in ("size", "width"))
        chunks, at = (end - start) // chunk if chunk else 0, start
        are_unlike = interleaved and len({layout.values for _, layout in layouts}) > 1
        self._refuse_if(are_unlike, "interleaved channels of unlike length")
        for item, layout in layouts:
            if layout.kind in _NUMBERS and chunks:
                code, shape = f"{self._order}{_NUMBERS[layout.kind]}", (chunks, layout.values)
                item._extents.append((shape, code, at, (chunk, row if interleaved else layout.width)))
            at += layout.width if interleaved else layout.size

    def _value(self) -> str | float | None:
        (kind,) = self._unpack("I")
        if kind == _TEXT:
            return self._text()
        if kind in _NUMBERS:
            return float(self._unpack(_NUMBERS[kind])[0])
        if kind == _TIMESTAMP:  # fractions of 2⁻⁶⁴ s, and seconds since 1904
            parts = self._unpack("qQ" if self._order == ">" else "Qq")
            fractions, seconds = parts[::-1] if self._order == ">" else parts
            return seconds + fractions * 2.0**-64
        self._refuse_if(kind not in _OTHERS, "an unknown property")
        self._bytes(_OTHERS[kind])
        return None

    def _text(self) -> str:
        return self._bytes(self._unpack("I")[0]).decode("utf-8", "replace")

    def _unpack(self, codes: str) -> tuple[int, ...]:
        layout = f"{self._order}{codes}"
        return struct.unpack(layout, self._bytes(struct.calcsize(layout)))

    def _bytes(self, count: int) -> bytes:
        self._refuse_if(count > len(self._content) - self.at, CUT_SHORT)
        self._metadata_bytes += count
        self._refuse_if(self._metadata_bytes > _MOST_METADATA, "too many properties", ONE_TEST)
        self.at += count
        return self._content[self.at - count : self.at]

    def _refuse_if(self, wrong: object, found: str, advice: str = "download it again") -> None:
        refuse_if(wrong, self._where, "a sound TDMS file", found, advice)
