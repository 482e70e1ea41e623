"""Vocabulary of foreign files: spellings of units, channel codes of ISO-MME, words on a channel's source and quality.

A channel code::

    10SEATLERE00ACXP
    1                 test object (1: vehicle 1)
     0                position (0: none, on the vehicle itself; 1: the driver's …)
      SEAT            main location
          LERE00      three fine locations (left, rear, undefined)
                AC    physical dimension (acceleration)
                  X   direction, signed as in SAE J211; NHTSA writes 1 for X, too
                   P  filter class (D: CFC 60, C: CFC 180 …; Q: below CFC 60; V: film analysis; P: prefiltered only)

Characters that say nothing are 0 or ?; the IIHS fills them with _, as in ``11VEHC0000__ACX_``.

Sources: ISO/TS 13499, related electronic documents A and B, 1.6.2, as quoted by the public packages pyisomme and
sdata; the codes of NHTSA's and the IIHS's downloads.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from functools import cache
from typing import Any, Literal, Self, get_args

from crashfuse.errors import UsageError, printable
from crashfuse.files.toml_text import package_data
from crashfuse.units import KPH, KPH_KG, LB, MPH, MPH_LB, MS, G, Quantity

_LETTERS = str.maketrans({"ł": "l", "ø": "o", "đ": "d", "ı": "i", "æ": "ae"})  # that have no accent to drop
_ACCENTS = re.compile("[\u0300-\u036f]")
_CJK = "[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7a3]"
_BETWEEN_WORDS = re.compile("[^\\w\u0900-\u0eff]|_")  # in Indic and Thai words marks are no letters
_SCRIPTS = re.compile(rf"(?<={_CJK})(?=[0-9a-z])|(?<=[0-9a-z])(?={_CJK})")


def _unaccented(text: str) -> str:
    flat = unicodedata.normalize("NFKD", text.casefold().translate(_LETTERS))
    return unicodedata.normalize("NFC", _ACCENTS.sub("", flat))


def plain(text: str) -> str:
    """A name in any script as words of small letters without accents; CJK words stand apart from others."""
    return " ".join(_BETWEEN_WORDS.sub(" ", _SCRIPTS.sub(" ", _unaccented(text))).split())


_WORDS = package_data(__file__, "words.toml")

NHTSA: Mapping[str, Any] = _WORDS["nhtsa"]
ISOMME: Mapping[str, Any] = _WORDS["isomme"]
RADIOSS: Mapping[str, list[str]] = {name: text.split(", ") for name, text in _WORDS["radioss"].items()}
PROPERTIES: Mapping[str, str] = _WORDS["property"]
HEADERS: Mapping[str, re.Pattern[str]] = {name: re.compile(form) for name, form in _WORDS["header"].items()}


@cache
def words(*groups: str) -> re.Pattern[str]:
    """A pattern of the words in groups of ``words.toml`` (``body``, or ``key.source``), for a name that is plain."""
    terms: list[str] = []
    for group, _, part in (name.partition(".") for name in groups):
        texts = [_WORDS[group][part]] if part else _WORDS[group].values()
        terms += [_unaccented(term).replace("*", r"\w*") for text in texts for term in text.split(", ")]
    letters, signs = ([term for term in terms if bool(re.search(_CJK, term)) is is_cjk] for is_cjk in (False, True))
    return re.compile("|".join([rf"(?<![^\W\d])(?:{'|'.join(letters)})(?![^\W\d])", *signs]))


AXES = "xyz"
Travel = Literal["x", "-x", "y", "-y", "z", "-z"]  # in the file's own axes
TRAVELS: tuple[Travel, ...] = get_args(Travel)

# factors to m/s² of the units that occur in records; mm/s² and what follows are those of solvers
_USUAL = {"g": G, "m/s²": 1.0, "mm/s²": 1e-3, "mm/ms²": 1e3}
ACCELERATION_UNITS: Mapping[str, float] = _USUAL | {"cm/s²": 0.01, "in/s²": 0.0254, "ft/s²": 0.3048}
USUAL_UNITS = tuple(_USUAL)  # the others are not inferred

UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": MS, "µs": 1e-6},
    "acceleration": ACCELERATION_UNITS,
    "speed": {"km/h": KPH, "mph": MPH, "m/s": 1.0},
    "mass": {"kg": 1.0, "lb": LB, "t": 1000.0},
    "share": {"%": 0.01, "1": 1.0},
}  # factors to SI by quantity and by our own unit name

_NAMES = {spelling: name for name, spellings in _WORDS["unit"].items() for spelling in spellings.split(", ")}
_LEADING_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")
_FORM = re.compile(r"[0-9?_][0-9A-Z?_]{15}")
_DUMMY, _SIDE_MEMBERS, _REAR = (_WORDS["code"][name].split(", ") for name in ("dummy", "side_member", "rear"))
_PLACES = [(codes.split(", "), place) for place, codes in _WORDS["place_by_code"].items()]  # the best first
PLACES_BY_TITLE: Mapping[str, str] = _WORDS["place_by_title"]
# of CFC 1000, 600, 180, 60 (SAE J211-1), and of these in the editions before
_CUTOFF_HZ = dict(zip("ABCDEFGH", (1650.0, 1000.0, 300.0, 100.0) * 2, strict=True))
_RAW_FIRST = "0PAE2BF3CGDH1SXLQV"  # then what the standard does not have
_DULL = {"L": "filtered with CFC 20", "Q": "filtered below CFC 60", "V": "film analysis"}
_KEY = re.compile(r"([^:=,;\t|]{1,40}?)(?:\s*[:=,;\t|]+|\s{2,})\s*(.*)")
_MARKS = "#%!*/;,\"' \t"
_SOURCE = words("key.source")
_FAULT = words("quality.failure", "quality.doubt").pattern
_SOUND = re.compile(rf"(({words('quality.sound').pattern})( |$))*|{words('quality.unstated').pattern}")
_FAILED, _DOUBTED = words("quality.failure", "quality.no_data"), words("quality.doubt")
_FAILED_CODE = re.compile(r"\b(cf|mn|md|nd)\b")
_DENIED = re.compile(rf"\b(not|nicht|never) ({_FAULT})|{words('quality.denied').pattern}")
_SUM, _SOME_CELLS = words("sum.sum"), words("sum.part")
_OTHER = re.compile("|".join(_WORDS["setup"].values()), re.IGNORECASE)


def unit_named(text: str, quantity: str | None = None) -> str | None:
    """Our name of the unit that a text spells; None if it is none (of this quantity, a key of ``UNITS``)."""
    spelling = unicodedata.normalize("NFKC", text.strip()).strip("[](){}").lower().replace("’", "'")
    name = _NAMES.get(re.sub(r"[\s^*·()]", "", spelling))
    known = {name for units in UNITS.values() for name in units} if quantity is None else UNITS[quantity]
    return name if name in known else None


def acceleration_unit(text: str) -> str:
    """Our name of a unit of acceleration, however it is spelt (``mps2``); a UsageError if it is none."""
    if (name := unit_named(str(text), "acceleration")) is None:
        units = ", ".join(ACCELERATION_UNITS)
        raise UsageError(f"There is no unit {printable(repr(text), 40)} of acceleration; take {units}.")
    return name


def number_and_unit(text: str) -> tuple[float, str] | None:
    """Split ``56,3 km/h`` into the number and the rest; None if it does not start with a number."""
    match = _LEADING_NUMBER.match(text := text.strip())
    return None if match is None else (float(match[0].replace(",", ".")), text[match.end() :].strip())


def iso_date(text: str, form: str) -> str:
    """A date as 2017-10-03, if it is of this form; else as it is."""
    with suppress(ValueError):
        return datetime.strptime(text.strip(), form).date().isoformat()
    return text


class _InBoth(Quantity):
    """A quantity whose reader's units nobody knows before there is a campaign."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{self.in_units(KPH_KG)} ({self.in_units(MPH_LB)})"


