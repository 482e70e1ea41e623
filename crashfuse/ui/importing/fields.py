"""Fields of an import: detected values are shown in grey, values filled in take precedence."""

from collections.abc import Sequence

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from crashfuse.campaign_folder.condition_tables import Role
from crashfuse.errors import DataError, UsageError
from crashfuse.files.csv_text import without_formulas
from crashfuse.importing import Choices, ColumnChoice, Reading, Settled, settle
from crashfuse.importing.sources import tables_of
from crashfuse.importing.tables import TableForm
from crashfuse.readers.format import TRAVELS, Travel
from crashfuse.readers.formats import FORMATS, TABLES
from crashfuse.readers.record import Record
from crashfuse.readers.table_headers import ColumnRole
from crashfuse.readers.table_mapping import QUANTITIES
from crashfuse.readers.vocabulary import ACCELERATION_UNITS, UNITS
from crashfuse.ui.importing.condition import Units, condition_of, units_of
from crashfuse.ui.importing.session import Source, forms_of
from crashfuse.ui.text import plain
from crashfuse.units import MS

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
_CLASSES: dict[str, float | str] = {
    **{f"CFC {cfc}": float(cfc) for cfc in (60, 180, 600, 1000)},
    "Not filtered": "none",
}
_SIGNS = {"Deceleration negative": "negative", "Deceleration positive": "positive"}


def reading_of(source: Source) -> Reading:
    """Ask how to read a source: direction of travel, what columns of tables mean, which table has the conditions."""
    if source.fmt == TABLES:
        return _reading_of_tables(source)
    travel = _travel(source) if FORMATS[source.fmt].axes else None
    tables = {path.name: path for path in tables_of(source.path)} if source.path.is_dir() else {}
    if not tables:
        return Reading(source.path, source.fmt, travel=travel)
    forms = forms_of(source)
    known = {file for form in forms if form.proposed.kind == "conditions" for file in _files(form)}
    names = list(tables)
    name = st.selectbox(
        "Table of conditions, by id",
        names,
        index=names.index(next(iter(known))) if len(known) == 1 else None,
        placeholder="none",
        key=f"{source.key} conditions",
        persist_state="session",
    )
    if name is None:
        return Reading(source.path, source.fmt, travel=travel)
    columns = tuple(choice for form in forms if name in _files(form) for choice in _columns(form, source.key))
    return Reading(source.path, source.fmt, columns, conditions=tables[name], travel=travel)


def _reading_of_tables(source: Source) -> Reading:
    forms = forms_of(source)
    columns = tuple(choice for form in forms[:_MOST_FORMS] for choice in _columns(form, source.key))
    if len(forms) > _MOST_FORMS:
        st.caption(f"{len(forms) - _MOST_FORMS} more kinds of tables are read as their headers say.")
    role_of = {choice.column: choice.role for choice in columns}
    pulses = [[role_of.get(use.column, use.role) for use in form.proposed.uses] for form in forms]
    chosen = "each"
    if any(roles.count("acceleration") > 1 for roles in pulses):
        chosen = st.radio(
            "Accelerations in one table are",
            ["each", "averaged"],
            # one crash taken for several tests would be predicted from itself
            index=0 if any(form.proposed.kind == "conditions" for form in forms) else 1,
            format_func={"each": "Each a record of its own", "averaged": "Sensors of one record"}.__getitem__,
            key=f"{source.key} together",
            persist_state="session",
        )
    return Reading(source.path, source.fmt, columns, together=chosen == "averaged")


def _files(form: TableForm) -> set[str]:
    """The files with such a table; each has one, or several in sheets."""
    return {name.partition(": ")[0] for name in form.names}


def _travel(source: Source) -> Travel | None:
    travel: Travel | None = st.selectbox(
        "Direction of travel",
        TRAVELS,
        index=None,
        placeholder="to be found",
        format_func=lambda travel: travel.replace("-", "−").upper(),
        key=f"{source.key} travel",
        persist_state="session",
        help="Along which axis of the files the vehicle drives. Found from the motion at the start, if you leave it.",
    )
    return travel


def _columns(form: TableForm, source_key: str) -> tuple[ColumnChoice, ...]:
    """Ask for the meaning of the columns of tables with these headers."""
    key = f"{source_key} {hash(form.columns)}"
    rest = f" and {len(form.names) - 1} more with the same columns" if len(form.names) > 1 else ""
    with st.container(border=True):
        st.markdown(f"**{plain(form.names[0])}**{rest}")
        st.dataframe(without_formulas(form.head.iloc[:, :_MOST_COLUMNS]), hide_index=True, height="content")
        holds = st.segmented_control(
            "It holds",
            ["pulses", "conditions", "neither"],
            default=form.proposed.kind,
            required=True,
            format_func=str.capitalize,
            key=f"{key} holds",
            persist_state="session",
        )
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
                units[role] = place.selectbox(
                    f"Unit of {role.replace('_', ' ')}",
                    list(UNITS[QUANTITIES[role]]),
                    index=None,
                    placeholder=form.unit_of(picked[role]) or "?",
                    key=f"{key} unit of {role}",
                    persist_state="session",
                    disabled=not picked[role],
                    label_visibility="visible" if below else "collapsed",
                    width="stretch" if below else _UNIT_PX,
                )
    return form.choices(picked, units)


