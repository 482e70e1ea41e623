"""The command that judges acceptance criteria at conditions, and those on its seal."""

import argparse
import hashlib
from contextlib import suppress
from dataclasses import replace

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.notes import read_notes
from crashfuse.certification import file_store, seal
from crashfuse.certification.certify import APPROACH, recompute
from crashfuse.certification.certify import certify as certify_campaign
from crashfuse.certification.criteria import read_criteria
from crashfuse.certification.earlier import AGREEMENTS, FILE, UNDERIVED, VERDICTS, read_earlier
from crashfuse.certification.matrix import Matrix
from crashfuse.cli.conditions import factor, units_of
from crashfuse.cli.models import settings
from crashfuse.cli.output import opened, say, writing
from crashfuse.errors import NO_FILE, DataError, Problem, UsageError, printable, shortened
from crashfuse.execution.training_progress import watching
from crashfuse.results.certification import certification_result
from crashfuse.results.files import replaced, write_files


def certify(arguments: argparse.Namespace) -> None:
    """Judge every criterion at every condition."""
    arguments.approach = [arguments.approach or APPROACH]
    config = settings(arguments)
    if arguments.since and arguments.out.resolve() in (arguments.since.resolve(), arguments.since.resolve().parent):
        raise UsageError(f"{arguments.out} holds the earlier certification; name another folder for --out.")
    earlier = read_earlier(arguments.since) if arguments.since else None
    key = None if arguments.seal is None else seal.read_key(arguments.seal, "private")
    others = arguments.criteria, arguments.matrix, arguments.archive
    inputs = {} if key is None else seal.rests_on(arguments.campaign, *others)
    (campaign, display), notes = opened(arguments, "certification"), read_notes(arguments.campaign)
    criteria = read_criteria(arguments.criteria or arguments.campaign / "criteria.toml")
    if earlier is not None:
        earlier.require_of(campaign)  # or another vehicle's would be told only once all is computed
    matrix = _matrix(arguments, campaign)
    how = {name: getattr(arguments, name) for name in ("costs", "robustness", "workers", "scheduler")}
    with watching() as watch:
        judged = certify_campaign(
            campaign, criteria, matrix, approach=config.approaches[0], config=config, watch=watch, **how
        )
    certification = judged if earlier is None else judged.beside(earlier)
    if key is not None:
        certification = replace(certification, key=seal.key_name(key.public_key()))
    latest = next(iter(file_store.certifications(campaign).values()), None) if earlier is None else earlier
    before = None if latest is None else latest.digest
    result = certification_result(certification, notes)
    with writing(arguments.out), replaced(result.kind, arguments.out) as folder:
        write_files(result, folder, display)
        if key is not None:
            seal.seal(folder, key, inputs, before)
    content = (arguments.out / FILE).read_bytes()
    with suppress(DataError):  # where nothing can be kept, the page does not list it
        file_store.keep_certification(content, campaign)
    say(result, display, arguments.out)
    print(f"SHA-256 of {FILE}: {hashlib.sha256(content).hexdigest()}")
    if key is not None:
        print(f"Sealed by the key {certification.key}{_following(before)}.")


def make_key(arguments: argparse.Namespace) -> None:
    """Make a pair of keys."""
    print(f"{arguments.key} is the private key {seal.make_keys(arguments.key)}; reviewers get {arguments.key}.pub.")


def verify(arguments: argparse.Namespace) -> None:
    """Verify, recompute or review a certification."""
    folder, reviewing = arguments.folder, None if arguments.seal is None else seal.read_key(arguments.seal, "private")
    sealed = None
    if arguments.recompute is None or reviewing or arguments.key or (folder / seal.SEAL).exists():
        sealed = seal.verify(folder, arguments.key, arguments.campaign)
    if arguments.recompute is not None:
        _recompute(arguments)
    if sealed is None:
        print(f"There is no {seal.SEAL}.")
        return
    if reviewing is not None:
        seal.review(folder, reviewing)
        sealed = sealed._replace(reviewer=seal.key_name(reviewing.public_key()))
    print(f"{FILE} and {len(sealed.files)} files are as the key {sealed.key} sealed them{_following(sealed.before)}.")
    print(f"Made on {sealed.date}, by its own account: who was given the seal before a test, knows that it is older.")
    if arguments.key is None:
        print("The key came with the seal: whose it is, shows only one that you were given (--key).")
    if sealed.reviewer is not None:
        print(f"Reviewed by the key {sealed.reviewer}.")
    if sealed.reviewer == sealed.key:
        print("Maker and reviewer have one key: this is no review by another.")
    if arguments.campaign is None:
        print(f"It rests on {len(sealed.rests_on)} files of the campaign, which --campaign compares.")
    else:
        elsewhere = seal.elsewhere(arguments.campaign, sealed.rests_on)
        if lacking := [printable(name) for name, path in elsewhere.items() if not path.is_file()]:
            print(f"Not compared, as not beside the campaign: {', '.join(lacking)}.")
    if others := {path.name for path in folder.iterdir()} - {FILE, seal.SEAL, seal.REVIEW, *sealed.files}:
        print(f"Not sealed: {', '.join(printable(name) for name in sorted(others))}.")
    print("A seal proves that nothing was changed since. Only --recompute proves the numbers.")


def _recompute(arguments: argparse.Namespace) -> None:
    campaign = load_campaign(arguments.recompute, arguments.archive)
    with watching() as watch:
        how = {name: getattr(arguments, name) for name in ("workers", "scheduler")}
        values = recompute(arguments.folder, campaign, watch=watch, **how)
    places, agreement = values["place"], values["agreement"].rename("agree")
    kinds = places.str.startswith(VERDICTS).map({True: "verdicts", False: "other values"}).rename("recomputed")
    print(pd.crosstab(kinds, agreement).to_string())
    others = dict.fromkeys(places[agreement == UNDERIVED].str.partition(", ")[0])
    print(f"Not derived: {', '.join(others)}, report.html, credibility.csv.")
    print("Recomputing proves that verdicts follow from these records, not that tests gave them.")
    wrong = values[agreement == AGREEMENTS[-1]].itertuples()
    problems = [Problem(f"{own.file}, {own.place}", str(own.recomputed), str(own.recorded), seal.ASK) for own in wrong]
    if problems:
        raise DataError(shortened(problems))


def _following(before: str | None) -> str:
    return ", after no other certification" if before is None else f", after the one with the SHA-256 {before}"


def _matrix(arguments: argparse.Namespace, campaign: Campaign) -> Matrix:
    axes = (arguments.speed_mps, arguments.front_weight_kg, arguments.rear_weight_kg)
    if not any((*axes, arguments.factor)):
        path = arguments.matrix or arguments.campaign / "matrix.csv"
        if not path.is_file():
            raise DataError(Problem(path.name, "this file", NO_FILE, "list the conditions in it, or give a grid"))
        return Matrix.read(path, campaign.factors)
    if arguments.matrix is not None or not all(axes):
        raise UsageError("A grid takes --speed-mph, --front-weight-lb and --rear-weight-lb (or kph, kg), no --matrix.")
    factors: dict[str, dict[str, None]] = {}
    for text in arguments.factor or ():
        name, value = factor(text, campaign.factors)
        factors.setdefault(name, {})[value] = None
    return Matrix.grid(*axes, {name: tuple(values) for name, values in factors.items()}, units_of(arguments))