def speed(*values_mps: float, form: str = ".1f", between: str = "–") -> Quantity:
    """Speeds, given in m/s; as a string, in km/h and mph."""
    return _InBoth(tuple(value / KPH for value in values_mps), "km/h", form, between)


def weight(*values_kg: float, form: str = ".0f", between: str = "–") -> Quantity:
    """Weights, given in kg; as a string, in kg and lb."""
    return _InBoth(values_kg, "kg", form, between)


@dataclass(frozen=True, slots=True)
class ChannelCode:
    """A channel code: 16 capitals and digits, 0 for what it does not say."""

    text: str

    @classmethod
    def parsed(cls, text: str) -> Self | None:
        """Read a code in any spelling of its fill characters; None if it is none."""
        code = text.strip().upper()
        return cls(re.sub("[?_]", "0", code)) if _FORM.fullmatch(code) else None

    @property
    def sensor(self) -> str:
        """All but the filter class: equal for raw and filtered signals."""
        return self.text[:15]

    @property
    def is_acceleration(self) -> bool:
        """Whether it is an acceleration in any direction."""
        return self.text[12:14] == "AC"

    @property
    def is_along_x(self) -> bool:
        """Whether its direction is the vehicle's X."""
        return self.text[14] in "X1"

    @property
    def is_of_a_dummy(self) -> bool:
        """By its location, or by a kind of dummy in the last fine location (H3)."""
        main = self.text[2:6]
        return main in _DUMMY or (self.rank == UNPLACED and main not in _SIDE_MEMBERS and self.text[10:12] != "00")

    @property
    def rank(self) -> int:
        """How well its place follows the whole vehicle: 0 is best, ``UNPLACED`` says nothing of it."""
        main, position, fine = self.text[2:6], self.text[1], (self.text[6:8], self.text[8:10])
        if main in _REAR and position == "0" and "RE" in fine:
            return 0
        if main in _SIDE_MEMBERS and not {"RE", "MI"}.intersection(fine):
            return UNPLACED  # in the crush
        return next((rank for rank, (mains, _) in enumerate(_PLACES) if main in mains), UNPLACED)

    @property
    def order(self) -> tuple[int, bool, bool, int]:
        """Sort key: best place first, the vehicle's before an occupant's, the front last, the least filtered first."""
        is_in_front = "FR" in (self.text[6:8], self.text[8:10])
        return self.rank, self.text[1] != "0", is_in_front, f"{_RAW_FIRST}{self.text[15]}".index(self.text[15])

    @property
    def cutoff_hz(self) -> float | None:
        """The −3 dB frequency of its filter class; None if it names none."""
        return _CUTOFF_HZ.get(self.text[15])

    @property
    def sums(self) -> int:
        """Whether it is a sum of some load cells (1), or of all (2)."""
        fine = self.text[6:8], self.text[8:10]
        return 0 if "SU" not in fine else 2 if {"SU", "00"} == {*fine} else 1

    def status(self, stated: str) -> str:
        """What speaks against it: what is stated, else what its filter takes beyond CFC 60."""
        return stated if doubt_of(stated) else _DULL.get(self.text[15], stated)


