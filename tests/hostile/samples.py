"""A valid file of every format that Shoal reads, and what reads it: each ends with a result or one
sentence.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import io
import json
import time
import traceback
import zipfile
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

import shoal
from shoal.cli import run as command
from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.lab import Sweep, run_sweep
from shoal.lab.coordinator import prepare
from shoal.missions import missions_of
from shoal.missions.checking import check_missions
from shoal.missions.files import FORMATS, write_missions
from shoal.parts import problem_for
from shoal.rigs import SimulatedRig
from shoal.rigs.driving import drive, replay_log
from shoal.rigs.log import DriveLog, read_log
from shoal.search.flight.terrain import open_terrain
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.regions.builder import open_region
from shoal.search.regions.places import read_points
from shoal.search.regions.region import SearchRegion
from shoal.steering.workspaces.formats import open_workspace
from shoal.studio.answers import ANSWERS
from shoal.studio.folder import PICTURES, Folder
from shoal.studio.jobs import FILE as JOBS
from shoal.studio.jobs import JobStore
from shoal.swarm.maps.files import open_map
from shoal.swarm.maps.pictures import read_pixels

Reader = Callable[[Path], object]
LONGEST = 700
"""Characters of a refusal, with the path of the file in it."""

SECONDS = 10
FIELD = [[8.50, 47.40], [8.501, 47.40], [8.501, 47.401], [8.50, 47.401], [8.50, 47.40]]
POND = [[8.5004, 47.4004], [8.5006, 47.4004], [8.5006, 47.4006], [8.5004, 47.4004]]
SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]


def samples(folder: Path) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    """Return the reader of each format and valid files of it: the content of each by its name, the
    one to read first.
    """
    (folder / "field.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [FIELD]}))
    field = open_region(folder / "field.geojson")
    flown = _missions(folder, field) | _flights(field)
    return (
        _maps()
        | _regions(folder)
        | flown
        | _studio(folder)
        | _steering()
        | _problems()
        | _episodes(folder)
    )


def verified(path: Path) -> object:
    """Load an episode and play it again."""
    return shoal.load(path).verify()


def replayed(path: Path) -> object:
    """Read the log of a drive and drive again."""
    read_log(path)
    return replay_log(path)


def through_commands(path: Path) -> object:
    """Look at a store by all commands that do; what any refuses is raised."""
    for words in (
        ["summary"],
        ["status"],
        ["check"],
        ["export", "--out", str(path.with_suffix(".csv"))],
    ):
        said = io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = command(["sweep", words[0], str(path), *words[1:]])
        if code == 2:
            raise InvalidInputError(said.getvalue().rstrip("\n"))
    return code


# What is read, by part


def _maps() -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    import nibabel

    free = np.random.default_rng(5).integers(0, 2, (6, 9)).astype(bool)
    volume = nibabel.Nifti1Image(np.ones((3, 4, 2), np.uint8), np.eye(4)).to_bytes()
    text = b"..#.\n#...\n"
    many = {
        "png": [
            _picture("PNG"),
            _picture("PNG", np.uint16),
            _picture("PNG", mode="P", transparency=3),
            _picture("PNG", mode="RGBA"),
        ],
        "tif": [
            *(
                _picture("TIFF"),
                _picture("TIFF", np.uint16),
                _picture("TIFF", mode="F"),
                *_tiffs(free),
            ),
            _picture("TIFF", mode="1", compression="group4"),
            *(
                _picture("TIFF", mode="RGB", compression=name)
                for name in ("tiff_lzw", "tiff_adobe_deflate", "jpeg", "packbits")
            ),
        ],
        "bmp": [_picture("BMP"), _picture("BMP", mode="1"), _picture("BMP", mode="RGBA")],
        "jpg": [_picture("JPEG"), _picture("JPEG", mode="CMYK", progressive=True)],
        "txt": [text, b"\xef\xbb\xbf..\r\n##\r\n"],
        "map": [b"type octile\nheight 2\nwidth 4\nmap\n..@.\n@...\n"],
        "npy": [_array(free), _array(free.astype(float)), _array(np.ones((2, 2, 2), ">i2"))],
        "csv": [b"1,1,0,1\n0,1,1,1\n", b"1;0.0;1e0\n0;1;1\n"],
        "gif": [_picture("GIF")],
        "mat": [_matrix(free)],
        "nrrd": [_nrrd(free, "raw"), _nrrd(free, "gzip"), _nrrd(free, "ascii")],
        "dcm": [_dicom(free)],
        "nii": [volume],
        "nii.gz": [gzip.compress(volume, mtime=0)],
    }
    found: dict[str, tuple[Reader, list[dict[str, bytes]]]] = {
        f"map {suffix}": (open_map, [{f"a.{suffix}": content} for content in contents])
        for suffix, contents in many.items()
    }
    slices = {f"layers/{k}.png": _picture("PNG") for k in (1, 2)}
    return found | {
        "map nhdr": (
            open_map,
            [
                {
                    "a.nhdr": _nrrd(free, "raw", file="a.raw"),
                    "a.raw": free.astype(np.uint8).tobytes(),
                }
            ],
        ),
        "map folder": (lambda path: open_map(path.parent), [slices]),
        "photograph": (
            read_pixels,
            [{"a.png": _picture("PNG", mode="RGBA")}, {"a.tif": _picture("TIFF")}],
        ),
    }


def _matrix(free: np.ndarray) -> bytes:
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {"free": free}, do_compression=True)
    return buffer.getvalue()


def _nrrd(free: np.ndarray, encoding: str, *, file: str = "") -> bytes:
    sides = " ".join(map(str, reversed(free.shape)))
    head = (
        f"NRRD0004\ntype: uchar\ndimension: 2\nsizes: {sides}\nencoding: {encoding}\nspacings: 0.5"
        " 0.5\n".encode()
    )
    raw = free.astype(np.uint8).tobytes()
    if file:
        return head + f"data file: {file}\n".encode()
    return (
        head
        + b"\n"
        + {"raw": raw, "gzip": gzip.compress(raw), "ascii": " ".join(map(str, raw)).encode()}[
            encoding
        ]
    )


def _dicom(free: np.ndarray) -> bytes:
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian

    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    one.SOPClassUID, one.SOPInstanceUID, one.SeriesInstanceUID = (
        "1.2.840.10008.5.1.4.1.1.2",
        "1.2.3",
        "1.2.4",
    )
    one.Rows, one.Columns = free.shape
    one.SamplesPerPixel, one.PhotometricInterpretation, one.PixelRepresentation = (
        1,
        "MONOCHROME2",
        0,
    )
    one.BitsAllocated, one.BitsStored, one.HighBit, one.PixelSpacing = 8, 8, 7, [0.5, 0.5]
    one.PixelData = free.astype(np.uint8).tobytes()
    buffer = io.BytesIO()
    one.save_as(buffer, enforce_file_format=True)
    return buffer.getvalue()


def _tiffs(free: np.ndarray) -> list[bytes]:
    import tifffile

    made = []
    for values, options in (
        (free.astype(np.float64), {}),
        (
            np.stack([free] * 3).astype(np.uint16) * 999,
            {"photometric": "rgb", "planarconfig": "separate"},
        ),
        (
            np.stack([free] * 2).astype(np.uint8),
            {"imagej": True, "metadata": {"axes": "ZYX", "spacing": 2.0, "unit": "um"}},
        ),
    ):
        buffer = io.BytesIO()
        tifffile.imwrite(buffer, values, **options)
        made.append(buffer.getvalue())
    return made


def _regions(folder: Path) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    import pyogrio
    import shapely

    shapes = np.array(
        [shapely.to_wkb(shapely.Polygon(ring)) for ring in (FIELD, POND)], dtype=object
    )
    layered = {}
    for suffix, driver in (("gpkg", "GPKG"), ("shp", "ESRI Shapefile")):
        path = folder / f"{suffix}-files" / f"a.{suffix}"
        path.parent.mkdir()
        marks = [np.array(["", "1"], dtype=object)]
        pyogrio.raw.write(
            path,
            shapes,
            marks,
            ["no_go"],
            crs="EPSG:4326",
            geometry_type="Polygon",
            driver=driver,
            layer="a",
        )
        others = sorted(other for other in path.parent.iterdir() if other != path)
        layered[f"region {suffix}"] = (
            open_region,
            [{one.name: one.read_bytes() for one in (path, *others)}],
        )
    zipped = _zipped(layered["region shp"][1][0])
    words = [" ".join(f"{x},{y},0" for x, y in ring) for ring in (FIELD, POND)]
    kml = (
        '<?xml version="1.0" encoding="UTF-8"?><kml'
        ' xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>a</name><Polygon>'
        f"<outerBoundaryIs><LinearRing><coordinates>{words[0]}</coordinates></LinearRing></outerBoundaryIs>"
        f"<innerBoundaryIs><LinearRing><coordinates>{words[1]}</coordinates></LinearRing></innerBoundaryIs>"
        "</Polygon></Placemark></Document></kml>"
    ).encode()
    polygon = {"type": "Polygon", "coordinates": [FIELD, POND]}
    feature = {"type": "Feature", "properties": {"name": "a", "no_go": False}, "geometry": polygon}
    collection = {
        "type": "FeatureCollection",
        "features": [feature],
        "crs": {"properties": {"name": "EPSG:4326"}},
    }
    return layered | {
        "region geojson": (
            open_region,
            [{"a.geojson": json.dumps(one).encode()} for one in (polygon, collection)],
        ),
        "region kml": (open_region, [{"a.kml": kml}, {"a.kml": kml.decode().encode("utf-16")}]),
        "region plan": (
            open_region,
            [{"a.plan": _plan(survey=True)}, {"a.plan": _plan(survey=False)}],
        ),
        "region poly": (open_region, [{"a.poly": _latitudes}]),
        "region fen": (open_region, [{"a.fen": b"47.4005 8.5005\n" + _latitudes}]),
        "region waypoints": (open_region, [{"a.waypoints": _fence_items}]),
        "region txt": (open_region, [{"a.txt": _fence_items}]),
        "region zip": (open_region, [{"a.zip": zipped}]),
        "region kmz": (open_region, [{"a.kmz": _zipped({"doc.kml": kml})}]),
        "region csv": (
            open_region,
            [{"a.csv": b"x_m,y_m,ring\n0,0,1\n90,0,1\n90,60,1\n\n20,20,2\n30,20,2\n30,30,2\n"}],
        ),
        "points csv": (
            _points,
            [{"a.csv": b"x_m,y_m\n1,1\n9,9\n"}, {"a.csv": b"# here\n5;6\n7;8\n"}],
        ),
    }


def _points(path: Path) -> object:
    return read_points(path, open_region("square:60"), what="obstacles")


def _missions(
    folder: Path, region: SearchRegion
) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    missions, flown = missions_of([(-20, -30), (20, -30), (20, 30), (-20, 30)], region.frame), {}
    for name in FORMATS:
        (file,) = write_missions(missions, folder / name, formats=[name])
        flown[f"mission {name}"] = (
            partial(_checked, region=region),
            [{f"mission/{file.name}": file.read_bytes()}],
        )
    return flown


def _checked(path: Path, region: SearchRegion) -> object:
    return check_missions(path.parent, region, 30).report()


def _flights(region: SearchRegion) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    """Vehicles, heights of the ground, and the fence and rally points beside missions."""
    corners = ((8.499, 47.399), (8.502, 47.399), (8.502, 47.402), (8.499, 47.402))
    rows = [f"{k}\t0\t0\t5001\t4\t0\t0\t0\t{y}\t{x}\t0\t1" for k, (x, y) in enumerate(corners)]
    beside = {
        "fence.txt": "\n".join(["QGC WPL 110", *rows]),
        "rally.txt": "QGC WPL 110\n0\t0\t3\t5100\t0\t0\t0\t0\t47.4\t8.5\t9\t1\n",
    }
    missions = missions_of([(-20, -30), (20, -30), (20, 30)], region.frame, autopilot="ardupilot")
    text = FORMATS.get("wpl").write(missions[0])
    grid = (
        b"ncols 3\nnrows 2\nxllcorner 8.5\nyllcorner 47.4\ncellsize 0.001\nNODATA_value -9999\n401"
        b" 402 403.5\n404 -9999 406\n"
    )
    drone: dict[str, object] = {
        "preset": "multirotor",
        "cruise_speed": 8.0,
        "endurance": 20,
        "wind_speed": 3,
    }
    toml = "\n".join(f"{name} = {json.dumps(value)}" for name, value in drone.items()).encode()
    return {
        "vehicle json": (vehicle_of, [{"a.json": json.dumps(drone).encode()}]),
        "vehicle toml": (vehicle_of, [{"a.toml": toml}]),
        "terrain tif": (
            open_terrain,
            [{"a.tif": _heights(kind)} for kind in (np.float32, np.uint16)],
        ),
        "terrain asc": (open_terrain, [{"a.asc": grid}, {"a.asc": grid, "a.prj": b"EPSG:4326"}]),
        "mission fence": (
            partial(_checked, region=region),
            [
                {
                    f"mission/{name}": beside[name].encode(),
                    "mission/robot-01.waypoints": text.encode(),
                }
                for name in beside
            ],
        ),
    }


def _studio(folder: Path) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    """What a browser brings into the folder of a studio, and the jobs that lie there."""
    store = JobStore(folder)
    store.add("play", {"problem": {"kind": "swarm", "map": "line:9"}, "seed": 1})
    store.close()
    return {
        "studio upload": (
            _uploaded,
            [{"a.png": _picture("PNG")}, {"a.tif": _picture("TIFF")}, {"a.geojson": b"{}"}],
        ),
        "studio jobs": (_jobs, [{JOBS: (folder / JOBS).read_bytes()}]),
    }


def _jobs(path: Path) -> object:
    store = JobStore(path.parent)
    try:
        return store.newest(), store.counts()
    finally:
        store.close()


def _uploaded(path: Path) -> object:
    """Bring a file into the folder of a studio, and look at it there as pages do."""

    async def pieces() -> AsyncIterator[bytes]:
        check_file(path, what="file of the tests")
        yield path.read_bytes()

    folder = Folder(path.parent)
    with ThreadPoolExecutor(1) as thread:  # a test before may have left its own loop in this one
        name = thread.submit(asyncio.run, folder.take(path.name, pieces())).result()
    return (
        ANSWERS["photograph"](folder, {"file": name}) if name.endswith(PICTURES) else folder.files()
    )


def _heights(dtype: type) -> bytes:
    """Return a GeoTIFF of 2 x 3 heights."""
    from PIL import Image, TiffImagePlugin

    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550], tags.tagtype[33550] = (0.001, 0.001, 0.0), 12
    tags[33922], tags.tagtype[33922] = (0.0, 0.0, 0.0, 8.5, 47.4, 0.0), 12
    tags[34735], tags.tagtype[34735] = (
        (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326),
        3,
    )
    tags[42113] = "-9999"
    buffer = io.BytesIO()
    Image.fromarray(np.arange(400, 406, dtype=dtype).reshape(2, 3)).save(
        buffer, format="TIFF", tiffinfo=tags
    )
    return buffer.getvalue()


def _steering() -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    region = {
        "type": "region",
        "outline": SQUARE[:-1],
        "obstacles": [[[0.5, 0.5], [1, 0.5], [1, 1]]],
    }
    prism = {
        "type": "prism",
        "base": {"type": "polygon", "vertices": SQUARE[:-1]},
        "height": 1,
        "open_ends": True,
    }
    drawing = (
        b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><rect width="8"'
        b' height="8"/><path d="M1 1h2v2z"/></svg>'
    )
    return {
        "workspace json": (
            open_workspace,
            [{"a.json": json.dumps(one).encode()} for one in (region, prism)],
        ),
        "workspace geojson": (
            open_workspace,
            [{"a.geojson": json.dumps({"type": "Polygon", "coordinates": [SQUARE]}).encode()}],
        ),
        "workspace wkt": (
            open_workspace,
            [{"a.wkt": b"POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0), (0.5 0.5, 1 0.5, 1 1, 0.5 0.5))"}],
        ),
        "workspace svg": (open_workspace, [{"a.svg": drawing}]),
    }


def _problems() -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    problems = {
        "swarm": problem_for("line:9", {"particles": 3, "policy": "random-moves", "slip": 0.1}),
        "steering": problem_for(
            "square", {"start": [(0.2, 0.5), (0.4, 0.5)], "goal": [(0.3, 0.5), (0.4, 0.5)]}
        ),
        "search": problem_for("square:60", {"robots": 2, "footprint": 10, "faults": "crash:1@20"}),
    }
    sweep = (
        b'name = "x"\ntrials = 2\nseed = 1\n[problem]\nkind = "swarm"\nmap ='
        b' "line:9"\n[axes]\nparticles = [2, 9]\nmax_moves = {from = 1, to = 9, count = 3}\n'
    )
    found: dict[str, tuple[Reader, list[dict[str, bytes]]]] = {
        f"problem {name}": (shoal.load_problem, [{"a.json": json.dumps(one.to_dict()).encode()}])
        for name, one in problems.items()
    }
    return found | {"sweep": (lambda path: prepare(Sweep.load(path)), [{"a.toml": sweep}])}


def _episodes(folder: Path) -> dict[str, tuple[Reader, list[dict[str, bytes]]]]:
    swarm = shoal.run("line:9", particles=3, policy="random-moves")
    steering = shoal.run("square", start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)])
    search = shoal.run("square:60", robots=2, footprint=10)
    for name, episode in {
        "swarm.npz": swarm,
        "steering.json": steering,
        "search.json": search,
    }.items():
        episode.save(folder / name)
    rig = SimulatedRig(open_map("line:9"), [(0, 1), (0, 5)])
    drive(rig, policy="closest-frontier", log=DriveLog(folder / "drive.jsonl"))
    sweep = Sweep(name="s", problem={"kind": "swarm", "map": "line:9"}, axes={"particles": [2, 9]})
    run_sweep(sweep, folder / "store", workers=0)
    read = {
        "swarm.npz": verified,
        "steering.json": verified,
        "search.json": verified,
        "drive.jsonl": replayed,
        "store": through_commands,
    }
    return {
        f"saved {name}": (reader, [{name: (folder / name).read_bytes()}])
        for name, reader in read.items()
    }


def _picture(
    kind: str, dtype: type = np.uint8, *, mode: str | None = None, **options: object
) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    image = Image.fromarray(
        np.random.default_rng(5).integers(0, np.iinfo(dtype).max, (6, 9), dtype=dtype)
    )
    (image.convert(mode) if mode else image).save(buffer, format=kind, **options)
    return buffer.getvalue()


def _array(values: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(values))
    return buffer.getvalue()


_latitudes = b"#saved by Mission Planner 1.3.80\n47.4 8.5\n47.4 8.501\n47.401 8.501\n47.401 8.5\n"
_fence_items = b"QGC WPL 110\n" + b"".join(
    b"%d\t0\t0\t%d\t%d\t0\t0\t0\t%.4f\t%.4f\t0\t1\n" % (k, command, count, latitude, longitude)
    for k, (command, count, latitude, longitude) in enumerate(
        [(5000, 0, 47.4002, 8.5002)]
        + [
            (5001, 4, *corner)
            for corner in ((47.4, 8.5), (47.4, 8.501), (47.401, 8.501), (47.401, 8.5))
        ]
        + [
            (5002, 3, *corner)
            for corner in ((47.4004, 8.5004), (47.4004, 8.5006), (47.4006, 8.5004))
        ]
        + [(5004, 9, 47.4008, 8.5008)]
    )
)


def _plan(*, survey: bool) -> bytes:
    """Return a plan of QGroundControl: a survey, or a fence that includes a polygon and excludes a
    polygon and a circle.
    """
    square = [[47.4, 8.5], [47.4, 8.501], [47.401, 8.501], [47.401, 8.5]]
    inner = [[47.4004, 8.5004], [47.4004, 8.5006], [47.4006, 8.5004]]
    circle = {
        "circle": {"center": [47.4008, 8.5008], "radius": 9.0},
        "inclusion": False,
        "version": 1,
    }
    polygons = [
        {"inclusion": inclusion, "polygon": ring, "version": 1}
        for inclusion, ring in ((True, square), (False, inner))
    ]
    items = (
        [{"type": "ComplexItem", "complexItemType": "survey", "polygon": square}] if survey else []
    )
    fence = {"circles": [circle], "polygons": polygons[survey:], "version": 2}
    return json.dumps(
        {"fileType": "Plan", "geoFence": fence, "mission": {"items": items}, "version": 1}
    ).encode()


def _zipped(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def lay_out(files: dict[str, bytes], folder: Path) -> Path:
    """Write files into a folder; return the path of the first."""
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(content)
    return folder / next(iter(files))


def faults(read: Reader, path: Path) -> list[str]:
    """Return what is wrong with how a reader takes a file: what it raises, how it refuses, and how
    long it takes.
    """
    started = time.process_time()
    try:
        read(path)
    except ShoalError as error:
        said = str(error)
        wrong = ["no sentence"] if not said.strip() or "\n" in said else []
        wrong += [f"{len(said)} characters: {said[:300]}"] if len(said) > LONGEST else []
    except (Exception, SystemExit):
        wrong = [traceback.format_exc()]
    else:
        wrong = []
    took = time.process_time() - started
    return wrong + ([f"{took:.1f} s of the processor"] if took > SECONDS else [])
