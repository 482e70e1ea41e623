"""What a run of any solver tells: histories of nodes, accelerometers among them, travel, units, mass and quality.

No solver records which nodes are accelerometers: titles tell; without titles, nodes that travel as far as most others
are proposed. LS-DYNA records no units either: duration, speed and the size of a vehicle's mass tell them, and so force.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from crashfuse.cae_library import QUALITIES, RunQuality
from crashfuse.campaign_folder.condition_tables import listed
from crashfuse.errors import refuse_if
from crashfuse.readers.record import PartialCondition, Record, RecordedChannel
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, AXES, PLACES_BY_TITLE, Travel, iso_date, speed, weight
from crashfuse.signals.pulse import FloatArray
from crashfuse.signals.wall import Wall
from crashfuse.units import KPH, MS, G, Sentence, number

CUT = "The last state is cut short and left out."
KEEP_APART = "keep runs in separate folders"

_ALIASED = 0.05  # of the velocity
_ALIKE = 0.1  # of the median travel
_DUMMY = re.compile(r"\b(dummy|head|neck|chest|thorax|pelvis|femur|tibia|foot|spine)\b", re.I)
_SLOWEST_MPS = 1.0
_LEAST_OF_FASTEST = 0.2  # a vehicle is at its fastest when it sets out; what is accelerated first is none
_AT_SPEED, _AT_REST, _AT_ONCE = 0.98, 0.05, 5.0  # shares of the largest speed; by so much faster set than lost
_STILL = 0.005  # of the largest speed of any node, which may have come off
_OBLIQUE = 0.25  # 14°: the component along the axis is 3 % short

# the title and the line below it in every text file of LS-DYNA
STAMP = re.compile(r"([^\n]*)\n *ls-dyna +\(?(?:version +)?(\S.*?)\)? +date +(\d\d/\d\d/\d{4})")
_STATED = {
    "title": STAMP,
    "date": re.compile(r"\bdate *:? *(\d\d/\d\d/\d{4})", re.IGNORECASE),
    "deck": re.compile(r"(?:Input file *:|\bi *=)(?: *i *=)? *(?:\S*[/\\])?([^/\\\s|]+)"),
}
_VERSION = re.compile(r"(?:Version|Revision|Build tag) *: *([^|*\s](?:[^|*\n]*[^|*\s])?)")
_ENDED = re.compile(rb"(n ?o ?r ?m ?a ?l|e ?r ?r ?o ?r) +t ?e ?r ?m ?i ?n ?a ?t ?i ?o ?n|user break", re.IGNORECASE)
_OVERLAP = 100  # bytes; the words may lie across two chunks

LONGEST_S, _LONGEST_MS = 2.0, 2000.0  # duration of a run
_SLOWEST_S = 5e-3  # time step of a run in s; a longer one is in ms, of a run that ended at once
FASTEST_MPS, _SLOWEST_MMPS = 100.0, 3000.0  # in between, the unit could be inch or cm
_HEAVIEST_CAR_KG = 3000.0
_FAST_MPS, _HARD_MPS2 = 33.0, 45 * G  # of no car into a barrier, start and mean: the unit could be ft
_SHARE_OF = ("the energy at the start", "the largest internal energy", "the mass at the start")  # by QUALITIES

# of the units of mass that may go with each, the usual one first
_MASSES_KG: dict[str, tuple[float, ...]] = {"mm/ms²": (1.0, 1e-3, 1e3), "mm/s²": (1e3, 1.0, 1e-3)}
_MASSES_KG |= {"m/s²": (1.0, 1e3, 1e-3), "cm/s²": (1e-3, 1.0), "in/s²": (175.1268,), "ft/s²": (14.59390,)}

# of a run: its unit of time in s, the unit of acceleration (None: not known), and a sentence
Units = tuple[float, str | None, str]


def read_listing(chunks: Iterable[bytes]) -> dict[str, str]:
    """What the listing of a run of LS-DYNA or Radioss says: title, date, version, deck, and how the run ended."""
    head, before, ended = "", b"", "killed"
    for chunk in chunks:
        head = head or chunk.decode("latin-1")
        for match in _ENDED.finditer(before[-_OVERLAP:] + chunk):
            ended = match[1].replace(b" ", b"").decode().lower() if match[1] else "killed"
        before = chunk
    stated = {name: line[1].strip() for name, words in _STATED.items() if (line := words.search(head))}
    version = " ".join(dict.fromkeys(_VERSION.findall(head)[:2]))
    stated |= {"date": iso_date(stated.get("date", ""), "%m/%d/%Y"), "version": version, "termination": ended}
    return {name: text for name, text in stated.items() if text}


def sha256_of(chunks: Iterable[bytes]) -> str:
    """SHA-256 of a file."""
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(chunk)
    return digest.hexdigest()


@dataclass(frozen=True, eq=False, slots=True)
class History:
    """One node or rigid body along the axis of travel, in the units of the run."""

    name: str  # the node's number; body 12 for a rigid body
    title: str  # from *DATABASE_HISTORY_NODE_ID; empty if it has none
    time: FloatArray
    acceleration: FloatArray
    velocity: FloatArray  # all NaN if the file has none

    def since(self, time: float) -> "History":
        """Its states from a time on."""
        late = self.time >= time
        return replace(self, time=self.time[late], acceleration=self.acceleration[late], velocity=self.velocity[late])

    @property
    def lacks_acceleration(self) -> bool:
        """Whether the file has velocities alone."""
        return bool(np.isnan(self.acceleration).all() and np.isfinite(self.velocity).all())


def _is_aliased(node: History) -> bool:
    """Whether accelerations lack or fail to reproduce the velocity."""
    change, goes_on = node.velocity - node.velocity[0], bool((np.diff(node.time) > 0).all())
    if node.lacks_acceleration and node.time.size > 1:
        return goes_on
    if not goes_on or not np.isfinite([change, node.acceleration]).all() or node.time.size < 3:
        return False
    error = np.abs(integral(node.acceleration, node.time) - change).max()
    return bool(error > _ALIASED * np.abs(node.velocity).max())


def integral(values: FloatArray, time: FloatArray) -> FloatArray:
    """The integral over time by the trapezoidal rule, 0 at the start."""
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (values[1:] + values[:-1]) / 2)])


def titled_nodes(nodes: Sequence[History]) -> tuple[list[History], str] | None:
    """The nodes whose titles name a place of accelerometers, and the reason; None if no title does."""
    for where, words in PLACES_BY_TITLE.items():
        if named := [n for n in nodes if re.search(words, _words(n.title), re.I) and not is_on_a_dummy(n)]:
            return _finest(named), f"Nodes {where}, averaged: {_listed(_finest(named))}."
    return None


def is_on_a_dummy(node: History) -> bool:
    """Whether a node is one of a dummy, by its title."""
    return _DUMMY.search(_words(node.title)) is not None


def proposed_nodes(nodes: Sequence[History]) -> tuple[list[History], str]:
    """The nodes to average, and the reason."""
    if titled := titled_nodes(nodes):
        return titled
    nodes = _finest(nodes)
    travels = np.array([np.abs(integral(node.velocity, node.time)).max() for node in nodes])
    middle = np.nanmedian(travels) if np.isfinite(travels).any() else np.nan
    alike = [node for node, travel in zip(nodes, travels, strict=True) if abs(travel - middle) <= _ALIKE * middle]
    chosen = alike or nodes
    why = f"No title names an accelerometer; averaged are {len(chosen)} of {len(nodes)} that travel alike"
    return chosen, f"{why}: {_listed(chosen)}. Choose others if some lie in the crush."


def _finest(nodes: Sequence[History]) -> list[History]:
    """Only nodes of one clock can be averaged."""
    most = max(node.time.size for node in nodes)
    return [node for node in nodes if node.time.size == most]


def _listed(nodes: Sequence[History]) -> str:
    return listed(f"{node.name}{f' ({node.title})' if node.title else ''}" for node in nodes)


def _words(title: str) -> str:
    return re.sub(r"[_-]+|(?<=[a-z])(?=[A-Z])", " ", title)


_finite = partial(np.nan_to_num, nan=0.0, posinf=0.0, neginf=0.0)


def axis_of_travel(start: FloatArray, travel: Travel | None = None, fastest: FloatArray | None = None) -> int:
    """The axis given, else along which nodes set out fastest on average, or get fastest from rest (shape (3,))."""
    if travel is not None:
        return AXES.index(travel[-1])
    speeds = np.abs(_finite(start)).mean(axis=1)
    if fastest is not None and speeds.max() <= _STILL * fastest.max():
        speeds = fastest
    return int(speeds.argmax())


def departure_time(nodes: Sequence[History], travel: Travel | None) -> float:
    """When the velocity of nodes at rest is set, as after a preload; else their first time.

    They speed up as their accelerations do not tell, or as the user says (``travel``), and brake from there.
    """
    nodes = _finest([node for node in nodes if not is_on_a_dummy(node)] or nodes)
    time, speed = nodes[0].time, np.median([np.abs(node.velocity) for node in nodes], axis=0)
    top = float(np.nan_to_num(speed).max())
    first = int((speed >= _AT_SPEED * top).argmax())
    at_rest = np.flatnonzero(speed[:first] <= _AT_REST * top)
    slow = np.flatnonzero(speed[first:] <= top / 2)
    if not at_rest.size or not slow.size or not np.isfinite(speed).all():
        return float(time[0])
    rest = int(at_rest[-1])
    set_in, braked_in = time[first] - time[rest], time[first + slow[0]] - time[first]
    change = np.median([integral(node.acceleration, node.time)[[rest, first]] for node in nodes], axis=0)
    is_told = travel is None and abs(abs(change[1] - change[0]) - top) < top / 2
    return float(time[first] if _AT_ONCE * set_in <= braked_in and not is_told else time[0])


def units_of(nodes: Sequence[History], source: str, mass: float | None = None, *, imperial: bool = False) -> Units:
    """The units of a run, by how long it lasts and how fast its nodes are, and by its mass in the run's own unit."""
    end, fastest = float(nodes[0].time[-1]), max(float(np.abs(node.velocity).max()) for node in nodes)
    refuse_if(not 0 < end <= _LONGEST_MS, source, "a crash in s or ms", f"one that ends at {end:g}", "choose another")
    step = (end - float(nodes[0].time[0])) / max(nodes[0].time.size - 1, 1)
    told = f"the run ends at {end:.4g} and its nodes move at up to {fastest:.4g}"
    if end > LONGEST_S or (step > _SLOWEST_S and not fastest >= _SLOWEST_MMPS):
        return MS, "mm/ms²", f"Units mm and ms: {told}."
    if fastest >= _SLOWEST_MMPS:
        return 1.0, "mm/s²", f"Units mm and s: {told}."
    may_be = ("m/s²", "ft/s²") if 0 < fastest <= FASTEST_MPS else ("in/s²", "cm/s²")
    fitting = [unit for unit in may_be if mass is not None and mass_unit_kg(mass, unit) is not None]
    if imperial and len(fitting) == 1 and fitting[0] != "m/s²":
        return 1.0, fitting[0], f"Units {fitting[0].partition('/')[0]} and s, by the mass: {told}."
    if may_be[0] == "m/s²" and (fitting or not imperial or not _is_too_hard(nodes)):
        return 1.0, "m/s²", f"SI units: {told}."
    speeds = (number(fastest * ACCELERATION_UNITS[of] / KPH, ".1f") for of in may_be)
    options = " or ".join(f"{kph} km/h if in {of}" for kph, of in zip(speeds, may_be, strict=True))
    return 1.0, None, f"Unit of length unknown: {told}, {options}."


