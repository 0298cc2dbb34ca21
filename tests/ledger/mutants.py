"""Mutants of the closed forms, and the rows of the ledger that notice them.

    python -m tests.ledger.mutants [--only MODULE …] [--write FILE [--add]] [--journal FILE]

A mutant is one function with one small mistake: a constant 1 % off, a sign swapped, a term or factor dropped, near and
far exchanged, minimum for maximum. It is compiled from the changed syntax tree and put in the place of the function's
code; rows that run the function are then checked until one fails. Compiled functions and caches that hold the old code
are cleared. What no row notices is either equivalent, for a reason that `mutant_reasons` gives, or a gap.

A mutant may make a loop endless, in Python or in compiled code. Each row has a limit of processor time: at its end a
signal raises an exception, and three times later another one ends the process, which is started anew and goes on. Both
count as noticed. A journal keeps what was found; with `--journal` a run that was stopped goes on with it.
"""

import argparse
import ast
import builtins
import contextlib
import functools
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shadowjax.ledger import equation as equation_module
from tests.ledger.mutant_patches import Patcher
from tests.ledger.mutant_reasons import reason_of
from tests.ledger.mutant_syntax import LEDGER, LIBRARY, OTHERS, Mutant, mutants, places, source

RECORD = Path(__file__).with_name("mutants.json")
MOST_ROWS = 40  # that a mutant is tried against, the cheapest first
SECONDS = 10.0  # of processor time that any row may take under a mutant; a row that needs long gets more
ENDLESS = "does not end"
Record = dict[str, Any]


# --- the journal ----------------------------------------------------------------------------------------------------


class Journal:
    """Lines of what was found: ["row", id, seconds, functions], ["try", mutant, row], ["noticed", mutant, row, why]."""

    def __init__(self, file: Path):
        self.file = file
        lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []
        if lines and lines[-1][0] == "try":
            del lines[-1]  # a run was stopped there
        self.rows = {one[1]: (one[2], set(one[3])) for one in lines if one[0] == "row"}
        self.noticed = [one[1:] for one in lines if one[0] == "noticed"]
        self.survivors = {one[1] for one in lines if one[0] == "survives"}
        self.tried = {(one[1], one[2]) for one in lines if one[0] == "try"}

    def note(self, *words: Any) -> None:
        """Add a line."""
        with self.file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(words, ensure_ascii=False) + "\n")


def supervised(command: list[str], file: Path) -> int:
    """Run a command that keeps a journal, again whenever the limit of processor time ends it."""
    while (code := subprocess.run([*command, "--journal", str(file)], check=False).returncode) == -signal.SIGVTALRM:
        kind, mutant, row = json.loads(file.read_text(encoding="utf-8").splitlines()[-1])
        assert kind == "try", "only a mutant's row has a limit"
        print(f"{mutant}  |  {row}  {ENDLESS}", file=sys.stderr, flush=True)
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(["noticed", mutant, row, ENDLESS], ensure_ascii=False) + "\n")
    return code


# --- which rows run which functions ---------------------------------------------------------------------------------


def _instrumented(module: str) -> types.CodeType:
    """A module whose functions say that they run, those inside functions under the name of the outermost."""
    tree, file = source(module)
    for place, outermost in places(tree, module):
        call = ast.Call(ast.Name("_mutants_seen", ast.Load()), [ast.Constant(place)], [])
        for node in list(ast.walk(outermost)):
            if isinstance(node, ast.Lambda):
                node.body = ast.Subscript(ast.Tuple([call, node.body], ast.Load()), ast.Constant(1), ast.Load())
            elif isinstance(node, ast.FunctionDef):
                node.body.insert(1 if ast.get_docstring(node) is not None else 0, ast.Expr(call))
    return compile(ast.fix_missing_locations(tree), file, "exec", dont_inherit=True)


@dataclass
class Row:
    """A row of the ledger with its cost in seconds and the functions that it runs."""

    equation: equation_module.Equation
    seconds: float
    runs: set[str]

    @property
    def limit(self) -> float:
        """Seconds of processor time after which it counts as endless."""
        return max(SECONDS, 4 * self.seconds)


