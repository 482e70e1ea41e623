"""Check that the tests detect faults: ``python benchmarks/deliberate_faults.py [ROOM …] [--seed 0]``.

One small fault at a time is made in a copy of the project (a constant, a comparison, an index, two arguments swapped),
and the room's own fast tests are run on it. The sample is seeded, with a fixed number of faults per room, 100 in
all. Surviving faults are listed at the end: for each, write a test that fails, or explain why none can. Faults in
texts, types and tolerances, and those in ``HARMLESS``, are not made. It takes about ten minutes on one core, where
processes can fork.
"""

import argparse
import ast
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SHARED = os.environ.get("CRASHFUSE_SHARED", str(ROOT.parent / "shared"))
MOST_S = 120  # for the tests of one fault: one that makes them hang counts as detected
PRELOADED = ["pandas", "pyarrow.parquet", "pytest", "scipy.interpolate", "scipy.optimize", "scipy.stats", "torch"]


class Room(NamedTuple):
    """Number of faults, the modules in which they are made, and the tests that should detect them."""

    faults: int
    modules: str
    tests: str


ROOMS = {
    "rating": Room(16, "signals/rating.py", "signals/test_rating.py"),
    "metrics": Room(16, "signals/metrics.py signals/occupant.py", "signals/test_metrics.py signals/test_occupant.py"),
    "calibration": Room(10, "approaches/calibration.py", "approaches/test_calibration.py"),
    "dynamics": Room(
        8, "approaches/displacement_domain/dynamics.py", "approaches/displacement_domain/test_dynamics.py"
    ),
    "weights": Room(
        12, "approaches/mixture.py approaches/fused.py", "approaches/test_mixture.py approaches/test_fused.py"
    ),
    "recommendation": Room(
        14, "study/recommendation.py study/study.py", "study/test_recommendation.py study/test_study.py"
    ),
    "tables": Room(6, "results/result_tables.py", "results/test_result_tables.py"),
    "writer": Room(
        12,
        "campaign_folder/writer.py campaign_folder/editing.py",
        "campaign_folder/test_writer.py campaign_folder/test_editing.py",
    ),
    "cache": Room(6, "execution/cache.py", "execution/test_cache.py"),
}
HARMLESS = ("_BAND_BYTES", "_RUNS_A_BATCH", "_GLANCE_S", "_LINE", "np.errstate", "getLogger")
"""Statements that decide memory, pace or looks, but no number."""

EQUIVALENT = {
    "possible.sum(axis=1) > 1  ->  possible.sum(axis=1) >= 1": "a single candidate is computed again, and chosen again",
    "difference > 0  ->  difference < 0": "a reference that varies has a slope somewhere: a guard that is never needed",
    "1  ->  2  in  return np.full(velocity.shape[:-1], np.nan)": "one NaN for all draws: their interval is unknown too",
    "1  ->  2  in  n_times = int(np.ceil(": "a time more than is read off",
    "np.ceil  ->  np.floor  in  n_times = int(np.ceil(": "a time less, of standing still: below a micrometre",
    "np.ceil(phase.end_s / DT_S)  ->  phase.end_s / DT_S": "the same",
    "begin <= 1e-09  ->  begin < 1e-09": "how a record is judged that begins on a tolerance, to the last bit",
    "len(draws) - np.maximum(below, above)  ->  len(": "quantiles are computed where counting had decided the same",
    "i % _LOOK_STEPS  ->  i * _LOOK_STEPS": "who has stopped is integrated on, beyond the time up to which it is valid",
    "i:  ->  i + 1:  in  accel[i:], velocity[i:], displacement[i:] = a, v, s[0]": "sample i has these values already",
    "adding.size and start < slow  ->  adding.size or": "what acts near the stop alone adds nothing before",
    "1  ->  2  in  slow = over_speed[1] *": "the same",
    "1  ->  2  in  grid = np.linspace(0.0, phase.crush_m, _REPLAY_STEPS": "1601 steps for 1600",
    "10  ->  11  in  _FEW": "either way to the same bit",
    "1  ->  2  in  taut = np.ascontiguousarray(": "to NumPy any negative length is what is left",
    ":40  ->  :40 + 1  in  return self.folder / kind": "how long a file's name is",
    "('parquet', 'csv')  ->  ('csv', 'parquet')": "a campaign that has both cannot be opened",
    "math.ceil(n * dt_s / RATING_DT_S - 1e-06)  ->": "np.arange rounds up, too",
    "np.floor(np.cumsum(weights) * n_draws + 0.5)  ->": "the fraction is cut off anyway",
    "part.prepare(campaign, conditions, watch)  ->": "earlier or later, the same is computed",
    "200  ->  201": "where the text of an error is cut",
    "2  ->  3  in  n_fft = 2 **": "a longer transform of the same product",
    "2  ->  3  in  motion = integrate(phase.accel_at(grid)[None], grid[1], np.zeros((1, 2))": "nothing, in more steps",
    "40  ->  41  in  return self.folder / kind": "the same",
    "(str, list[str])  ->  (list[str], str)": "a type",
}
"""Faults that nobody could notice, and why; others are made instead."""
COMMUTES = {"add", "max", "maximum", "min", "minimum", "multiply"}  # so do equal ones: the same either way