def _is_too_hard(nodes: Sequence[History]) -> bool:
    initial, stops = initial_speed(nodes), []
    for node in nodes:
        stopped = node.velocity * np.sign(node.velocity[0]) <= 0
        stops += [float(node.time[stopped.argmax()] - node.time[0])] if stopped.any() else []
    is_hard = bool(stops and initial > _HARD_MPS2 * float(np.median(stops)))
    return initial > _FAST_MPS or (is_hard and initial > _FAST_MPS / 2)  # else too slow in ft


def initial_speed(nodes: Sequence[History]) -> float:
    """The median speed at which nodes set out, in the units of the run."""
    return float(np.median([abs(node.velocity[0]) for node in nodes]))


def departure(
    nodes: Sequence[History], units: Units, motion: tuple[FloatArray, FloatArray], travel: Travel | None, source: str
) -> tuple[float | None, str, str]:
    """The speed in m/s at which the nodes set out, why it is unknown, and a sentence on their direction.

    ``motion`` are velocities of all nodes at the start, shape (3, n_nodes), and the largest along each axis.
    """
    per_second, unit, units_sentence = units
    per_mps = None if unit is None else ACCELERATION_UNITS[unit] * per_second  # of a velocity
    initial = initial_speed(nodes)
    largest = max(float(np.nan_to_num(np.abs(node.velocity)).max()) for node in nodes)
    axis, start = axis_of_travel(motion[0], travel), _finite(motion[0])
    found = f"{'-' * bool(start[axis].sum() < 0)}{AXES[axis]}"
    is_fast = initial > 0 and initial >= _LEAST_OF_FASTEST * largest
    moves = is_fast and (per_mps is None or initial * per_mps >= _SLOWEST_MPS)
    at_start, at_most = _by_axis(np.abs(start).max(axis=1), per_mps), _by_axis(motion[1], per_mps)
    # whether half of the nodes set out along another axis, too; of a wheel's, not all do
    middle = np.median(np.abs(start), axis=1)
    is_aslant = bool(middle[axis] > 0 and (middle > _OBLIQUE * middle[axis]).sum() > 1)
    expected = "a vehicle that travels along one axis" if moves else "nodes fastest at the start"
    advice = "give axis and speed (--travel, --speed-kph)"
    is_lost = travel is None and (not moves or is_aslant)
    refuse_if(is_lost, source, expected, f"{at_start} at the start, at most {at_most}", advice)
    is_still = not largest * (per_mps or 1.0) > (_SLOWEST_MPS if per_mps else 0.0)
    expected, advice = f"nodes that move along {travel}, as given", "check --travel"
    refuse_if(travel is not None and is_still, source, expected, f"at most {at_most}", advice)
    expected, advice = f"nodes that set out along {travel}", f"check the direction (--travel {found})"
    refuse_if(moves and travel not in (None, found), source, expected, f"along {found}", advice)
    sentence = f"Travel along {travel or found}, {'as the nodes set out' if travel is None else 'given by the user'}."
    if is_aslant:
        sentence = f"Careful: travel along {travel}, given by the user, but nodes set out at {at_start} at most."
    if not moves:
        return None, f"nodes at rest along {AXES[axis]} at the start", sentence
    if per_mps is None or not np.isfinite(initial):
        return None, f"a {units_sentence[0].lower()}{units_sentence[1:].rstrip('.')}", sentence
    return initial * per_mps, "", sentence


