"""Seals: each file that was changed is named, whoever changed it; a key of another kind is refused in a sentence."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crashfuse import cli
from crashfuse.certification import seal as seals
from crashfuse.certification.seal import FILE, REVIEW, SEAL, key_name, make_keys, read_key, review, seal, verify
from crashfuse.errors import DataError, Problem, UsageError
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


@pytest.fixture
def reviewed(sealed: Path, tmp_path: Path) -> Path:
    """The folder with a review, too."""
    make_keys(tmp_path / "reviewer")
    review(sealed, read_key(tmp_path / "reviewer", "private"))
    return sealed


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_changed_byte_of_any_file_passes(reviewed: Path, data: st.DataObject) -> None:
    """Each file that was changed is named; a signature that reads as before in other bytes may pass."""
    name = data.draw(st.sampled_from([FILE, "track_record.csv", SEAL, REVIEW]))
    before, told = (reviewed / name).read_bytes(), verify(reviewed)
    place = data.draw(st.integers(0, len(before) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda value: value != before[place]))
    after = before[:place] + data.draw(st.sampled_from([bytes([byte]), b"", before[place : place + 1] + b"\r"]))
    (reviewed / name).write_bytes(after + before[place + 1 :])
    problems: Sequence[Problem] = ()
    try:
        assert verify(reviewed) == told
    except DataError as error:
        problems = error.problems
    finally:
        (reviewed / name).write_bytes(before)
    assert problems or name in (SEAL, REVIEW)
    assert all(name in f"{problem.where} {problem.found}" for problem in problems)


@pytest.mark.parametrize("name", [SEAL, REVIEW])
@pytest.mark.parametrize("field", ["public_key", "signature"])
@pytest.mark.parametrize("of_another", [False, True])
def test_no_field_of_a_signature_can_be_changed(reviewed: Path, name: str, field: str, of_another: bool) -> None:
    """Nor be left out: neither for another's, which reads as well."""
    values = json.loads((reviewed / name).read_text())
    other = json.loads((reviewed / (REVIEW if name == SEAL else SEAL)).read_text())
    changed = {key: (other if key == field else values)[key] for key in values if of_another or key != field}
    (reviewed / name).write_text(json.dumps(changed))
    (problem,) = problems_of(lambda: verify(reviewed))
    assert name in f"{problem.where} {problem.found}"


def test_a_seal_of_before_with_digests_of_lines_holds(sealed: Path) -> None:
    """They are neither signed as the file is nor believed: whatever they say, files tell by their SHA-256."""
    values = json.loads((sealed / SEAL).read_text())
    (sealed / SEAL).write_text(json.dumps({**values, "lines_signature": "AA==", "lines": {FILE: "0" * 8}}))
    assert verify(sealed)
    (sealed / "track_record.csv").unlink()
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.found) == ("track_record.csv", "no such file")


def test_whoever_seals_it_anew_has_another_key(sealed: Path, maker: Path, tmp_path: Path) -> None:
    """What was changed and sealed again holds by its own key, and not by the one that the reviewer was given."""
    make_keys(tmp_path / "forger")
    (sealed / "track_record.csv").write_bytes(TABLE.replace(b"not met", b"met"))
    forger, its_name = read_key(tmp_path / "forger", "private"), key_name(read_key(tmp_path / "forger.pub", "public"))
    seals._sign(sealed / SEAL, forger, (sealed / FILE).read_bytes())  # which names its maker
    (problem,) = problems_of(lambda: verify(sealed))
    assert (problem.where, problem.found) == (SEAL, f"one by the key {its_name}")
    seal(sealed, forger, {}, None)
    assert verify(sealed).key == its_name
    (problem,) = problems_of(lambda: verify(sealed, maker.with_name("maker.pub")))
    assert problem.where == SEAL
    assert key_name(read_key(maker.with_name("maker.pub"), "public")) in problem.expected


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
    seal(sealed, read_key(maker, "private"), seals.rests_on(campaign_folder), None)
    assert verify(sealed, campaign=campaign_folder)
    assert {"archive.cfa", "tests.csv", "tests/T1.csv", "cae_pulses.parquet"} <= set(verify(sealed).rests_on)
    (campaign_folder / "tests.csv").write_bytes(b"x")
    (campaign_folder / "tests" / "T1.csv").unlink()
    found = {p.where: p.found for p in problems_of(lambda: verify(sealed, campaign=campaign_folder))}
    assert found == {"tests.csv": "another one", "tests/T1.csv": "no such file"}
    (campaign_folder / "criteria.toml").write_text("")  # those from elsewhere are looked for beside it
    other = sealed.parent / "criteria.toml"
    other.write_text("confidence = 0.9")
    seal(sealed, read_key(maker, "private"), seals.rests_on(campaign_folder, other, None), None)
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
    seals._sign(sealed / SEAL, read_key(maker, "private"), (sealed / FILE).read_bytes())
    (problem,) = problems_of(lambda: verify(sealed))
    assert problem.where == FILE
