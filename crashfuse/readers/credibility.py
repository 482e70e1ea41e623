"""How far a channel can be believed, by the file's own words on its source and its quality.

ISO/TS 13499 writes ``Data source`` (transducer, camera, calculation, simulation, parameter) and ``Data status`` (ok,
channel failed, meaningless data, no data, questionable data, scaling factor changed, system noise), laboratories in
spellings of their own; NHTSA's database has codes for the same.
"""

import re
from collections.abc import Iterable
from enum import IntEnum

_PROGRAM = r"ls ?dyna|ls prepost|nodout|(nodal|element) history|radioss|abaqus|pam ?crash|madymo"
_SIMULATION = re.compile(
    rf"(?<![^\W\d])({_PROGRAM}|sim(s|ula\w*)?|synthetic\w*|synthetisch\w*|cae|fe[am]?|finite element\w*|calculs?|"
    r"num[eé]ri(c|qu|sch)\w*|virtu[ae]l\w*|predict\w*|prognos\w*|vorhersage\w*|(be)?rechnung\w*|modell?$)(?![^\W\d])"
)
_STATEMENT = re.compile(r"\b(predicted by|ls dyna keyword|ls prepost|nodout|(nodal|element) history)\b")
_PARAMETER = re.compile(
    r"(?<![^\W\d])(param\w*|limit|limit (value|curve|line)s?|grenz(wert|kurve|linie)\w*|corridors?|korridor\w*)"
    r"(?![^\W\d])"
)
_COMPUTED = re.compile(r"\b(calc\w*|comput\w*|deriv\w*|cm)\b")
_SOUND = re.compile(
    r"((data|channel|sensor|signal|filtered|ok|o k|okay|am|as measured|good|valid|sound|normal|passed|accepted|checked|"
    r"correct|bon|gut|i o|in ordnung|(no|without) (remark|error|failure|fault|comment)s?|not failed|\d{2,})( |$))*|"
    r"unknown|undefined|not (specified|stated|checked|applicable)|n a|none|novalue"
)
_FAILED = re.compile(
    r"\b(fail\w*|meaningless|no (valid )?(data|signal|values?)|not (ok|o k|valid|usable|good)|nok|n i o|nio|bad|"
    r"invalid|lost|loss|broken|defect\w*|defekt\w*|destroyed|damaged|unusable|unbrauchbar|ausfall|ausgefallen|ungültig|"
    r"cf|mn|md|nd)\b"
)


class Doubt(IntEnum):
    """What speaks against a channel."""

    NONE = 0
    SOME = 1
    """Its quality is questionable, or it is computed from others; better than none."""
    FAILED = 2


def is_simulated(origin: str) -> bool:
    """Whether the words on a channel's source say that nobody measured it: a simulation, a limit, a parameter."""
    return names_a_simulation(origin) or names_a_parameter(origin)


def names_a_simulation(name: str) -> bool:
    """Whether a name is that of a simulation or a prediction."""
    return _SIMULATION.search(_plain(name)) is not None


def names_a_parameter(name: str) -> bool:
    """Whether a name is that of a limit or a parameter."""
    return _PARAMETER.search(_plain(name)) is not None


def statement_of_simulation(lines: Iterable[str]) -> str:
    """The first of the lines above a table that says that its numbers are a program's; empty if there is none."""
    return next((line.strip() for line in lines if _STATEMENT.search(_plain(line))), "")


def is_computed(origin: str) -> bool:
    """Whether the words on a channel's source say that it was computed from others."""
    return _COMPUTED.search(_plain(origin)) is not None


def doubt_of(status: str) -> Doubt:
    """What speaks against a channel, by the words on its quality; nothing where they are empty."""
    words = _plain(status)
    if _SOUND.fullmatch(words):
        return Doubt.NONE
    return Doubt.FAILED if _FAILED.search(words) else Doubt.SOME


def _plain(text: str) -> str:
    return " ".join(re.sub(r"[\W_]+", " ", text[:200].casefold()).split())