def _pick(place: DeltaGenerator, form: TableForm, role: ColumnRole, label: str, key: str) -> Sequence[str]:
    proposed = [use.column for use in form.proposed.of(role)]
    key = f"{key} {role}"
    if role in _SEVERAL:
        return place.multiselect(
            label, form.columns, default=proposed, key=key, placeholder="none", persist_state="session", wrap=True
        )
    column = place.selectbox(
        label,
        form.columns,
        index=form.columns.index(proposed[0]) if proposed else None,
        placeholder="the table's name" if role == "id" and label in _OF_PULSES.values() else "none",
        key=key,
        persist_state="session",
    )
    return () if column is None else (column,)


def choices_of(
    source: Source, records: Sequence[Record], first: Record, role: Role, own_class: float | None
) -> tuple[Choices, Units]:
    """Ask for everything that should not be detected automatically, and for the units of the condition.

    The answers hold for all records; ``first`` is the one shown. With ``own_class`` the campaign filters its
    records itself.
    """
    channels = _channels(source, records, first)
    units = units_of(source)
    condition, share = condition_of(source, records, units)
    found = _found(first, Choices(channels=channels, condition=condition, front_share=share), role)
    left, right = st.columns(2)
    unit = _field(left, "Unit", list(ACCELERATION_UNITS), found.unit if found else None, source)
    detected_sign = f"Deceleration {found.deceleration_sign}" if found else None
    sign = _field(right, "Sign", list(_SIGNS), detected_sign, source)
    left, right = st.columns(2)
    zero_ms = left.number_input(
        "Time zero (ms)",
        value=None,
        placeholder="to be found" if found is None else f"{found.time_zero_s / MS:.4g}",
        key=f"{source.key} time zero",
        persist_state="session",
        help="First contact, in the file's own time.",
    )
    if own_class is not None:
        right.selectbox("Filter", [f"CFC {own_class:g}, by the campaign"], disabled=True, key=f"{source.key} own class")
        cfc: float | str | None = own_class
    else:
        own = found.channel_filter_class if found else None
        detected = f"CFC {own:g}" if own is not None else "Not filtered"
        name = _field(right, "Filter", list(_CLASSES), detected if found else None, source)
        cfc = _CLASSES[name] if name else None
    gap_mm = None
    if role == "cae":
        gap_mm = st.number_input(
            "Gap before the barrier (mm)",
            value=None,
            min_value=0.0,
            placeholder="none",
            key=f"{source.key} gap",
            persist_state="session",
            help="How far the vehicle moves in the run before it meets the barrier.",
        )
    choices = Choices(
        channels,
        unit,
        _SIGNS.get(sign or ""),  # type: ignore[arg-type]
        None if zero_ms is None else zero_ms * MS,
        None if gap_mm is None else gap_mm * MS,
        cfc,  # type: ignore[arg-type]
        condition,
        share,
    )
    return choices, units


def _channels(source: Source, records: Sequence[Record], first: Record) -> tuple[str, ...]:
    if all(len(record.channels) == 1 for record in records):
        return ()
    labels = {channel.name: channel.label for record in reversed(records) for channel in record.channels}
    names = [channel.name for channel in first.channels] if first.channels else []
    names += [name for name in labels if name not in names]
    chosen = st.multiselect(
        "Channels, averaged",
        names,
        default=records[0].proposed,
        format_func=lambda name: name if labels[name] in name else f"{name} · {labels[name]}",
        key=f"{source.key} channels {hash(frozenset(names))}",
        persist_state="session",
        wrap=True,
        help="All that could be the vehicle's pulse along X. Those that are proposed are filled in.",
    )
    return () if tuple(chosen) == records[0].proposed else tuple(chosen)


def _field(place: DeltaGenerator, label: str, options: list[str], found: str | None, source: Source) -> str | None:
    return place.selectbox(
        label,
        options,
        index=None,
        placeholder=found or "to be found",
        key=f"{source.key} {label}",
        persist_state="session",
    )


def _found(record: Record, choices: Choices, role: Role) -> Settled | None:
    """What is detected in a record without any of the user's values."""
    try:
        return settle(record, choices, role=role)
    except (DataError, UsageError):
        return None
