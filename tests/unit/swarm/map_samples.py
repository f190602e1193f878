"""One small map file of each kind, written by the tests that read it."""

from __future__ import annotations

import gzip
import json

import numpy as np
from PIL import Image

LINES = np.zeros((20, 30), dtype=np.uint8)
LINES[3:5, 2:28] = 1
LINES[3:17, 14:17] = 1
GREYS = LINES * 100
GREYS[14:17, 4:20] = 220
"""Three grey values: 0, 100 and 220."""

VOLUME = np.stack([GREYS, GREYS, np.roll(GREYS, 2, axis=1)])


def write_samples(folder):
    """Write one file of each kind. Return the path of each by its name."""
    for write in (
        write_pictures,
        write_tiffs,
        write_texts,
        write_arrays,
        write_niftis,
        write_dicom,
    ):
        write(folder)
    colours = np.stack([GREYS, np.roll(GREYS, 1, axis=0), GREYS // 2], axis=-1).tobytes()
    bits = {"BitsAllocated": 8, "BitsStored": 8, "HighBit": 7}
    colour = {
        "SamplesPerPixel": 3,
        "PhotometricInterpretation": "RGB",
        "PlanarConfiguration": 0,
        "PixelData": colours,
    }
    write_dicom(folder, [GREYS, GREYS], name="coloured", **bits, **colour)
    write_nrrd(folder / "volume.nrrd", VOLUME)
    return {path.name: path for path in folder.iterdir()}


def write_pictures(folder):
    Image.fromarray(GREYS).save(folder / "grey.png")
    Image.fromarray(GREYS).save(folder / "grey.bmp")
    Image.fromarray(GREYS.astype(np.uint16) * 290).save(folder / "deep.tif")
    colours = np.stack([GREYS, np.roll(GREYS, 1, axis=0), GREYS // 2], axis=-1)
    Image.fromarray(colours).save(folder / "colour.png")
    Image.fromarray(colours).save(folder / "colour.jpg", quality=100)
    palette = Image.fromarray(GREYS // 100).convert("P")
    palette.putpalette([0, 0, 0, 250, 100, 100, 0, 200, 0])
    palette.save(folder / "palette.png")
    frames = [Image.fromarray(one) for one in (GREYS, np.roll(GREYS, 3, axis=1))]
    frames[0].save(folder / "film.gif", save_all=True, append_images=frames[1:])
    pages = [Image.fromarray(one) for one in VOLUME]
    pages[0].save(folder / "stack.tif", save_all=True, append_images=pages[1:])
    (folder / "slices").mkdir()
    for number, page in enumerate(pages):
        page.save(folder / "slices" / f"{number}.png")


def write_tiffs(folder):
    import tifffile

    planes = np.stack([GREYS, np.roll(GREYS, 1, axis=0), GREYS // 2]).astype(np.uint16) * 290
    tifffile.imwrite(folder / "planes.tif", planes, photometric="rgb", planarconfig="separate")
    tifffile.imwrite(folder / "double.tif", GREYS.astype(np.float64))
    hyper = np.stack([np.stack([VOLUME, np.roll(VOLUME, 1, axis=1)], axis=1)] * 2)  # T Z C Y X
    hyper[1] = np.roll(hyper[1], 4, axis=-1)
    tifffile.imwrite(
        folder / "imagej.tif",
        hyper,
        imagej=True,
        resolution=(4, 4),
        metadata={"axes": "TZCYX", "spacing": 2.0, "unit": "um"},
    )
    sizes = {
        "PhysicalSizeX": 0.5,
        "PhysicalSizeY": 0.25,
        "PhysicalSizeZ": 3.0,
        "Channel": {"Name": ["DAPI", "GFP"]},
    }
    tifffile.imwrite(folder / "cells.ome.tif", hyper, metadata={"axes": "TZCYX", **sizes})


def write_texts(folder):
    letters = ["".join(".#"[int(value == 0)] for value in row) for row in LINES]
    (folder / "rows.txt").write_text("\n".join(letters) + "\n")
    (folder / "octile.map").write_text(
        "type octile\nheight 20\nwidth 30\nmap\n" + "\n".join(letters).replace("#", "@") + "\n"
    )
    np.savetxt(folder / "table.csv", GREYS, fmt="%d", delimiter=",")
    np.savetxt(folder / "savetxt.txt", GREYS, header="a maze")


def write_arrays(folder):
    from scipy.io import savemat

    np.save(folder / "flat.npy", GREYS)
    np.save(folder / "fortran.npy", np.asfortranarray(VOLUME.astype(np.float64)))
    np.save(folder / "colour.npy", np.stack([GREYS, np.roll(GREYS, 1, axis=0), GREYS], axis=-1))
    savemat(folder / "matrix.mat", {"maze": GREYS.astype(float), "voxel": 0.5})


def write_niftis(folder):
    import nibabel

    stored = VOLUME.transpose(2, 0, 1)
    (folder / "volume.nii.gz").write_bytes(
        gzip.compress(nibabel.Nifti1Image(stored, np.eye(4)).to_bytes())
    )
    film = np.stack([stored, np.roll(stored, 1, axis=0)], axis=-1)
    nibabel.save(nibabel.Nifti1Image(film, np.eye(4)), folder / "film.nii")


def write_nrrd(path, values, **header):
    """Write a picture or a volume as NRRD."""
    import nrrd

    nrrd.write(str(path), np.asarray(values).T, header, index_order="F")


def write_dicom(folder, values=VOLUME, *, step=2.5, name="series", **more):
    """Write a DICOM series: one file for each layer, from head to foot, with pixels of 0.5 mm and
    0.25 mm.
    """
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    (folder / name).mkdir()
    series = generate_uid(entropy_srcs=[name])
    for number, layer in enumerate(values):
        meta = FileMetaDataset()
        meta.TransferSyntaxUID = ExplicitVRLittleEndian
        meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
        meta.MediaStorageSOPInstanceUID = generate_uid(entropy_srcs=[name, str(number)])
        one = Dataset()
        one.file_meta = meta
        one.SOPClassUID, one.SOPInstanceUID = (
            meta.MediaStorageSOPClassUID,
            meta.MediaStorageSOPInstanceUID,
        )
        one.SeriesInstanceUID, one.InstanceNumber = series, len(values) - number
        one.Rows, one.Columns = layer.shape
        one.SamplesPerPixel, one.PhotometricInterpretation, one.PixelRepresentation = (
            1,
            "MONOCHROME2",
            0,
        )
        one.BitsAllocated, one.BitsStored, one.HighBit = 16, 16, 15
        one.PixelSpacing = [0.5, 0.25]
        one.ImageOrientationPatient, one.ImagePositionPatient = (
            [1, 0, 0, 0, 1, 0],
            [0, 0, -step * number],
        )
        one.PixelData = layer.astype("<u2").tobytes()
        for key, value in more.items():
            setattr(one, key, value)
        one.save_as(folder / name / f"{number * 7 % 10}{number}.dcm", enforce_file_format=True)


def as_json(capsys):
    """The object that a command has printed."""
    return json.loads(capsys.readouterr().out)