def _by_axis(speeds: FloatArray, per_mps: float | None) -> str:
    texts = (f"{axis} {speed:.3g}" for axis, speed in zip(AXES, speeds * (per_mps or 1.0), strict=True))
    return f"{', '.join(texts)} {'in the unit of the file' if per_mps is None else 'm/s'}"


def note_of_kept(kept: int, total: int) -> list[str]:
    """That not all nodes are kept, if so."""
    return [f"{kept} of {total} nodes are kept, titled ones first."] if kept < total else []


def mass_unit_kg(mass: float, unit: str | None) -> float | None:
    """The unit of mass in kg, of those that go with a unit of acceleration, by the size of a vehicle's mass."""
    kilograms = _MASSES_KG.get(unit or "", ())
    heaviest = _HEAVIEST_CAR_KG if len(kilograms) == 1 else 60_000
    return next((one for one in kilograms if 300 <= mass * one <= heaviest), None)


def run_record(
    run_id: str,
    source: str,
    nodes: Sequence[History],
    proposed: Sequence[History],
    units: Units,
    speed_or_why: tuple[float | None, str],
    mass_and_source: tuple[float | None, str],  # in the unit of the run
    quality: RunQuality,
    steps: Sequence[str],
    about: Mapping[str, str],
    wall: tuple[FloatArray, FloatArray] | None = None,
) -> Record:
    """The record of a run: its nodes as channels, and what its quantities add to the steps."""
    per_second, unit, _ = units
    (speed_mps, no_speed), (mass, mass_of) = speed_or_why, mass_and_source
    told, of_mass = list(steps), None if mass is None else mass_unit_kg(mass, unit)
    mass_kg = None if mass is None or of_mass is None else mass * of_mass
    if any(node.lacks_acceleration for node in proposed):
        told.append("The run has no accelerations; they are taken from the velocities.")
    elif any(map(_is_aliased, proposed)):
        told.append("Accelerations that do not add up are taken from the velocities.")
    if speed_mps is not None:
        told.append(Sentence("Speed {}, at which it sets out.", speed(speed_mps, form=".4g")))
    if mass_kg is not None:
        told.append(Sentence(f"Mass {{}}, {mass_of}.", weight(mass_kg)))
    values = [getattr(quality, name) for name in QUALITIES]
    shares = [
        f"{label} not recorded" if value is None else f"{label} {number(100 * value, '.3g')} % of {whole}"
        for label, value, whole in zip(QUALITIES.values(), values, _SHARE_OF, strict=True)
    ]
    told.append(f"Run quality: {', '.join(shares)}.")
    channels = []
    for node in nodes:
        accel = np.gradient(node.velocity, node.time) if _is_aliased(node) else node.acceleration
        label = node.title or ("rigid body" if node.name.startswith("body") else "node")
        channels.append(RecordedChannel(node.name, label, per_second * node.time, accel, unit))
    names = tuple(node.name for node in proposed)
    force = None
    if wall is not None and unit in _MASSES_KG and wall[0].size > 1:
        told.append("Force of the barrier: that of all rigid walls.")
        stopped = impulse_mass(wall, proposed)
        scale = of_mass or mass_unit_kg(stopped, unit) or _MASSES_KG[unit][0]
        force = Wall(per_second * wall[0], scale * ACCELERATION_UNITS[unit] * wall[1])
    found = (PartialCondition(speed_mps, mass_kg), tuple(channels), names, tuple(told))
    return Record(run_id, source, *found, no_speed=no_speed, quality=quality, about=about, wall=force)


