"""Recordings that are not part of the project: in ELLIPTUDE_DATASETS or ../shared/datasets."""

import os
from pathlib import Path

import pytest

_NAMED = os.environ.get("ELLIPTUDE_DATASETS")
_FOLDERS = [Path(_NAMED)] if _NAMED else [folder / "shared" / "datasets" for folder in Path(__file__).resolve().parents]
FOLDER = next((folder for folder in _FOLDERS if folder.is_dir()), None)

needs_datasets = pytest.mark.skipif(FOLDER is None, reason="no datasets: ELLIPTUDE_DATASETS may name their folder")


def broad(trial):
    (path,) = (FOLDER / "broad").glob(f"{trial}_*.npz")
    return path


def xio():
    return FOLDER / "xio-fusion-example" / "sensor_data.csv.gz"


def fermi():
    return FOLDER / "fermi-gbm-poshist" / "glg_poshist_151013_excerpt.csv.gz"