def failure(equation: equation_module.Equation, limit: float) -> str:
    """Why a row fails: the first check that does, or an exception; empty if it passes."""

    def late(*_: Any) -> None:
        raise TimeoutError

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, limit)
    # Compiled loops run no handler of Python's: this signal has none, and ends the process.
    signal.setitimer(signal.ITIMER_VIRTUAL, 3 * limit)
    try:
        for one in equation_module.checks(equation):
            if not one.passed:
                return one.name
    except TimeoutError:
        return ENDLESS
    except Exception as error:
        return f"raises {type(error).__name__}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return ""


def trace(patcher: Patcher, prefixes: tuple[str, ...], say: Callable[[str], None], journal: Journal) -> list[Row]:
    """Check every row as it is, and find which functions it runs; cheapest first.

    Args:
        patcher: Of all modules that matter.
        prefixes: Beginnings of the ids of the rows to look at.
        say: Called with a line for each row.
        journal: Keeps what was found; rows that it knows are not checked again.
    """
    seen: set[str] = set()
    builtins._mutants_seen = seen.add  # type: ignore[attr-defined]
    rows = []
    with contextlib.ExitStack() as stack:
        for module in patcher.original:
            stack.enter_context(patcher.patched(module, _instrumented(module)))
        for equation in equation_module.ledger().values():
            if not equation.id.startswith(prefixes):
                continue
            if equation.id in journal.rows:
                rows.append(Row(equation, *journal.rows[equation.id]))
                continue
            for clear, _ in patcher.caches:
                clear()
            seen.clear()
            start = time.process_time()
            reason = failure(equation, 600.0)
            if reason:
                raise RuntimeError(f"{equation.id} fails as it is: {reason}")
            rows.append(Row(equation, time.process_time() - start, set(seen)))
            journal.note("row", equation.id, rows[-1].seconds, sorted(seen))
            say(f"{rows[-1].seconds:6.2f} s  {equation.id}")
    return sorted(rows, key=lambda row: row.seconds)


# --- the run --------------------------------------------------------------------------------------------------------


def _test(mutant: Mutant, rows: list[Row], patcher: Patcher, journal: Journal) -> tuple[str, str]:
    """The first row that fails for a mutant, and why; empty if none does."""
    with patcher.patched(mutant.module, mutant.code()):
        for row in rows:
            journal.note("try", mutant.id, row.equation.id)
            if reason := failure(row.equation, row.limit):
                journal.note("noticed", mutant.id, row.equation.id, reason)
                return row.equation.id, reason
    return "", ""


