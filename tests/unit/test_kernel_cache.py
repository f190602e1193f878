"""Where compiled kernels are kept: no folder, damage, a full disk, several first runs and a kill
are no reason to stop.
"""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import pkgutil
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from llvmlite import binding
from numba import typeof
from tests.soak import often

from shoal.core import notices
from shoal.jit import COMPILING, cache, compiler, loader, lowered
from shoal.jit.cache import content_key, load_machine_code
from shoal.jit.loader import compiled_form, kinds_of_arguments
from shoal.search.kernels import cycles

SOURCE = Path(__file__).with_name("small_kernels.py")
NOBODY = 65534


@pytest.fixture
def told(monkeypatch):
    """What commands would print on stderr."""
    found = []
    monkeypatch.setattr(notices, "listeners", [found.append])
    monkeypatch.setattr(notices, "_told", {COMPILING})
    return found


@pytest.fixture
def script(tmp_path):
    """The kernels in a folder of their own."""
    folder = tmp_path / "code"
    folder.mkdir()
    shutil.copy(SOURCE, folder)
    return folder / SOURCE.name


def start(script, *kinds, prefix=(), **environment):
    clean = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("SHOAL_CACHE", "XDG_CACHE"))
    }
    return subprocess.Popen(
        [*prefix, sys.executable, str(script), *kinds],
        env=clean | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def played(script, *kinds, **more):
    """Return what a run printed: its results, whether it compiled, and the lines on stderr."""
    process = start(script, *kinds, **more)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    results, compiled = out.splitlines()
    return results, compiled, [line for line in err.splitlines() if line != COMPILING]


def imported_module(script):
    """Return the module of the kernels, imported as if this process had begun anew."""
    cache.folder_of.cache_clear()
    module = importlib.util.module_from_spec(
        importlib.util.spec_from_file_location(script.stem, script)
    )
    module.__spec__.loader.exec_module(module)
    return module


def imported(script):
    """Return what the kernels give in this process, and whether they were compiled."""
    module = imported_module(script)
    result = module.total(np.arange(4))
    return int(result), "compiled" if module.total.entry.overloads else "loaded"


def test_beside_the_sources_and_in_a_named_folder(script, told, tmp_path, monkeypatch):
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert list((script.parent / "__pycache__").glob("*.kernel"))
    monkeypatch.setenv("SHOAL_CACHE", str(tmp_path / "named"))
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert not told
    (tmp_path / "file").touch()
    monkeypatch.setenv("SHOAL_CACHE", str(tmp_path / "file"))
    assert imported(script) == (12, "compiled")
    assert len(told) == 1
    assert told[0].startswith("SHOAL_CACHE: expected a folder that can be written")


KERNELS = '''
"""Some kernels."""
import numpy as np
from shoal.jit import in_place_kernel, kernel
import factors

STEP = 3
TABLE = np.array([1, 2])
Pair = __import__("collections").namedtuple("Pair", ["first", "second"])

@in_place_kernel
def scaled(number, by=1):
    """Scale a number."""
    return STEP * number * by

def plain(number):
    """Return the number."""
    return number + TABLE[0] * factors.FACTOR

@kernel
def total(numbers):
    """Return a sum."""
    found = 0
    for number in numbers:
        found += scaled(number)
    return found + 0 * STEP

@kernel
def counted(numbers):
    return Pair(len(numbers), 1).first

@kernel
def apart(numbers):
    return len(numbers)
'''
UNCHANGED = {
    "docstring of the kernel": ("Return a sum.", "Return the sum of all numbers."),
    "docstring of a called kernel": ("Scale a number.", "Return a scaled number."),
    "docstring of the module": ("Some kernels.", "A few kernels."),
    "no docstring": ('    """Return a sum."""\n', ""),
    "comment": ("    found = 0", "    found = 0  # the sum so far"),
    "layout": ("found + 0 * STEP", "(\n        found\n        + 0 * STEP\n    )"),
    "place": ("STEP = 3", "STEP = 3\n\n\n"),
    "kernel that is not called": ("return len(numbers)\n", "return 2 * len(numbers)\n"),
    "constant that is not used": ("[1, 2]", "[1, 5]"),
}
CHANGED = {
    "the kernel": ("found = 0", "found = 1"),
    "called kernel": ("number * by", "number * by + 1"),
    "default of a called kernel": ("by=1", "by=2"),
    "constant": ("STEP = 3", "STEP = 4"),
    "type of a constant": ("STEP = 3", "STEP = 3.0"),
    "name that stands for another": (
        "from shoal.jit import in_place_kernel, kernel",
        "from shoal.jit import in_place_kernel, kernel\nlen = sum",
    ),
    "reference counting": ("@in_place_kernel", "@kernel"),
}


@pytest.fixture
def key_of(tmp_path, monkeypatch):
    """Return a function that writes changed kernels and returns the content key of one of them."""
    monkeypatch.syspath_prepend(tmp_path)
    # byte code of a file that changes within a second, and keeps its length, would be taken for new
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "factors.py").write_text("FACTOR, OTHER = 2, 3\n")

    def key(*change, kernel="total", text=KERNELS):
        changed = text.replace(*change) if change else text
        assert changed != text or not change
        (tmp_path / "some_kernels.py").write_text(changed)
        for name in ("some_kernels", "factors"):
            sys.modules.pop(name, None)
        return content_key(getattr(imported_module(tmp_path / "some_kernels.py"), kernel))

    return key


