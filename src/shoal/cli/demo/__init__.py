"""shoal demo: examples of swarm, steering and search with real or realistic input."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_json, print_table, say
from shoal.core.checks import check_integer, shape_text, shortened
from shoal.core.errors import InvalidInputError

EXAMPLE = "Example: shoal demo --out demo"


def demo(
    what: Annotated[
        str,
        typer.Argument(
            metavar="[steer|search]",
            help=(
                "Demo: steer (two particles, one input) or search (robots in a marsh). By default,"
                " the demo maps the "
                "vessels of an eye."
            ),
        ),
    ] = "vessels",
    particles: Annotated[int, typer.Option("-n", "--particles", help="Number of particles.")] = 300,
    seed: options.Seed = 0,
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Folder for the results.")
    ] = Path("demo"),
    json_: options.Json = False,
) -> None:
    """Map the vessels in a photograph of a real eye, with 300 particles that obey one shared
    command.

    The command 'shoal demo' writes two pictures of the photograph with its vessels, the vessel map,
    a picture of the final map, a chart of the frontier cells, a film (MP4), the HTML player and the
    episode. The command 'shoal demo steer' brings two particles to two goals in a square, a
    hexagon, a disk, a prism and a noisy field. The command 'shoal demo steer' writes figures,
    episodes and two players. The command 'shoal demo search' sends 12 robots through a marsh around
    a lake, and three robots fail. The command 'shoal demo search' writes figures, the player, the
    episode and mission files.
    """
    if what == "steer":
        from shoal.cli.steering import demo_steer

        demo_steer(out, seed=seed, json_=json_)
    elif what == "search":
        from shoal.cli.search.searching import demo_search

        demo_search(out, seed=seed, json_=json_)
    elif what == "vessels":
        _demo_vessels(out, particles=particles, seed=seed, json_=json_)
    else:
        raise InvalidInputError(
            f"demo: expected 'steer', 'search' or nothing, got {shortened(what)}"
        )


def _demo_vessels(out: Path, *, particles: int, seed: int, json_: bool) -> None:
    """Map the vessels of an eye with a swarm: ``shoal demo``."""
    particles = check_integer(particles, what="particles", least=1)
    from shoal.cli.swarm.exploration import summary, write_outputs
    from shoal.swarm import GridWorkspace, SwarmProblem
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.imaging import find_vessels, map_of_vessels
    from shoal.swarm.maps.imaging.samples import retina
    from shoal.swarm.run import run
    from shoal.views.swarm.figures import beside, overlay_picture, save_picture

    check_folder(out)
    photograph = retina()
    say("finding the vessels in the photograph ...")
    mask = find_vessels(photograph).mask
    workspace = GridWorkspace(map_of_vessels(mask), name="retina")
    say(f"mapping {workspace.n_free} cells with {particles} particles ...")
    episode = run(
        SwarmProblem(workspace, particles=particles, policy="closest-frontier"), seed=seed
    )
    result = summary([episode], seed=seed)
    pictures = {
        "photograph.jpg": photograph,
        "overlay.jpg": overlay_picture(photograph, mask),
        "comparison.jpg": beside(photograph, mask),
    }
    written = [save_picture(picture, out / name) for name, picture in pictures.items()]
    write_map(workspace, out / "vessels.png")
    films = [out / "film.html", out / "film.mp4"]
    written += [out / "vessels.png", *write_outputs([episode], result, out, films)]
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    rows = [
        ("photograph", "skimage.data.retina(), CC0, 1411x1411 pixels"),
        ("map", f"{shape_text(workspace.shape)}, {workspace.n_free} free cells"),
        ("result", f"{particles} particles; {episode.sentence}"),
        ("time", f"{episode.seconds:.3f} s"),
    ]
    print_table(
        rows, title="Mapping of the vessels of an eye", written=[path.resolve() for path in written]
    )