def run(
    modules: dict[str, bool], prefixes: tuple[str, ...], say: Callable[[str], None], journal: Journal, old: Record
) -> Record:
    """Every mutant of some modules against the rows that run its function.

    Args:
        modules: As in LIBRARY.
        prefixes: Beginnings of the ids of the rows to look at.
        say: Called with a line for each thing done.
        journal: What is known of this run.
        old: An earlier record: mutants that it knows to be noticed, or that no row can notice, are not tried again,
            nor rows that notice one.

    Returns:
        For each mutant the row that noticed it, or an empty name; for each row a mutant that it fails for, likewise;
        the functions that no row runs; and the mutants under which a row does not end.
    """
    patcher = Patcher((*LIBRARY, *LEDGER))
    rows = trace(patcher, prefixes, say, journal)
    ran: set[str] = set().union(*(row.runs for row in rows))
    every = [
        mutant
        for module, whole in modules.items()
        for mutant in mutants(module, whole)
        if mutant.place in ran and mutant.place not in OTHERS
    ]
    known = {one.id for one in every}
    found = {name: row for name, row in old["mutants"].items() if name in known and (row or _is_equivalent(name))}
    noticed: dict[str, str] = {row.equation.id: old["rows"].get(row.equation.id, "") for row in rows}
    endless = {one for one in old["endless"] if one in found}
    helped: dict[str, set[str]] = {}  # function → rows that noticed one of its mutants
    for name, row in found.items():
        helped.setdefault(name.split(":")[0], set()).add(row)

    def notice(mutant: str, row: str, reason: str) -> None:
        if mutant in known:
            found[mutant] = row
        helped.setdefault(mutant.split(":")[0], set()).add(row)
        noticed[row] = noticed[row] or mutant
        if reason == ENDLESS:
            endless.add(mutant)

    for name, row, reason in journal.noticed:
        notice(name, row, reason)
    found |= {name: "" for name in journal.survivors if name in known and name not in found}
    all_places = {place for module in modules for place, _ in places(source(module)[0], module)}
    unused = sorted(one for one in all_places - ran - OTHERS if "#" not in one)
    todo = [one for one in every if one.id not in found]
    say(f"{len(every)} mutants, {len(todo)} of them not known to be noticed")
    for number, mutant in enumerate(todo):
        likely = helped.get(mutant.place, set())

        def cost(row: Row, likely: set[str] = likely) -> float:
            """Rows that noticed another mistake of the function come first, then cheap ones that noticed none yet."""
            return row.seconds * (0.2 if row.equation.id in likely else 1.0) + 0.2 * bool(noticed[row.equation.id])

        chosen = sorted((row for row in rows if mutant.place in row.runs), key=cost)
        name, reason = _test(mutant, chosen[:MOST_ROWS], patcher, journal)
        if name:
            notice(mutant.id, name, reason)
        else:
            found[mutant.id] = ""
            journal.note("survives", mutant.id)
        say(f"{number:5d}  {mutant.id}  |  {name or f'SURVIVES {len(chosen)} rows'}  {reason}")
    wanted = [row for row in rows if not noticed[row.equation.id]]
    inner = [mutant for module in LEDGER for mutant in mutants(module)] if wanted else []
    for row in wanted:
        here = (one for one in (*every, *inner) if one.place in row.runs)
        new = (one for one in here if (one.id, row.equation.id) not in journal.tried)
        at = next((one for one in new if _test(one, [row], patcher, journal)[0]), None)
        noticed[row.equation.id] = at.id if at else ""
        say(f"{row.equation.id}  fails for  {noticed[row.equation.id] or 'NOTHING'}")
    return {"mutants": found, "rows": noticed, "unused": unused, "endless": sorted(endless)}


def _is_equivalent(name: str) -> bool:
    reason = reason_of(name)
    return reason != "" and not reason.startswith("gap")


@functools.cache
def _existing() -> set[str]:
    """Every mutant that the code as it is has."""
    library = {one.id for module, whole in LIBRARY.items() for one in mutants(module, whole)}
    return library | {one.id for module in LEDGER for one in mutants(module)}


def pruned(record: Record) -> Record:
    """A record without what is no more: mutants of code that has changed, and rows that the ledger has lost."""
    known, rows = _existing(), equation_module.ledger()
    kept = {one: row for one, row in record["mutants"].items() if one in known and (not row or row in rows)}
    return {
        "mutants": dict(sorted(kept.items())),
        "rows": {one: name if (name := record["rows"].get(one, "")) in known else "" for one in rows},
        "unused": record["unused"],
        "endless": sorted(set(record.get("endless", ())) & set(kept)),
    }


def added(old: Record, new: Record, modules: tuple[str, ...]) -> Record:
    """A record with some of its modules made anew."""
    begins = tuple(f"{module}." for module in modules)
    kept = {name: row for name, row in old["mutants"].items() if not name.startswith(begins)}
    return {
        "mutants": dict(sorted({**kept, **new["mutants"]}.items())),
        "rows": {name: new["rows"].get(name) or mutant for name, mutant in old["rows"].items()},
        "unused": sorted({one for one in old["unused"] if not one.startswith(begins)} | set(new["unused"])),
        "endless": sorted({one for one in old["endless"] if one in kept} | set(new["endless"])),
    }


