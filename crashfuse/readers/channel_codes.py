"""Channel codes of ISO-MME: what their 16 characters say of a sensor, and which sensors measure the vehicle's pulse.

::

    10SEATLERE00ACXP
    1                 test object (1: vehicle 1)
     0                position (0: none, on the vehicle itself; 1: the driver's …)
      SEAT            main location
          LERE00      three fine locations (left, rear, undefined)
                AC    physical dimension (acceleration)
                  X   direction, signed as in SAE J211; NHTSA writes 1 for X, too
                   P  filter class (D: CFC 60, C: CFC 180 …; S: special; P: prefiltered only)

Characters that say nothing are 0 or ?; the IIHS fills them with _, as in ``11VEHC0000__ACX_``.

Sources: ISO/TS 13499, related electronic document B (channel codes), 1.6.2, as quoted by the public packages pyisomme
and sdata; the codes of NHTSA's and the IIHS's downloads.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

_FORM = re.compile(r"[0-9?_][0-9A-Z?_]{15}")
_DUMMY = frozenset(
    ["HEAD", "NECK", "CHST", "THSP", "SPIN", "PELV", "FEMR", "TIBI", "FOOT", "ABDO", "SHLD", "KNEE", "RIBS", "ACTB"]
)
_REAR = ("SEAT", "FLOR", "FORA", "FLPA")  # NHTSA's: seat cross-member, floor, floor pan
_PLACES = (
    ((), "on the rear seat cross-member or floor, behind the crush"),
    (("VEHC", "CVEH"), "of the vehicle as a whole"),
    (("TUNN",), "on the tunnel"),
    (("SIME", "SILL"), "on the sills"),
    (("BPIL",), "on the B-pillars"),
)
_CUTOFF_HZ = {"A": 1650.0, "B": 1000.0, "C": 300.0, "D": 100.0}  # of CFC 1000, 600, 180, 60 (SAE J211-1)
_RAW_FIRST = "0PXSABCD"


@dataclass(frozen=True, slots=True)
class ChannelCode:
    """A channel code: 16 capitals and digits, 0 for what it does not say."""

    text: str

    @classmethod
    def parsed(cls, text: str) -> "ChannelCode | None":
        """Read a code in any spelling of its fill characters; None if it is none."""
        code = text.strip().upper()
        return cls(re.sub("[?_]", "0", code)) if _FORM.fullmatch(code) else None

    @property
    def test_object(self) -> str:
        """The vehicle or barrier."""
        return self.text[0]

    @property
    def side(self) -> str:
        """The first fine location: LE, RI, or another."""
        return self.text[6:8]

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
    def of_a_dummy(self) -> bool:
        """Whether it is in a dummy: by its location, or by a kind of dummy in the last fine location (H3)."""
        return self.text[2:6] in _DUMMY or (self.rank == UNPLACED and self.text[10:12] != "00")

    @property
    def rank(self) -> int:
        """How well its place follows the motion of the whole vehicle: 0 is best, ``UNPLACED`` says nothing of it."""
        main, position, fine = self.text[2:6], self.text[1], (self.text[6:8], self.text[8:10])
        if main in _REAR and position == "0" and "RE" in fine:
            return 0
        return next((rank for rank, (mains, _) in enumerate(_PLACES) if main in mains), UNPLACED)

    @property
    def order(self) -> tuple[int, bool, int]:
        """Sort key: best place first, the vehicle's before an occupant's, the least filtered first."""
        return self.rank, self.text[1] != "0", _RAW_FIRST.find(self.text[15])

    @property
    def cutoff_hz(self) -> float | None:
        """The −3 dB frequency of its filter class; None if it names none."""
        return _CUTOFF_HZ.get(self.text[15])


UNPLACED = len(_PLACES)
"""The rank of a place that need not follow the motion of the whole vehicle."""


def proposed(codes: Mapping[str, ChannelCode]) -> tuple[tuple[str, ...], str]:
    """The channels whose average is the pulse, by name, and the reason; none if none sits at a known place.

    At the rear, where laboratories mount redundant sensors, all are taken; elsewhere one, or one on either side. Of a
    raw and a filtered signal the raw one is taken.
    """
    ordered = sorted(codes.items(), key=lambda pair: pair[1].order)
    rank = ordered[0][1].rank if ordered else UNPLACED
    if rank == UNPLACED:
        return (
            (),
            "No X acceleration is at the rear seat, the vehicle's own, or on tunnel, sills or B-pillars; choose one.",
        )
    there = [(name, code) for name, code in ordered if code.rank == rank]
    rawest: dict[str, ChannelCode] = {}
    for _, code in there:
        rawest.setdefault(code.sensor, code)
    chosen = tuple(name for name, code in there if rawest[code.sensor] == code)
    if rank:
        sides = [next((name for name, code in there if code.side == side), None) for side in ("LE", "RI")]
        chosen = tuple(side for side in sides if side is not None) or chosen[:1]
    average = "; their average is the pulse" if len(chosen) > 1 else ""
    return chosen, f"X acceleration {_PLACES[rank][1]}: {', '.join(chosen)}{average}."
