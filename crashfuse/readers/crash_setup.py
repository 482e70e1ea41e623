"""What a file calls a test that is not the crash modelled here: full-frontal into a barrier."""

import re
from collections.abc import Iterable

from crashfuse.errors import printable

_VEHICLE = r"(?:car|vehicle|veh|fahrzeug|pkw)"
_OTHER = re.compile(
    rf"\b{_VEHICLE}[ _-]*(?:to|2|into|vs\.?|against|gegen|-)[ _-]*(?:other )?{_VEHICLE}s?\b|\b(?:v2v|c2c|vtv)\b|"
    r"\b(?:small|moderate|partial|narrow)[ _-]*(?:\w+[ _-]*)?overlap|\bdeformable\b|\bm?pdb\b|\bodb\b|"
    r"\boffset[ _-]*(?:frontal|barrier|crash|impact|test|deform\w*)|\b(?:frontal|front|%)[ _-]*offset|"
    r"(?<!\d)(?:[1-9]|[1-9]\d)(?:\.\d+)? ?%[ _-]*(?:\w+[ _-]*)?(?:overlap|uberdeckung|überdeckung)|"
    r"\b(?:side|rear|lateral|far[ -]?side)[ _-]*(?:pole|impact|crash|end|collision)|\bimpactor[ _-]*into\b|\bpole\b|"
    r"\boblique\b|\broll[ -]?over\b|\bwhiplash\b|\bsled\b|\bseitena\w+|\bhecka\w+|\bpfahl\w*|\bschlitten\w*",
    re.IGNORECASE,
)


def other_setup(texts: Iterable[str]) -> str:
    """The first of these texts (title, type of the test …) that names another crash; empty if none does."""
    return next((printable(text.strip(), 80) for text in texts if _OTHER.search(text[:1000])), "")