@pytest.mark.parametrize("change", UNCHANGED)
def test_what_is_not_compiled_does_not_change_the_key(change, key_of):
    assert key_of(*UNCHANGED[change]) == key_of()


@pytest.mark.parametrize("change", CHANGED)
def test_what_is_compiled_changes_the_key(change, key_of):
    if change.startswith("name"):
        assert key_of(*CHANGED[change], kernel="apart") != key_of(kernel="apart")
    else:
        assert key_of(*CHANGED[change]) != key_of()


def test_functions_arrays_and_modules_that_a_kernel_uses_change_its_key(key_of, tmp_path):
    text = KERNELS.replace("found += scaled(number)", "found += plain(number)")
    before = key_of(text=text)
    assert key_of(text=text) == before
    assert key_of("[1, 2]", "[2, 2]", text=text) != before
    assert key_of("return number + ", "return number - ", text=text) != before
    assert key_of("Return the number.", "Return a number.", text=text) == before
    (tmp_path / "factors.py").write_text("FACTOR, OTHER = 2, 4  # not used\n")
    assert key_of(text=text) == before
    (tmp_path / "factors.py").write_text("FACTOR, OTHER = 20, 4\n")
    assert key_of(text=text) != before


def test_the_order_of_fields_is_part_of_what_is_compiled(key_of):
    assert key_of('["first", "second"]', '["second", "first"]', kernel="counted") != key_of(
        kernel="counted"
    )
    forms = []
    for fields in (["first", "second"], ["second", "first"]):
        pair = NamedTuple("Pair", [(field, int) for field in fields])
        forms.append(repr(compiled_form(kinds_of_arguments((pair(1, 2),)))))
    assert forms[0] != forms[1]


def test_a_kernel_that_calls_itself_has_a_key(key_of):
    itself = (
        "def scaled(number, by=1):\n    if number > 0:\n        return scaled(number - 1)\n   "
        " return by\n"
    )
    itself += "\ndef unused(number, by=1):"
    before = key_of("def scaled(number, by=1):", itself)
    assert len(before) == 16
    assert key_of("def scaled(number, by=1):", itself.replace("- 1", "- 2")) != before


def test_a_value_that_cannot_be_described_never_fits(key_of):
    text = KERNELS.replace("STEP = 3", "STEP = (3, open)").replace(
        "STEP * number", "STEP[0] * number"
    )
    assert key_of(text=text) == key_of(text=text)
    text = text.replace("(3, open)", "(3, iter([]), lambda: 0, (each for each in ()))")
    assert key_of(text=text) != key_of(text=text)


def test_no_kernel_of_shoal_is_without_a_key():
    """A content key with random bytes would be compiled again in each process."""
    for module in (
        "swarm.kernels.planning.anneal",
        "steering.kernels.contact",
        "search.kernels.runs",
    ):
        kernels = vars(importlib.import_module(f"shoal.{module}")).values()
        kernels = [each for each in kernels if hasattr(each, "function")]
        before = [content_key(each) for each in kernels]
        cache._own_content.cache_clear()
        assert kernels
        assert [content_key(each) for each in kernels] == before


def test_a_change_is_compiled_and_leaves_nothing_behind(script):
    assert imported(script) == (12, "compiled")
    before = sorted(path.name for path in (script.parent / "__pycache__").iterdir())
    text = script.read_text()
    script.write_text("# a comment\n" + text.replace("Return twice each number.", "Double all."))
    assert imported(script) == (12, "loaded")
    script.write_text(text.replace("2 * numbers", "10 * numbers"))
    assert [imported(script) for _ in range(2)] == [(60, "compiled"), (60, "loaded")]
    assert sorted(path.name for path in (script.parent / "__pycache__").iterdir()) == before


