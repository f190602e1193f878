"""python -m benchmarks.sizes NAME [SIZE]: the sizes that users bring; CPU seconds and memory.

Each measurement runs in a process of its own, so that its peak memory is its own. What the process
needs before its work (imports, the data) is subtracted from the memory.
"""

from __future__ import annotations

import argparse
import inspect
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from shoal.lab import Sweep

WARM = 100  # size of the first call, which loads libraries and kernels


def measure(text: str, call: Callable[[], object], *, per: float = 1, unit: str = "") -> None:
    """Print the CPU seconds of a call and the memory by which the process grew."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    try:
        found = call()
    except Exception as error:  # the sentence is a result, too
        found = error
    seconds = time.process_time() - began
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    share = f", {grown / per:.1f} bytes a {unit}" if unit else ""
    print(f"{text}: {seconds:.2f} CPU s, {grown / 2**20:.0f} MiB more{share}: {repr(found)[:160]}")


def bootstrap(size: int = 100_000) -> None:
    """A bootstrap interval of so many trials at one point."""
    from shoal.lab.statistics import estimate

    values = np.random.default_rng(0).exponential(5, size)
    estimate(values[:WARM], method="bootstrap")
    measure(f"bootstrap of {size} trials", lambda: estimate(values, method="bootstrap"))


def summary(size: int = 10_000_000) -> None:
    """The summary and the CSV of a store of so many rows."""
    from benchmarks.store import large
    from shoal.lab import Store
    from shoal.lab.exchange import export
    from shoal.lab.statistics import estimate, summarise

    sweep = large(size)
    estimate([1, 2, 3])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.sqlite"
        elsewhere(write_store, path, sweep)
        with Store(path) as store:
            measure(f"summary of {size} rows", lambda: len(summarise(store, "large", "moves")))
            measure(f"CSV of {size} rows", lambda: export(store, "large", Path(folder) / "a.csv"))


def merge(size: int = 1_000_000) -> None:
    """Two stores of so many rows, whose sweeps differ."""
    from benchmarks.store import large
    from shoal.lab import merge_stores

    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in "ab"]
        for seed, path in enumerate(paths):
            elsewhere(write_store, path, large(size, seed=seed))
        measure(f"merge of {size} rows each", lambda: merge_stores(paths, Path(folder) / "c"))


def elsewhere(call: Callable[..., object], *arguments: object) -> None:
    """Call a function in another process, whose memory does not count."""
    process = multiprocessing.get_context("fork").Process(target=call, args=arguments)
    process.start()
    process.join()
    assert process.exitcode == 0


def write_store(path: Path, sweep: Sweep) -> None:
    from benchmarks.store import fill
    from shoal.lab import Store

    with Store(path, write=True) as store:
        fill(store, sweep, skip=9973)


def write_mask(path: Path, side: int) -> None:
    from PIL import Image

    blocks = np.random.default_rng(0).random((side // 10, side // 10)) < 0.7
    Image.fromarray(np.kron(blocks, np.full((10, 10), 255, dtype=np.uint8))).save(path)


def write_volumes(paths: list[Path], side: int) -> None:
    import nibabel
    import nrrd

    blocks = np.random.default_rng(0).random((side // 8, side // 8, side // 8)) < 0.7
    cells = np.kron(blocks, np.ones((8, 8, 8), dtype=np.uint8))
    nibabel.save(nibabel.Nifti1Image(cells, np.eye(4)), paths[0])
    nrrd.write(str(paths[1]), cells, compression_level=1)


def mask(size: int = 10_000) -> None:
    """A mask of size x size pixels."""
    from shoal.swarm.maps.files import read_map

    with tempfile.TemporaryDirectory() as folder:
        for side in (WARM, size):
            path = Path(folder) / f"{side}.png"
            elsewhere(write_mask, path, side)
            measure(f"{side}^2 pixels", partial(read_map, path), per=side**2, unit="pixel")


def volume(size: int = 512) -> None:
    """A volume of size^3 cells, as NIfTI and as NRRD."""
    from shoal.swarm.maps.files import read_map

    with tempfile.TemporaryDirectory() as folder:
        for side in (16, size):
            paths = [Path(folder) / f"{side}{suffix}" for suffix in (".nii.gz", ".nrrd")]
            elsewhere(write_volumes, paths, side)
            for path in paths:
                measure(
                    f"{path.name}, {side}^3 cells",
                    partial(read_map, path),
                    per=side**3,
                    unit="cell",
                )


def reach(size: int = 64) -> None:
    """What two particles reach in six moves in a polygon with so many sides."""
    from shoal.steering import polygon_reach, regular_polygon

    for sides in (4, size):
        workspace = regular_polygon(sides)
        measure(
            f"{sides} sides, 6 moves",
            lambda workspace=workspace: [
                one.fraction() for one in polygon_reach(workspace, (0.2, 0.1), moves=6)
            ],
        )


def listing(size: int = 10_000) -> None:
    """A list of a studio's folder of so many episodes."""
    from shoal.studio.folder import Folder

    with tempfile.TemporaryDirectory() as name:
        for i in range(size):
            (Path(name) / f"{i}.npz").write_bytes(b"PK")
        folder = Folder(name)
        for turn in ("first", "second"):
            measure(f"{turn} list of {size}", lambda: len(folder.list_files()["files"]))


def player(size: int = 1_000_000) -> None:
    """The HTML player of an episode of so many moves."""
    from shoal import film, run
    from shoal.swarm import SwarmProblem

    for moves in (WARM, size):
        problem = SwarmProblem(map="line:1900", particles=1, policy="random-moves", max_moves=moves)
        episode = run(problem, seed=3)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.html"
            measure(f"page of {episode.moves} moves", partial(film, episode, path))
            seconds = seconds_in_browser(path, episode.moves)
            print(f"shown: {seconds[0]:.1f} s; its last move after {seconds[1]:.1f} s")


def seconds_in_browser(path: Path, moves: int) -> tuple[float, float]:
    """Return the seconds until Chromium has opened a page, and until it shows the last move."""
    import shutil

    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page()
        began = time.perf_counter()
        page.goto(path.as_uri())
        opened = time.perf_counter() - began
        page.keyboard.press("End")
        text = f"move {moves:,} of"
        page.wait_for_function("text => document.body.innerText.includes(text)", arg=text)
        seconds = time.perf_counter() - began - opened
        browser.close()
        return opened, seconds


def best(size: int = 1000) -> None:
    """Moves of the planner `best` on size x size cells."""
    from shoal import run
    from shoal.swarm import SwarmProblem

    for side in (64, size):
        problem = SwarmProblem(
            map=f"cave:{side}x{side}", particles=side**2 // 100, policy="best", max_moves=20
        )
        measure(f"{side}^2 cells, 20 moves", partial(run, problem))


SIZES = {
    call.__name__: call
    for call in (bootstrap, summary, merge, mask, volume, reach, listing, player, best)
}


def main() -> None:
    names = "\n".join(f"{name}: {inspect.getdoc(call)}" for name, call in SIZES.items())
    parser = argparse.ArgumentParser(
        description=f"{__doc__}\n{names}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=SIZES)
    parser.add_argument("size", nargs="*", type=int)
    given = parser.parse_args()
    SIZES[given.name](*given.size[:1])


if __name__ == "__main__":
    main()
