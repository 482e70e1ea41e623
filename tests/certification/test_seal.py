"""Seals: what was changed is found and placed, whoever changed it; a key of another kind is refused in a sentence."""

import base64
import json
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crashfuse import cli
from crashfuse.certification.seal import (
    FILE,
    REVIEW,
    SEAL,
    _of_lines,
    _write,
    key_name,
    make_keys,
    read_key,
    rests_on,
    seal,
    verify,
)
from crashfuse.errors import DataError, UsageError
from tests.conftest import Capture, problems_of

TABLE = b"held_out,verdict,measured\nT01,met,410.25\nT02,not met,455.5\nT\xc3\xbc3,open,431\n"
RECORD = {"date": "2026-11-27T10:00:00+00:00", "cells": {"M01": {"crush": ["met", 0.97]}, "M02": {"crush": ["open"]}}}


@pytest.fixture
def maker(tmp_path: Path) -> Path:
    """A private key."""
    make_keys(tmp_path / "maker")
    return tmp_path / "maker"


@pytest.fixture
def sealed(tmp_path: Path, maker: Path) -> Path:
    """A sealed folder of two files."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / FILE).write_text(json.dumps(RECORD), encoding="utf-8")
    (folder / "track_record.csv").write_bytes(TABLE)
    seal(folder, read_key(maker, "private"), {"tests.csv": "ab"}, "cd")
    return folder


def test_keys_are_a_pair_that_no_one_else_reads(tmp_path: Path, capsys: Capture) -> None:
    """Mode 0600, never written over; the public one is in a form that other programs read."""
    path = tmp_path / "mine"
    assert cli.main(["key", str(path)]) == cli.DONE
    name = key_name(read_key(tmp_path / "mine.pub", "public"))
    assert name in capsys.readouterr().out
    assert key_name(read_key(path, "private").public_key()) == name
    assert path.stat().st_mode & 0o777 == 0o600
    before = path.read_bytes()
    with pytest.raises(UsageError, match="is there already"):
        make_keys(path)
    assert path.read_bytes() == before


def test_a_seal_holds_what_it_rests_on_and_follows(sealed: Path, maker: Path, capsys: Capture) -> None:
    """The signature is one of Ed25519 over the very bytes of the file, so that any program can check it."""
    told = verify(sealed, maker.with_name("maker.pub"))
    assert (told.key, told.before, told.reviewer) == (key_name(read_key(maker, "private").public_key()), "cd", None)
    assert dict(told.rests_on) == {"tests.csv": "ab"}
    assert list(told.files) == ["track_record.csv"]
    values = json.loads((sealed / SEAL).read_text())
    key = Ed25519PublicKey.from_public_bytes(base64.b64decode(values["public_key"]))
    key.verify(base64.b64decode(values["signature"]), (sealed / FILE).read_bytes())
    assert cli.main(["verify", str(sealed)]) == cli.DONE
    assert "shows only one that you were given" in capsys.readouterr().out


@pytest.mark.parametrize("name", [FILE, "track_record.csv"])
@pytest.mark.parametrize(
    "change",
    [
        lambda line: line.replace(b"met", b"mot"),  # a letter
        lambda line: line.replace(b"4", b"5").replace(b"0.97", b"0.98"),  # a digit
        lambda line: line + b" ",
        lambda line: line + b"\r",
        lambda line: b"\xef\xbb\xbf" + line,
        lambda line: line + b"\x00",
        lambda line: line + b"\xff",
        lambda line: line + "\N{ZERO WIDTH SPACE}".encode(),
        lambda line: line.replace(b",", b";"),
        lambda line: line[1:],
        lambda line: line[:0],
    ],
)
def test_a_changed_byte_is_placed(sealed: Path, name: str, change: object) -> None:
    """Of any class: letter, digit, space, line ending, mark, null, no UTF-8, unseen, separator, removed."""
    lines = (sealed / name).read_bytes().split(b"\n")
    mark = b'        "met",' if name == FILE else b"met"
    place = next(i for i, line in enumerate(lines) if mark in line)
    lines[place] = change(lines[place])  # type: ignore[operator]
    if lines == (sealed / name).read_bytes().split(b"\n"):
        return  # has no such byte
    (sealed / name).write_bytes(b"\n".join(lines))
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.row) == (name, place + 1)
    assert problem.column == ("cells.M01.crush" if name == FILE else None)


@pytest.mark.parametrize("at", [0, 1, -1])
def test_lines_that_were_added_or_removed_are_counted(sealed: Path, at: int) -> None:
    """From where they are; a file that is gone is named."""
    table = sealed / "track_record.csv"
    lines = TABLE.split(b"\n")
    table.write_bytes(b"\n".join([*lines[: at % len(lines)], b"T09,met,1", *lines[at % len(lines) :]]))
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.found, problem.row) == ("1 more lines, from here on", at % len(lines) + 1)
    table.write_bytes(b"\n".join(lines[:-2]) + b"\n")
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.found, problem.row) == ("1 fewer lines, from here on", 4)
    table.unlink()
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.found) == ("track_record.csv", "no such file")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_changed_byte_of_any_file_passes(sealed: Path, data: st.DataObject) -> None:
    """Neither in what was sealed nor in the seal; a seal that reads as before in other bytes may."""
    name = data.draw(st.sampled_from([FILE, "track_record.csv", SEAL]))
    before = (sealed / name).read_bytes()
    place = data.draw(st.integers(0, len(before) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda value: value != before[place]))
    after = before[:place] + bytes([byte]) + before[place + 1 :]
    (sealed / name).write_bytes(after)
    try:
        told = verify(sealed)
    except DataError:
        pass
    else:
        assert name == SEAL
        assert told.key == json.loads((sealed / FILE).read_text())["seal"]["key"]
    finally:
        (sealed / name).write_bytes(before)


def test_whoever_seals_it_anew_has_another_key(sealed: Path, maker: Path, tmp_path: Path) -> None:
    """What was changed and sealed again holds by its own key, and not by the one that the reviewer was given."""
    make_keys(tmp_path / "forger")
    (sealed / "track_record.csv").write_bytes(TABLE.replace(b"not met", b"met"))
    seal(sealed, read_key(tmp_path / "forger", "private"), {}, None)
    assert verify(sealed).key == key_name(read_key(tmp_path / "forger.pub", "public"))
    (problem,) = problems_of(lambda: verify(sealed, maker.with_name("maker.pub")))
    assert (problem.where, key_name(read_key(maker.with_name("maker.pub"), "public")) in problem.expected) == (
        SEAL,
        True,
    )


def test_lines_that_a_forger_wrote_place_nothing(sealed: Path) -> None:
    """Digests of lines are signed, too: with others, a change is found, and no line is named."""
    values = json.loads((sealed / SEAL).read_text())
    values["lines"][FILE] = "0" * len(values["lines"][FILE])
    (sealed / SEAL).write_text(json.dumps(values))
    (sealed / FILE).write_bytes((sealed / FILE).read_bytes() + b" ")
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.row) == (FILE, None)


def test_a_review_is_signed_once_all_holds_and_one_key_for_both_is_told(
    sealed: Path, maker: Path, tmp_path: Path, capsys: Capture
) -> None:
    """A review of another file does not hold; a maker who reviews is told."""
    make_keys(tmp_path / "reviewer")
    assert cli.main(["verify", str(sealed), "--seal", str(tmp_path / "reviewer")]) == cli.DONE
    assert "one key" not in capsys.readouterr().out
    assert verify(sealed).reviewer == key_name(read_key(tmp_path / "reviewer.pub", "public"))
    assert cli.main(["verify", str(sealed), "--seal", str(maker)]) == cli.DONE
    assert "Maker and reviewer have one key" in capsys.readouterr().out
    values = json.loads((sealed / REVIEW).read_text())
    values["signature"] = json.loads((sealed / SEAL).read_text())["signature"]  # the seal is no review
    (sealed / REVIEW).write_text(json.dumps(values))
    (problem,) = problems_of(lambda: verify(sealed))
    assert problem.where == REVIEW
    (sealed / "track_record.csv").write_bytes(b"")
    (sealed / REVIEW).unlink()
    assert cli.main(["verify", str(sealed), "--seal", str(maker)]) == cli.WRONG_DATA
    assert not (sealed / REVIEW).exists()


def test_files_of_the_campaign_are_compared_where_it_is_given(sealed: Path, maker: Path, campaign_folder: Path) -> None:
    """Each by its place; changed ones, those that are gone and those that came are named."""
    (campaign_folder / "archive.cfa").write_bytes(b"past vehicles")
    seal(sealed, read_key(maker, "private"), rests_on(campaign_folder), None)
    assert verify(sealed, campaign=campaign_folder)
    assert {"archive.cfa", "tests.csv", "tests/T1.csv", "cae_pulses.parquet"} <= set(verify(sealed).rests_on)
    (campaign_folder / "tests.csv").write_bytes(b"x")
    (campaign_folder / "tests" / "T1.csv").unlink()
    found = {p.where: p.found for p in problems_of(lambda: verify(sealed, campaign=campaign_folder))}
    assert found == {"tests.csv": "another one", "tests/T1.csv": "no such file"}
    (campaign_folder / "criteria.toml").write_text("")  # those from elsewhere are looked for beside it
    other = sealed.parent / "criteria.toml"
    other.write_text("confidence = 0.9")
    seal(sealed, read_key(maker, "private"), rests_on(campaign_folder, other, None), None)
    assert {"criteria.toml", "../criteria.toml"} <= set(verify(sealed, campaign=campaign_folder).rests_on)
    other.write_text("other")
    (campaign_folder / "notes.csv").write_text("test,note\n")
    found = {p.where: p.found for p in problems_of(lambda: verify(sealed, campaign=campaign_folder))}
    assert found == {"../criteria.toml": "another one", "notes.csv": "one that was added since"}


def test_a_key_of_the_wrong_kind_is_refused_in_a_sentence(sealed: Path, maker: Path, tmp_path: Path) -> None:
    """Public for private, private for public, RSA, with a password, no key at all, and no file."""
    other, locked, none = tmp_path / "rsa", tmp_path / "locked", tmp_path / "none"
    pem, pkcs8 = form.Encoding.PEM, form.PrivateFormat.PKCS8
    other.write_bytes(rsa.generate_private_key(65537, 2048).private_bytes(pem, pkcs8, form.NoEncryption()))
    locked.write_bytes(read_key(maker, "private").private_bytes(pem, pkcs8, form.BestAvailableEncryption(b"x")))
    none.write_text("no key")
    public = maker.with_name("maker.pub")
    for path, found in ((public, "a public key"), (other, "RSA"), (locked, "password"), (none, "no key")):
        (problem,) = problems_of(lambda path=path: read_key(path, "private"))  # type: ignore[misc]
        assert found in problem.found, path
    for path, found in ((maker, "a private key"), (none, "no key"), (tmp_path / "gone", "no such file")):
        (problem,) = problems_of(lambda path=path: verify(sealed, path))  # type: ignore[misc]
        assert found in problem.found, path


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"{}", b"\xff", b"[" * 99_999, b'{"public_key": 1}', b'{"public_key": "", "signature": ""}']
)
def test_a_seal_that_is_none_is_refused_in_a_sentence(sealed: Path, content: bytes) -> None:
    """Whatever it holds; without any it is asked for."""
    (sealed / SEAL).write_bytes(content)
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.found) == (SEAL, "another file, or a damaged one")
    (sealed / SEAL).unlink()
    (problem,) = problems_of(lambda: verify(sealed))
    assert problem.found == "no such file or directory"


def test_a_sealed_name_elsewhere_is_not_read(sealed: Path, maker: Path) -> None:
    """A forger's own seal may name any file of this machine."""
    values = json.loads((sealed / FILE).read_text())
    values["seal"]["files"] = {"../../etc/passwd": "00"}
    (sealed / FILE).write_text(json.dumps(values))
    signed = {"signature": (sealed / FILE).read_bytes(), "lines_signature": _of_lines({FILE: ""})}
    _write(sealed / SEAL, read_key(maker, "private"), signed, lines={FILE: ""})
    (problem,) = problems_of(lambda: verify(sealed))
    assert problem.where == FILE