@pytest.mark.parametrize("why", ["asked for", "unknown version"])
def test_numba_alone_compiles_where_its_inside_is_not_known(why, script, monkeypatch):
    if why == "asked for":
        monkeypatch.setenv("SHOAL_PLAIN_KERNELS", "1")
    else:
        monkeypatch.setattr(loader, "version_of_numba", lambda: "9.99.0")
    assert imported(script) == (12, "compiled")
    assert not list((script.parent / "__pycache__").glob("*.kernel"))
    module = imported_module(script)
    assert type(module.double._numba_type_.dispatcher).__module__ == "numba.core.registry"


def test_named_tuples_pass_by_pointer(tmp_path):
    """Of named tuples in named tuples, chosen ones, and those that a kernel makes, each kernel sees
    the values it was given.
    """
    (tmp_path / "tuples.py").write_text(TUPLES)
    module = imported_module(tmp_path / "tuples.py")
    inner, other = module.Inner(np.arange(3.0), 5), module.Inner(np.arange(3.0) + 10, 7)
    outer = module.Outer(inner, other, 2)
    for flip in (0, 1):
        assert module.chosen(outer, flip) == module.chosen.__wrapped__(outer, flip)
    assert module.swapped(outer, 4) == module.swapped.__wrapped__(outer, 4)
    assert module.made(outer) == module.made.__wrapped__(outer)
    assert module.counted(outer) == module.counted.__wrapped__(outer)
    # nothing was written into the tuples
    assert (outer.first.number, outer.second.number) == (5, 7)


TUPLES = """
from typing import Any, NamedTuple
import numpy as np
from shoal.jit import in_place_kernel, kernel

class Inner(NamedTuple):
    values: Any
    number: Any

class Outer(NamedTuple):
    first: Inner
    second: Inner
    size: Any

@in_place_kernel
def weigh(inner, outer):
    total = inner.number * outer.size
    for value in inner.values:
        total += value
    return total

@in_place_kernel
def chosen(outer, flip):
    inner = outer.first
    if flip == 1:
        inner = outer.second
    return weigh(inner, outer)

@in_place_kernel
def swapped(outer, times):
    one, other = outer.first, outer.second
    total = 0.0
    for k in range(times):
        kept = one
        total = 2 * total + weigh(one, outer)
        one = other
        other = kept
        total += weigh(kept, outer)
    return total

@in_place_kernel
def made(outer):
    inner = Inner(outer.first.values, 9)
    return weigh(inner, outer) + weigh(outer.second, Outer(outer.second, inner, 3))

@kernel
def counted(outer):
    inner = outer.first
    total = 0.0
    for k in range(outer.size):
        total += weigh(inner, outer) + weigh(outer.second, outer) + inner.values.copy().sum()
        inner = outer.second
    return total
"""


# Archives of lowered kernels


