"""How far a channel can be believed, by the file's own words on its source and its quality.

ISO/TS 13499 writes ``Data source`` (transducer, camera, calculation, simulation, parameter) and ``Data status`` (ok,
channel failed, meaningless data, no data, questionable data, scaling factor changed, system noise), laboratories in
spellings of their own; NHTSA's database has codes for the same.
"""

import re
from enum import IntEnum

_SIMULATION = re.compile(
    r"(?<![^\W\d])(sim(s|ulat\w*)?|cae|fe[am]?|finite element\w*|virtu[ae]l\w*|predict\w*|prognos\w*|vorhersage\w*|"
    r"(be)?rechnung\w*|modell?$|(nodal|element) history|nodout|ls prepost)(?![^\W\d])"
)
_PARAMETER = re.compile(
    r"(?<![^\W\d])(param\w*|limit|limit (value|curve|line)s?|grenz(wert|kurve|linie)\w*|corridors?|korridor\w*)"
    r"(?![^\W\d])"
)
_COMPUTED = re.compile(r"\b(calc\w*|comput\w*|deriv\w*|cm)\b")
_SOUND = re.compile(
    r"(data |channel )?(ok|o k|okay|am|as measured|good|valid|sound|normal|passed|accepted|i o|in ordnung)( data)?|"
    r"|unknown|undefined|not (specified|stated|checked|applicable)|n a|none|novalue|no (error|failure|fault)s?"
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
