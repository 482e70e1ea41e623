"""Seals: ``certification.json`` signed with Ed25519, so that whoever has the public key can tell what was changed.

It holds the SHA-256 of every file that it rests on. ``seal.json`` is its maker's signature, ``review.json`` that of a
reviewer who found all as it was sealed. Nothing else in these two is believed.
"""

import base64
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from crashfuse.campaign_folder.load import is_read
from crashfuse.errors import DataError, Problem, UsageError, printable, shortened
from crashfuse.files.atomic import write_atomically

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

FILE, SEAL, REVIEW = "certification.json", "seal.json", "review.json"
_LARGEST = 64 << 20  # bytes of a seal or a certification; a key takes two hundred
_REVIEW = b"crashfuse review\n"  # begins what a reviewer signs, so that no seal is a review
ASK = "ask its maker for the original"


def make_keys(path: Path) -> str:
    """Write a new private key, for its owner alone, and the public one beside it (``.pub``); returns its name."""
    private = _ed25519().Ed25519PrivateKey.generate()
    public = path.parent / f"{path.name}.pub"  # of a folder, too: it is there already
    if there := [file for file in (path, public) if file.exists()]:
        raise UsageError(f"{there[0]} is there already; name another file for the key.")
    from cryptography.hazmat.primitives import serialization as form

    pem = private.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
        stream.write(pem)
    public.write_bytes(private.public_key().public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo))
    return key_name(private.public_key())


def key_name(key: "Ed25519PublicKey") -> str:
    """The first half of the SHA-256 of a public key, to be compared on the phone."""
    return hashlib.sha256(key.public_bytes_raw()).hexdigest()[:32]


def read_key(path: Path, word: Literal["private", "public"]) -> Any:  # noqa: ANN401 - of either kind
    """Read a private or a public key; a DataError if it is none of Ed25519."""
    kinds = {"private": _ed25519().Ed25519PrivateKey, "public": _ed25519().Ed25519PublicKey}
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

    content = read(path, f"a {word} key")
    try:
        key = load_pem_private_key(content, None) if word == "private" else load_pem_public_key(content)
        if isinstance(key, kinds[word]):
            return key
        kind = type(key).__name__.replace("_", "").replace("Key", " key")
    except TypeError:
        kind = "one with a password"
    except ValueError:
        kind = next((f"a {other} key" for other in kinds if f"{other.upper()} KEY".encode() in content), "no key")
    raise DataError(Problem(path.name, f"a {word} key of Ed25519", kind, "give one that crashfuse key made"))


def _ed25519() -> Any:  # noqa: ANN401 - a module of the extra
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError as error:
        raise UsageError('A seal needs, in a checkout: python -m pip install ".[seal]".') from error
    return ed25519


def read(path: Path, expected: str) -> bytes:
    """The content of a file of bounded size; a DataError says what was ``expected``."""
    try:
        if path.stat().st_size > _LARGEST:
            raise DataError(Problem(path.name, expected, f"{path.stat().st_size >> 20} MB", "check the path"))
        return path.read_bytes()
    except OSError as error:
        found = (error.strerror or "none that can be read").lower()
        raise DataError(Problem(path.name, expected, found, "check the path")) from None


def rests_on(campaign: Path, *others: Path | None) -> dict[str, str]:
    """SHA-256 of every file of a campaign, by its place there; of files elsewhere by ``../`` and name."""
    files = {campaign.name: campaign} if campaign.is_file() else {}
    for path in sorted(campaign.rglob("*")) if campaign.is_dir() else ():
        place = path.relative_to(campaign)
        if path.is_file() and is_read(place):
            files[place.as_posix()] = path
    files |= {f"../{path.name}": path for path in others if path is not None}
    return {name: _sha256(path) for name, path in files.items()}


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def seal(folder: Path, key: "Ed25519PrivateKey", inputs: Mapping[str, str], before: str | None) -> None:
    """Write what a certification rests on into its ``certification.json``, and sign that."""
    names = sorted(path.name for path in folder.iterdir() if path.is_file() and path.name not in (FILE, SEAL, REVIEW))
    values = json.loads((folder / FILE).read_bytes())
    values["seal"] = {
        "key": key_name(key.public_key()),
        "date": values["date"],
        "before": before,
        "files": {name: _sha256(folder / name) for name in names},
        "rests_on": dict(inputs),
    }
    content = (json.dumps(values, indent=2, ensure_ascii=False) + "\n").encode()
    write_atomically(folder / FILE, content)
    _sign(folder / SEAL, key, content)


