"""Converts docstrings, which are written with Sphinx roles, to the links and equations of this site."""

import re

import griffe

_ROLE = re.compile(r":(?:mod|class|func|meth|data|attr):`([~!]?)(?:([^`<]+) <)?([^`>]+)>?`")
_MATH = re.compile(r"^( *)\.\. math::\n\n((?:\1 +.*\n|\n)+)", re.MULTILINE)
_INLINE_MATH = re.compile(r":math:`([^`]+)`")
_SESSION = re.compile(r"^( *)(>>> .*(?:\n\1(?:>>> |\.\.\. ).*)*)", re.MULTILINE)
_LITERAL = re.compile(r"(?<!`)``(?!`)")
_LITERAL_BLOCK = re.compile(r"::$", re.MULTILINE)


class Roles(griffe.Extension):
    """Rewrites each docstring before it is parsed."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Rewrite the docstring of a module, class, function or attribute."""
        if obj.docstring is not None:
            obj.docstring.value = rewritten(obj.docstring.value)


def rewritten(text: str) -> str:
    """A docstring in Markdown."""
    text = _MATH.sub(lambda found: f"{found[1]}$$\n{found[2].strip()}\n{found[1]}$$\n\n", text + "\n").rstrip()
    text = _SESSION.sub(lambda found: f"{found[1]}```python\n{_typed(found[2])}\n{found[1]}```", text)
    text = _INLINE_MATH.sub(r"$\1$", text)
    text = _ROLE.sub(lambda found: f"`{found[2] or _short(found[3], found[1])}`", text)
    return _LITERAL.sub("`", _LITERAL_BLOCK.sub(":", text))


def _typed(session: str) -> str:
    """The input typed in a session at Python's prompt."""
    return re.sub(r"^( *)(?:>>>|\.\.\.) ", r"\1", session, flags=re.MULTILINE).replace("  # doctest: +SKIP", "")


def _short(target: str, tilde: str) -> str:
    return target.rpartition(".")[2] if tilde == "~" else target.removeprefix("crashfuse.")