UNPLACED = len(_PLACES)  # the rank of a place that need not follow the motion of the whole vehicle


def propose_by_code(codes: Mapping[str, ChannelCode]) -> tuple[tuple[str, ...], str]:
    """The channels to average, and the reason: all at the rear, elsewhere one, or one on either side."""
    ordered = sorted(codes.items(), key=lambda pair: pair[1].order)
    rank = ordered[0][1].rank if ordered else UNPLACED
    if rank == UNPLACED:
        return (), "No X acceleration is at the rear seat, on tunnel, sills or B-pillars; choose one."
    there = [(name, code) for name, code in ordered if code.rank == rank]
    rawest = {code.sensor: code for _, code in reversed(there)}
    chosen = tuple(name for name, code in there if rawest[code.sensor] == code)
    if rank:
        sides = [next((name for name, code in there if code.text[6:8] == side), "") for side in ("LE", "RI")]
        chosen = tuple(filter(None, sides)) or chosen[:1]
    return chosen, f"X acceleration {_PLACES[rank][1]}: {', '.join(chosen)}."


class Doubt(IntEnum):
    """What speaks against a channel."""

    NONE = 0
    SOME = 1  # its quality is questionable, or it is computed from others; better than none
    FAILED = 2


def mentions(text: str, *groups: str) -> bool:
    """Whether a text in the words of a file has one of the words in these groups, see :func:`words`."""
    return words(*groups).search(_plain(text)) is not None


def is_simulated(origin: str) -> bool:
    """Whether words on a channel's source say that nobody measured it."""
    return mentions(origin, "simulation", "parameter")


def key_and_value(line: str) -> tuple[str, str]:
    """Split a line above a table, ``# Channel: Driver head X``; the value is empty where there is no key."""
    text = line.strip().strip(_MARKS)
    return (match[1], match[2].strip(_MARKS)) if (match := _KEY.match(text)) else (text, "")


def statement_of_simulation(lines: Iterable[str]) -> str:
    """The first of the lines above a table that says that a program computed it."""
    stated = (line.strip() for line in lines if HEADERS["statement"].search(_plain(line)) or _says_simulated(line))
    return next(stated, "")


def _says_simulated(line: str) -> bool:
    key, value = key_and_value(line)
    if _SOURCE.search(_plain(key)):
        return mentions(value, "simulation") or mentions(f"{key} {value}", "simulation")
    text = _plain(key)
    found = None if _plain(value) in ("no", "none", "nein", "non") else words("simulation").search(text)
    return found is not None and HEADERS["before_simulation"].fullmatch(text[: found.start()]) is not None


def doubt_of(status: str) -> Doubt:
    """What speaks against a channel, by the words on its quality; nothing where they are empty."""
    words = _plain(status)
    if _SOUND.fullmatch(words):
        return Doubt.NONE
    return Doubt.FAILED if _FAILED.search(words) or _FAILED_CODE.search(words) else Doubt.SOME


def doubt_in(comment: str) -> Doubt:
    """What speaks against a channel, by a comment in any words, most of which are not of quality."""
    words = _DENIED.sub(" ", _plain(comment))
    return Doubt.FAILED if _FAILED.search(words) else Doubt.SOME if _DOUBTED.search(words) else Doubt.NONE


def sums_of(name: str) -> int:
    """As :attr:`ChannelCode.sums`, by a name."""
    words = _plain(name)
    return (1 if _SOME_CELLS.search(words) else 2) if _SUM.search(words) else 0


def _plain(text: str) -> str:
    return plain(text[:200])


def other_setup(texts: Iterable[str]) -> str:
    """The first of these texts that names another crash; empty if none does."""
    return next((printable(text.strip(), 80) for text in texts if _OTHER.search(text[:1000])), "")