def table(result: Record) -> str:
    """What a run found, module by module, then what survives with its reason."""
    lines, counts = [], {}
    for name, row in result["mutants"].items():
        module = next(one for one in (*LIBRARY, *LEDGER) if name.startswith(one + "."))
        made, noticed = counts.get(module, (0, 0))
        counts[module] = made + 1, noticed + bool(row)
    for module, (made, noticed) in counts.items():
        lines.append(f"{module:32} {made:5d} mutants, {noticed:5d} noticed")
    survivors = [name for name, row in result["mutants"].items() if not row]
    without = [name for name in survivors if not reason_of(name)]
    gaps = [name for name in survivors if reason_of(name).startswith("gap")]
    lines += ["", "Survivors:", *(f"- {name}\n    {reason_of(name) or 'NO REASON'}" for name in survivors)]
    silent = [name for name, mutant in result["rows"].items() if not mutant]
    lines += ["", f"rows that fail for no mutant: {', '.join(silent) or 'none'}"]
    lines += [f"functions that no row runs: {', '.join(result['unused']) or 'none'}"]
    total = len(result["mutants"])
    share = 100 * (total - len(survivors)) / max(total, 1)
    lines += [
        f"{total - len(survivors)} of {total} mutants noticed ({share:.1f} %), {len(result['endless'])} of them by a "
        f"row that does not end; {len(survivors)} survive, {len(gaps)} of them in gaps and {len(without)} without a "
        f"reason; {len(result['rows']) - len(silent)} of {len(result['rows'])} rows fail for some mutant"
    ]
    return "\n".join(lines)


def sample(count: int, seed: int, say: Callable[[str], None]) -> list[str]:
    """Mutants that the record says a row notices, drawn at random, against that row alone.

    Returns:
        Those that their row does not notice any more.
    """
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    by_row = {name: row for name, row in record["mutants"].items() if row and name not in record["endless"]}
    known = equation_module.ledger()
    patcher = Patcher((*LIBRARY, *LEDGER))
    every = [
        mutant
        for module, whole in LIBRARY.items()
        for mutant in mutants(module, whole)
        if by_row.get(mutant.id) in known
    ]
    missed = []
    for mutant in random.Random(seed).sample(every, min(count, len(every))):
        row = known[by_row[mutant.id]]
        with patcher.patched(mutant.module, mutant.code()):
            reason = failure(row, 6 * SECONDS)
        say(f"{mutant.id}  |  {row.id}  {reason or 'SURVIVES'}")
        if not reason:
            missed.append(mutant.id)
    return missed


def main() -> int:
    """Run all of it, or some modules and rows, and print what survives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[*LIBRARY], help="modules to change")
    parser.add_argument("--rows", nargs="+", default=[""], help="beginnings of the ids of rows to check")
    parser.add_argument("--write", type=Path, default=None, help="where to write what was found, as JSON")
    parser.add_argument("--add", action="store_true", help="keep what the file says, and try what it does not know")
    parser.add_argument("--journal", type=Path, default=None, help="keeps what was found line by line, to go on with")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--sample", type=int, help="draw so many mutants of the record, each against its row")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--table", action="store_true", help="print what the record says, and try nothing")
    chosen = parser.parse_args()
    modules = {name: LIBRARY.get(name, False) for name in chosen.only}
    start = time.process_time()

    def say(line: str) -> None:
        print(f"{time.process_time() - start:7.1f}  {line}", file=sys.stderr, flush=True)

    if chosen.sample:
        missed = sample(chosen.sample, chosen.seed, say)
        print("\n".join(missed) or f"{chosen.sample} mutants, each noticed by its row")
        return 1 if missed else 0
    if chosen.table:
        print(table(json.loads(RECORD.read_text(encoding="utf-8"))))
        return 0
    if not chosen.worker:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "tests.ledger.mutants", *sys.argv[1:], "--worker"]
            return supervised(command, chosen.journal or Path(folder) / "journal")
    empty: Record = {"mutants": {}, "rows": {}, "unused": [], "endless": []}
    old = pruned(json.loads(chosen.write.read_text(encoding="utf-8")) if chosen.add else empty)
    result = added(old, run(modules, tuple(chosen.rows), say, Journal(chosen.journal), old), tuple(modules))
    if chosen.write:
        chosen.write.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(table(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
