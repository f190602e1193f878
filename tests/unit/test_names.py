"""Names are the field's: each word of a public name is plain English or in the glossary, and no two public things share a name."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import shoal

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "shoal"
PLAIN = {line for line in (Path(__file__).parent / "plain_words.txt").read_text().split() if not line.startswith("#")}
GLOSSARY = {
    word
    for term in re.findall(r"^\| ([^|]+) \|", (ROOT / "docs" / "glossary.md").read_text(), re.M)
    for word in re.findall(r"[a-z]+", term.lower())
}

# Verbs that the parts share, since who knows one part is to know the others, and what each format or view of a kind has.
SHARED = {"run", "check", "main", "scan", "write", "clip_of", "page_data", "player_page"}


def words_of(name: str) -> list[str]:
    """Take a name apart.

    >>> words_of("GridWorkspace"), words_of("move_cost"), words_of("hilbert2d")
    (['grid', 'workspace'], ['move', 'cost'], ['hilbert', 'd'])
    """
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    return [part.lower() for part in parts]


def modules() -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted(SOURCE.rglob("*.py")):
        yield path.relative_to(SOURCE), ast.parse(path.read_text())


def definitions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Yield public classes and functions of a module, and public methods of public classes."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from definitions(node)


def public_names() -> Iterator[tuple[str, str]]:
    """Yield (name, where) of modules, classes, functions, their parameters and the fields of classes."""
    for path, tree in modules():
        for part in path.with_suffix("").parts:
            yield part, str(path)
        for node in definitions(tree):
            yield node.name, f"{path}:{node.lineno}"
            if isinstance(node, ast.FunctionDef) and "kernels" not in path.parts:
                every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                yield from ((one.arg, f"{path}:{node.lineno} {node.name}") for one in every if not one.arg.startswith("_"))
            if isinstance(node, ast.ClassDef):
                fields = [one.target for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)]
                yield from ((one.id, f"{path}:{one.lineno} {node.name}") for one in fields if not one.id.startswith("_"))


def strange_words(names: Iterator[tuple[str, str]]) -> dict[str, str]:
    return {
        word: f"{name} in {where}"
        for name, where in names
        for word in words_of(name)
        if len(word) > 1 and not {word, word.removesuffix("s")} & (PLAIN | GLOSSARY)
    }


def test_every_word_is_plain_english_or_in_the_glossary():
    assert strange_words(public_names()) == {}, "add it to docs/glossary.md with its meaning, or choose a plain word"


@pytest.mark.parametrize(
    ("place", "fields"),
    [
        ("maze:9x7", {"particles": 4, "policy": "closest-frontier", "slip": 0.1}),
        ("square", {"start": [(0.2, 0.5), (0.4, 0.5)], "goal": [(0.3, 0.5), (0.4, 0.5)], "planner": "greedy"}),
        ("square:60", {"robots": 3, "footprint": 10.0, "targets": 2}),
    ],
)
def test_fields_of_json_are_plain_english_or_in_the_glossary(place, fields):
    episode = shoal.run(place, **fields)
    told = [episode.report(), episode.problem.to_dict(defaults=True), episode.metrics]
    assert strange_words((name, episode.part) for one in told for name in fields_of(one)) == {}


def fields_of(told: Any) -> Iterator[str]:
    """Yield the names of fields of what JSON holds, at any depth."""
    if isinstance(told, dict):
        yield from told
        told = list(told.values())
    if isinstance(told, list):
        for one in told:
            yield from fields_of(one)


def test_no_two_public_things_share_a_name():
    homes: defaultdict[str, list[str]] = defaultdict(list)
    for path, tree in modules():
        if (
            "kernels" in path.parts or "cli" in path.parts
        ):  # kernels have no users but their own part; a command is named by its verb
            continue
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_") and node.name not in SHARED:
                homes[node.name].append(str(path))
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


@pytest.mark.parametrize("old", ["ways", "gates", "rings", "standing", "rising", "lifting", "played", "sharing", "sight", "seen",
    "asking", "wonder", "manner", "ground", "passages", "corners", "stops", "judgement", "arrivals", "assembling", "named",
    "methods", "fleet", "presence", "pilot", "heights", "growing", "opposite", "filling", "plays", "mending", "foresight", "guess",
    "experience", "prospect", "survey", "planned", "crews", "claim", "looks", "plant"])  # fmt: skip
def test_no_module_has_a_private_word(old):
    assert [str(path) for path in SOURCE.rglob(f"{old}.py")] == []