def impulse_mass(wall: tuple[FloatArray, FloatArray], nodes: Sequence[History]) -> float:
    """The mass that a barrier stops, in the unit of the run; 0 if none."""
    changes = [float(np.nan_to_num(np.abs(node.velocity - node.velocity[0]).max())) for node in nodes]
    change = float(np.median(changes)) if nodes else 0.0
    return float(np.abs(integral(wall[1], wall[0])).max()) / change if change > 0 and wall[0].size > 1 else 0.0


def quality_by_histories(
    total: FloatArray | None = None,  # energy: kinetic, internal, contact, hourglass and whatever else is kept or lost
    work: FloatArray | None = None,  # done from outside
    internal: FloatArray | None = None,
    hourglass: FloatArray | None = None,
    added_mass_percent: FloatArray | None = None,  # by mass scaling, of the mass without it
) -> RunQuality:
    """The quality of a run by its global histories, shape (n,); None where the solver did not write one."""
    most_hourglass, most_internal, added = (
        None if of is None or not of.size or not np.isfinite(of).all() else float(of.max())
        for of in (hourglass, internal, added_mass_percent)
    )
    share = None
    if most_hourglass is not None and most_internal is not None and most_internal > 0:
        share = most_hourglass / most_internal
    gained = None
    if total is not None and work is not None and total.size and total[0] > 0:
        change = (total - work) - (total[0] - work[0])
        gained = float(change[np.abs(change).argmax()] / total[0]) if np.isfinite(change).all() else None
    return RunQuality.of(gained, share, None if added is None else added / 100)