@pytest.fixture
def archived(script, told, tmp_path, monkeypatch):
    """Return a function that plays first calls, with an empty cache each time, and returns which
    members the archive gained and lost.
    """
    monkeypatch.setenv("SHOAL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(lowered, "_IMPORTED", 2**63)  # the tests import what they write

    def record(*names, values=(4, 4.0)):
        forget()
        before = members(script)
        with lowered.record_kernels() as changes:
            for name in names:
                for value in values:
                    getattr(imported_module(script), name)(np.arange(value))
        after = members(script)
        assert (
            list(changes.values())
            == [(len(after - before), len(before - after))][: before != after]
        )
        return sorted(each.split("-")[0].split(".")[-1] for each in after - before), sorted(
            each.split("-")[0].split(".")[-1] for each in before - after
        )

    def forget():
        shutil.rmtree(tmp_path / "cache", ignore_errors=True)
        lowered._functions.cache_clear()
        lowered._archive.cache_clear()

    record.forget = forget
    return record


def members(script):
    archive = script.parent / lowered.NAME
    return set(zipfile.ZipFile(archive).namelist()) if archive.exists() else set()


def test_a_lowered_kernel_is_not_compiled_from_its_source(script, archived):
    assert archived("total") == (["total", "total"], [])
    archived.forget()
    assert imported(script) == (12, "loaded")
    archived.forget()
    (script.parent / lowered.NAME).unlink()
    assert imported(script) == (12, "compiled")


def test_comments_leave_an_archive_as_it_is_and_a_change_makes_only_its_kernels_again(
    script, archived
):
    archived("total", "one_more", values=(4,))
    archive, text = script.parent / lowered.NAME, script.read_text()
    content = archive.read_bytes()
    for changed in (
        "# a comment\n" + text,
        text.replace("Return twice each number.", "Double all."),
        text.replace("    found = 0\n", "    found = (\n        0\n    )  # the sum so far\n"),
        text.replace("number + 9", "number + 8"),  # called by neither
    ):
        assert changed != text
        script.write_text(changed)
        archived.forget()
        assert imported(script) == (12, "loaded")
        assert archived("total", "one_more", values=(4,)) == ([], [])
        assert archive.read_bytes() == content
    script.write_text(text.replace("2 * numbers", "10 * numbers"))
    archived.forget()
    assert imported(script) == (60, "compiled")
    assert archived("total", "one_more", values=(4,)) == (["total"], ["total"])
    archived.forget()
    assert imported(script) == (60, "loaded")


def test_an_archive_holds_what_first_calls_need(script, archived):
    assert archived("total", "double") == (["double", "double", "total", "total"], [])
    assert archived("total") == ([], ["double", "double"])
    assert archived("total", "double", values=(4,)) == (["double"], ["total"])
    with lowered.record_kernels() as changes:  # also of what is in the cache already
        imported(script)
        imported_module(script).double(np.arange(4))
    assert not changes


def test_archives_made_apart_have_equal_bytes(script, archived):
    program = """if True:
        import numpy as np
        from shoal.jit.lowered import record_kernels
        with record_kernels():
            import small_kernels
            small_kernels.total(np.arange(4))
        """
    contents = []
    for _ in range(2):
        subprocess.run([sys.executable, "-c", program], cwd=script.parent, check=True)
        with zipfile.ZipFile(script.parent / lowered.NAME) as archive:
            (inside,) = (archive.read(name) for name in archive.namelist())
        for folder in (script.parent, sys.prefix, sys.base_prefix):
            assert str(folder).encode() not in inside
        contents.append((script.parent / lowered.NAME).read_bytes())
        (script.parent / lowered.NAME).unlink()
        archived.forget()
    assert contents[0] == contents[1]


def test_a_damaged_archive_costs_time_only(script, archived, told):
    archived("total")
    archive = script.parent / lowered.NAME
    whole, rng = archive.read_bytes(), np.random.default_rng(1)
    damaged = [b"", b"PK", whole[:999], whole[-999:]]
    damaged += [
        whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :]
        for place in rng.integers(len(whole), size=often(5, 10))
    ]
    for content in damaged:
        archive.write_bytes(content)
        archived.forget()
        assert imported(script)[0] == 12
    assert not told


def test_lowered_code_is_optimized_as_the_source_is(monkeypatch):
    """Numba's optimization leaves out the counts of references by the names of the functions that
    count. Tours took four times as long with code from an archive that had not kept these names.
    """
    monkeypatch.setattr(compiler.Entry, "keep_lowered", True)
    links, parent = np.zeros((16, 2), dtype=np.int64), np.arange(16)
    forms = compiler.CompiledForms(cycles.tree_of_blocks.function)
    content = forms.compile((np.ones((2, 2), bool), 0, 4, True, links, parent))[2]
    (result,) = forms.entry.overloads.values()
    made = compiler.Entry(compiler._codegen(), "again")
    made.optimize(binding.parse_bitcode(pickle.loads(content).code))
    counts = [
        sum("call" in line and "@NRT_decref(" in line for line in str(module).splitlines())
        for module in (result.library._final_module, made._final_module)
    ]
    assert counts[0] == counts[1] > 0


def test_a_source_that_changed_after_its_import_does_not_choose_lowered_code(
    script, archived, monkeypatch
):
    archived("total")
    archived.forget()
    monkeypatch.setattr(lowered, "_IMPORTED", script.stat().st_mtime_ns - 1)
    assert imported(script) == (12, "compiled")


