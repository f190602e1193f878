"""shoal bench run, table: Shoal-Bench, the scores of policies on suites of fixed problems."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_columns, print_json, say, warnings_said
from shoal.core.errors import InvalidInputError
from shoal.core.files import as_json, write_json

if TYPE_CHECKING:
    from shoal.lab.bench import Score, Suite

RUN_EXAMPLE = "Example: shoal bench run closest-frontier --suite mapping-easy"
TABLE_EXAMPLE = "Example: shoal bench table bench.sqlite"
SHOWN = 3  # failed trials of a suite

SuiteNames = Annotated[
    list[str] | None,
    typer.Option(
        "--suite",
        metavar="NAME",
        help="Suite, such as mapping-easy; the option can be repeated.",
    ),
]
OutFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Also write the result as JSON.")
]


def run(
    policies: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[POLICY]...",
            help=(
                "Policies, planners or allocations, by name or as MODULE:ATTRIBUTE. Default: the"
                " baselines of each suite."
            ),
        ),
    ] = None,
    suite: SuiteNames = None,
    store: Annotated[
        Path,
        typer.Option(
            "--store",
            metavar="FILE",
            help="File for the results. Shoal creates the file if it does not exist.",
        ),
    ] = Path("bench.sqlite"),
    workers: options.Processes = None,
    seed: options.UnusedSeed = 0,
    out: OutFile = None,
    json_: options.Json = False,
) -> None:
    """Run policies on suites of problems that never change, and print their scores.

    Without --suite, each policy runs on all suites that know its name. Results that the store
    contains are not run again. To continue a stopped run, repeat the same command.

    The exit code is 1 if at least one trial failed.
    """
    from shoal.core.checks import check_integer
    from shoal.lab import Store
    from shoal.lab.bench import find_suite, run_suite, scores, suites

    if out is not None:
        check_folder(out.parent)
    if workers is not None:
        check_integer(workers, what="workers", least=0)
    chosen = [find_suite(name) for name in suite] if suite else [*suites().values()]
    plan = [(one, _fitting(one, policies, named=bool(suite))) for one in chosen]
    for policy in policies or ():
        if not any(policy in names for _, names in plan):
            raise InvalidInputError(
                f"policy: expected a policy that a suite knows by its name, got {policy}; for your"
                " own policy, name suites with --suite"
            )
    _check_runnable(plan)
    from shoal.cli.sweep import live
    from shoal.lab.batches import MixedVersionsWarning

    found: list[Score] = []
    failures: list[str] = []
    for one, names in plan:
        if not names:
            continue
        with live(one.name) as tell, warnings_said(MixedVersionsWarning):
            run_suite(one, names, store, workers=workers, on_progress=tell)
        with Store(store) as opened:
            found += [score for score in scores(opened, one) if score.policy in names]
            failures += [
                f"suite {one.name}, trial {trial}: {error}"
                for values, trial, _, error in opened.failures(one.name)
                if values[one.policy] in names
            ][:SHOWN]
    _report(found, store, out, json_=json_)
    if failures:
        for text in failures:
            say(f"shoal: {text}")
        raise typer.Exit(1)


def _fitting(suite: Suite, policies: list[str] | None, *, named: bool) -> list[str]:
    """Return the policies that run on a suite: all policies if the user named the suite, otherwise
    those whose names the suite knows.
    """
    if not policies:
        return [*suite.baselines]
    return [*dict.fromkeys(policy for policy in policies if named or suite.accepts(policy))]


def _check_runnable(plan: list[tuple[Suite, list[str]]]) -> None:
    """Refuse policies that a suite cannot run, before the first trial of any suite."""
    for suite, names in plan:
        if names:
            assert suite.sweep(names).points  # which checks all fields


def table(
    store: Annotated[
        Path, typer.Argument(metavar="STORE", help="File with the results of shoal bench run.")
    ] = Path("bench.sqlite"),
    suite: SuiteNames = None,
    level: Annotated[
        float, typer.Option("--level", help="Confidence level of the intervals.")
    ] = 0.95,
    seed: options.UnusedSeed = 0,
    out: OutFile = None,
    json_: options.Json = False,
) -> None:
    """Print the scores of all policies in a store, with intervals and the generalisation gap.

    A score is the mean, over the maps of a split, of the moves of a policy divided by the moves of
    the suite's reference policy from the same starts: less is better. For searches, times replace
    moves. The gap is the score on the test maps divided by the score on the training maps.
    """
    from shoal.core.checks import check_number
    from shoal.lab import Store
    from shoal.lab.bench import find_suite, scores, suites

    if out is not None:
        check_folder(out.parent)
    check_number(level, what="--level", above=0, below=1)
    chosen = [find_suite(name) for name in suite] if suite else [*suites().values()]
    from shoal.cli.sweep import say_if_mixed

    with Store(store) as opened:
        there = opened.names
        for one in chosen if suite else ():
            if one.name not in there:
                raise InvalidInputError(
                    f"{store}: expected results of the suite {one.name}, got results of"
                    f" {', '.join(there) or 'none'}"
                )
        found = []
        for one in chosen:
            if one.name in there:
                say_if_mixed(opened, one.name)
                found += scores(opened, one, level=level)
    if not found:
        raise InvalidInputError(f"{store}: expected results of shoal bench run, got none")
    _report(found, store, out, json_=json_, level=level)


def _report(
    found: list[Score], store: Path, out: Path | None, *, json_: bool, level: float = 0.95
) -> None:
    result: dict[str, Any] = {
        "store": str(store),
        "level": level,
        "scores": [as_json(asdict(score)) for score in found],
    }
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
        return
    print_columns(
        ["suite", "policy"],
        ["test", "train", "gap", "completed"],
        [_row(score) for score in found],
        title=f"scores [{100 * level:g} % interval]",
    )


def _row(score: Score) -> list[str]:
    """Return the texts of a row of the table. A score with missing trials is not shown."""
    completed = f"{score.completed} of {score.trials}"
    if score.missing:
        completed += f", {score.missing} missing"
    estimates = (score.test, score.train, score.gap)
    return [
        score.suite,
        score.policy,
        *("-" if one is None else str(one) for one in estimates),
        completed,
    ]
