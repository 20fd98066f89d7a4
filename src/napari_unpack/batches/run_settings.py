"""What is done to every scan of a run, and how a scan that is done is known again."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from napari_unpack.atomic import is_temporary, written_atomically
from napari_unpack.geometry.view import FROM_ABOVE, View
from napari_unpack.io.scan import Scan
from napari_unpack.io.session_archive import ArrayFacts
from napari_unpack.segmentation.common.validation import check_smallest
from napari_unpack.unpacking.direction import checked_direction
from napari_unpack.version import __version__

FORMAT, VERSION = "napari-unpack batch", 1
RUN, SCANS = "run.json", "scans"
INDEX, ALL_OBJECTS, ALL_SCANS = "index.html", "objects.parquet", "scans.parquet"
OWN_FILES = (RUN, INDEX, ALL_OBJECTS, ALL_SCANS)
LABEL_FORMATS = ("npz", "zarr")


@dataclass(frozen=True)
class Settings:
    """What is done to every scan; all of it can be seen in the results.

    Parameters
    ----------
    smallest : float, optional
        See `segment`.
    grainy : bool, optional
        See `segment`.
    view : (float, float, float)
        Direction of looking, z y x.
    direction : str or (float, float, float), optional
        Where objects leave; by default towards the viewer.
    pictures : bool
        Draw each scan, and make a page of its objects.
    film : bool
        Make a film of each unpacking.
    labels : {"npz", "zarr"}
        How labels are written: `labels.npz`, or OME-Zarr in `labels.ome.zarr`.
    copies : bool
        Sessions hold a copy of the volume; False lets them refer to the file.

    Raises
    ------
    ValueError
        If an option is not as above.
    """

    smallest: float | None = None
    grainy: bool | None = None
    view: tuple[float, float, float] = FROM_ABOVE
    direction: str | tuple[float, float, float] | None = None
    pictures: bool = True
    film: bool = False
    labels: str = "npz"
    copies: bool = True

    def __post_init__(self) -> None:
        if self.labels not in LABEL_FORMATS:
            raise ValueError(f"labels must be npz or zarr, got {self.labels!r}")
        # Before any scan: each would fail by it.
        View(self.view)
        checked_direction(self.direction)
        check_smallest(self.smallest)
        # What is equal is known by one hash, and JSON takes no numbers of numpy.
        plain: dict[str, Any] = {"view": tuple(map(float, self.view))}
        if not isinstance(self.direction, str | None):
            plain["direction"] = tuple(map(float, self.direction))
        plain["smallest"] = None if self.smallest is None else float(self.smallest)
        plain["grainy"] = None if self.grainy is None else bool(self.grainy)
        plain |= {k: bool(getattr(self, k)) for k in ("pictures", "film", "copies")}
        for name, value in plain.items():
            object.__setattr__(self, name, value)

    def record(self) -> dict[str, Any]:
        """Return them as plain data, with the version whose results they decide."""
        # As it comes back from a file, where a tuple is a list.
        told: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return {**told, "version": __version__}


def identity_of_settings(settings: Settings) -> str:
    """Return what settings are known by."""
    return hashlib.sha256(json.dumps(settings.record(), sort_keys=True).encode()).hexdigest()


def identity(scan: Scan, settings: Settings) -> str:
    """Return what a result is known by: content of a scan and settings, no names and no times.

    Parameters
    ----------
    scan : Scan
        As it was read, with the labels and the voxel size that count.
    settings : Settings
    """
    arrays = {"volume": scan.volume, "labels": scan.labels}
    place = scan.scanner_from_scan
    told = {
        "settings": identity_of_settings(settings),
        **{k: ArrayFacts.of(v).record() for k, v in arrays.items() if v is not None},
        "spacing": scan.spacing,
        "names": sorted((scan.names or {}).items()),
        "place": None if place is None else place.tolist(),
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def check_folder(output: Path, settings: Settings) -> None:
    """Refuse a folder that holds something else, or a run with other settings.

    Parameters
    ----------
    output : Path
    settings : Settings

    Raises
    ------
    ValueError
        If it is not free for this run.
    """
    remedy = "choose another folder, or give --force (force=True) to make its results anew"
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output} is a file, and a folder is wanted for the results")
    if not is_run(output):
        if output.exists() and not all(is_temporary(entry.name) for entry in output.iterdir()):
            raise ValueError(f"{output} holds something else: {remedy}")
        return
    before, told = _settings_of(output), settings.record()
    other = sorted(k for k in before | told if before.get(k) != told.get(k))
    if other:
        changes = ", ".join(
            f"{k} {_said(before.get(k))} there and {_said(told.get(k))} now" for k in other
        )
        raise ValueError(f"{output} holds a run with other settings ({changes}): {remedy}")


def claim_folder(output: Path, settings: Settings, force: bool = False) -> None:
    """Make a folder this run's; what is in it already stays.

    Parameters
    ----------
    output : Path
        Made where it is missing.
    settings : Settings
    force : bool
        Even where `check_folder` refuses it.

    Raises
    ------
    ValueError
        If another run has taken it since it was checked.
    """
    (output / SCANS).mkdir(parents=True, exist_ok=True)
    manifest = {"format": FORMAT, "form": VERSION, "settings": settings.record()}
    with written_atomically(output / RUN) as temporary:
        temporary.write_text(json.dumps(manifest, indent=1), encoding="utf-8")
        try:
            # Of two that begin together one is first: a name is not linked twice.
            os.link(temporary, output / RUN)
        except FileExistsError:
            if not force:
                check_folder(output, settings)
        except OSError:
            # Some disks know no links: the last one has it there.
            pass


def is_run(folder: Path) -> bool:
    """Tell whether a folder holds the results of a run."""
    # Not Path's own, which raises where nobody may look into the folder.
    return os.path.isfile(folder / RUN)


def _settings_of(output: Path) -> dict[str, Any]:
    """Return the settings of the run that a folder holds.

    Raises
    ------
    ValueError
        If its file is damaged, or of a newer version.
    """
    file = output / RUN
    try:
        told = json.loads(file.read_text("utf-8"))
        known = told["format"] == FORMAT and told["form"] <= VERSION
        settings: dict[str, Any] = dict(told["settings"])
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{file} is damaged: remove it, or choose another folder") from error
    if not known:
        raise ValueError(f"{file} was written by a newer napari-unpack: update it")
    return settings


def _said(value: Any) -> str:
    return "not given" if value is None else str(value)
