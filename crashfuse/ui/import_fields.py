"""Fields of an import: detected values are shown in grey, values filled in take precedence."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import DataError, UsageError
from crashfuse.files.csv_text import without_formulas
from crashfuse.importing import Choices, ColumnChoice, Reading, Settled, settle
from crashfuse.importing.sources import TableForm, tables_of
from crashfuse.readers.formats import FORMATS, TABLES
from crashfuse.readers.record import PartialCondition, Record
from crashfuse.readers.table_headers import ColumnRole
from crashfuse.readers.table_mapping import QUANTITIES
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, TRAVELS, UNITS, Travel
from crashfuse.ui.kit import address
from crashfuse.ui.kit.address import kept
from crashfuse.ui.kit.text import chosen_units, plain
from crashfuse.ui.kit.uploads import Source, forms_of
from crashfuse.units import KPH_KG, MS, UnitSystem

_WEIGHTS = ("front weight", "rear weight", "mass")
_OF_PULSES: dict[ColumnRole, str] = {"time": "Time", "acceleration": "Acceleration along X", "id": "Ids"}
_OF_CONDITIONS: dict[ColumnRole, str] = {
    "id": "Ids",
    "speed": "Speed",
    "front_weight": "Front weight",
    "rear_weight": "Rear weight",
    "mass": "Mass",
    "front_share": "Front share",
    "factor": "Other columns to keep",
}
_SEVERAL: tuple[ColumnRole, ...] = ("acceleration", "factor")
_MOST_FORMS, _MOST_COLUMNS = 4, 30  # shown; the others are read as proposed
_UNIT_PX = 110
_CLASSES: dict[str, float | str] = {f"CFC {cfc}": float(cfc) for cfc in (60, 180, 600, 1000)} | {"Not filtered": "none"}
_SIGNS = {"Deceleration negative": "negative", "Deceleration positive": "positive"}


def _condition_of(source: Source, records: Sequence[Record]) -> tuple[PartialCondition, float | None, UnitSystem]:
    (left, right), usual = st.columns(2), chosen_units() if st.session_state.get("system") else KPH_KG
    v = _choose_unit(left, "Speed in", usual.speed, tuple(UNITS["speed"]), source)
    w = _choose_unit(right, "Weights in", usual.weight, ("kg", "lb"), source)
    mps, kg = UNITS["speed"][v], UNITS["mass"][w]
    names = "speed", "front share", *_WEIGHTS
    speed, share, front, rear, mass = (st.session_state.get(f"{source.key} {name}") for name in names)
    given = PartialCondition(speed, mass, front, rear)
    conditions = [record.condition.overruled(replace(given, front_share=share)) for record in records]
    pairs = [(at.front_weight_kg, at.rear_weight_kg) for at in conditions]
    sums = [None if None in pair else sum(filter(None, pair)) for pair in pairs]
    fronts, rears = zip(*pairs, strict=True)
    masses = [at.mass_kg or whole for at, whole in zip(conditions, sums, strict=True)]
    shares = [front and whole and front / whole for front, whole in zip(fronts, sums, strict=True)]
    speeds, above, (left, right) = [at.speed_mps for at in conditions], st.container(), st.columns(2)
    _number(above, f"{source.key} speed", f"Speed ({v})", speeds, mps)
    _number(left, f"{source.key} front weight", f"Front weight ({w})", fronts, kg)
    _number(right, f"{source.key} rear weight", f"Rear weight ({w})", rears, kg)
    _number(left, f"{source.key} mass", f"Mass ({w})", masses, kg)
    _number(right, f"{source.key} front share", "Front share (%)", shares, 0.01, "Of the mass, on the front axle.")
    return given, share, UnitSystem("mph" if v == "mph" else "km/h", "lb" if w == "lb" else "kg")


def _choose(
    place: DeltaGenerator, label: str, options: Iterable[Any], grey: str | None, key: str, **look: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401 - one of the options  # fmt: skip
    grey = grey or "to be found"
    return place.selectbox(label, list(options), index=None, placeholder=grey, **kept(key, **look))


def _choose_unit(place: DeltaGenerator, label: str, usual: str, units: Sequence[str], source: Source) -> str:
    key = f"{source.key} {label}"
    address.default(key, usual)
    return str(place.selectbox(label, units, **kept(key)))


def _number(
    place: DeltaGenerator, key: str, label: str, in_si: Sequence[float | None], unit: float, tip: str | None = None
) -> None:
    state, shown = st.session_state, f"{key} in units of {unit:g}"
    values = sorted(value / unit for value in in_si if value is not None and value > 0)
    grey = "not found"
    if values:
        grey = f"{values[0]:.5g}" if values[-1] - values[0] < 1e-6 * values[-1] else f"{values[0]:.4g}–{values[-1]:.4g}"

    def take() -> None:
        state[key] = None if state[shown] is None else state[shown] * unit

    address.put(shown, None if state.get(key) is None else float(f"{state[key] / unit:.7g}"))
    place.number_input(label, value=None, placeholder=grey, help=tip, key=shown, on_change=take)


def reading_of(source: Source) -> Reading:
    """Ask how to read a source: direction of travel, columns, table of conditions."""
    if source.fmt == TABLES:
        return _reading_of_tables(source)
    travel: Travel | None = None
    if FORMATS[source.fmt].axes:
        look: dict[str, Any] = {"help": "In the files' axes."}
        look["format_func"] = lambda travel: travel.replace("-", "−").upper()
        travel = _choose(st.container(), "Direction of travel", TRAVELS, None, f"{source.key} travel", **look)
    tables = {path.name: path for path in tables_of(source.path)} if source.path.is_dir() else {}
    if not tables:
        return Reading(source.path, source.fmt, travel=travel)
    forms, names = forms_of(source), list(tables)
    with_conditions = {file for form in forms if form.proposed.kind == "conditions" for file in _files(form)}
    place = names.index(next(iter(with_conditions))) if len(with_conditions) == 1 else None
    look = kept(f"{source.key} conditions", placeholder="none")
    name = st.selectbox("Table of conditions, by id", names, place, **look)
    if name is None:
        return Reading(source.path, source.fmt, travel=travel)
    columns = tuple(choice for form in forms if name in _files(form) for choice in _columns(form, source.key))
    return Reading(source.path, source.fmt, columns, conditions=tables[name], travel=travel)


def _reading_of_tables(source: Source) -> Reading:
    forms = forms_of(source)
    columns = tuple(choice for form in forms[:_MOST_FORMS] for choice in _columns(form, source.key))
    if len(forms) > _MOST_FORMS:
        st.caption(f"{len(forms) - _MOST_FORMS} more kinds of tables are read by their headers.")
    role_of = {choice.column: choice.role for choice in columns}
    pulses = [[role_of.get(use.column, use.role) for use in form.proposed.uses] for form in forms]
    chosen = "each"
    if any(roles.count("acceleration") > 1 for roles in pulses):
        # one crash taken for several tests would be predicted from itself
        has_conditions = any(form.proposed.kind == "conditions" for form in forms)
        words = {"each": "Each a record of its own", "averaged": "Sensors of one record"}
        look = {"index": 0 if has_conditions else 1, "format_func": words.__getitem__}
        chosen = st.radio("Accelerations in one table are", list(words), **kept(f"{source.key} together", **look))
    return Reading(source.path, source.fmt, columns, together=chosen == "averaged")


def _files(form: TableForm) -> set[str]:
    return {name.partition(": ")[0] for name in form.names}


def _columns(form: TableForm, source_key: str) -> tuple[ColumnChoice, ...]:
    key = f"{source_key} {hash(form.columns)}"
    more = f" and {len(form.names) - 1} more with the same columns" if len(form.names) > 1 else ""
    uses = form.proposed.uses
    needed = {"pulses": {"time", "acceleration"}, "conditions": {"id", "speed"}}.get(form.proposed.kind, {"none"})
    known = (use.unit if use.role in QUANTITIES else not use.is_unknown for use in uses)
    is_clear = needed <= {use.role for use in uses} and all(known)
    with st.expander(f"**{plain(form.names[0])}**{more}", expanded=not is_clear):
        st.dataframe(without_formulas(form.head.iloc[:, :_MOST_COLUMNS]), hide_index=True, height="content")
        kinds, look = ["pulses", "conditions", "neither"], {"required": True, "format_func": str.capitalize}
        holds = st.segmented_control("It holds", kinds, default=form.proposed.kind, **kept(f"{key} holds", **look))
        if holds == "neither":
            return form.nothing()
        asked = _OF_PULSES if holds == "pulses" else _OF_CONDITIONS
        picked: dict[ColumnRole, Sequence[str]] = {} if holds == "pulses" else {"time": (), "acceleration": ()}
        units: dict[ColumnRole, str | None] = {}
        for role, label in asked.items():
            below = role in _SEVERAL  # beside them names of columns would be cut to what they have in common
            place = st.container(horizontal=not below, vertical_alignment="bottom")
            picked[role] = _pick(place, form, role, label, key)
            if role in QUANTITIES:
                units[role] = _choose(
                    place, f"Unit of {role.replace('_', ' ')}", UNITS[QUANTITIES[role]],
                    form.unit_of(picked[role]) or "?", f"{key} unit of {role}", disabled=not picked[role],
                    label_visibility="visible" if below else "collapsed", width="stretch" if below else _UNIT_PX,
                )  # fmt: skip
    return form.choices(picked, units)


def _pick(place: DeltaGenerator, form: TableForm, role: ColumnRole, label: str, key: str) -> Sequence[str]:
    proposed = [use.column for use in form.proposed.of(role)]
    key = f"{key} {role}"
    if role in _SEVERAL:
        look = {"default": proposed, "placeholder": "none", "wrap": True}
        return place.multiselect(label, form.columns, **kept(key, **look))
    usual = form.columns.index(proposed[0]) if proposed else None
    none = "the table's name" if role == "id" and label in _OF_PULSES.values() else "none"
    column = place.selectbox(label, form.columns, usual, placeholder=none, **kept(key))
    return () if column is None else (column,)


def choices_of(
    source: Source, records: Sequence[Record], first: Record, role: Role, own_class: float | None
) -> tuple[Choices, UnitSystem]:
    """Ask for what should not be detected, shown of the ``first`` record, and for units."""
    channels = _channels(source, records, first)
    condition, share, units = _condition_of(source, records)
    detected: Settled | None = None
    with suppress(DataError, UsageError):
        detected = settle(first, Choices(channels=channels, condition=condition, front_share=share), role=role)
    left, right = st.columns(2)
    unit = _choose(left, "Unit", ACCELERATION_UNITS, detected.unit if detected else None, f"{source.key} Unit")
    detected_sign = f"Deceleration {detected.deceleration_sign}" if detected else None
    sign = _choose(right, "Sign", _SIGNS, detected_sign, f"{source.key} Sign")
    left, right = st.columns(2)
    zero = "to be found" if detected is None else f"{detected.time_zero_s / MS:.4g}"
    look = kept(f"{source.key} time zero", placeholder=zero, help="First contact, in the file's own time.")
    zero_ms = left.number_input("Time zero (ms)", value=None, **look)  # no limits: a browser would drop what is beyond
    if own_class is not None:
        right.selectbox("Filter", [f"CFC {own_class:g}, by the campaign"], disabled=True, key=f"{source.key} own class")
        cfc: float | str | None = own_class
    else:
        own_filter = detected.channel_filter_class if detected else None
        detected_filter = f"CFC {own_filter:g}" if own_filter is not None else "Not filtered"
        name = _choose(right, "Filter", _CLASSES, detected_filter if detected else None, f"{source.key} Filter")
        cfc = _CLASSES[name] if name else None
    gap_mm = None
    if role == "cae":
        look = {"min_value": 0.0, "placeholder": "none", "help": "The vehicle moves so far before contact."}
        gap_mm = st.number_input("Gap before the barrier (mm)", value=None, **kept(f"{source.key} gap", **look))
    zero_s, gap_m = (None if value is None else value * MS for value in (zero_ms, gap_mm))
    chosen = Choices(channels, unit, _SIGNS.get(sign or ""), zero_s, gap_m, cfc, condition, share)  # type: ignore[arg-type]
    return chosen, units


def _channels(source: Source, records: Sequence[Record], first: Record) -> tuple[str, ...]:
    if all(len(record.channels) == 1 for record in records):
        return ()
    labels = {channel.name: channel.label for record in reversed(records) for channel in record.channels}
    names = [channel.name for channel in first.channels] if first.channels else []
    names += [name for name in labels if name not in names]
    shown = {name: name if labels[name] in name else f"{name} · {labels[name]}" for name in names}
    look = {"default": records[0].proposed, "wrap": True, "help": "What could be the pulse along X."}
    key = f"{source.key} channels {hash(frozenset(names))}"
    chosen = st.multiselect("Channels, averaged", names, format_func=shown.__getitem__, **kept(key, **look))
    return () if tuple(chosen) == records[0].proposed else tuple(chosen)
