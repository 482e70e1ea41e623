"""TOML that nobody should trust, and values as TOML."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.errors import DataError
from crashfuse.files.toml_text import read_toml, toml_text

PARTS = ("a", '"a"', "'a'", ' "\\"" ', "a\t")
FORMS = ("{} = 1", "[{}]", "[[{}]]", "x = {{ {} = 1 }}", "x = [\n{{ {} = 1 }}]")


def test_keys_of_some_parts_and_texts_with_points_are_read(tmp_path: Path) -> None:
    text = 'a.b."c.d".e = "Version 1.2.3. Made by J. R. R. Doe ... 10.1016/j.x"\n[imported.T1]\ntimes = [0.1, 0.2]\n'
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    assert read_toml(tmp_path / "x.toml", 1, "") == tomllib.loads(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("\n".join(f"[a{i}{'.a' * 19}]" for i in range(60_000)), "at most 200,000 dots and brackets, found more"),
        ("\n".join(f"a{i}{'.a' * 19} = 1" for i in range(60_000)), "at most 200,000 dots and brackets, found more"),
        ("a = 1\nx = [\n1" + "0" * 3_900_000 + "]", "row 2: expected numbers of fewer than 1000 characters"),
        ("x = 0x1" + "_0" * 1_900_000, "row 1: expected numbers of fewer than 1000 characters"),
        *(("y = 1\n" + form.format(".".join([part] * 16_000)), "at most 20 parts") for part in PARTS for form in FORMS),
    ],
    ids=lambda text: text[:30],
)
def test_what_takes_a_gigabyte_to_parse_is_refused_before(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many tables or keys of many parts, and numbers of millions of digits: 0.4 to 1.2 GB for 4 MiB."""
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    monkeypatch.delattr(tomllib, "loads")
    with pytest.raises(DataError, match=said):
        read_toml(tmp_path / "x.toml", 4, "leave out what is no setting")


_TEXTS = st.text(st.characters(exclude_categories=["Cs"]))


@given(st.dictionaries(_TEXTS, _TEXTS))
def test_texts_come_back_from_toml(texts: dict[str, str]) -> None:
    assert tomllib.loads(f"x = {toml_text(texts)}\ny = {toml_text(list(texts))}") == {"x": texts, "y": list(texts)}