def review(folder: Path, key: "Ed25519PrivateKey") -> None:
    """Sign a certification as one who found all of it as it was sealed."""
    _sign(folder / REVIEW, key, _REVIEW + (folder / FILE).read_bytes())


def _sign(path: Path, key: "Ed25519PrivateKey", content: bytes) -> None:
    raw = {"public_key": key.public_key().public_bytes_raw(), "signature": key.sign(content)}
    values = {name: base64.b64encode(value).decode() for name, value in raw.items()}
    write_atomically(path, (json.dumps(values, indent=1) + "\n").encode())


class Sealed(NamedTuple):
    """A seal that holds, with the names of its key and of the reviewer's."""

    key: str
    reviewer: str | None
    date: str
    before: str | None
    files: Mapping[str, str]
    rests_on: Mapping[str, str]


def verify(folder: Path, trusted: Path | None = None, campaign: Path | None = None) -> Sealed:
    """Hold a certification against its seal, by a trusted key or its own; a DataError has every changed file."""
    key, signature = _signed(folder / SEAL)
    content, problems = read(folder / FILE, "the sealed file"), list[Problem]()
    if not _holds(key, signature, content):
        raise DataError(Problem(FILE, "what was sealed", f"other content than {SEAL} signs", ASK))
    sealed = _contents(folder / FILE, content)
    for maker in (sealed.key, sealed.key if trusted is None else key_name(read_key(trusted, "public"))):
        if key_name(key) != maker:
            expected, found = f"a seal by the key {maker}", f"one by the key {key_name(key)}"
            raise DataError(Problem(SEAL, expected, found, "ask its maker, and do not trust it until then"))
    for name, sha256 in sealed.files.items():
        is_there = (folder / name).is_file()
        if not is_there or _sha256(folder / name) != sha256:
            found = "another one" if is_there else "no such file"
            problems.append(Problem(name, "the file that was sealed", found, ASK))
    if campaign is not None:
        problems += _changes_below(campaign, sealed.rests_on)
    if (folder / REVIEW).exists():
        reviewer, signature = _signed(folder / REVIEW)
        sealed = sealed._replace(reviewer=key_name(reviewer))
        if not _holds(reviewer, signature, _REVIEW + content):
            problems.append(Problem(REVIEW, f"a review of this {FILE}", "one of another", "ask the reviewer"))
    if problems:
        raise DataError(shortened(problems))
    return sealed


def elsewhere(campaign: Path, names: Iterable[str]) -> dict[str, Path]:
    """Where files that a seal has from elsewhere, such as the criteria, are looked for: beside the campaign."""
    return {name: campaign.parent / Path(name).name for name in names if name.startswith("../")}


def _changes_below(campaign: Path, then: Mapping[str, str]) -> Iterator[Problem]:
    others = elsewhere(campaign, then)
    now = rests_on(campaign, *filter(Path.is_file, others.values()))
    for name in sorted({*then, *now}):
        if now.get(name) != then.get(name) and (name in now or name not in others):
            found = "no such file" if name not in now else "another one" if name in then else "one that was added since"
            yield Problem(name, "the file that it rests on", found, ASK)


@contextmanager
def _as_written(path: Path) -> Iterator[None]:
    try:
        yield
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise DataError(Problem(path.name, "a seal", "another file, or a damaged one", ASK)) from None


def _signed(path: Path) -> "tuple[Ed25519PublicKey, bytes]":
    ed25519, content = _ed25519(), read(path, "the seal that crashfuse certify --seal writes")
    with _as_written(path):
        values = json.loads(content)
        raw, signature = (base64.b64decode(values[name], validate=True) for name in ("public_key", "signature"))
        return ed25519.Ed25519PublicKey.from_public_bytes(raw), signature


def _contents(path: Path, content: bytes) -> Sealed:
    with _as_written(path):
        values = json.loads(content)["seal"]
        files, inputs = dict(values["files"]), dict(values["rests_on"])
        if any(PureWindowsPath(name).name != name or name == ".." for name in files):
            raise ValueError("names of files elsewhere")
        date, before = (None if text is None else printable(text, 200) for text in (values["date"], values["before"]))
        return Sealed(printable(values["key"], 200), None, date or "", before, files, inputs)


def _holds(key: "Ed25519PublicKey", signature: bytes, content: bytes) -> bool:
    from cryptography.exceptions import InvalidSignature

    with suppress(InvalidSignature):
        key.verify(signature, content)
        return True
    return False
