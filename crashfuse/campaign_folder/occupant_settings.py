"""The occupant model of a campaign: ``[occupant]`` in ``campaign.toml``."""

from typing import Any

from crashfuse.errors import Problem, printable
from crashfuse.files.toml_text import shown
from crashfuse.signals.occupant import OCCUPANT_RANGES, USUAL_OCCUPANT, OccupantModel, likely_m

_WHERE, _TABLE = "campaign.toml", "[occupant]"


def occupant_settings(values: dict[str, Any], problems: list[Problem]) -> OccupantModel:
    """Pop ``[occupant]`` from the settings of a campaign; append its problems to ``problems``."""
    given = values.pop("occupant", {})
    if not isinstance(given, dict):
        expected = f"a table {_TABLE} with {', '.join(OCCUPANT_RANGES)}"
        problems.append(Problem(_WHERE, expected, "another value", "correct it", "occupant"))
        return USUAL_OCCUPANT
    own: dict[str, float] = {}
    for name, value in given.items():
        if name not in OCCUPANT_RANGES:
            found = printable(str(name), 60)
            problems.append(
                Problem(_WHERE, f"{', '.join(OCCUPANT_RANGES)} in {_TABLE}", found, "correct or remove it", name)
            )
            continue
        low, high = OCCUPANT_RANGES[name]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        advice = likely_m(name, value) if is_number else ""
        if is_number and low <= value <= high and not advice:
            own[name] = float(value)
        else:
            expected = f"a number from {low} to {high}"
            problems.append(Problem(_WHERE, expected, shown(value), advice or "correct the value", f"occupant.{name}"))
    return OccupantModel(**own)


def occupant_lines(occupant: OccupantModel) -> list[str]:
    """What differs from the usual model, as lines of ``campaign.toml``."""
    own = [name for name in OCCUPANT_RANGES if getattr(occupant, name) != getattr(USUAL_OCCUPANT, name)]
    return [_TABLE, *(f"{name} = {getattr(occupant, name)!r}" for name in own)] if own else []