OTHER: dict[type[ast.AST], Any] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.And: ast.Or, ast.Or: ast.And, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
TURNED: dict[type[ast.AST], Any] = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
PAIRS = ("min max", "minimum maximum", "argmin argmax", "floor ceil", "any all", "mean sum", "lower upper")
NAMES = {a: b for pair in PAIRS for a, b in (pair.split(), reversed(pair.split()))}
CASTS = {"array", "asarray", "ascontiguousarray", "bool", "dict", "float", "int", "list", "set", "str", "tuple"}
TEXTS = {"Problem", "DataError", "UsageError", "cast", "report", "warning"}
FORM = {"strict", "encoding", "newline", "compression", "parents", "exist_ok", "missing_ok", "ignore_errors"}


class Fault(NamedTuple):
    """One variant of one node of a module, by index."""

    module: str
    node: int
    variant: int
    text: str


def main() -> None:
    """Make the faults and print the outcome of each."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("rooms", nargs="*", choices=[*ROOMS, []], default=[])
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "CRASHFUSE_SHARED": SHARED}
    survived, made, seconds = [], 0, 0.0
    with tempfile.TemporaryDirectory() as scratch:
        project = Path(scratch) / "project"
        skipped = shutil.ignore_patterns(".*", "__pycache__", "docs", "benchmarks")
        shutil.copytree(ROOT, project, ignore=skipped)
        for name in given.rooms or ROOMS:
            room = ROOMS[name]
            sound, took = run(project, room)
            if not sound:
                sys.exit(f"The tests of {name} fail as they are.")
            seconds += took
            faults = [fault for module in room.modules.split() for fault in faults_of(module)]
            print(f"{name}: {room.faults} of {len(faults)} faults, tests of {took:.0f} s", flush=True)
            for fault in sample(faults, room.faults, given.seed):
                caught, took = caught_by(project, fault, room)
                made += 1
                survived += [] if caught else [fault]
                print(f"  {'caught  ' if caught else 'SURVIVED'} {took:4.0f} s  {fault.text}", flush=True)
    print(f"\n{made - len(survived)} of {made} faults caught by tests that together take {seconds:.0f} s. Survived:")
    print("\n".join(f"  {fault.text}" for fault in survived) or "  none")


def sample(faults: list[Fault], n: int, seed: int) -> list[Fault]:
    """Draw faults, and replace those that no test could detect."""
    chance = random.Random(seed)  # noqa: S311
    first = chance.sample(faults, n)
    rest = [fault for fault in faults if fault not in first]
    drawn = [*first, *chance.sample(rest, len(rest))]
    return [fault for fault in drawn if not _is_equivalent(fault.text)][:n]


def _is_equivalent(text: str) -> bool:
    """Whether a fault is in ``EQUIVALENT``, or swaps two arguments that may be swapped, or two equal ones."""
    before, _, after = text.partition("  ")[2].partition("  in  ")[0].partition("  ->  ")
    name = before.partition("(")[0]
    swapped = after.startswith(f"{name}(") and sorted(before) == sorted(after)
    commutes = before == after or (swapped and name.removeprefix("np.") in COMMUTES)
    return commutes or any(known in text for known in EQUIVALENT)


def faults_of(module: str) -> list[Fault]:
    """All faults that can be made in a module."""
    source = (ROOT / "crashfuse" / module).read_text(encoding="utf-8")
    tree, lines = ast.parse(source), source.splitlines()
    numbers = {node: number for number, node in enumerate(ast.walk(tree))}
    faults = []
    for node in _expressions(tree):
        for variant, other in enumerate(_variants(node)):
            change = f"{ast.unparse(node)}  ->  {ast.unparse(other)}  in  {lines[node.lineno - 1].strip()}"
            faults.append(Fault(module, numbers[node], variant, f"{module}:{node.lineno}  {change}"))
    return faults


def _expressions(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions that determine numbers: not those in texts, types and decorators."""
    match node:
        case ast.Raise() | ast.FunctionDef(name="__repr__"):
            return
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in TEXTS:
            return
        case ast.keyword(arg=name) if name in FORM:
            return
        case ast.Assign() | ast.AnnAssign() | ast.Return() if any(name in ast.unparse(node) for name in HARMLESS):
            return
        case ast.expr():
            yield node
    for field, value in ast.iter_fields(node):
        if field not in ("annotation", "returns", "decorator_list", "format_spec"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _expressions(child)


def _variants(node: ast.AST) -> Iterator[ast.expr]:
    """The faults that can be made at a node."""
    match node:
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=float(value)) if value == 0 or abs(value) > 1e-5:  # smaller ones are tolerances
            yield ast.Constant(round(value * 1.2, 9) or 0.1)
        case ast.BinOp(left, op, right) if type(op) in OTHER:
            yield ast.BinOp(left, OTHER[type(op)](), right)
        case ast.BoolOp(op, values):
            yield ast.BoolOp(OTHER[type(op)](), values)
        case ast.UnaryOp(_, operand):
            yield operand
        case ast.Compare(left, [op, *others], values):
            for kind in (OTHER, TURNED):
                if type(op) in kind:
                    yield ast.Compare(left, [kind[type(op)](), *others], values)
        case ast.IfExp(test, body, orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Slice(lower, upper, step):
            if lower is not None:
                yield ast.Slice(ast.BinOp(lower, ast.Add(), ast.Constant(1)), upper, step)
            if upper is not None:
                yield ast.Slice(lower, ast.BinOp(upper, ast.Add(), ast.Constant(1)), step)
        case ast.Name(name, ast.Load()) if name in NAMES:
            yield ast.Name(NAMES[name], ast.Load())
        case ast.Attribute(value, name, ast.Load()) if name in NAMES:
            yield ast.Attribute(value, NAMES[name], ast.Load())
        case ast.Call(function, [first, *others], keywords) if not isinstance(first, ast.Starred):
            if others and not isinstance(others[0], ast.Starred):
                yield ast.Call(function, [others[0], first, *others[1:]], keywords)
            if ast.unparse(function).rpartition(".")[2] not in CASTS:
                yield first
        case ast.Tuple([first, second, *others], context) if isinstance(context, ast.Load):
            yield ast.Tuple([second, first, *others], context)


def caught_by(project: Path, fault: Fault, room: Room) -> tuple[bool, float]:
    """Make a fault in the copy, run the tests, and undo it."""
    path = project / "crashfuse" / fault.module
    sound = path.read_text(encoding="utf-8")
    tree = ast.parse(sound)
    nodes = list(ast.walk(tree))
    variant = list(_variants(nodes[fault.node]))[fault.variant]
    for parent in nodes:
        for field, value in ast.iter_fields(parent):
            if value is nodes[fault.node]:
                setattr(parent, field, variant)
            elif isinstance(value, list):
                value[:] = [variant if child is nodes[fault.node] else child for child in value]
    try:
        _write(path, ast.unparse(ast.fix_missing_locations(tree)))
        passed, took = run(project, room)
    finally:
        _write(path, sound)
    return not passed, took


def _write(path: Path, source: str) -> None:
    path.write_text(source, encoding="utf-8")
    Path(cache_from_source(str(path))).unlink(missing_ok=True)  # size and time in whole seconds may be unchanged


def run(project: Path, room: Room) -> tuple[bool, float]:
    """True if the room's tests pass on the copy, and the seconds taken."""
    context = multiprocessing.get_context("forkserver")  # so that slow imports happen only once
    context.set_forkserver_preload(PRELOADED)
    start = time.perf_counter()
    process = context.Process(target=_run, args=(project, room.tests.split()))
    process.start()
    process.join(MOST_S)
    process.kill()
    process.join()
    return process.exitcode == 0, time.perf_counter() - start


def _run(project: Path, tests: list[str]) -> None:
    os.chdir(project)
    os.environ["PYTHONPATH"] = str(project)
    sys.path.insert(0, str(project))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    import pytest

    sys.exit(
        pytest.main(["-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", *(f"tests/{test}" for test in tests)])
    )


if __name__ == "__main__":
    main()