def test_each_kernel_of_shoal_is_keyed_by_its_source():
    """Bytecode as a key would make an archive useless in another version of Python."""
    kernels = {}
    for part in ("swarm", "steering", "search", "jit"):
        package = importlib.import_module(f"shoal.{part}.kernels")
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            values = vars(importlib.import_module(found.name)).values()
            kernels |= {id(each): each for each in values if hasattr(each, "function")}
    assert len(kernels) > 200
    for kernel in kernels.values():
        assert isinstance(lowered._source(kernel.function.__code__), str), kernel


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user"
)
def test_installed_by_root_and_used_by_somebody_without_a_home(script, tmp_path, tmp_path_factory):
    # the latter may be anywhere
    shared, ours = Path(tempfile.gettempdir()), tmp_path_factory.getbasetemp()
    for folder in script.parents:
        if folder.is_relative_to(ours) or (folder != shared and folder.is_relative_to(shared)):
            folder.chmod(0o755)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    temporary.chmod(0o1777)
    become = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    reading = "import sys, shoal; open(sys.argv[1])"
    reads = subprocess.run(
        [*become, sys.executable, "-c", reading, str(script)], capture_output=True, check=False
    )
    if reads.returncode:
        pytest.skip("another user cannot read the installation, or the folder of the tests")
    place = {"HOME": "/nonexistent", "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"}
    results, compiled, told = played(script, prefix=become, **place)
    assert (results, compiled, len(told)) == ("12.0", "compiled", 1)
    assert f"kept in {temporary}/shoal-kernels-{NOBODY}" in told[0]
    assert (temporary / f"shoal-kernels-{NOBODY}").stat().st_mode & 0o077 == 0
    # a folder of that name that somebody else made may hold anything: it is not used
    shutil.rmtree(temporary / f"shoal-kernels-{NOBODY}")
    (temporary / f"shoal-kernels-{NOBODY}").mkdir(mode=0o777)
    results, compiled, told = played(script, prefix=become, **place)
    assert (results, compiled, len(told)) == ("12.0", "compiled", 1)
    assert "compiled anew by each run" in told[0]
    assert not list((temporary / f"shoal-kernels-{NOBODY}").iterdir())


def test_a_kernel_in_the_cache_needs_no_numba(script):
    """Importing Numba takes longer than most commands. Whatever is imported later works beside what
    is loaded.
    """
    imported(script)
    program = """if True:
        import sys, numpy as np, small_kernels
        print(small_kernels.total(np.arange(4)), "numba" in sys.modules)
        print(small_kernels.total(np.arange(4.0)), "numba" in sys.modules)
        """
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=script.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["12 False", "12.0 True"]


def test_what_determines_a_compiled_form():
    class Pair(NamedTuple):
        one: object
        other: object

    class Twin(NamedTuple):
        one: object
        other: object

    numbers = np.zeros((4, 6))
    fixed = numbers.copy()
    fixed.setflags(write=False)
    arrays = [
        numbers,
        numbers.astype(np.float32),
        numbers.ravel(),
        numbers[:, ::2],
        numbers.T,
        fixed,
        numbers.view(np.recarray),
    ]
    records = [
        np.rec.array(np.zeros(1, dtype=[(name, kind)]))[0]
        for name, kind in (("a", "i8"), ("b", "i8"), ("a", "f8"))
    ]
    values = [
        *arrays,
        *records,
        1,
        2**63,
        True,
        1.0,
        None,
        np.int8(1),
        (1, 2),
        (1, 2.0),
        Pair(1, 2),
        Twin(1, 2),
        Pair(1, numbers),
    ]
    assert len({kinds_of_arguments((value,)) for value in values}) == len(values)
    assert kinds_of_arguments((1, Pair(2, numbers))) == kinds_of_arguments(
        (-5, Pair(7, numbers + 1))
    )
    for value in ("text", [1], np.timedelta64(1, "s"), {}):
        with pytest.raises(TypeError):
            kinds_of_arguments((1, value))


def test_arguments_of_one_numba_type_share_machine_code():
    flat = np.zeros((1, 4))
    values = [
        1,
        np.int64(2),
        True,
        np.bool_(0),
        1.0,
        np.float64(2),
        np.float32(2),
        flat,
        flat.T,
        flat[:, ::2],
        np.zeros((3, 4)),
    ]
    values += [
        np.zeros((3, 4)).T,
        np.zeros((0, 4)),
        (1, flat),
        (np.int64(1), np.zeros((3, 4))),
        (1.0, flat),
    ]
    for one in values:
        for other in values:
            same = compiled_form(kinds_of_arguments((one,))) == compiled_form(
                kinds_of_arguments((other,))
            )
            assert same == (typeof(one) == typeof(other)), (one, other)


def test_damaged_files_are_replaced(script):
    imported(script)
    (whole,) = (script.parent / "__pycache__").glob("*.kernel")
    for damage in (
        b"",
        b"\x80",
        b"garbage" * 99,
        whole.read_bytes()[:99],
        whole.read_bytes()[:-99],
    ):
        whole.write_bytes(damage)
        assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]


def test_a_flipped_bit_is_never_run(script):
    """Of 1,000 random places: machine code with a wrong bit may give wrong results, or end the
    process.
    """
    imported(script)
    (file,) = (script.parent / "__pycache__").glob("*.kernel")
    whole = file.read_bytes()
    kernel = imported_module(script).total
    kinds = kinds_of_arguments((np.arange(4),))
    assert load_machine_code(kernel, kinds) is not None
    rng = np.random.default_rng(1)
    for place in rng.integers(len(whole) * 8, size=1000):
        damaged = bytearray(whole)
        damaged[place // 8] ^= 1 << place % 8
        file.write_bytes(damaged)
        assert load_machine_code(kernel, kinds) is None, place
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert load_machine_code(kernel, kinds) is not None


def test_the_file_of_one_kernel_is_not_taken_for_that_of_another(script):
    """A file that got another name, by a repair of the disk or by hand, is whole but compiled from
    something else.
    """
    module = imported_module(script)
    assert module.total(np.arange(4)) == 12
    assert module.total(np.arange(4.0)) == 12.0
    first, second = sorted((script.parent / "__pycache__").glob("*.kernel"))
    kept = first.read_bytes(), second.read_bytes()
    first.write_bytes(kept[1])
    second.write_bytes(kept[0])
    again = imported_module(script).total
    for numbers in (np.arange(4), np.arange(4.0)):
        assert load_machine_code(again, kinds_of_arguments((numbers,))) is None
        assert again(numbers) == 12
    assert all(
        load_machine_code(again, kinds_of_arguments((numbers,)))
        for numbers in (np.arange(4), np.arange(4.0))
    )


def test_a_damaged_cache_of_a_whole_command(tmp_path):
    """Five wrong bits in each file: the next command compiles, says nothing else, and gives the
    same tour.
    """
    # its kernels compile in a third of the time of those that play an episode
    words = [sys.executable, "-m", "shoal", "tour", "moore", "rectangle:8x8", "--json"]
    environment = {**os.environ, "SHOAL_CACHE": str(tmp_path)}
    environment["PYTHONPATH"] = str(Path(cache.__file__).parents[2])

    def report():
        ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
        assert not [line for line in ended.stderr.splitlines() if line != COMPILING]
        return json.loads(ended.stdout)

    before, rng = report(), np.random.default_rng(2)
    files = sorted(tmp_path.rglob("*.kernel"))
    assert files
    kept = {file: file.read_bytes() for file in files}
    for file, content in kept.items():
        damaged = bytearray(content)
        for place in rng.integers(len(content) * 8, size=5):
            damaged[place // 8] ^= 1 << place % 8
        file.write_bytes(damaged)
    assert report() == before
    assert {file: len(file.read_bytes()) for file in files} == {
        file: len(content) for file, content in kept.items()
    }


def test_a_full_disk_costs_time_and_one_line(script, told, tmp_path, monkeypatch):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4k", "none", str(small)],
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        monkeypatch.setenv("SHOAL_CACHE", str(small))
        assert imported(script) == (12, "compiled")
        assert len(told) == 1
        assert told[0].startswith("compiled kernels cannot be kept in")
        assert not [path for path in small.rglob("*") if path.is_file()]
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_three_first_runs_at_once_and_a_killed_one(script):
    killed = start(script, "int", "float", "short")
    while killed.poll() is None and not list((script.parent / "__pycache__").glob("*.kernel")):
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    runs = [
        start(script, *kinds) for kinds in (("int", "float"), ("float", "short"), ("short", "int"))
    ]
    assert [run.communicate(timeout=120)[0].splitlines()[0] for run in runs] == ["12.0 12.0"] * 3
    assert played(script, "int", "float", "short") == ("12.0 12.0 12.0", "loaded", [])


def test_a_kernel_from_the_cache_is_not_taken_for_another_that_was_made_alike(script):
    alone = played(script, "made", "one")[0], played(script, "made", "nine")[0]
    assert alone[0] != alone[1]
    for path in (script.parent / "__pycache__").glob("*nine_more*"):
        path.unlink()
    # one is loaded, then nine compiled
    assert played(script, "made", "one", "nine")[0] == " ".join(alone)
